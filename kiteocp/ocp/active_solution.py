"""What is known of a solution on its active set: the set, the polished numbers, and their derivatives."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlp import Label


class ActiveSetError(Exception):
    """The first-order conditions on an active set have no regular solution near the start."""


class ActiveSet(msgspec.Struct, frozen=True):
    """Which bounds are active: -1 lower, +1 upper, 0 none, for each variable and row; equalities count as 1.

    Attributes
    ----------
    variables, rows
        Shape (variables,) and (rows,).
    weak
        Labels of bounds of which it is not clear whether they are active.
    """

    variables: NDArray[np.int8]
    rows: NDArray[np.int8]
    weak: tuple[Label, ...] = ()

    def same(self, other: ActiveSet) -> bool:
        """Whether the same bounds are active."""
        return bool(np.array_equal(self.variables, other.variables) and np.array_equal(self.rows, other.rows))


class PolishedSolution(msgspec.Struct, frozen=True):
    """A solution of the first-order conditions on an active set, to rounding.

    Attributes
    ----------
    x, g, lam_x, lam_g, p, f
        As in `Solution`.
    active
        The active set.
    nearer_lower
        Whether a variable or row is nearer to its lower bound than to its upper one, shape (variables + rows,).
    """

    x: FloatArray
    g: FloatArray
    lam_x: FloatArray
    lam_g: FloatArray
    p: FloatArray
    f: float
    active: ActiveSet
    nearer_lower: NDArray[np.bool_]


class Derivatives(msgspec.Struct, frozen=True):
    """Derivatives of a solution along directions of the parameters, on its active set; a column for each direction.

    Attributes
    ----------
    objective
        Of the optimal objective, shape (directions,).
    x
        Of the variables (scaled), shape (variables, directions).
    values, multipliers
        Of the variables and rows, and of their multipliers, shape (variables + rows, directions).
    lower, upper
        Of the bounds of variables and rows, shape (variables + rows, directions); zero for infinite ones.
    pressed
        Of the bound that each active variable or row is at, shape (variables + rows, directions); else zero.
    objective_second
        Second derivatives of the optimal objective, shape (directions, directions).
    """

    objective: FloatArray
    x: FloatArray
    values: FloatArray
    multipliers: FloatArray
    lower: FloatArray
    upper: FloatArray
    pressed: FloatArray
    objective_second: FloatArray
