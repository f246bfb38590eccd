"""Cost of the optimal cycle in process, for every shipped problem: building the program, solving it, certifying it."""

from __future__ import annotations

from statistics import median

import kiteocp
from benchmarks.caches import clear_caches
from benchmarks.timing import Line, time_call
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import optimise
from kiteocp.optimum.search import cycle_solver, solver_options
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

SOLVER_TARGET_S = 5e-3


def lines(repeats: int) -> list[Line]:
    """Measure build and solve of the shipped problems."""
    return [line for name in kiteocp.shipped_problems() for line in _problem_lines(name, repeats)]


def _problem_lines(name: str, repeats: int) -> list[Line]:
    problem = kiteocp.load_problem(name)
    group = f"optimum of {name}"
    build = Line(group, "build", tuple(_build_time(problem) for _ in range(repeats)))
    kiteocp.solve(problem)
    one_start, starts, quick, full = [], [], [], []
    for _ in range(repeats):
        result = kiteocp.solve(problem, certificate="quick")
        # What the solver takes does not depend on where it starts from best: the median over the starts.
        one_start.append(median(start["time_s"] for start in result.details["starts"]))
        starts.append(result.details["solver"]["starts_time_s"])
        quick.append(time_call(lambda: kiteocp.solve(problem, certificate="quick")))
        full.append(time_call(lambda: kiteocp.solve(problem)))
    return [
        build,
        Line(group, "solver, one start", tuple(one_start), target=SOLVER_TARGET_S),
        Line(group, "solver, warm, from 1 % less wind", _warm_times(problem, repeats), relative_to="solver, one start"),
        Line(group, "solver, all starts", tuple(starts), relative_to="solver, one start"),
        Line(group, "solve, quick certificate", tuple(quick), relative_to="solver, one start"),
        Line(group, "solve, full certificate", tuple(full), relative_to="solver, one start"),
    ]


def _warm_times(problem: Problem, repeats: int) -> tuple[float, ...]:
    """Time of the solver from the optimum of a neighbour, as in sweeps, s."""
    key = "environment.wind.reference_speed_m_s"
    values = parameter_values(problem)
    neighbour = optimise(problem.with_values({key: 0.99 * values[key]}), certificate="quick")
    times = []
    for _ in range(repeats + 1):
        solution = neighbour.solver.solve(neighbour.solution.x, values.vector, warm=neighbour.solution)
        times.append(solution.time_s)
    # The first call builds the solver.
    return tuple(times[1:])


def _build_time(problem: Problem) -> float:
    """Time from a loaded problem to a solver that takes any numbers of its structure, s."""
    clear_caches()
    return time_call(
        lambda: cycle_solver(parameter_values(problem).structure, Formulation.of(problem), solver_options(problem))
    )
