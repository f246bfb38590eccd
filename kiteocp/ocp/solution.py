"""The optimal pumping cycle of a problem: from starts to a result."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from kiteocp.cycle.simulation import simulate
from kiteocp.cycle.summary import channels_of, cycle_summary, phase_summaries, validity_warnings
from kiteocp.errors import CycleError, SolveError
from kiteocp.ocp.formulation import Formulation, cycle_program
from kiteocp.ocp.limits import SCALES
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.optimum import OptimalCycle, active_limits, speed_jumps
from kiteocp.ocp.starts import STARTS, guess_of
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.problem import Problem
from kiteocp.result import Result


@dataclass(frozen=True)
class Attempt:
    """A solution from one start."""

    start: str
    solution: Solution


def solve(problem: Problem) -> Result:
    """Find the pumping cycle of largest mean power under the limits of a problem.

    Every start of `STARTS` is tried and the best cycle kept.

    Parameters
    ----------
    problem
        The problem; its ``limits`` bound the cycle, its ``optimisation`` block says what is free.

    Returns
    -------
    Result
        With status ``ok``; ``prescribed`` is the forward simulation of the same problem, its mean power on equal terms
        (the same phase-change time), or None where the prescribed cycle cannot be flown.

    Raises
    ------
    SolveError
        No start led to a cycle.
    """
    began = time.perf_counter()
    values = parameter_values(problem)
    solver = cycle_solver(values.structure, Formulation.of(problem), _options(problem))
    built = time.perf_counter()
    attempts = solve_from_starts(solver, values)
    solved = time.perf_counter()
    best = best_of(attempts)
    cycle = OptimalCycle.of(solver.program, best.solution, values)
    warnings = [*validity_warnings(cycle.records, values), *jump_warnings(cycle)]
    phases = phase_summaries(cycle.records)
    pause = values["limits.phase_change_time_s"]
    traction = cycle.records[-1]
    return Result(
        verb="solve",
        problem=problem,
        status="ok",
        warnings=tuple(warnings),
        phases=phases,
        cycle=dict(
            cycle_summary(
                values,
                phases,
                # eq:meantractionaltitude with the lengths and the mean elevation that were flown.
                traction_altitude_m=float(
                    0.5
                    * (traction.tether_length_m[0] + traction.tether_length_m[-1])
                    * np.sin(np.trapezoid(traction.elevation_rad, traction.time_s) / traction.duration_s)
                ),
                phase_change_time_s=pause,
            )
        ),
        channels=channels_of(cycle.records, values, pause),
        details={
            "solver": {
                "name": "ipopt",
                "status": best.solution.status,
                "iterations": best.solution.iterations,
                "time_s": solved - built,
                "build_time_s": built - began,
                "starts": len(attempts),
                "start": best.start,
                "variables": len(solver.program.variables),
                "rows": len(solver.program.rows),
            },
            "starts": [
                {
                    "start": attempt.start,
                    "status": attempt.solution.status,
                    "mean_power_W": _mean_power(attempt.solution),
                    "iterations": attempt.solution.iterations,
                    "time_s": attempt.solution.time_s,
                }
                for attempt in attempts
            ],
            "active_limits": active_limits(cycle),
            "speed_jumps": speed_jumps(cycle.records, values),
            "resimulation": resimulation(cycle),
        },
        prescribed=prescribed_cycle(problem),
    )


@lru_cache(maxsize=16)
def cycle_solver(structure: Structure, formulation: Formulation, options: tuple[tuple[str, Any], ...] = ()) -> Solver:
    """Build (once) the solver of a structure, for any numbers."""
    return Solver(cycle_program(structure, formulation), dict(options))


def _options(problem: Problem) -> tuple[tuple[str, Any], ...]:
    given = problem.optimisation
    return (("tol", given.tolerance), ("max_iter", given.max_iterations))


def solve_from_starts(solver: Solver, values: ParameterValues) -> list[Attempt]:
    """Solve from every start."""
    program: NonlinearProgram = solver.program
    return [
        Attempt(start.name, solver.solve(program.pack(guess_of(start, values, program)), values.vector))
        for start in STARTS
    ]


def best_of(attempts: list[Attempt]) -> Attempt:
    """Return the attempt of largest mean power among those that succeeded.

    Raises
    ------
    SolveError
        None did.
    """
    succeeded = [attempt for attempt in attempts if attempt.solution.success]
    if not succeeded:
        states = ", ".join(f"{attempt.solution.status} from a {attempt.start}" for attempt in attempts)
        raise SolveError(f"no start led to a cycle within the limits (IPOPT: {states})")
    return min(succeeded, key=lambda attempt: attempt.solution.f)


def _mean_power(solution: Solution) -> float | None:
    return -solution.f * SCALES["power"] if solution.success else None


def resimulation(cycle: OptimalCycle) -> dict[str, Any]:
    """Fly the optimal schedules by the independent integrator and compare energy, tether length and elevation."""
    try:
        flown = cycle.resimulate()
    except CycleError as error:
        return {"completed": False, "message": str(error)}
    energy = sum(phase.energy_J for phase in flown)
    last = cycle.records[-1]
    transition = cycle.records[1]
    return {
        "completed": True,
        "energy_J": energy,
        "energy_gap": (energy - cycle.energy_J) / cycle.energy_J,
        "tether_length_gap_m": float(flown[-1].states[-1, 1] - last.tether_length_m[-1]),
        "elevation_gap_deg": float(np.degrees(flown[1].states[-1, 2] - transition.elevation_rad[-1])),
    }


def jump_warnings(cycle: OptimalCycle) -> list[str]:
    """Say where the winch needs longer for a change of speed between phases than the phase-change time gives it."""
    return [
        f"Between {jump['from_phase']} and {jump['to_phase']} the reeling speed changes by {jump['jump_m_s']:.1f} m/s, "
        f"more than the winch can do in limits.phase_change_time_s ({jump['allowed_m_s']:g} m/s)."
        for jump in speed_jumps(cycle.records, cycle.values)
        if abs(jump["jump_m_s"]) > jump["allowed_m_s"] * (1 + 1e-6)
    ]


def prescribed_cycle(problem: Problem) -> Result | None:
    """Simulate the prescribed cycle of the same problem, with the optimum's phase-change time in its means."""
    try:
        return simulate(problem, phase_change_time_s=problem.limits.phase_change_time_s)
    except CycleError:
        return None
