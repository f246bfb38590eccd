"""Real signals at many instants of the long verbs: one sentence, exit status 130, what was reached saved, at once."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from made_flight import kitepower_rows, made_flight, write_csv

from kiteocp.cli import list as list_problems
from kiteocp.cli.main import main

VERBS = {
    "solve": ["solve", "v3-kite"],
    "simulate": ["simulate", "strong-wind"],
    "sensitivity": ["sensitivity", "strong-wind"],
    "vary": ["sensitivity", "strong-wind", "--no-intervals", "--vary", "kite.mass_kg=10:20:100"],
    "global": ["sensitivity", "strong-wind", "--no-intervals", "--global", "--samples", "500", "--jobs", "2"],
    "crosswind": ["crosswind", "strong-wind"],
    "validate": ["validate", "--format", "png"],
    "estimate": ["estimate", "FLIGHT", "--system", "v9-kite"],
    "validate-flight": ["validate", "FLIGHT", "--system", "v9-kite"],
}

#: Until Python has started and hears Ctrl-C by kiteocp's rules; a start takes 0.1 s here.
STARTED_S = 0.35

#: The promise is a second; what else the machine does, and the end of the interpreter, come on top.
LATENCY_S = 3.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_csv(tmp_path_factory.mktemp("flight") / "flight.csv", kitepower_rows(made_flight()))


def interrupted_at(
    seconds: float, words: list[str], directory: Path, number: int = signal.SIGINT
) -> tuple[int, str, float] | None:
    """Send the signal to the whole process group, as a terminal does; None where the verb was done before."""
    process = subprocess.Popen(
        [sys.executable, "-m", "kiteocp", *words, "-o", str(directory)],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    time.sleep(seconds)
    if process.poll() is not None:
        process.communicate()
        return None
    os.killpg(process.pid, number)
    sent = time.monotonic()
    try:
        _, error = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise
    return process.returncode, error, time.monotonic() - sent


def check(words: list[str], seconds: float, directory: Path) -> bool:
    """Interrupt a verb and check what it leaves; False where it was done before."""
    ended = interrupted_at(seconds, words, directory)
    if ended is None:
        return False
    status, error, latency = ended
    *progress, last = error.splitlines() or [""]
    assert status in {0, 130}, error
    assert latency < LATENCY_S
    assert all(" of " in line for line in progress), error
    if status == 130:
        assert last.startswith("kiteocp: interrupted"), error
    assert not list(directory.glob(".*"))
    if (directory / "summary.json").exists():
        summary = json.loads((directory / "summary.json").read_text())
        assert summary["status"] in {"ok", "certified", "interrupted", "not_certified"}
    if " saved in " in last:
        assert (directory / "summary.json").exists()
    return True


def words_of(name: str, flight: Path) -> list[str]:
    return [str(flight) if word == "FLIGHT" else word for word in VERBS[name]]


@pytest.mark.parametrize("name", VERBS)
def test_ctrl_c_ends_every_verb_at_once(name: str, tmp_path: Path, flight: Path) -> None:
    for index, seconds in enumerate((STARTED_S, 0.9)):
        check(words_of(name, flight), seconds, tmp_path / str(index))


@pytest.mark.slow
@pytest.mark.parametrize("name", VERBS)
def test_ctrl_c_at_thirty_instants(name: str, tmp_path: Path, flight: Path) -> None:
    words = words_of(name, flight)
    began = time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "kiteocp", *words, "-o", str(tmp_path / "whole")],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    whole = time.monotonic() - began
    heard = [check(words, STARTED_S + (whole - STARTED_S) * index / 30, tmp_path / str(index)) for index in range(30)]
    # Else the test would have tested nothing; the last instants may come after the end.
    assert sum(heard) >= 10


def test_sigterm_is_said_too(tmp_path: Path) -> None:
    ended = interrupted_at(0.8, VERBS["vary"], tmp_path / "out", signal.SIGTERM)
    assert ended is not None
    assert ended[0] == 143
    assert ended[1].startswith("kiteocp: terminated")


@pytest.mark.parametrize(("name", "table"), [("vary", "variation.csv"), ("global", "global.csv")])
def test_finished_points_are_saved(name: str, table: str, tmp_path: Path) -> None:
    words = [*VERBS[name]]
    words[4:5] = ["kite.mass_kg=10:20:1000"] if name == "vary" else words[4:5]
    if name == "global":
        words[words.index("500")] = "100000"
    # Later and later until there are some: how long building takes is the machine's affair.
    for seconds in (4.0, 8.0, 16.0):
        directory = tmp_path / str(seconds)
        ended = interrupted_at(seconds, words, directory)
        assert ended is not None
        assert ended[0] == 130
        rows = []
        if (directory / table).exists():
            with (directory / table).open(newline="") as stream:
                rows = list(csv.DictReader(stream))
        if rows:
            break
    assert rows
    assert {row["status"] for row in rows} <= {"certified", "solved"}
    assert json.loads((directory / "summary.json").read_text())["status"] == "interrupted"


def test_an_error_that_an_interruption_leaves_behind_is_the_interruption(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A library that calls Python from C may lose the exception, and fails later for want of what was not done."""

    def run(_arguments: object) -> int:
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)
        raise ValueError("Invalid bounding box")

    monkeypatch.setattr(list_problems, "run", run)
    assert main(["list"]) == 130
    assert capsys.readouterr().err == "kiteocp: interrupted\n"
