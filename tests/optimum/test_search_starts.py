"""One start is enough for a quick certificate; a full one has a second opinion, and so has what gives a reason."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from kiteocp import load_problem
from kiteocp.errors import InfeasibleError
from kiteocp.ocp.nlpsolver import STOPPED, Solution, Solver
from kiteocp.optimum import search as searching
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import optimise
from kiteocp.optimum.search import HARD
from kiteocp.optimum.starts import STARTS
from kiteocp.physics.parameters import parameter_values

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


def test_where_no_explanation_is_asked_for_the_verdict_comes_without(monkeypatch: pytest.MonkeyPatch) -> None:
    from kiteocp.optimum import infeasibility  # noqa: PLC0415

    def asked(*_arguments: Any) -> Any:
        raise AssertionError("the limits in conflict were looked for")

    monkeypatch.setattr(infeasibility._Search, "smallest_conflict", asked)
    hopeless = load_problem("v3-kite").with_values(
        {"limits.reel_in_speed_max_m_s": 2.0, "limits.tether_force_min_N": 3000.0}
    )
    with pytest.raises(InfeasibleError, match="no cycle keeps all limits") as error:
        optimise(hopeless, certificate="quick", explained=False)
    assert error.value.explanation["elastic_sum"] > 0.1
    with pytest.raises(AssertionError, match="looked for"):
        optimise(hopeless, certificate="quick")


def test_a_start_that_takes_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "PATIENCE", 10)
    problem = load_problem("v3-kite")
    solver = searching.cycle_solver(
        parameter_values(problem).structure, Formulation.of(problem), searching.solver_options(problem)
    )
    attempts = list(searching.attempts_from_starts(solver, parameter_values(problem)))
    assert {attempt.solution.status for attempt in attempts} == {STOPPED}
    assert not any(attempt.solution.success for attempt in attempts)
    # The next solution is as patient as ever.
    monkeypatch.undo()
    assert next(searching.attempts_from_starts(solver, parameter_values(problem))).solution.success
