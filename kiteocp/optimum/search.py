"""The search for the best cycle on one mesh: starts, the way from less freedom, and the rescue where they all fail."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import msgspec

from kiteocp.errors import InfeasibleError, SolveError
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.optimum.program import Formulation, cycle_program, deferred_rows
from kiteocp.optimum.starts import STARTS, enriched, guess_of, pinned_start, rescue_starts
from kiteocp.physics.parameters import ParameterValues, Structure
from kiteocp.problem import Problem

#: Iterations from a start beyond which its optimum is compared with those of others: twice the usual number (median 29
#: over `benchmarks.family`). What takes longer comes from far away, or wanders between several optima.
HARD = 60

#: Sum of relative relaxations below which the elastic program alone does not decide that there is no cycle.
NEARLY_FEASIBLE = 0.02


class Attempt(msgspec.Struct, frozen=True):
    """A solution from one start.

    Attributes
    ----------
    start
        Its name.
    solver, solution
        What solved the cycle from there, and the result.
    """

    start: str
    solver: Solver
    solution: Solution

    @property
    def mean_power_W(self) -> float | None:
        """Mean power of the objective, None where the solver failed."""
        return float(self.solver.program.in_units(self.solution.f)) if self.solution.success else None


def search(
    values: ParameterValues,
    formulation: Formulation,
    options: tuple[tuple[str, Any], ...],
    *,
    second_opinion: bool = True,
) -> list[Attempt]:
    """Solve from several starts; where none succeeds, find out why, and try again where there is hope.

    Parameters
    ----------
    values, formulation, options
        The problem, its mesh included, and IPOPT options.
    second_opinion
        Solve from all starts. Without it the first of them is enough, unless it fails or has a hard time.

    Returns
    -------
    list of Attempt
        At least one of them succeeded, or `best_of` says so.

    Raises
    ------
    InfeasibleError
        No start led to a cycle, and limits are in conflict.
    """
    solver = cycle_solver(values.structure, formulation, options)
    attempts = solve_from_starts(solver, values, second_opinion=second_opinion)
    if formulation != formulation.plain():
        attempts += _from_less_freedom(solver, values, formulation, options, second_opinion)
    if not any(attempt.solution.success for attempt in attempts):
        attempts += _rescue(solver, values, formulation)
    return attempts


@lru_cache(maxsize=32)
def cycle_solver(structure: Structure, formulation: Formulation, options: tuple[tuple[str, Any], ...] = ()) -> Solver:
    """Build (once) the solver of a structure, for any numbers."""
    program = cycle_program(structure, formulation)
    return Solver(program, dict(options), deferred=deferred_rows(program, structure))


def solver_options(problem: Problem) -> tuple[tuple[str, Any], ...]:
    """IPOPT options that a problem file sets."""
    given = problem.optimisation
    return (("tol", given.tolerance), ("max_iter", given.max_iterations))


def solve_from_starts(solver: Solver, values: ParameterValues, *, second_opinion: bool = True) -> list[Attempt]:
    """Solve from every start, and from a shortest traction that is solved first and then released."""
    program = solver.program
    attempts = []
    for start in STARTS:
        solution = solver.solve(program.pack(guess_of(start, values, program)), values.vector)
        attempts.append(Attempt(start.name, solver, solution))
        if not second_opinion and solution.success and solution.iterations <= HARD:
            return attempts
    guess, pinned = pinned_start(values, program)
    held = solver.solve(program.pack(guess), values.vector, pinned=pinned)
    released = solver.solve(held.x, values.vector) if held.success else held
    attempts.append(Attempt("shortest traction", solver, released))
    return attempts


def _from_less_freedom(
    solver: Solver,
    values: ParameterValues,
    formulation: Formulation,
    options: tuple[tuple[str, Any], ...],
    second_opinion: bool,
) -> list[Attempt]:
    """Go on from the optimum of constant elevation and fixed power setting: more freedom must not lose against it."""
    plain = cycle_solver(values.structure, formulation.plain(), options)
    found = solve_from_starts(plain, values, second_opinion=second_opinion)
    succeeded = [attempt.solution for attempt in found if attempt.solution.success]
    if not succeeded:
        return []
    best = min(succeeded, key=lambda solution: solution.f)
    guess = enriched(plain.program.unpack(best.x, values.vector), values, solver.program)
    solution = solver.solve(solver.program.pack(guess), values.vector, near=True)
    return [Attempt("optimum of less freedom", solver, solution)]


def _rescue(solver: Solver, values: ParameterValues, formulation: Formulation) -> list[Attempt]:
    """Ask the elastic program why nothing was found; go on from its cycle where no limit had to move.

    Where the limits had to move very little only, random starts have the last word.

    Raises
    ------
    InfeasibleError
        Limits are in conflict.
    """
    # Imported where it is needed, which is seldom: `kiteocp solve` starts sooner without.
    from kiteocp.cycle.weight import uncarried_weight  # noqa: PLC0415
    from kiteocp.optimum.infeasibility import explain  # noqa: PLC0415
    from kiteocp.optimum.relaxations import penalised_optimum  # noqa: PLC0415

    program = solver.program
    weight = uncarried_weight(values, formulation.power_setting)
    if weight is not None:
        raise InfeasibleError(weight.sentence, weight.to_dict())
    found = explain(values, formulation)
    if found.start is not None:
        attempt = Attempt("elastic", solver, solver.solve(program.pack(found.start), values.vector))
        if not attempt.solution.success:
            # At the edge of feasibility IPOPT may see no feasible point where it stands on one.
            crude = (guess_of(start, values, program) for start in (*STARTS, *rescue_starts()))
            penalised = penalised_optimum(values, formulation, (found.start, *crude))
            if penalised is not None:
                solution = solver.solve(penalised.x, values.vector, warm=penalised)
                attempt = Attempt("exact penalty", solver, solution)
        if attempt.solution.success:
            return [attempt]
    if found.elastic_sum is not None and found.elastic_sum < NEARLY_FEASIBLE:
        for start in rescue_starts():
            solution = solver.solve(program.pack(guess_of(start, values, program)), values.vector)
            attempt = Attempt(start.name, solver, solution)
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
