"""Optima of problems that differ in their numbers only, each found from the optimum of a neighbour.

Around the optimum of one problem, with all local optima that its starts led to, others are solved by a few steps of
sequential quadratic programming (`kiteocp.ocp.neighbour`). What these steps do not reach is solved warm by IPOPT, and
what that does not reach from all starts, as `kiteocp.optimum.refine.optimise` does.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import msgspec
import numpy as np

from kiteocp.cycle.phases import TRACTION
from kiteocp.execution import one_at_a_time
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.neighbour import Neighbourhood
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.optimum.certificate import KKT_TOLERANCE, SAME_OPTIMUM, Level, optimality_of
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import Optimum, certified, optimise
from kiteocp.optimum.search import Attempt, attempts_from_starts, cycle_solver, search, solver_options
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.problem import Problem

#: Another local optimum is followed too where it is expected to be worse by no more than this share of the power. To
#: first order the difference of two optima over changes of 20 % is right to some per cent of the power.
RIVAL = 0.05

#: A traction that lasts longer or shorter by this factor than where a solution comes from makes it another kind of
#: cycle: optima of short and of long ones trade places there, and a start has the word too.
ANOTHER_KIND = 1.5

#: Local optima that are kept, the best ones.
MOST_OPTIMA = 3


class Family(msgspec.Struct, frozen=True, eq=False, dict=True):
    """Problems that share a program, around the local optima of one of them.

    Attributes
    ----------
    structure, formulation, options
        What they share.
    optima
        Local optima of one problem, the best first.
    """

    structure: Structure
    formulation: Formulation
    options: tuple[tuple[str, object], ...]
    optima: tuple[Solution, ...]

    @classmethod
    def around(cls, problem: Problem, *, explained: bool = True) -> Family:
        """Solve a problem from all starts; where it has no cycle, look for the limits in conflict if asked to.

        Raises
        ------
        InfeasibleError, SolveError
            It has no optimum.
        """
        values, formulation, options = parameter_values(problem), Formulation.of(problem), solver_options(problem)
        attempts = search(values, formulation, options, explained=explained)
        found: list[Solution] = []
        for attempt in sorted(
            (attempt for attempt in attempts if attempt.solution.success), key=lambda attempt: attempt.solution.f
        ):
            if not any(_same(attempt.solution, other) for other in found):
                found.append(attempt.solution)
        return cls(values.structure, formulation, options, tuple(found[:MOST_OPTIMA]))

    @classmethod
    def of(cls, optimum: Optimum) -> Family:
        """Return the family of an optimum on its own mesh."""
        return cls(optimum.values.structure, optimum.formulation, solver_options(optimum.problem), (optimum.solution,))

    @cached_property
    def solver(self) -> Solver:
        """The solver of all of them."""
        return cycle_solver(self.structure, self.formulation, self.options)

    @cached_property
    def _neighbourhood(self) -> Neighbourhood:
        return Neighbourhood(self.solver.program, self.optima[0])

    @cached_property
    def _slopes(self) -> list[FloatArray]:
        """Derivatives of the objective of each optimum to the parameters."""
        optimality = optimality_of(self.solver.program)
        return [optimality.parametric_gradient(optimum) for optimum in self.optima]

    @staticmethod
    def key_of(problem: Problem) -> tuple[Structure, Formulation, tuple[tuple[str, object], ...]]:
        """Return what all problems of a family share."""
        return parameter_values(problem).structure, Formulation.of(problem), solver_options(problem)

    def attempts(
        self, values: ParameterValues, start: Solution | None = None, known: Solution | None = None
    ) -> list[Attempt]:
        """Solve for other numbers from a neighbour's solution, and from rivals of the best optimum.

        Where that leads to another kind of cycle, also from the first of the crude starts.

        Parameters
        ----------
        values
            The numbers.
        start
            Solution of the nearest problem that is solved; the best optimum of the family if left out.
        known
            The nearest solution that a crude start agreed with, or has not been asked about as nothing changed since.

        Returns
        -------
        list of Attempt
            Those that led to a solution; all of the same program, so that the best is the optimum.
        """
        nearest = start or self.optima[0]
        found = [Attempt("neighbour", self.solver, solution) for solution in self._followed(nearest, values)]
        expected = [f + slope @ (values.vector - optimum.p) for f, slope, optimum in self._lines()]
        for rival, power in zip(self.optima[1:], expected[1:], strict=True):
            if power - expected[0] <= RIVAL * abs(self.optima[0].f):
                found += [Attempt("rival", self.solver, solution) for solution in self._followed(rival, values)]
        if found and self._is_another_kind(found[0].solution, known or self.optima[0]):
            found.append(next(attempts_from_starts(self.solver, values)))
        return found

    def traction_duration(self, solution: Solution) -> float:
        """Return the duration of the traction of a solution, over its scale."""
        return float(solution.x[self.solver.program.layouts[TRACTION.name].duration])

    def _is_another_kind(self, solution: Solution, known: Solution) -> bool:
        ratio = self.traction_duration(solution) / self.traction_duration(known)
        return max(ratio, 1.0 / ratio) > ANOTHER_KIND

    def _lines(self) -> list[tuple[float, FloatArray, Solution]]:
        # A single optimum has no rivals, and needs no slopes.
        slopes = self._slopes if len(self.optima) > 1 else [np.zeros(self.optima[0].p.size)]
        return [(optimum.f, slope, optimum) for optimum, slope in zip(self.optima, slopes, strict=True)]

    def _followed(self, start: Solution, values: ParameterValues) -> list[Solution]:
        """Follow a solution to other numbers, by SQP or else by IPOPT; return none if neither leads there."""
        solution = self._neighbourhood.solve(values.vector, start)
        if solution is not None:
            return [solution]
        try:
            solution = self.solver.solve(start.x, values.vector, warm=start)
        except ValueError:
            return []  # bounds cross: the search explains it
        accepted = solution.success and optimality_of(self.solver.program).residuals(solution).largest <= KKT_TOLERANCE
        return [solution] if accepted else []


def _same(one: Solution, other: Solution) -> bool:
    return abs(one.f - other.f) <= SAME_OPTIMUM * abs(one.f)


@one_at_a_time
def optimise_near(
    problem: Problem,
    family: Family,
    start: Solution | None = None,
    known: Solution | None = None,
    *,
    certificate: Level = "quick",
) -> Optimum:
    """Find and certify the optimal cycle of a problem from a neighbour's; from all starts where that does not pass.

    Parameters
    ----------
    problem
        A problem that the family serves.
    family, start, known
        See `Family.attempts`.
    certificate
        As for `kiteocp.optimum.refine.optimise`; ``none`` checks the first-order conditions alone.

    Raises
    ------
    InfeasibleError, SolveError
        It has no optimum.
    """
    attempts: Sequence[Attempt] = family.attempts(parameter_values(problem), start, known)
    if attempts:
        optimum = certified(problem, attempts, certificate)
        if optimum.certificate.passed:
            return optimum
    return optimise(problem, certificate=certificate, explained=False)
