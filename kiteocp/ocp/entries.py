"""The small declarations of an optimal control problem: variables, equations, constraints, rate limits, links.

Each has a name, a scale and, where it is bounded, bounds that may depend on the problem's parameters. They are put
together in `kiteocp.ocp.declaration`.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import msgspec

Expression = Any
"""A number or a scalar ``casadi.SX`` expression (CasADi carries no types)."""


def _require_scale(owner: str, scale: float) -> None:
    """Reject a scale that is not a positive finite number."""
    if not (math.isfinite(scale) and scale > 0.0):
        raise ValueError(f"{owner}: scale must be positive and finite, not {scale}")


def _require_bounds(owner: str, lower: Expression, upper: Expression) -> None:
    """Reject numeric bounds that are NaN or crossed; symbolic ones are left to the numbers that come."""
    low, high = ca.SX(lower), ca.SX(upper)
    if low.is_constant() and high.is_constant() and not float(low) <= float(high):
        raise ValueError(f"{owner}: lower bound {float(low)} must not exceed upper bound {float(high)}")


class Variable(msgspec.Struct, frozen=True):
    """A scalar unknown of the problem.

    Attributes
    ----------
    name
        Unique within its phase (or among the statics).
    lower, upper
        Bounds in physical units: numbers (infinite allowed) or ``SX`` expressions of the problem's parameters.
    scale
        Typical magnitude; the solver sees value / scale.
    continuous
        Of an algebraic or a control: between the points it follows a curve without jumps
        (`kiteocp.ocp.collocation.PhaseMesh.continuous_matrix`); otherwise it may jump at the borders of intervals. The
        values at the points are free in either case.

    """

    name: str
    lower: Expression = -math.inf
    upper: Expression = math.inf
    scale: float = 1.0
    continuous: bool = False

    def __post_init__(self) -> None:
        _require_scale(f"variable '{self.name}'", self.scale)
        _require_bounds(f"variable '{self.name}'", self.lower, self.upper)


class Static(Variable, frozen=True, eq=False):
    """A decision shared by all phases; use `symbol` in models, links and the objective."""

    symbol: Expression = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.symbol is None:
            msgspec.structs.force_setattr(self, "symbol", ca.SX.sym(self.name))


class Residual(msgspec.Struct, frozen=True):
    """An algebraic equation ``expression == 0``; its row in the program is expression / scale."""

    name: str
    expression: Expression
    scale: float = 1.0

    def __post_init__(self) -> None:
        _require_scale(f"residual '{self.name}'", self.scale)


class PathConstraint(msgspec.Struct, frozen=True):
    """``lower <= expression <= upper`` at every collocation point; bounds as for `Variable`."""

    name: str
    expression: Expression
    lower: Expression = -math.inf
    upper: Expression = math.inf
    scale: float = 1.0

    def __post_init__(self) -> None:
        _require_scale(f"constraint '{self.name}'", self.scale)
        _require_bounds(f"constraint '{self.name}'", self.lower, self.upper)


class RateLimit(msgspec.Struct, frozen=True):
    """Bounds on the slope of a quantity in time, anywhere in a phase.

    What is bounded is the slope of the continuous curve through the values at the collocation points
    (`kiteocp.ocp.collocation.slope_bounds_matrix`). Of an output it says as much as that curve follows the output
    between the points: the variables that it depends on have to be continuous.

    Attributes
    ----------
    name
        Name of the rows.
    quantity
        A state, algebraic, control or output of the phase.
    lower, upper
        Bounds in units of the quantity per second, as for `Variable`.
    scale
        Typical magnitude of the rate.

    """

    name: str
    quantity: str
    lower: Expression
    upper: Expression
    scale: float = 1.0

    def __post_init__(self) -> None:
        _require_scale(f"rate limit '{self.name}'", self.scale)
        _require_bounds(f"rate limit '{self.name}'", self.lower, self.upper)


class Link(msgspec.Struct, frozen=True):
    """``lower <= expression <= upper`` over phase ends, durations, integrals, statics; by default ``== 0``."""

    name: str
    expression: Expression
    lower: Expression = 0.0
    upper: Expression = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        _require_scale(f"link '{self.name}'", self.scale)
        _require_bounds(f"link '{self.name}'", self.lower, self.upper)
