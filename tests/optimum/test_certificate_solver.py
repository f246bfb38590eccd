"""A solver that lies, or a number that is missing, must not be certified: each check against its sabotage."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from kiteocp import load_problem
from kiteocp.cli.main import main
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.optimum import certificate as certify
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import Optimum, optimise
from kiteocp.optimum.search import cycle_solver, solver_options
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem, shipped_problems

Sabotage = Callable[[Solver, Solution], Solution]


@pytest.fixture(scope="module")
def strong_wind() -> Problem:
    return load_problem("strong-wind")


def sabotaged(monkeypatch: pytest.MonkeyPatch, sabotage: Sabotage) -> None:
    """Let every solver return something else than it found."""
    honest = Solver.solve

    def solve(self: Solver, *arguments: object, **options: object) -> Solution:
        return sabotage(self, honest(self, *arguments, **options))  # type: ignore[arg-type]

    monkeypatch.setattr(Solver, "solve", solve)


def failures(optimum: Optimum) -> set[str]:
    return {check.name for check in optimum.certificate.failures}


@pytest.mark.parametrize("level", ["quick", "full"])
@pytest.mark.parametrize("name", shipped_problems())
def test_shipped_problems_are_certified(name: str, level: certify.Level) -> None:
    optimum = optimise(load_problem(name), certificate=level)
    assert optimum.certificate.status == "certified", optimum.certificate.message
    assert optimum.certificate.message == ""
    names = {check.name for check in optimum.certificate.checks}
    expected = {"solver", "optimality", "objective", "limits", "re-simulation", "starts", "speed jumps"}
    assert names == (expected | {"mesh"} if level == "full" else expected)


def moved(solver: Solver, solution: Solution) -> Solution:
    """Return another x: the durations 0.1 % longer, all rows as they were."""
    x = solution.x.copy()
    x[solver.program.find_variables(kind="duration")] *= 1.001
    return replace(solution, x=x)


def without_multipliers(_: Solver, solution: Solution) -> Solution:
    return replace(solution, lam_g=np.zeros_like(solution.lam_g))


def scaled_multipliers(_: Solver, solution: Solution) -> Solution:
    return replace(solution, lam_g=1.01 * solution.lam_g, lam_x=1.01 * solution.lam_x)


def negative_multipliers(_: Solver, solution: Solution) -> Solution:
    return replace(solution, lam_g=-solution.lam_g, lam_x=-solution.lam_x)


def flattered(_: Solver, solution: Solution) -> Solution:
    """Claim a larger power than that of the variables."""
    return replace(solution, f=1.02 * solution.f)


@pytest.mark.parametrize("sabotage", [moved, without_multipliers, scaled_multipliers, negative_multipliers, flattered])
def test_a_solver_that_lies_fails_the_optimality_check(
    sabotage: Sabotage, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    sabotaged(monkeypatch, sabotage)
    optimum = optimise(strong_wind, certificate="quick")
    assert "optimality" in failures(optimum)
    assert optimum.certificate.status == "not_certified"
    assert "the check of optimality failed" in optimum.certificate.message


@pytest.mark.parametrize("iterations", [1, 4, 8])
def test_a_point_that_has_not_converged_is_not_certified_whatever_the_solver_says(
    iterations: int, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    sabotaged(monkeypatch, lambda _, solution: replace(solution, success=True, status="Solve_Succeeded"))
    unfinished = strong_wind.with_values({"optimisation.max_iterations": iterations})
    assert "optimality" in failures(optimise(unfinished, certificate="quick"))


@pytest.mark.parametrize("hides_the_pin", [False, True])
def test_a_feasible_cycle_that_is_not_optimal_fails_only_the_optimality_check(
    hides_the_pin: bool, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = Solver.solve

    def pinned(self: Solver, x0: object, p: np.ndarray, **_: object) -> Solution:
        [index] = self.program.find_variables(phase="traction", kind="duration")
        solution = honest(self, x0, p, pinned={int(index): 35.0 / self.program.variables[index].scale})  # type: ignore[arg-type]
        lam_x = solution.lam_x.copy()
        lam_x[index] *= not hides_the_pin
        return replace(solution, lam_x=lam_x)

    monkeypatch.setattr(Solver, "solve", pinned)
    assert failures(optimise(strong_wind, certificate="quick")) == {"optimality"}


def test_the_solver_that_admits_failure_is_not_certified(strong_wind: Problem) -> None:
    values, formulation = parameter_values(strong_wind), Formulation.of(strong_wind)
    solver = cycle_solver(values.structure, formulation, solver_options(strong_wind))
    solution = optimise(strong_wind, certificate="quick").solution
    failed = replace(solver.solve(solution.x, values.vector), success=False, status="Maximum_Iterations_Exceeded")
    check = certify.solver_check(failed)
    assert check.passed is False
    assert "Maximum_Iterations_Exceeded" in check.text


# What a file may hold and the solution of "strong-wind" runs into once it is tightened: a limit of each kind.
TIGHTER = {
    "limits.reel_in_speed_max_m_s": 6.5,
    "limits.reel_out_speed_max_m_s": 8.0,
    "limits.height_max_m": 310.0,
    "limits.tether_length_min_m": 410.0,
    "limits.tether_length_max_m": 700.0,
    "limits.elevation_max_deg": 65.0,
    "limits.traction_elevation_min_deg": 25.0,
    "limits.traction_elevation_max_deg": 23.5,
    "limits.traction_duration_min_s": 42.0,
    "limits.generator_power_max_W": 20e3,
    "limits.motor_power_max_W": 6e3,
    "limits.stroke_min_m": 300.0,
}


def solved_for(monkeypatch: pytest.MonkeyPatch, problem: Problem, key: str, number: float, *, owns_up: bool) -> None:
    """Give every solver another number than that of the problem; it may sign with the right one."""
    honest, index = Solver.solve, parameter_values(problem).structure.keys.index(key)

    def solve(self: Solver, x0: object, p: np.ndarray, **options: object) -> Solution:
        other = p.copy()
        other[index] = number
        solution = honest(self, x0, other, **options)  # type: ignore[arg-type]
        return solution if owns_up else replace(solution, p=p)

    monkeypatch.setattr(Solver, "solve", solve)


@pytest.mark.parametrize("key", TIGHTER)
def test_a_solution_for_other_limits_fails_the_check_of_the_limit(
    key: str, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Limits that the file does not have are secretly far away.
    loose = 1e5 if key.endswith("_W") else 50.0 if key == "limits.stroke_min_m" else parameter_values(strong_wind)[key]
    tight = strong_wind.with_values({key: TIGHTER[key]})
    solved_for(monkeypatch, tight, key, loose, owns_up=False)
    optimum = optimise(tight, certificate="quick")
    assert "limits" in failures(optimum)
    assert key in optimum.certificate.message


@pytest.mark.parametrize(
    ("key", "number"), [("limits.tether_force_max_N", 2950.0), ("limits.tether_force_min_N", 780.0)]
)
def test_a_solution_for_other_forces_fails_the_re_simulation(
    key: str, number: float, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The winch holds a scheduled force beyond the limit at the limit, and the cycle is then another one."""
    tight = strong_wind.with_values({key: number})
    solved_for(monkeypatch, tight, key, parameter_values(strong_wind)[key], owns_up=False)
    assert {"optimality", "re-simulation"} <= failures(optimise(tight, certificate="quick"))


