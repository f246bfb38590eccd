"""The search for the best cycle on one mesh: starts, the way from less freedom, and the rescue where they all fail."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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

#: Iterations after which a start is given up. Of 332 problems with a cycle three took more from every start (up to
#: 304); where no cycle is found the elastic program and the starts without this limit have the last word.
PATIENCE = 150

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
    explained: bool = True,
) -> list[Attempt]:
    """Solve from several starts; where none succeeds, find out why, and try again where there is hope.

    Parameters
    ----------
    values, formulation, options
        The problem, its mesh included, and IPOPT options.
    second_opinion
        Solve from all starts. Without it the first of them is enough, unless it fails or has a hard time.
    explained
        Where there is no cycle, look for the limits in conflict, which takes seconds.

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
    attempts = []
    for attempt in attempts_from_starts(solver, values):
        attempts.append(attempt)
        if not attempt.solution.success and len(attempts) == 1:
            _require_carried_weight(values, formulation)
        if _is_enough(attempts, second_opinion=second_opinion):
            break
    if formulation != formulation.plain():
        attempts += _from_less_freedom(solver, values, formulation, options, second_opinion)
    if not any(attempt.solution.success for attempt in attempts):
        attempts += _rescue(solver, values, formulation, explained)
    return attempts


def _is_enough(attempts: Sequence[Attempt], *, second_opinion: bool) -> bool:
    """Whether the last of some attempts gives no reason for another."""
    last = attempts[-1].solution
    if second_opinion:
        return False
    # Of the problems that have a cycle none is solved by the last start alone.
    return len(attempts) == len(STARTS) or (last.success and last.iterations <= HARD)


@lru_cache(maxsize=32)
def cycle_solver(structure: Structure, formulation: Formulation, options: tuple[tuple[str, Any], ...] = ()) -> Solver:
    """Build (once) the solver of a structure, for any numbers."""
    program = cycle_program(structure, formulation)
    return Solver(program, dict(options), deferred=deferred_rows(program, structure))


def solver_options(problem: Problem) -> tuple[tuple[str, Any], ...]:
    """IPOPT options that a problem file sets."""
    given = problem.optimisation
    return (("tol", given.tolerance), ("max_iter", given.max_iterations))


def attempts_from_starts(solver: Solver, values: ParameterValues) -> Iterator[Attempt]:
    """Solve from one start after the other, and from a shortest traction that is solved first and then released."""
    program = solver.program
    for start in STARTS:
        guess = program.pack(guess_of(start, values, program))
        yield Attempt(start.name, solver, solver.solve(guess, values.vector, patience=PATIENCE))
    crude, pinned = pinned_start(values, program)
    held = solver.solve(program.pack(crude), values.vector, pinned=pinned, patience=PATIENCE)
    released = solver.solve(held.x, values.vector, patience=PATIENCE) if held.success else held
    yield Attempt("shortest traction", solver, released)


def _from_less_freedom(
    solver: Solver,
    values: ParameterValues,
    formulation: Formulation,
    options: tuple[tuple[str, Any], ...],
    second_opinion: bool,
) -> list[Attempt]:
    """Go on from the optimum of constant elevation and fixed power setting: more freedom must not lose against it."""
    plain = cycle_solver(values.structure, formulation.plain(), options)
    found: list[Attempt] = []
    for attempt in attempts_from_starts(plain, values):
        found.append(attempt)
        if _is_enough(found, second_opinion=second_opinion):
            break
    succeeded = [attempt.solution for attempt in found if attempt.solution.success]
    if not succeeded:
        return []
    best = min(succeeded, key=lambda solution: solution.f)
    guess = enriched(plain.program.unpack(best.x, values.vector), values, solver.program)
    solution = solver.solve(solver.program.pack(guess), values.vector, near=True)
    return [Attempt("optimum of less freedom", solver, solution)]


def _require_carried_weight(values: ParameterValues, formulation: Formulation) -> None:
    """Reject a kite that cannot carry its own weight: no limit that may move would help.

    Raises
    ------
    InfeasibleError
        It cannot.
    """
    # Imported where it is needed, which is seldom: `kiteocp solve` starts sooner without.
    from kiteocp.cycle.weight import uncarried_weight  # noqa: PLC0415

    weight = uncarried_weight(values, formulation.power_setting)
    if weight is not None:
        raise InfeasibleError(weight.sentence, weight.to_dict())


def _rescue(solver: Solver, values: ParameterValues, formulation: Formulation, explained: bool) -> list[Attempt]:
    """Ask the elastic program why nothing was found; go on from its cycle where no limit had to move.

    Where the limits had to move very little only, random starts have the last word.

    Raises
    ------
    InfeasibleError
        Limits are in conflict.
    """
    # Imported where it is needed, which is seldom.
    from kiteocp.optimum.infeasibility import explain  # noqa: PLC0415
    from kiteocp.optimum.relaxations import penalised_optimum  # noqa: PLC0415

    program = solver.program
    found = explain(values, formulation, conflict=explained)
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
        # The crude starts once more, for as long as it takes.
        tries = [*((start, None) for start in STARTS), *((start, PATIENCE) for start in rescue_starts())]
        for start, patience in tries:
            guess = program.pack(guess_of(start, values, program))
            solution = solver.solve(guess, values.vector, patience=patience)
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
