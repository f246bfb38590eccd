"""Cost of the optimal cycle in process, for every shipped problem: building the program, solving it, certifying it."""

from __future__ import annotations

import numpy as np

import kiteocp
from benchmarks.caches import clear_caches
from benchmarks.family import WIND_KEY
from benchmarks.neighbours import designs
from benchmarks.timing import Line, time_call
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import optimise
from kiteocp.optimum.search import cycle_solver, solver_options
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

SOLVER_TARGET_S = 15e-3

#: Random designs whose optima are found one after the other, and what each may take.
DESIGNS = 60
NEIGHBOUR_TARGET_S, CERTIFIED_NEIGHBOUR_TARGET_S = 6e-3, 10e-3

#: A power curve: winds at the reference height, m/s.
CURVE_WINDS, CURVE_TARGET_S = np.linspace(5.0, 17.0, 25), 0.4


def lines(repeats: int) -> list[Line]:
    """Measure build and solve of the shipped problems, and of their neighbours."""
    alone = [line for name in kiteocp.shipped_problems() for line in _problem_lines(name, repeats)]
    return [*alone, *_many_lines(repeats)]


def _many_lines(repeats: int) -> list[Line]:
    """Measure many optima at once, functions built."""
    problems = designs(kiteocp.load_problem("strong-wind"), DESIGNS)
    curve = [kiteocp.load_problem("v3-kite").with_values({WIND_KEY: float(wind)}) for wind in CURVE_WINDS]
    kiteocp.solve_many([*problems[:2], *curve[:2]])
    group, times = "many optima (solve_many)", {}
    for level in ("none", "quick"):
        once = [time_call(lambda: kiteocp.solve_many(problems, certificate=level)) for _ in range(repeats)]  # noqa: B023
        times[level] = tuple(time / DESIGNS for time in once)
    winds = tuple(time_call(lambda: kiteocp.solve_many(curve)) for _ in range(repeats))
    return [
        Line(group, "each of 60 designs, no certificate", times["none"], target=NEIGHBOUR_TARGET_S),
        Line(group, "each of 60 designs, quick certificate", times["quick"], target=CERTIFIED_NEIGHBOUR_TARGET_S),
        Line(group, "25 winds, quick certificate", winds, target=CURVE_TARGET_S),
    ]


def _problem_lines(name: str, repeats: int) -> list[Line]:
    problem = kiteocp.load_problem(name)
    group = f"optimum of {name}"
    build = Line(group, "build", tuple(_build_time(problem) for _ in range(repeats)))
    kiteocp.solve(problem)
    one_start, starts, quick, full = [], [], [], []
    for _ in range(repeats):
        result = kiteocp.solve(problem, certificate="quick")
        one_start.append(result.details["starts"][0]["time_s"])
        quick.append(time_call(lambda: kiteocp.solve(problem, certificate="quick")))
        full.append(time_call(lambda: kiteocp.solve(problem)))
        starts.append(kiteocp.solve(problem).details["solver"]["starts_time_s"])
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
    values = parameter_values(problem)
    neighbour = optimise(problem.with_values({WIND_KEY: 0.99 * values[WIND_KEY]}), certificate="quick")
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
