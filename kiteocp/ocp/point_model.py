"""The model of a phase at one point of its mesh, and its derivatives, generated once for all meshes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from kiteocp.ocp.declaration import Expression, OptimalControlProblem, Phase


class PointModel:
    """A phase at one point, in the variables of the program: each over its scale.

    Functions take (variables of the point, fraction of the phase's duration, parameters and what is derived from them),
    and some the weights of the
    outputs as well. The variables are states, algebraics, controls, statics and the duration, in this order; the
    outputs are derivatives, residuals, constraints and outputs of the declaration, in physical units.

    Parameters
    ----------
    problem, phase
        Where it is declared.

    Attributes
    ----------
    function
        The model as it is declared: (states, algebraics, controls, time, duration, statics, parameters and what is
        derived from them) -> (derivatives, residuals, constraints, outputs), columns in the order of declaration,
        physical units.
    outputs
        Number of outputs.

    Raises
    ------
    ValueError
        If the model uses a symbol that is none of these.
    """

    def __init__(self, problem: OptimalControlProblem, phase: Phase) -> None:
        self.name = phase.name
        self.function = _point_function(problem, phase)
        declared = [*phase.states, *phase.algebraics, *phase.controls, *problem.statics, phase.duration_variable]
        sizes = [len(phase.states), len(phase.algebraics), len(phase.controls), len(problem.statics), 1]
        self._variables = ca.SX.sym(f"{phase.name}.point", len(declared))
        fraction, self._parameters = ca.SX.sym("fraction"), _parameters_of(problem)
        physical = self._variables * ca.DM([variable.scale for variable in declared])
        *groups, statics, duration = ca.vertsplit(physical, np.cumsum([0, *sizes]).tolist())
        results = self.function.call([*groups, fraction * duration, duration, statics, self._parameters])
        self._inputs = [self._variables, fraction, self._parameters]
        self._outputs = ca.vertcat(*results)
        self.outputs = int(self._outputs.numel())
        # Of each kind of function one for each set of outputs; more than one set comes from meshes that differ much.
        self.values = lru_cache(self._values)
        self.slopes = lru_cache(self._slopes)
        self.sweep = lru_cache(self._sweep)
        self.curvature = lru_cache(self._curvature)

    def _values(self, used: tuple[int, ...]) -> Any:
        """Make the function of the outputs."""
        return self._function("values", self._inputs, [self._outputs[list(used)]])

    def _slopes(self, used: tuple[int, ...], with_parameters: bool) -> Any:
        """Make the function of the outputs and their Jacobian to the variables, or to variables and parameters."""
        outputs = self._outputs[list(used)]
        return self._function("slopes", self._inputs, [outputs, ca.jacobian(outputs, self._to(with_parameters))])

    def _sweep(self, used: tuple[int, ...], with_parameters: bool) -> Any:
        """Make the function of the gradient of the weighted sum of the outputs."""
        weights = ca.SX.sym("weights", len(used))
        swept = ca.jtimes(self._outputs[list(used)], self._to(with_parameters), weights, True)
        return self._function("sweep", [*self._inputs, weights], [ca.densify(swept)])

    def _curvature(self, used: tuple[int, ...], with_parameters: bool) -> Any:
        """Make the function of the Hessian of the weighted sum of the outputs."""
        weights = ca.SX.sym("weights", len(used))
        hessian, _ = ca.hessian(ca.dot(weights, self._outputs[list(used)]), self._to(with_parameters))
        return self._function("curvature", [*self._inputs, weights], [hessian])

    def _to(self, with_parameters: bool) -> Any:
        return ca.vertcat(self._variables, self._parameters) if with_parameters else self._variables

    def _function(self, what: str, inputs: list[Any], outputs: list[Any]) -> Any:
        # The model has no common subexpressions left. Those of its derivatives are 4 %, and to find them takes as long
        # as to solve.
        return ca.Function(f"{what}_{self.name}", inputs, outputs)


@lru_cache(maxsize=64)
def point_model(problem: OptimalControlProblem, phase: Phase) -> PointModel:
    """Return the (once built) model of a phase, which all meshes of the problem share."""
    return PointModel(problem, phase)


def _point_function(problem: OptimalControlProblem, phase: Phase) -> Any:
    """Return the model of a phase at one point, see `PointModel`."""
    point, said = phase.point, phase.expressions
    groups = [column_of([point[v.name] for v in g]) for g in (phase.states, phase.algebraics, phase.controls)]
    statics = column_of([static.symbol for static in problem.statics])
    inputs = [*groups, point.time, point.duration, statics, _parameters_of(problem)]
    outputs = [
        column_of([said.derivatives[v.name] for v in phase.states]),
        column_of([r.expression for r in said.residuals]),
        column_of([c.expression for c in said.constraints]),
        column_of(list(said.outputs.values())),
    ]
    require_known(f"the model of phase '{phase.name}'", outputs, inputs)
    return ca.Function(f"point_{phase.name}", inputs, [ca.densify(part) for part in outputs], {"cse": True})


def _parameters_of(problem: OptimalControlProblem) -> Any:
    return ca.vertcat(ca.SX(problem.parameters), problem.derived[0])


def column_of(expressions: Sequence[Expression]) -> Any:
    """Column vector of scalars, of shape (0, 1) when there are none."""
    return ca.SX(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


def require_known(owner: str, expressions: Sequence[Any], known: Sequence[Any]) -> None:
    """Reject expressions of symbols that have no value where they are used."""
    allowed = {symbol.__hash__() for group in known for symbol in ca.symvar(group)}
    strange = [s.name() for s in ca.symvar(ca.veccat(*expressions)) if s.__hash__() not in allowed]
    if strange:
        raise ValueError(f"{owner} uses {', '.join(strange)}, which has no value there")
