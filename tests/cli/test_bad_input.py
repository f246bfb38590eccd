"""Whatever a user gives: one printable sentence of sensible length, in time, and never an internal error."""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from made_flight import kitepower_rows, made_flight, write_csv

import kiteocp
from kiteocp.cli.main import main
from kiteocp.errors import InputError, one_sentence, printable, shortened
from kiteocp.problem.files import read_source
from kiteocp.problem.reading import VALUE_LIMIT, parse
from kiteocp.recording.columns import load_columns

STRONG = kiteocp.shipped_problems()["strong-wind"].read_text()


def lists_of_lists(name: str = "a", levels: int = 9) -> str:
    """Return aliases of aliases, ten times as many values in every line."""
    lines = [f"{name}0: &{name}0 [1]"]
    lines += [f"{name}{k}: &{name}{k} [{', '.join([f'*{name}{k - 1}'] * 10)}]" for k in range(1, levels)]
    return "\n".join(lines) + "\n"


BOMBS = {
    "lists": lists_of_lists(),
    "maps": "m0: &m0 {k: 1}\n" + "".join(f"m{k}: &m{k} {{l: *m{k - 1}, r: *m{k - 1}}}\n" for k in range(1, 31)),
    "merge": "x0: &x0 {k: 1}\n"
    + "".join(f"x{k}: &x{k} {{<<: [{', '.join([f'*x{k - 1}'] * 9)}]}}\n" for k in range(1, 9)),
    "wide": f"a: &a [{', '.join(['1'] * 2000)}]\nb: [{', '.join(['*a'] * 2000)}]\n",
}  # fmt: skip


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the one sentence with which a command is refused."""
    began = time.monotonic()
    assert main(list(words)) == 2
    assert time.monotonic() - began < 10.0
    error = capsys.readouterr().err
    assert error.startswith("kiteocp: ")
    assert error.count("\n") == 1
    assert error[:-1].isprintable()
    assert len(error) < 2100
    assert "internal error" not in error
    return error


@pytest.mark.parametrize("name", list(BOMBS))
def test_aliases_that_multiply_are_refused_at_once(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("bomb.yaml").write_text(BOMBS[name])
    began = time.monotonic()
    assert "bomb.yaml" in refused(capsys, "check", "bomb.yaml")
    with pytest.raises(InputError, match="values, those behind aliases"):
        load_columns("bomb.yaml")
    assert time.monotonic() - began < 5.0


def test_aliases_that_multiply_are_refused_in_an_override(capsys: pytest.CaptureFixture[str]) -> None:
    levels = ", ".join(f"&a{k} [{', '.join([f'*a{k - 1}'] * 10) if k else 1}]" for k in range(9))
    assert "aliases" in refused(capsys, "check", "strong-wind", "--set", f"environment.wind.heights_m=[{levels}]")


def test_aliases_that_save_writing_are_read() -> None:
    text = STRONG.replace("powered: {lift", "powered: &same {lift", 1)
    start = text.index("  depowered:")
    text = text[:start] + "  depowered: *same\n" + text[text.index("\n", start) + 1 :]
    Path("alias.yaml").write_text(text)
    problem = kiteocp.load_problem("alias.yaml")
    assert problem.kite.depowered == problem.kite.powered
    read, _ = parse(f"[{', '.join(['1'] * (VALUE_LIMIT - 1))}]", "text")
    assert len(read) == VALUE_LIMIT - 1


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 3000, "- " * 20_000, "a: " + "[" * 60 + "]" * 60])
def test_deep_nesting_is_one_message_whatever_the_parser_says(text: str) -> None:
    with pytest.raises(InputError, match="nested too deeply"):
        parse(text, "text")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_pipes_are_not_waited_for(capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo("pipe.yaml")
    os.mkfifo("summary.json")
    assert "pipe" in refused(capsys, "check", "pipe.yaml")
    assert "pipe" in refused(capsys, "estimate", "pipe.yaml", "--system", "v9-kite")
    assert "pipe" in refused(capsys, "plot", ".")
    assert "device" in refused(capsys, "check", "/dev/null")


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="no process substitution here")
def test_a_pipe_that_is_written_to_is_read() -> None:
    command = f"{sys.executable} -m kiteocp check <(sleep 0.5; cat {kiteocp.shipped_problems()['v3-kite']})"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    with pytest.raises(InputError, match="no such file"):
        read_source(Path("nothing"), "nothing", 10)


@pytest.mark.parametrize(
    "words",
    [
        ("check", "x" * 400),
        ("check", "x" * 400 + ".yaml"),
        ("check", "~nouser/x.yaml"),
        ("check", "a\0b.yaml"),
        ("estimate", "~nouser/x.csv", "--system", "v9-kite"),
        ("estimate", "x" * 400 + ".csv", "--system", "v9-kite"),
        ("estimate", "a\0b.csv", "--system", "v9-kite"),
        ("plot", "x" * 400),
        ("plot", "~nouser"),
        ("new", "mine", "-o", "x" * 400 + ".yaml"),
        ("new", "x" * 400),
        ("new", "mine", "-o", "/dev/null/mine.yaml"),
        ("check", "strong-wind", "--set", f"environment.wind.heights_m[{'9' * 5000}]=3"),
        ("check", "strong-wind", "--set", "k" * 100_000 + "=3"),
        ("check", "strong-wind", "--set", "description=[" + "x " * 50_000),
        ("check", "strong-wind", "--set", "kite.mass_kg=\x1b[31m3"),
        ("check", "\x1b[31m.yaml"),
        ("\x1b[2J" + "v" * 100_000,),
        ("check", "strong-wind", "--" + "o" * 100_000),
        ("simulate", "strong-wind", "--time-step", "1e-300"),
        ("simulate", "strong-wind", "--time-step", "1e-7"),
    ],
    ids=lambda words: " ".join(words)[:40].encode("unicode_escape").decode(),
)
def test_bad_arguments_are_one_sentence(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, *words)


def test_a_map_with_a_name_that_is_too_long_is_missing() -> None:
    for path in ("x" * 400 + ".yaml", "~nouser/map.yaml"):
        with pytest.raises(InputError, match="no such column map"):
            load_columns(path)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become nobody and back")
def test_folders_that_may_not_be_entered(capsys: pytest.CaptureFixture[str]) -> None:
    os.mkdir("locked", 0o700)
    os.seteuid(65534)
    try:
        refused(capsys, "new", "mine", "-o", "locked/mine.yaml")
        refused(capsys, "check", "locked/mine.yaml")
        with pytest.raises(InputError):
            load_columns("locked/map.yaml")
    finally:
        os.seteuid(0)


def test_files_with_long_or_unprintable_texts(capsys: pytest.CaptureFixture[str]) -> None:
    for text in (
        "k" * 100_000 + ": 1\n",
        f"name: {'n' * 100_000}\n",
        '"\\e[31m": 1\n',
        '"a\\0b": 1\n"a\\0b": 2\n',
        "? [a, b]\n: 1\n",
        STRONG.replace("kite: ", "kite: \u202e", 1).replace("projected_area_m2", "\\u0007"),
    ):
        Path("odd.yaml").write_text(text)
        refused(capsys, "check", "odd.yaml")


def test_a_description_cannot_command_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    Path("odd.yaml").write_text(STRONG.replace("source: van", 'source: "\\e]0;title\\a"\n#', 1))
    assert main(["simulate", "odd.yaml", "--no-plot", "--json"]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert json.loads(out)["input"]["source"] == "\x1b]0;title\x07"


def test_texts_for_people() -> None:
    assert printable("a\x1b\0\u202eb\x9b", keep="\n") == "a\\u001b\\u0000\\u202eb\\u009b"
    assert printable("a\nb", keep="\n") == "a\nb"
    assert json.loads(printable('"\U000e0001"')) == "\U000e0001"
    assert shortened("x" * 100, 20) == "x" * 12 + "..." + "x" * 5
    assert len(one_sentence("word " * 50_000)) <= 2000
    assert one_sentence("kite m\u00e4ssig\n is") == "kite m\u00e4ssig is"


def test_a_flight_named_with_a_line_break_writes_no_live_key() -> None:
    name = "flight\nlimits: {tether_force_max_N: 1}\n\x1b[31m"
    rows = kitepower_rows(made_flight())
    path = Path(f"{name}.csv")
    write_csv(path, rows)
    assert main(["estimate", str(path), "--system", "v9-kite", "-o", "out", "--no-plot"]) == 0
    content = yaml.safe_load(Path("out/estimated.yaml").read_text())
    assert content["limits"]["tether_force_max_N"] == kiteocp.load_problem("v9-kite").limits.tether_force_max_N
    assert all(line.startswith("#") for line in Path("out/estimated.yaml").read_text().splitlines()[:3])
    assert "\x1b" not in Path("out/estimated.yaml").read_text()


def test_words_of_the_api_are_checked() -> None:
    problem = kiteocp.load_problem("v3-kite")
    place = {"tether_length_m": 300.0, "elevation_deg": 30.0, "reeling_factor": 0.2}
    flight = made_flight()
    for call in (
        lambda: kiteocp.solve(problem, certificate="Full"),  # type: ignore[arg-type]
        lambda: kiteocp.solve(problem, certificate=None),  # type: ignore[arg-type]
        lambda: kiteocp.simulate(problem, equilibrium="closed"),  # type: ignore[arg-type]
        lambda: kiteocp.flight_state(problem, setting="Powered", **place),  # type: ignore[arg-type]
        lambda: kiteocp.crosswind(problem, "figure-8"),
        lambda: kiteocp.representative_course(problem, "Circle"),
        lambda: kiteocp.estimate(flight, kiteocp.load_problem("v9-kite"), wind="lidar"),  # type: ignore[arg-type]
    ):
        with pytest.raises(InputError, match="it must be"):
            call()


def test_the_origin_of_a_problem_cannot_be_changed() -> None:
    problem = kiteocp.load_problem("strong-wind")
    problem.origin.given["kite"]["mass_kg"] = 999.0
    assert problem.origin.given["kite"]["mass_kg"] == 15.0
    assert problem.with_values({"tether.diameter_m": 0.005}).kite.mass_kg == 15.0


@pytest.fixture(scope="module")
def simulated_result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("simulated")
    kiteocp.simulate(kiteocp.load_problem("v3-kite")).save(directory)
    return directory


def _summary_with(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    def spoil(directory: Path) -> None:
        path = directory / "summary.json"
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))

    return spoil


def _rows_of_csv(keep: Callable[[list[list[str]]], list[list[str]]]) -> Callable[[Path], None]:
    def spoil(directory: Path) -> None:
        path = directory / "timeseries.csv"
        rows = [line.split(",") for line in path.read_text().splitlines()]
        path.write_text("".join(",".join(row) + "\n" for row in keep(rows)))

    return spoil


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_summary_with(lambda s: s["cycle"].update(energy_J={})), "energy_J of cycle is no number"),
        (_summary_with(lambda s: s["phases"]["traction"].update(energy_J=[1])), "energy_J of traction is no number"),
        (_rows_of_csv(lambda rows: [row[:2] + row[3:] for row in rows]), "no channel 'tether_length_m'"),
        (_rows_of_csv(lambda rows: rows[:1]), "fewer than two rows"),
        (_rows_of_csv(lambda rows: rows[:2]), "fewer than two rows"),
        (_summary_with(lambda s: s.update(active_limits={"traction": [{"share": 0.5}]})), "is not a complete result"),
    ],
)
def test_a_spoilt_result_is_not_drawn_and_says_why(
    simulated_result: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    spoil: Callable[[Path], None],
    words: str,
) -> None:
    directory = tmp_path / "spoilt"
    shutil.copytree(simulated_result, directory)
    spoil(directory)
    assert main(["plot", str(directory)]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not list(directory.glob("*.png"))


def test_plots_need_no_import_of_their_own() -> None:
    code = "import kiteocp, sys; assert 'matplotlib' not in sys.modules; kiteocp.plots.draw"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize("degree", range(1, 10))
def test_every_declared_mesh_degree_solves(degree: int) -> None:
    """The power of all agrees; one Radau point is of first order, and honest about its error."""
    result = kiteocp.solve(kiteocp.load_problem("v3-kite", {"optimisation.mesh.degree": degree}))
    assert result.status == ("certified" if degree > 1 else "not_certified")
    assert result.cycle["mean_power_W"] == pytest.approx(6251.52, rel=1e-4 if degree > 1 else 2e-3)
    assert all(isinstance(count, int) for mesh in result.details["meshes"] for count in mesh["intervals"])


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"kite.mass_kg": -1.0}, "kite.mass_kg is -1 kg; it must be greater than 0 kg"),
        ({"kite.mass_kg": [15.0, -1.0]}, r"kite.mass_kg\[1\] is -1 kg"),
        ({"machine.motor_efficiency": [0.9, 90.0]}, r"motor_efficiency\[1\] is 90; it must be at most 1"),
        ({"operation.traction.elevation_deg": [30.0, 90.0]}, "must be less than 90 deg"),
        ({"operation.tether_length_min_m": [390.0, 800.0]}, r"problem \[1\]: operation.tether_length_min_m \(800\)"),
        ({"environment.wind.roughness_length_m": [0.07, 7.0]}, "not less than the reference height"),
    ],
)
def test_a_batch_is_checked_as_a_file_is(parameters: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        kiteocp.simulate_batch(kiteocp.load_problem("strong-wind"), parameters)  # type: ignore[arg-type]


def test_the_entries_of_a_wind_table_are_checked_in_a_batch() -> None:
    table = {"profile": "table", "heights_m": [0, 200, 800], "speeds_m_s": [8, 16, 18]}
    problem = kiteocp.load_problem("strong-wind", {"environment.wind": table})
    assert kiteocp.simulate_batch(problem, {"environment.wind.speeds_m_s[1]": np.linspace(15, 16, 5)}).flown.all()
    for key, value in (("speeds_m_s[1]", -1.0), ("heights_m[1]", 900.0)):
        with pytest.raises(InputError, match=key.partition("[")[0]):
            kiteocp.simulate_batch(problem, {f"environment.wind.{key}": [9.0, value]})


def test_mutated_files_and_overrides_get_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    """Bytes and lines of a problem file cut, doubled, swapped and replaced, with a fixed seed."""
    draw = random.Random(7)
    pieces = [b"\x00", b"\x1b[31m", b"&a ", b"*a", b"<<: ", b"[", b"}", b"? ", b"!!int ", b"1e999", b"\xff", b"|\n"]
    source = STRONG.encode()
    for _ in range(300):
        content = bytearray(source)
        for _ in range(draw.randint(1, 4)):
            at = draw.randrange(len(content))
            end = min(len(content), at + draw.randint(0, 30))
            content[at:end] = draw.choice([b"", draw.choice(pieces), bytes(content[at:end]) * 2])
        Path("mutated.yaml").write_bytes(bytes(content))
        status = main(["check", "mutated.yaml"])
        out, error = capsys.readouterr()
        assert status in (0, 2)
        assert error.count("\n") == (status == 2)
        assert "internal error" not in error
        assert "\x1b" not in out + error
    with contextlib.suppress(FileNotFoundError):
        os.remove("mutated.yaml")
