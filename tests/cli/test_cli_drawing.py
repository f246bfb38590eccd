"""Pictures drawn by a copy of the process: the same files, words and exit statuses as without one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a process is copied on Linux only")

HEAD = """
import errno, os, signal, sys, time
from kiteocp import forked
from kiteocp.cli import drawing
from kiteocp.cli.main import main
"""
ALONE = "forked._is_safe = lambda: False\n"
#: What `main` is called with, and what it leaves.
TAIL = """
status = main()
print("loaded:", *(name for name in ("matplotlib",) if name in sys.modules))
try:
    print(os.waitpid(-1, os.WNOHANG))
except ChildProcessError:
    print("no process left")
sys.exit(status)
"""


def run(preparation: str, *words: str, directory: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", HEAD + preparation + TAIL, *words],
        capture_output=True, text=True, timeout=120, check=False, cwd=directory,
    )  # fmt: skip


def pictures(directory: Path) -> dict[str, bytes]:
    assert not list(directory.rglob(".*"))
    return {path.name: path.read_bytes() for path in directory.rglob("*") if path.suffix in {".png", ".svg", ".pdf"}}


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "strong-wind"],
        ["solve", "strong-wind", "--certificate", "quick", "--format", "svg", "--format", "pdf"],
        ["sensitivity", "strong-wind", "--no-intervals"],
    ],
    ids=["simulate", "solve", "sensitivity"],
)
def test_the_same_pictures_as_without_a_copy(words: list[str], tmp_path: Path) -> None:
    both = []
    for name, preparation in (("apart", ""), ("alone", ALONE)):
        directory = tmp_path / name
        directory.mkdir()
        done = run(preparation, *words, directory=directory)
        assert (done.returncode, done.stderr) == (0, "")
        loaded, left = done.stdout.splitlines()[-2:]
        assert loaded == ("loaded:" if name == "apart" else "loaded: matplotlib")
        assert left == "no process left"
        both.append(pictures(directory))
    assert both[0]
    assert both[0] == both[1]


def outcome(preparation: str, directory: Path) -> tuple[int, str, str, dict[str, bytes]]:
    directory.mkdir()
    done = run(preparation, "simulate", "strong-wind", directory=directory)
    told, _, left = done.stdout.rpartition("loaded:")
    assert left.splitlines()[-1] == "no process left"
    assert (directory / "results/strong-wind/simulate/summary.json").exists()
    return done.returncode, told, done.stderr, pictures(directory)


@pytest.mark.parametrize(
    ("trouble", "status", "said"),
    [
        ("drawing._make_ready = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n", 0, ""),
        ("drawing._make_ready = lambda *_: 1 / 0\n", 0, ""),
        ("drawing._drawn = lambda *_: os.kill(os.getpid(), signal.SIGTERM)\n", 0, ""),
        (
            # In both processes, and not before the copy is made: NumPy would come along.
            "def fail(_): raise ValueError('no ink')\n"
            "def spoil():\n    from kiteocp.plots import pictures\n    pictures.composer = lambda *_: fail\n"
            "drawing._make_ready = lambda *_: spoil()\nfork = drawing.fork\n"
            "def fork_and_spoil(*of):\n    found = fork(*of)\n    spoil()\n    return found\n"
            "drawing.fork = fork_and_spoil\n",
            1,
            "kiteocp: internal error (ValueError: no ink)",
        ),
        (
            "real = os.replace\ndef replace(source, target):\n"
            "    if str(target).endswith('.png'): raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))\n"
            "    real(source, target)\nos.replace = replace\n",
            2,
            "cycle.png: cannot be written (No space left on device)",
        ),
    ],
    ids=["killed", "not ready", "ended", "failing", "full disk"],
)
def test_trouble_is_what_it_is_without_a_copy(trouble: str, status: int, said: str, tmp_path: Path) -> None:
    apart = outcome(trouble, tmp_path / "apart")
    alone = outcome(ALONE + trouble, tmp_path / "alone")
    assert apart == alone
    assert apart[0] == status
    assert said in apart[2]
    assert bool(apart[3]) == (status == 0)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interruption_while_it_draws_leaves_no_process(number: int, status: int, tmp_path: Path) -> None:
    preparation = "def endless(*_):\n    open('drawing', 'w').close()\n    time.sleep(60)\ndrawing._drawn = endless\n"
    process = subprocess.Popen(
        [sys.executable, "-c", HEAD + preparation + "sys.exit(main())", "simulate", "strong-wind"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True, cwd=tmp_path,
    )  # fmt: skip
    until = time.monotonic() + 60.0
    while not (tmp_path / "drawing").exists():
        assert time.monotonic() < until
        time.sleep(0.02)
    time.sleep(0.1)
    if number == signal.SIGINT:
        # The key of a terminal reaches all processes of the group.
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    _, error = process.communicate(timeout=10)
    assert process.returncode == status
    word = "interrupted" if number == signal.SIGINT else "terminated"
    assert error == f"kiteocp: {word}; the numbers are saved in results/strong-wind/simulate\n"
    assert pictures(tmp_path) == {}
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
