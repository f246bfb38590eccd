"""The optimal pumping cycle of a problem: from starts through certified solutions to a result."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from kiteocp.cycle.simulation import simulate
from kiteocp.cycle.summary import channels_of, cycle_summary, phase_summaries, validity_warnings
from kiteocp.errors import CycleError, InfeasibleError, SolveError
from kiteocp.ocp import certificate as certify
from kiteocp.ocp.certificate import Certificate, Level
from kiteocp.ocp.formulation import Formulation, cycle_program, deferred_rows
from kiteocp.ocp.infeasibility import explain
from kiteocp.ocp.limits import SCALES
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.optimum import OptimalCycle, active_limits, speed_jumps
from kiteocp.ocp.reliefs import penalised_optimum
from kiteocp.ocp.starts import STARTS, enriched, guess_of, pinned_start, rescue_starts
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.problem import Problem
from kiteocp.result import Result

#: Sum of relative relaxations below which the elastic program alone does not decide that there is no cycle.
NEARLY_FEASIBLE = 0.02

#: Times that the full certificate halves the mesh at most, and the collocation points that it goes up to.
REFINEMENTS = 4
MOST_POINTS = 450


@dataclass(frozen=True)
class Attempt:
    """A solution from one start."""

    start: str
    solution: Solution

    @property
    def mean_power_W(self) -> float | None:
        """Mean power of the objective, None where the solver failed."""
        return -self.solution.f * SCALES["power"] if self.solution.success else None


@dataclass(frozen=True)
class Optimum:
    """An optimal cycle with all that is known about it.

    Attributes
    ----------
    problem, values
        What was solved.
    solver
        The solver of the mesh that the solution is on.
    attempts
        Solutions from all starts on the coarsest mesh.
    solution
        The best, on the finest mesh.
    cycle
        The solution in the words of the cycle.
    certificate
        Its checks.
    facts
        Numbers behind the checks: limit margins, re-simulation, mesh powers.
    """

    problem: Problem
    values: ParameterValues
    solver: Solver
    attempts: tuple[Attempt, ...]
    solution: Solution
    cycle: OptimalCycle
    certificate: Certificate
    facts: dict[str, Any]

    @property
    def mean_power_W(self) -> float:
        """Mean power of the objective."""
        return -self.solution.f * SCALES["power"]


def solve(problem: Problem, *, certificate: Level = "full") -> Result:
    """Find the pumping cycle of largest mean power under the limits of a problem.

    Parameters
    ----------
    problem
        The problem; its ``limits`` bound the cycle, its ``optimisation`` block says what is free.
    certificate
        ``full`` refines the mesh until the optimal power no longer changes by more than 1e-4; ``quick`` judges the
        solution on the mesh of the problem file.

    Returns
    -------
    Result
        With status ``certified``, or ``not_certified`` and the failed checks in ``details["certificate"]``;
        ``prescribed`` is the forward simulation of the same problem, its mean power on equal terms (the same
        phase-change time), or None where the prescribed cycle cannot be flown.

    Raises
    ------
    InfeasibleError
        No start led to a cycle, and limits are in conflict.
    SolveError
        No start led to a cycle, for no reason that could be found.
    """
    began = time.perf_counter()
    return result_of(optimise(problem, certificate=certificate), time.perf_counter() - began)


def optimise(problem: Problem, *, certificate: Level = "full") -> Optimum:
    """Find and certify the optimal cycle; `solve` without the result's time series.

    Raises
    ------
    InfeasibleError, SolveError
        As `solve`.
    """
    values = parameter_values(problem)
    formulation = Formulation.of(problem)
    options = solver_options(problem)
    solver = cycle_solver(values.structure, formulation, options)
    attempts = solve_from_starts(solver, values)
    if formulation != formulation.plain():
        attempts += _from_less_freedom(solver, values, formulation, options)
    if not any(attempt.solution.success for attempt in attempts):
        attempts += _rescue(solver, values, formulation)
    solution = best_of(attempts).solution
    powers, meshes = [-solution.f * SCALES["power"]], [str(formulation.intervals)]
    optimum = None
    for _ in range(REFINEMENTS if certificate == "full" else 0):
        formulation = formulation.refined()
        if formulation.points > MOST_POINTS:
            break
        finer = cycle_solver(values.structure, formulation, options)
        start = finer.program.pack(solver.program.unpack(solution.x, values.vector))
        refined = finer.solve(start, values.vector, near=True)
        if not refined.success:
            refined = finer.solve(start, values.vector)
        if not refined.success:
            break
        solver, solution = finer, refined
        powers.append(-solution.f * SCALES["power"])
        meshes.append(str(formulation.intervals))
        optimum = _judged(problem, values, solver, attempts, solution, powers, meshes, certificate)
        if optimum.certificate.passed:
            break
    return optimum or _judged(problem, values, solver, attempts, solution, powers, meshes, certificate)


def _judged(
    problem: Problem,
    values: ParameterValues,
    solver: Solver,
    attempts: Sequence[Attempt],
    solution: Solution,
    powers: Sequence[float],
    meshes: Sequence[str],
    level: Level,
) -> Optimum:
    """Read a solution and run all checks on it."""
    cycle = OptimalCycle.of(solver.program, solution, values)
    resimulation, flown, facts = certify.resimulation_check(cycle)
    margins = certify.limit_margins(cycle, flown)
    checks = [
        certify.solver_check(solution),
        certify.kkt_check(solver.program, solution),
        certify.limits_check(margins),
        resimulation,
    ]
    if level == "full":
        checks.append(certify.mesh_check(powers, meshes))
    checks.append(certify.starts_check([attempt.mean_power_W for attempt in attempts]))
    checks.append(certify.jumps_check(cycle, problem.optimisation.speed_jumps == "limited"))
    return Optimum(
        problem,
        values,
        solver,
        tuple(attempts),
        solution,
        cycle,
        Certificate(level, tuple(checks)),
        {
            "resimulation": facts,
            "limit_margins": {item.key: {"phase": item.phase, "margin": item.margin} for item in margins},
            "meshes": [
                {"intervals": mesh, "mean_power_W": power} for mesh, power in zip(meshes, powers, strict=True)
            ],
        },
    )


@lru_cache(maxsize=32)
def cycle_solver(structure: Structure, formulation: Formulation, options: tuple[tuple[str, Any], ...] = ()) -> Solver:
    """Build (once) the solver of a structure, for any numbers."""
    program = cycle_program(structure, formulation)
    return Solver(program, dict(options), deferred=deferred_rows(program))


def solver_options(problem: Problem) -> tuple[tuple[str, Any], ...]:
    """IPOPT options that a problem file sets."""
    given = problem.optimisation
    return (("tol", given.tolerance), ("max_iter", given.max_iterations))


def solve_from_starts(solver: Solver, values: ParameterValues) -> list[Attempt]:
    """Solve from every start, and from a shortest traction that is solved first and then released."""
    program = solver.program
    attempts = [
        Attempt(start.name, solver.solve(program.pack(guess_of(start, values, program)), values.vector))
        for start in STARTS
    ]
    guess, pinned = pinned_start(values, program)
    held = solver.solve(program.pack(guess), values.vector, pinned=pinned)
    released = solver.solve(held.x, values.vector) if held.success else held
    attempts.append(Attempt("shortest traction", released))
    return attempts


def _from_less_freedom(
    solver: Solver, values: ParameterValues, formulation: Formulation, options: tuple[tuple[str, Any], ...]
) -> list[Attempt]:
    """Go on from the optimum of constant elevation and fixed power setting: more freedom must not lose against it."""
    plain = cycle_solver(values.structure, formulation.plain(), options)
    succeeded = [attempt.solution for attempt in solve_from_starts(plain, values) if attempt.solution.success]
    if not succeeded:
        return []
    best = min(succeeded, key=lambda solution: solution.f)
    guess = enriched(plain.program.unpack(best.x, values.vector), values, solver.program)
    return [Attempt("optimum of less freedom", solver.solve(solver.program.pack(guess), values.vector, near=True))]


def _rescue(solver: Solver, values: ParameterValues, formulation: Formulation) -> list[Attempt]:
    """Ask the elastic program why nothing was found; go on from its cycle where no limit had to move.

    Where the limits had to move very little only, random starts have the last word.

    Raises
    ------
    InfeasibleError
        Limits are in conflict.
    """
    program = solver.program
    found = explain(values, formulation)
    if found.start is not None:
        attempt = Attempt("elastic", solver.solve(program.pack(found.start), values.vector))
        if not attempt.solution.success:
            # At the edge of feasibility IPOPT may see no feasible point where it stands on one.
            penalised = penalised_optimum(values, formulation, found.start)
            if penalised is not None:
                attempt = Attempt("exact penalty", solver.solve(penalised.x, values.vector, warm=penalised))
        if attempt.solution.success:
            return [attempt]
    if found.elastic_sum is not None and found.elastic_sum < NEARLY_FEASIBLE:
        for start in rescue_starts():
            attempt = Attempt(start.name, solver.solve(program.pack(guess_of(start, values, program)), values.vector))
            if attempt.solution.success:
                return [attempt]
    raise InfeasibleError(found.sentence, found.to_dict())


def best_of(attempts: Sequence[Attempt]) -> Attempt:
    """Return the attempt of largest mean power among those that succeeded.

    Raises
    ------
    SolveError
        None did.
    """
    succeeded = [attempt for attempt in attempts if attempt.solution.success]
    if not succeeded:
        states = ", ".join(f"{attempt.solution.status} from the start '{attempt.start}'" for attempt in attempts)
        raise SolveError(f"no start led to a cycle within the limits (IPOPT: {states})")
    return min(succeeded, key=lambda attempt: attempt.solution.f)


def result_of(optimum: Optimum, total_time_s: float) -> Result:
    """Put an optimum into the form of the output contract."""
    cycle, values, problem = optimum.cycle, optimum.values, optimum.problem
    phases = phase_summaries(cycle.records)
    pause = values["limits.phase_change_time_s"]
    traction = cycle.records[-1]
    mean_elevation = float(np.trapezoid(traction.elevation_rad, traction.time_s)) / traction.duration_s
    # eq:meantractionaltitude with the lengths and the mean elevation that were flown.
    altitude = 0.5 * float(traction.tether_length_m[0] + traction.tether_length_m[-1]) * float(np.sin(mean_elevation))
    summary = cycle_summary(values, phases, traction_altitude_m=altitude, phase_change_time_s=pause)
    solver_time = sum(attempt.solution.time_s for attempt in optimum.attempts)
    best = best_of(optimum.attempts)
    return Result(
        verb="solve",
        problem=problem,
        status=optimum.certificate.status,
        warnings=tuple([*validity_warnings(cycle.records, values), *jump_warnings(cycle)]),
        phases=phases,
        cycle=dict(summary),
        channels=channels_of(cycle.records, values, pause),
        details={
            "solver": {
                "name": "ipopt",
                "status": optimum.solution.status,
                "iterations": best.solution.iterations,
                "time_s": best.solution.time_s,
                "starts_time_s": solver_time,
                "total_time_s": total_time_s,
                "starts": len(optimum.attempts),
                "start": best.start,
                "variables": len(optimum.solver.program.variables),
                "rows": len(optimum.solver.program.rows),
            },
            "certificate": optimum.certificate.to_dict(),
            **({} if optimum.certificate.passed else {"message": optimum.certificate.message}),
            "starts": [
                {
                    "start": attempt.start,
                    "status": attempt.solution.status,
                    "mean_power_W": attempt.mean_power_W,
                    "iterations": attempt.solution.iterations,
                    "time_s": attempt.solution.time_s,
                }
                for attempt in optimum.attempts
            ],
            "active_limits": active_limits(cycle),
            "speed_jumps": speed_jumps(cycle.records, values),
            **optimum.facts,
        },
        prescribed=prescribed_cycle(problem),
    )


def jump_warnings(cycle: OptimalCycle) -> list[str]:
    """Say where the winch needs longer for a change of speed between phases than the phase-change time gives it."""
    return [
        f"from {jump['from_phase']} to {jump['to_phase']} the reeling speed jumps by {jump['jump_m_s']:+.1f} m/s, "
        f"more than the winch can do in limits.phase_change_time_s ({jump['allowed_m_s']:g} m/s); "
        "optimisation.speed_jumps: limited keeps to that"
        for jump in speed_jumps(cycle.records, cycle.values)
        if abs(jump["jump_m_s"]) > jump["allowed_m_s"] * (1 + 1e-6)
    ]


def prescribed_cycle(problem: Problem) -> Result | None:
    """Simulate the prescribed cycle of the same problem, with the optimum's phase-change time in its means."""
    try:
        return simulate(problem, phase_change_time_s=problem.limits.phase_change_time_s)
    except CycleError:
        return None
