"""What a long calculation tells of how far it is."""

from __future__ import annotations

import pytest

from kiteocp.cli import progress as module
from kiteocp.cli.progress import FEWEST, Progress


def test_the_time_left_is_estimated_without_what_is_done_once_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    with Progress("values solved") as told:
        # The first takes 60 s, in which the solver is built; those after it 20 s each.
        for done in range(1, 12):
            now = 60.0 + 20.0 * (done - 1)
            told(done, 101)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 11
    assert all(line == f"{done} of 101 values solved" for done, line in enumerate(lines[:FEWEST], start=1))
    assert lines[FEWEST] == f"{FEWEST + 1} of 101 values solved, about {20 * (100 - FEWEST)} s left"
    assert lines[10].endswith("about 1800 s left")
