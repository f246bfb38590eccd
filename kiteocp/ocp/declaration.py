"""What an optimal control problem of several phases is, before any discretisation.

Variables, phases, links and an objective, written with CasADi ``SX`` symbols. Nothing here knows about meshes or
solvers. See `kiteocp.ocp.transcription` for the whole picture and an example.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import msgspec

from kiteocp.ocp.entries import Expression, Link, PathConstraint, RateLimit, Residual, Static, Variable

__all__ = [
    "Expression",
    "Link",
    "OptimalControlProblem",
    "PathConstraint",
    "Phase",
    "Point",
    "PointExpressions",
    "RateLimit",
    "Residual",
    "Static",
    "Symbols",
    "Variable",
]


class Point(msgspec.Struct, frozen=True):
    """The symbols a phase model is written in, at one instant.

    Attributes
    ----------
    values
        States, algebraics and controls by name; ``point["r"]`` is short for ``point.values["r"]``.
    time
        Time since the start of the phase.
    duration
        Duration of the phase.

    """

    values: Mapping[str, Expression]
    time: Expression
    duration: Expression

    def __getitem__(self, name: str) -> Expression:
        return self.values[name]


class PointExpressions(msgspec.Struct, frozen=True):
    """What a phase model answers: expressions of the `Point`, the statics and the parameters.

    Attributes
    ----------
    derivatives
        Time derivative of every state.
    residuals
        Algebraic equations, normally as many as algebraic variables.
    constraints
        Path constraints.
    outputs
        Named quantities to report, integrate, average, or limit in rate.

    """

    derivatives: Mapping[str, Expression]
    residuals: Sequence[Residual] = ()
    constraints: Sequence[PathConstraint] = ()
    outputs: Mapping[str, Expression] = msgspec.field(default_factory=dict)


class Symbols(Mapping[str, Expression]):
    """Symbols made on first use, one for each name asked for.

    Links refer to phase values through these; the transcription replaces exactly those that were used.
    """

    def __init__(self, owner: str, names: Sequence[str]) -> None:
        self._owner = owner
        self._names = tuple(names)
        self._used: dict[str, Expression] = {}

    def __getitem__(self, name: str) -> Expression:
        if name not in self._names:
            raise KeyError(f"{self._owner} has no '{name}'; it has {', '.join(self._names) or 'nothing'}")
        if name not in self._used:
            self._used[name] = ca.SX.sym(f"{self._owner}.{name}")
        return self._used[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def used(self) -> Mapping[str, Expression]:
        """The symbols that were asked for."""
        return self._used


class Phase:
    """One phase: its variables, its model, and the symbols that links are written with.

    Parameters
    ----------
    name
        Unique in the problem.
    duration
        The (free or fixed) duration; bounds and scale as for any variable.
    states
        Have a value at the phase start and at each collocation point, and a derivative in the model.
    model
        Called once with the phase's symbols; may use statics' symbols and parameters of the problem directly.
    algebraics, controls
        Have a value at each collocation point. The two differ in name only: algebraics are meant to be determined
        by the residuals.
    rate_limits
        Bounds on slopes in time inside the phase.

    Attributes
    ----------
    start : Symbols
        States at the phase start.
    first, end : Symbols
        Any state, algebraic, control or output at the first and at the last collocation point. The last one is
        the end of the phase; the first one lies shortly after its start.
    integral, mean : Symbols
        Time integral and time mean over the phase of any state, algebraic, control or output.

    Raises
    ------
    ValueError
        If names repeat, derivatives do not match the states, or a rate limit names an unknown quantity.

    """

    def __init__(
        self,
        name: str,
        *,
        duration: Variable,
        states: Sequence[Variable],
        model: Callable[[Point], PointExpressions],
        algebraics: Sequence[Variable] = (),
        controls: Sequence[Variable] = (),
        rate_limits: Sequence[RateLimit] = (),
    ) -> None:
        self.name = name
        self.duration_variable = duration
        self.states, self.algebraics, self.controls = tuple(states), tuple(algebraics), tuple(controls)
        self.rate_limits = tuple(rate_limits)
        unknowns = [v.name for v in (*self.states, *self.algebraics, *self.controls)]
        self.point = Point(
            {n: ca.SX.sym(f"{name}.{n}") for n in unknowns},
            ca.SX.sym(f"{name}.time"),
            ca.SX.sym(f"{name}.duration"),
        )
        self.expressions = model(self.point)
        self.quantities = (*unknowns, *self.expressions.outputs)
        self._check()
        self.start = Symbols(f"{name}.start", [v.name for v in self.states])
        self.first = Symbols(f"{name}.first", self.quantities)
        self.end = Symbols(f"{name}.end", self.quantities)
        self.integral = Symbols(f"{name}.integral", self.quantities)
        self.mean = Symbols(f"{name}.mean", self.quantities)

    @property
    def duration(self) -> Expression:
        """Symbol of the phase's duration."""
        return self.point.duration

    def _check(self) -> None:
        repeated = sorted({n for n in self.quantities if self.quantities.count(n) > 1})
        if repeated:
            raise ValueError(f"phase '{self.name}': more than one quantity is called {', '.join(repeated)}")
        wanted, given = {v.name for v in self.states}, set(self.expressions.derivatives)
        if wanted != given:
            raise ValueError(
                f"phase '{self.name}': derivatives must be given for exactly the states; "
                f"missing {sorted(wanted - given)}, not a state {sorted(given - wanted)}"
            )
        for limit in self.rate_limits:
            if limit.quantity not in self.quantities:
                raise ValueError(
                    f"phase '{self.name}': rate limit '{limit.name}' names the unknown quantity '{limit.quantity}'; "
                    f"known are {', '.join(self.quantities)}"
                )


class OptimalControlProblem(msgspec.Struct, frozen=True, eq=False, dict=True):
    """Phases, what links them, and what to minimise.

    Attributes
    ----------
    phases
        In any order; links say how they follow each other.
    objective
        To be minimised: an expression of phase symbols, statics and parameters, of order one.
    links
        Equalities and inequalities between phases.
    statics
        Decisions shared by the phases.
    parameters
        Column vector of ``SX`` symbols, the numbers that may change from solve to solve.
    objective_unit
        What an objective of one is in the unit of the problem; negative where that is to be as large as possible.
    derived
        Symbols (a column) and their expressions (of the parameters alone) that the models of the phases use: what is
        computed once for all points. Objective, links and bounds use the parameters themselves.

    """

    phases: Sequence[Phase]
    objective: Expression
    links: Sequence[Link] = ()
    statics: Sequence[Static] = ()
    parameters: Expression = msgspec.field(default_factory=lambda: ca.SX(0, 1))
    objective_unit: float = 1.0
    derived: tuple[Expression, Expression] = msgspec.field(default_factory=lambda: (ca.SX(0, 1), ca.SX(0, 1)))

    @cached_property
    def point_parameters(self) -> Any:
        """``p -> parameters and what is derived from them``, which the models of the phases take."""
        parameters = ca.SX(self.parameters)
        everything = ca.vertcat(parameters, ca.densify(self.derived[1]))
        return ca.Function("point_parameters", [parameters], [everything], {"cse": True})

    def __post_init__(self) -> None:
        for kind, names in (
            ("phase", [p.name for p in self.phases]),
            ("static", [s.name for s in self.statics]),
        ):
            repeated = sorted({n for n in names if names.count(n) > 1})
            if repeated:
                raise ValueError(f"more than one {kind} is called {', '.join(repeated)}")
