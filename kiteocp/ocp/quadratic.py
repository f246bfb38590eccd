"""Small convex quadratic programs, solved by an active-set method that ships with CasADi."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.ocp.collocation import FloatArray

#: Rows come in lots of this size: the solver is built for a number of rows, and its time grows with them.
LOT = 48

#: A row takes part from the beginning where a step of this size along its gradient could reach its bound.
REACH = 0.3

#: What a solution may miss a bound by, scaled.
TOLERANCE = 1e-7

#: A bound farther away than this is none.
FAR = 1e20


class StepError(Exception):
    """No step leads on from where a calculation stands."""


@lru_cache(maxsize=32)
def _solver(variables: int, rows: int) -> BufferedFunction:
    """Build the solver: (hessian, slope, rows, their bounds) -> solution and multipliers of the rows."""
    hessian, slope = ca.MX.sym("h", variables, variables), ca.MX.sym("g", variables)
    matrix, lower, upper = ca.MX.sym("a", rows, variables), ca.MX.sym("l", rows), ca.MX.sym("u", rows)
    structure = {"h": hessian.sparsity(), "a": matrix.sparsity()}
    name = "daqp" if ca.has_conic("daqp") else "qrqp"
    options = {"error_on_fail": False, **({"print_iter": False, "print_header": False} if name == "qrqp" else {})}
    solver = ca.conic("quadratic", name, structure, options)
    found = solver(h=hessian, g=slope, a=matrix, lba=lower, uba=upper)
    arguments = [hessian, slope, matrix, lower, upper]
    return BufferedFunction(ca.Function("quadratic", arguments, [found["x"], found["lam_a"]]))


def solve_quadratic(
    hessian: FloatArray, slope: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Minimise z' H z / 2 + h' z under lower <= A z <= upper, H positive definite.

    Rows that are far from their bounds are left out until a solution passes them.

    Parameters
    ----------
    hessian, slope
        H and h, shapes (n, n) and (n,).
    rows, lower, upper
        A and the bounds, shapes (m, n) and (m,).

    Returns
    -------
    z, multipliers : ndarray, shapes (n,) and (m,)
        A multiplier is positive at an upper bound, negative at a lower one.

    Raises
    ------
    StepError
        No z keeps the bounds.
    """
    sizes = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    taking_part = (lower > -REACH * sizes) | (upper < REACH * sizes)
    while True:
        chosen = np.flatnonzero(taking_part)
        capacity = LOT * max(-(-chosen.size // LOT), 1)
        matrix = np.zeros((capacity, slope.size))
        matrix[: chosen.size] = rows[chosen]
        low, high = np.full(capacity, -FAR), np.full(capacity, FAR)
        low[: chosen.size], high[: chosen.size] = np.maximum(lower[chosen], -FAR), np.minimum(upper[chosen], FAR)
        solver = _solver(slope.size, capacity)
        z, pressing = solver.call(hessian.ravel(), slope, matrix.ravel(order="F"), low, high)
        values = rows @ z
        missed = ~((values >= lower - TOLERANCE) & (values <= upper + TOLERANCE))
        if (missed & taking_part).any():
            raise StepError("no step keeps the bounds")
        if not missed.any():
            multipliers = np.zeros(lower.size)
            multipliers[chosen] = pressing[: chosen.size]
            return z.copy(), multipliers
        taking_part |= missed
