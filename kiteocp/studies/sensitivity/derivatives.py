"""An optimum on its active set: differentiated along every key of the problem file, followed, re-solved.

A key means what ``--set`` of it does: numbers that follow from it by default are carried along.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import msgspec
import numpy as np

from kiteocp.errors import InputError, SolveError
from kiteocp.ocp.active_set import ActiveSetMethod
from kiteocp.ocp.active_solution import ActiveSetError, Derivatives, PolishedSolution
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.continuation import Reach, follow, one_sided
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.optimum.refine import Optimum
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

#: Steps that resolve a derived default exactly: a power of two, as the rules are linear.
RESOLUTION_STEP = 2.0**-10


@lru_cache(maxsize=8)
def method_of(program: NonlinearProgram) -> ActiveSetMethod:
    """Return the (once built) derivatives of a program."""
    return ActiveSetMethod(program)


class LocalStudy(msgspec.Struct, frozen=True, dict=True):
    """An optimum on its active set with its derivatives along every key.

    Attributes
    ----------
    optimum
        What was solved.
    method, polished
        The method, and the optimum to rounding.
    keys
        Key paths of the numbers of the problem.
    directions
        What a unit of each key moves in the parameter vector, shape (parameters, keys).
    derivatives
        Along the directions.
    """

    optimum: Optimum
    method: ActiveSetMethod
    polished: PolishedSolution
    keys: tuple[str, ...]
    directions: FloatArray
    derivatives: Derivatives

    @classmethod
    def of(cls, optimum: Optimum) -> LocalStudy:
        """Polish and differentiate an optimum.

        Raises
        ------
        SolveError
            The optimum has no regular active set.
        """
        method = method_of(optimum.solver.program)
        keys, directions = optimum.values.structure.keys, key_directions(optimum.problem)
        polished = _polished(optimum, method)
        try:
            derivatives = method.derivatives(polished, directions)
        except ActiveSetError as error:
            raise _not_differentiable(error) from None
        return cls(optimum, method, polished, keys, directions, derivatives)

    def _in_watts(self, objective: Any) -> Any:
        return self.optimum.solver.program.in_units(objective)

    @property
    def mean_power_W(self) -> float:
        """Optimal mean power of the objective."""
        return float(self._in_watts(self.polished.f))

    @property
    def gradient(self) -> FloatArray:
        """Derivative of the optimal mean power, W per unit of each key, shape (keys,)."""
        # Adding zero turns the -0.0 of what has no influence into 0.0.
        return np.asarray(self._in_watts(self.derivatives.objective) + 0.0)

    @cached_property
    def gradient_alone(self) -> FloatArray:
        """The same with the keys held that follow by default, shape (keys,)."""
        return np.asarray(np.linalg.solve(self.directions.T, self.gradient) + 0.0)

    def curvature(self, column: int) -> float:
        """Return the second derivative of the optimal mean power along one key, W per unit squared."""
        return float(self._in_watts(self.derivatives.objective_second[column, column]) + 0.0)

    def followers(self, column: int) -> tuple[str, ...]:
        """Return the keys that follow a key by default and have an influence of their own."""
        moved = np.flatnonzero(self.directions[:, column] * self.gradient_alone)
        return tuple(self.keys[index] for index in moved if index != column)

    @cached_property
    def sides(self) -> tuple[FloatArray, FloatArray]:
        """Derivative of the optimal mean power below and above each key; infinite where there is no cycle."""
        below, above = one_sided(self.method, self.polished, self.derivatives, self.directions)
        return self._in_watts(below) + 0.0, self._in_watts(above) + 0.0

    def tangent(self, column: int) -> Derivatives:
        """Return the derivatives along one key."""
        part, chosen = self.derivatives, slice(column, column + 1)
        columns = {
            name: getattr(part, name)[:, chosen] for name in ("x", "values", "multipliers", "lower", "upper", "pressed")
        }
        return Derivatives(part.objective[chosen], **columns, objective_second=part.objective_second[chosen, chosen])

    def reach(self, column: int, farthest: float) -> Reach:
        """Follow the optimum along one key, to `farthest` away from its value at most."""
        tangent = self.tangent(column)
        # Where the solution stands still only bounds move, along straight lines.
        still = not tangent.x.any() and not tangent.multipliers.any()
        way = float(np.sign(farthest)) * np.inf if still else farthest
        return follow(self.method, self.polished, tangent, self.directions[:, column], way)

    def power_at(self, column: int, step: float) -> float | None:
        """Re-solve with one key changed, warm; None where no solution is found."""
        moved = self.polished.p + step * self.directions[:, column]
        try:
            solution = self.optimum.solver.solve(self.optimum.solution.x, moved, warm=self.optimum.solution)
        except ValueError:
            return None  # the change crosses two bounds
        return float(self._in_watts(solution.f)) if solution.success else None


def _polished(optimum: Optimum, method: ActiveSetMethod) -> PolishedSolution:
    """Solve the optimum on its active set, once more by IPOPT where it is not clear which bounds are active."""
    solution, p = optimum.solution, optimum.values.vector
    try:
        return method.polish_and_correct(solution, method.active_set_of(solution), p)
    except ActiveSetError:
        decided = optimum.solver.solve(solution.x, p, warm=solution, deciding=True)
        if not decided.success:
            decided = solution
    try:
        return method.polish_and_correct(decided, method.active_set_of(decided), p)
    except ActiveSetError as error:
        raise _not_differentiable(error) from None


def _not_differentiable(error: ActiveSetError) -> SolveError:
    return SolveError(f"the optimum cannot be differentiated: {error}; change a number slightly")


def key_directions(problem: Problem) -> FloatArray:
    """Return what a unit of each key moves in the parameter vector, derived defaults included.

    Returns
    -------
    ndarray, shape (parameters, keys)
        The identity, but for the columns of keys that others follow.
    """
    values = parameter_values(problem)
    directions = np.eye(values.vector.size)
    for column, key in enumerate(values.structure.keys):
        step = RESOLUTION_STEP * (abs(values.vector[column]) or 1.0)
        for signed in (step, -step):
            try:
                moved = parameter_values(problem.with_values({key: values.vector[column] + signed})).vector
            except InputError:  # at the edge of what the key may be: look to the other side
                continue
            directions[:, column] = (moved - values.vector) / signed
            directions[column, column] = 1.0
            break
    return directions