# Neither bounds anything nor is flown: only the optimum depends on the first, and all of the flight on the second.
@pytest.mark.parametrize(
    ("key", "number"), [("limits.phase_change_time_s", 0.5), ("environment.wind.reference_speed_m_s", 9.95)]
)
def test_a_solution_for_other_numbers_is_not_certified(
    key: str, number: float, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved_for(monkeypatch, strong_wind, key, number, owns_up=True)
    assert "the solution belongs to other numbers" in optimise(strong_wind, certificate="quick").certificate.message


@pytest.mark.parametrize("what", ["x", "lam_x", "lam_g", "f"])
def test_no_number_of_the_solution_may_be_missing(
    what: str, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def poisoned(_: Solver, solution: Solution) -> Solution:
        if what == "f":
            return replace(solution, f=float("nan"))
        numbers = getattr(solution, what).copy()
        numbers[numbers.size // 2] = np.nan
        return replace(solution, **{what: numbers})

    sabotaged(monkeypatch, poisoned)
    optimum = optimise(strong_wind, certificate="quick")
    assert optimum.certificate.status == "not_certified"
    assert "optimality" in failures(optimum)


@pytest.mark.parametrize("kind", ["state", "algebraic", "control", "duration", "static"])
def test_no_variable_of_the_solution_may_be_missing(
    kind: str, strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def poisoned(solver: Solver, solution: Solution) -> Solution:
        x = solution.x.copy()
        x[solver.program.find_variables(kind=kind)[-1]] = np.nan
        return replace(solution, x=x)

    sabotaged(monkeypatch, poisoned)
    assert optimise(strong_wind, certificate="quick").certificate.status == "not_certified"


def test_jumps_that_the_winch_cannot_do_fail_where_the_problem_forbids_them(
    strong_wind: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycle = optimise(strong_wind, certificate="quick").cycle
    assert certify.jumps_check(cycle, limited=False).passed is None
    assert certify.jumps_check(cycle, limited=True).passed is False
    # A winch quick enough for the jumps to fit, not so quick that they fit by themselves.
    limited = strong_wind.with_values(
        {"optimisation.speed_jumps": "limited", "limits.reeling_acceleration_max_m_s2": 4.5}
    )
    assert "speed jumps" not in failures(optimise(limited, certificate="quick"))
    honest = Formulation.of
    monkeypatch.setattr(Formulation, "of", lambda problem: replace(honest(problem), speed_jumps="free"))
    assert failures(optimise(limited, certificate="quick")) == {"speed jumps"}


def test_a_missing_speed_cannot_hide_among_the_jumps(strong_wind: Problem) -> None:
    cycle = optimise(strong_wind, certificate="quick").cycle
    for index in range(3):
        records = list(cycle.records)
        outputs = np.full_like(records[index].outputs, np.nan)
        records[index] = replace(records[index], outputs=outputs)
        broken = OptimalCycle(cycle.values, cycle.trajectory, cycle.schedules, tuple(records))
        assert certify.jumps_check(broken, limited=True).passed is False
        assert certify.limits_check(certify.limit_margins(broken, [])).passed is False


def test_the_program_says_so_and_exits_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sabotaged(monkeypatch, moved)
    assert main(["solve", "strong-wind", "--no-plot", "--certificate", "quick", "-o", str(tmp_path)]) == 1
    printed = capsys.readouterr()
    assert "not_certified" in printed.err
    assert "the check of optimality failed" in printed.err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["status"] == "not_certified"
    assert "optimality" in summary["certificate"]["failures"]


def test_numbers_that_are_missing_are_saved_as_null(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def poisoned(_: Solver, solution: Solution) -> Solution:
        return replace(solution, lam_g=np.full_like(solution.lam_g, np.nan))

    sabotaged(monkeypatch, poisoned)
    assert main(["solve", "strong-wind", "--no-plot", "--certificate", "quick", "-o", str(tmp_path)]) == 1
    text = (tmp_path / "summary.json").read_text()
    assert "NaN" not in text
    assert "Infinity" not in text
