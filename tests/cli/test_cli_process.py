"""The command line in a process of its own: start-up, streams, and the real calculations."""

from __future__ import annotations

import importlib.metadata
import json
import signal
import subprocess
import sys

import pytest

HEAVY = ("numpy", "scipy", "casadi", "matplotlib")
#: What a help page or a version needs none of.
READING = ("msgspec", "yaml", "dataclasses", "difflib", "hashlib", "tempfile")
#: What a calculation without a picture needs none of.
DRAWING = ("matplotlib", "scipy", "PIL", "numpy.ma", "importlib.metadata", "multiprocessing")


def run(*words, cwd=None, **options):
    command = [sys.executable, "-m", "kiteocp", *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120, check=False, **options)


def loaded_by(code, names=HEAVY, cwd=None):
    program = f"{code}\nimport sys\nprint('\\n' + ' '.join(name for name in {names} if name in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True, cwd=cwd
    )
    return done.stdout.splitlines()[-1].split()


def loaded_by_command(*words, names=HEAVY, cwd=None):
    return loaded_by(f"from kiteocp.cli.main import main; main({list(words)})", names, cwd)


def test_help_and_import_load_no_heavy_package():
    assert loaded_by_command("--help") == []
    assert loaded_by("import kiteocp; kiteocp.__version__; kiteocp.load_problem('strong-wind')") == []


@pytest.mark.parametrize(
    "words", [["--help"], ["--version"], ["solve", "--help"], ["new", "--help"], ["solve", "strong-wind", "--jsn"]]
)
def test_what_reads_no_problem_loads_nothing_to_read_one(words):
    # A mistake may look for what was meant.
    names = [name for name in (*HEAVY, *READING) if name != "difflib" or "--jsn" not in words]
    assert loaded_by_command(*words, names=names) == []


@pytest.mark.parametrize("words", [["list"], ["schema"], ["new", "mine"], ["check", "nonsense"], ["solve", "nonsense"]])
def test_a_verb_without_numbers_loads_no_numpy(words, tmp_path):
    assert loaded_by_command(*words, cwd=tmp_path) == []


def test_a_calculation_without_a_picture_loads_nothing_to_draw(tmp_path):
    words = ["solve", "strong-wind", "--no-plot", "--certificate", "quick"]
    assert loaded_by_command(*words, names=DRAWING, cwd=tmp_path) == []


def test_public_names_are_there_and_others_are_not():
    import kiteocp  # noqa: PLC0415

    assert set(kiteocp.__all__) <= set(dir(kiteocp))
    assert all(getattr(kiteocp, name) is not None for name in kiteocp.__all__)
    assert kiteocp.__version__ == importlib.metadata.version("kiteocp")
    assert kiteocp.InputError is kiteocp.errors.InputError
    with pytest.raises(AttributeError, match="has no attribute 'simulat'"):
        _ = kiteocp.simulat


def test_version():
    assert run("--version").stdout == f"kiteocp {importlib.metadata.version('kiteocp')}\n"


def test_simulate_end_to_end(tmp_path):
    done = run("simulate", "strong-wind", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    directory = tmp_path / "results" / "strong-wind" / "simulate"
    summary = json.loads((directory / "summary.json").read_text())
    assert {"python", "casadi", "numpy"} <= summary["versions"].keys()
    assert summary["status"] == "ok"
    assert summary["cycle"]["mean_power_W"] > 0.0
    assert (directory / "cycle.png").stat().st_size > 20_000
    assert run("plot", str(directory), "--format", "svg").returncode == 0


def test_solve_end_to_end(tmp_path):
    done = run("solve", "strong-wind", "-o", "out", "--no-plot", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["cycle"]["mean_power_W"] > summary["prescribed"]["cycle"]["mean_power_W"]
    assert set(summary["prescribed"]["cycle"]) >= {"duration_s", "mean_power_W", "energy_J"}
    assert "active limits" in done.stdout


def test_a_reader_that_leaves_is_no_error(tmp_path):
    command = f"{sys.executable} -m kiteocp schema | head -c 1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_full_standard_output_is_one_sentence():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "kiteocp", "schema"],
            stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "kiteocp: standard output: cannot be written (No space left on device)\n"


def test_a_terminal_without_unicode_shows_what_it_can():
    words = ("check", "strong-wind", "--set", "kite.mässig=1")
    done = run(*words, env={"PYTHONIOENCODING": "ascii", "LC_ALL": "C.UTF-8"})
    assert done.returncode == 2
    assert "kite.m?ssig" in done.stderr or r"kite.m\xe4ssig" in done.stderr
    assert done.stderr.count("\n") == 1


def test_ctrl_c_is_one_line_and_status_130(tmp_path):
    # Waits for its own signal inside a verb, so that the moment of the interruption is certain.
    program = (
        "import os, signal, sys, kiteocp.cycle\n"
        "kiteocp.cycle.simulate = lambda *a, **k: os.kill(os.getpid(), signal.SIGINT) or __import__('time').sleep(9)\n"
        "from kiteocp.cli.main import main\n"
        "sys.exit(main(['simulate', 'strong-wind']))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, cwd=tmp_path, check=False
    )
    assert done.returncode == 128 + signal.SIGINT
    directory = "results/strong-wind/simulate"
    assert done.stderr == f"kiteocp: interrupted; nothing was reached yet, as the summary in {directory} says\n"
    assert json.loads((tmp_path / directory / "summary.json").read_text())["status"] == "interrupted"
