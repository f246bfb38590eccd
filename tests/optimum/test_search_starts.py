"""One start is enough for a quick certificate; a full one has a second opinion, and so has what gives a reason."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from kiteocp import load_problem
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.optimum import search as searching
from kiteocp.optimum.refine import optimise
from kiteocp.optimum.search import HARD
from kiteocp.optimum.starts import STARTS

ALL = [start.name for start in STARTS] + ["shortest traction"]


def starts_of(certificate: Any) -> list[str]:
    return [attempt.start for attempt in optimise(load_problem("v3-kite"), certificate=certificate).attempts]


def test_a_quick_certificate_starts_once_and_a_full_one_from_everywhere() -> None:
    assert starts_of("quick") == ALL[:1]
    assert starts_of("full") == ALL


@pytest.mark.parametrize("change", [{"success": False}, {"iterations": HARD + 1}], ids=["failed", "hard"])
def test_a_start_that_fails_or_has_a_hard_time_is_not_the_only_one(
    change: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    solve, calls = Solver.solve, []

    def first_is_changed(solver: Solver, *arguments: Any, **options: Any) -> Solution:
        calls.append(solver)
        solution = solve(solver, *arguments, **options)
        return msgspec.structs.replace(solution, **change) if len(calls) == 1 else solution

    monkeypatch.setattr(Solver, "solve", first_is_changed)
    # The second start has no reason for a third.
    assert starts_of("quick") == ALL[:2]


def test_more_freedom_asks_the_optimum_of_less_too() -> None:
    free = load_problem("v3-kite", {"optimisation": {"traction_elevation": "linear"}})
    attempts = optimise(free, certificate="quick").attempts
    assert [attempt.start for attempt in attempts] == [ALL[0], "optimum of less freedom"]
    assert searching.best_of(attempts).mean_power_W == max(attempt.mean_power_W or 0.0 for attempt in attempts)
