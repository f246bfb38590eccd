"""First-order conditions of a program on an active set: their functions, and the linear system of Newton's method."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from kiteocp.ocp.active_solution import ActiveSet, ActiveSetError
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlp import NonlinearProgram

#: A solution of a linear system beyond this, in the scaled units of the program, comes from a singular one.
SINGULAR = 1e12


def dense(matrix: Any) -> FloatArray:
    """Return a sparse CasADi matrix as an array; its own way goes through a Python number for every zero too."""
    found = np.zeros(matrix.shape)
    places = matrix.sparsity().get_triplet()
    found[places] = matrix.nonzeros()
    return found


class FirstOrderSystem:
    """Functions of one program, built once, and the linear system of any of its active sets.

    Attributes
    ----------
    first
        ``(x, p, multipliers of the rows) -> gradient and Hessian of the Lagrangian to x and p, slopes of the rows``.
    bound_slopes
        ``p ->`` derivatives of the bounds (lbx, ubx, lbg, ubg) to the parameters; zero for infinite ones.
    curvature
        ``(p, weights) ->`` second derivatives of the weighted sum of the bounds.
    """

    def __init__(self, program: NonlinearProgram) -> None:
        self._program = nlp = program
        self._nx, self._ng = nlp.x.numel(), nlp.g.numel()
        self._composed = program.composition
        self.first = self._composed.first_order
        self._factors: dict[bytes, Any] = {}
        sides = ca.vertcat(*nlp.bounds(nlp.p))
        weights = ca.SX.sym("weights", sides.numel())
        # Infinite bounds have no derivatives, and infinity times a weight is not a number.
        finite = ca.vertcat(*(s if not s.is_constant() else ca.SX(0) for s in ca.vertsplit(sides)))
        self.bound_slopes = ca.Function("bound_slopes", [nlp.p], [ca.jacobian(finite, nlp.p)])
        self.curvature = ca.Function("curvature", [nlp.p, weights], [ca.hessian(ca.dot(weights, finite), nlp.p)[0]])

    def newton(self, x: FloatArray, p: FloatArray, lam_g: FloatArray) -> tuple[float, FloatArray, FloatArray, Any, Any]:
        """Return objective, rows, and gradient and Hessian of the Lagrangian and slopes of the rows to x alone."""
        f, g = self._composed.values(x, p)
        gradient, _ = self._composed.lagrangian_gradient(x, p, lam_g)
        hessian = ca.triu2symm(self._composed.hessian(x, p, 1.0, lam_g))
        return float(f), g.full().ravel(), gradient.full().ravel(), hessian, self._composed.jacobian(x, p)[1]

    def sides(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds of (variables, rows) at given parameters."""
        lbx, ubx, lbg, ubg = self._program.numeric_bounds(p)
        return np.concatenate((lbx, lbg)), np.concatenate((ubx, ubg))

    def own_rows(self, active: ActiveSet) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Index of each active bound among (variables, rows), and of its side among (lbx, ubx, lbg, ubg)."""
        both = np.concatenate((active.variables, active.rows))
        own = np.flatnonzero(both)
        offsets = np.where(own < self._nx, 0, self._nx)
        side = own + offsets + np.where(both[own] > 0, np.where(own < self._nx, self._nx, self._ng), 0)
        return own, side

    def solve(self, hessian: Any, rows: Any, own: NDArray[np.intp], right: FloatArray) -> FloatArray:
        """Solve the Newton system of the active bounds, by CasADi's own sparse QR.

        A dense solve waits for the threads of BLAS, a hundred times longer where other processes hold the cores;
        CasADi's sparse LU takes four times as long.

        Parameters
        ----------
        hessian, rows
            Of the Lagrangian to the variables, and of the rows' gradients, as `newton` gives them.
        own
            The active bounds, by `own_rows`.
        right
            Right-hand sides, shape (variables + active bounds, k).

        Returns
        -------
        ndarray, shape (variables + active bounds, k)
            Of the variables and of the multipliers.

        Raises
        ------
        ActiveSetError
            The system is singular.
        """
        active = ca.vertcat(ca.DM.eye(self._nx), rows)[own.tolist(), :]
        matrix = ca.blockcat([[hessian, active.T], [active, ca.DM(own.size, own.size)]])
        key = own.tobytes()
        if key not in self._factors:
            self._factors[key] = ca.Linsol("newton", "qr", matrix.sparsity())
        try:
            solved = np.asarray(self._factors[key].solve(matrix, ca.DM(right)).full())
        except RuntimeError as error:
            raise ActiveSetError("the active constraints are not independent") from error
        if not np.all(np.abs(solved) < SINGULAR):
            raise ActiveSetError("the active constraints are not independent")
        return solved
