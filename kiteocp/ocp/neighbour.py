"""A program solved near a solution that is known: sequential quadratic programming in the space that the model leaves.

Most of what a user solves are neighbours: curves, sweeps, samples. From a solution with its multipliers a handful of
Newton steps lead to the next one, and the steps are small: of 124 variables the equations of the model leave 33 free.

Each iteration

1. solves the linearised equations for the basic variables, chosen once at the known solution: dx = d + Z z,
2. minimises the quadratic model of the Lagrangian in z, its Hessian exact, under all bounds and inequalities [1]_,
3. takes the step as far as an l1 merit function decreases.

An indefinite reduced Hessian is made convex along the active bounds, where that changes nothing in the solution, and
only beyond that by its eigenvalues. Where a step fails the way to the parameters is divided.

References
----------
.. [1] J. Nocedal and S. J. Wright, "Numerical Optimization", 2nd ed., Springer 2006, chapter 18.

"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kiteocp.execution import leave_if_interrupted
from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution
from kiteocp.ocp.quadratic import StepError, solve_quadratic

#: Parts that the way to the parameters is divided into, one after the other, until all steps of one succeed.
PARTS = (1, 3, 6)

#: Iterations of one part.
MOST_ITERATIONS = 14

#: First-order residuals (scaled) at which a solution is accepted; the last step leaves much less.
CONVERGED = 1e-8

#: The least share of a step that is worth to go on with.
LEAST_SHARE = 0.1

#: What a unit of the active bounds adds to the reduced Hessian, over its own size, where that is not convex.
ACTIVE_WEIGHT = 10.0

#: The least eigenvalue of a reduced Hessian, over its largest.
LEAST_CURVATURE = 1e-6


@dataclass(frozen=True)
class _Iterate:
    """A point with its multipliers: x, and of variables and rows, inequalities first estimated by the last step."""

    x: FloatArray
    lam_x: FloatArray
    lam_g: FloatArray


class Neighbourhood:
    """Solves one program for parameters near those of a solution.

    Parameters
    ----------
    program
        The program.
    base
        A solution of it, which decides the basic variables.
    """

    def __init__(self, program: NonlinearProgram, base: Solution) -> None:
        self.program, self.base = program, base
        lower, upper = self._bounds_of(base.p)
        nx = len(program.variables)
        # Which rows are equations is a matter of structure; a bound that pins a variable is none of the equations.
        self._equations = np.flatnonzero(lower[nx:] == upper[nx:])
        self._inequalities = np.flatnonzero(lower[nx:] != upper[nx:])
        jacobian = _dense(program.composition.jacobian(base.x, base.p)[1])
        self._basic, self._free = _partition(jacobian[self._equations])

    @cached_property
    def _first(self) -> BufferedFunction:
        """What an iterate is judged by: see `_Linearisation`."""
        composed, (e, i) = self.program.composition, (self._equations.tolist(), self._inequalities.tolist())
        b, n = self._basic.tolist(), self._free.tolist()
        nx, np_ = len(self.program.variables), composed.p.numel()
        x, p = ca.MX.sym("x", nx), ca.MX.sym("p", np_)
        lam_x, lam_i = ca.MX.sym("lam_x", nx), ca.MX.sym("lam_i", len(i))
        f, gradient = composed.gradient(x, p)
        g, jacobian = composed.jacobian(x, p)
        basis = jacobian[e, b]
        solved = ca.solve(basis, ca.horzcat(ca.densify(jacobian[e, n]), g[e]), "qr")
        # Basic variables first; back in the order of x.
        back = np.argsort(np.concatenate((self._basic, self._free))).tolist()
        z = ca.vertcat(-solved[:, : len(n)], ca.MX.eye(len(n)))[back, :]
        d = ca.vertcat(-solved[:, len(n)], ca.MX.zeros(len(n), 1))[back]
        pressed = gradient + lam_x + jacobian[i, :].T @ lam_i
        lam_e = -ca.solve(basis.T, pressed[b], "qr")
        w, offset = jacobian[i, :] @ z, jacobian[i, :] @ d
        outputs = [f, g, gradient, lam_e, z.T @ pressed, d, ca.densify(z), offset, ca.densify(w)]
        function = ca.Function("first", [x, p, lam_x, lam_i], [ca.densify(out) for out in outputs])
        return BufferedFunction(function)

    @cached_property
    def _second(self) -> BufferedFunction:
        """``(x, p, lam_g, Z, d) -> H Z, H d`` with H the Hessian of the Lagrangian."""
        composed = self.program.composition
        nx, ng, np_ = len(self.program.variables), len(self.program.rows), composed.p.numel()
        x, p, lam_g = ca.MX.sym("x", nx), ca.MX.sym("p", np_), ca.MX.sym("lam_g", ng)
        z, d = ca.MX.sym("z", nx, self._free.size), ca.MX.sym("d", nx)
        curved = ca.triu2symm(composed.hessian(x, p, 1.0, lam_g)) @ ca.horzcat(z, d)
        parts = [ca.densify(curved[:, :-1]), ca.densify(curved[:, -1])]
        return BufferedFunction(ca.Function("second", [x, p, lam_g, z, d], parts))

    @cached_property
    def _values(self) -> BufferedFunction:
        return BufferedFunction(self.program.composition.values)

    @cached_property
    def _bounds(self) -> BufferedFunction:
        return BufferedFunction(self.program.bounds)

    def _bounds_of(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds of (variables, rows)."""
        lbx, ubx, lbg, ubg = self._bounds.call(p)
        lower, upper = np.concatenate((lbx, lbg)), np.concatenate((ubx, ubg))
        if not (lower <= upper).all():
            raise StepError("two bounds cross")
        return lower, upper

    def solve(self, p: ArrayLike, start: Solution | None = None) -> Solution | None:
        """Solve for other parameters.

        Parameters
        ----------
        p
            Parameters, shape (parameters,).
        start
            Solution of the program to start from, instead of the one that the neighbourhood was built around.

        Returns
        -------
        Solution or None
            None where no step leads on: another optimum may have to be found, or there is none.

        Raises
        ------
        KeyboardInterrupt
            It was interrupted.
        """
        began = time.perf_counter()
        target, start = np.asarray(p, dtype=float).ravel(), start or self.base
        if not np.isfinite(target).all():
            return None
        spent = 0
        for parts in PARTS:
            iterate = self._decided(start)
            try:
                for part in range(1, parts + 1):
                    share = part / parts
                    iterate, f, g, count = self._solve_at(start.p + share * (target - start.p), iterate)
                    spent += count
            except StepError:
                continue
            return Solution(
                iterate.x, f, g, iterate.lam_x, iterate.lam_g, target,
                success=True,
                status="Converged",
                iterations=spent,
                time_s=time.perf_counter() - began,
                method="SQP",
            )  # fmt: skip
        return None

    def _decided(self, start: Solution) -> _Iterate:
        """Return a solution without the traces that an interior-point method leaves in multipliers of other bounds."""
        lower, upper = self._bounds_of(start.p)
        values, multipliers = np.concatenate((start.x, start.g)), np.concatenate((start.lam_x, start.lam_g))
        slack = np.where(multipliers > 0.0, upper - values, values - lower)
        multipliers[np.abs(multipliers) < slack] = 0.0
        return _Iterate(start.x, *np.split(multipliers, [start.x.size]))

    def _solve_at(self, p: FloatArray, iterate: _Iterate) -> tuple[_Iterate, float, FloatArray, int]:
        """Iterate at fixed parameters; return the solution with its objective, its rows and the number of steps."""
        leave_if_interrupted()
        lower, upper = self._bounds_of(p)
        for count in range(MOST_ITERATIONS):
            at = _Linearisation(self, p, iterate, lower, upper)
            if at.residual <= CONVERGED:
                return _Iterate(iterate.x, iterate.lam_x, at.lam_g), at.f, at.g.copy(), count
            iterate = self._step(at)
        raise StepError("it does not converge")

    def _step(self, at: _Linearisation) -> _Iterate:
        """Take one step."""
        low, high = at.lower - at.values - at.offset, at.upper - at.values - at.offset
        curvature, slope = at.quadratic_model()
        z, multipliers = solve_quadratic(curvature, slope, at.slopes, low, high)
        nx = at.x.size
        step = at.d + at.z @ z
        # Equalities have their multipliers from the next linearisation.
        lam_x, lam_i = multipliers[:nx], multipliers[nx:]
        lam_g = np.zeros(at.g.size)
        lam_g[self._inequalities], lam_g[self._equations] = lam_i, at.lam_e
        share = self._share(at, step, np.max(np.abs(at.lam_e), initial=np.max(np.abs(multipliers), initial=0.0)))
        if share < 1.0:
            lam_x = at.iterate.lam_x + share * (lam_x - at.iterate.lam_x)
            lam_g = at.iterate.lam_g + share * (lam_g - at.iterate.lam_g)
        return _Iterate(at.x + share * step, lam_x, lam_g)

    def _share(self, at: _Linearisation, step: FloatArray, largest: float) -> float:
        """Return how much of a step decreases the l1 merit function enough."""
        price = 2.0 * largest + 1.0
        violation = at.violation
        merit = at.f + price * violation
        descent = min(float(at.gradient @ step) - price * violation, 0.0)
        share = 1.0
        while share >= LEAST_SHARE:
            x = at.x + share * step
            (f,), g = self._values.call(x, at.p)
            here = float(f) + price * _violation(np.concatenate((x, g)), *at.both)
            if np.isfinite(here) and here <= merit + 1e-4 * share * descent + 1e-10:
                return share
            share *= 0.5
        raise StepError("no step decreases the merit function")


class _Linearisation:
    """The program at an iterate: values, first-order residuals, and what a step is computed from.

    Attributes
    ----------
    f, g, gradient
        Objective, rows, gradient of the objective.
    lam_e, lam_g
        Multipliers of the equations that fit those of the inequalities, and of all rows.
    values, lower, upper
        Of variables and inequalities, and their bounds.
    d, z, offset, slopes
        A step is d + z times the free step; values change by offset + slopes times the free step.
    residual
        The largest first-order residual.
    """

    def __init__(
        self, of: Neighbourhood, p: FloatArray, iterate: _Iterate, lower: FloatArray, upper: FloatArray
    ) -> None:
        inequalities, equations = of._inequalities, of._equations
        self._of, self.p, self.iterate, self.x = of, p, iterate, iterate.x
        nx = self.x.size
        lam_i = iterate.lam_g[inequalities]
        f, g, gradient, lam_e, reduced, d, z, offset, slopes = of._first.call(self.x, p, iterate.lam_x, lam_i)
        free = of._free.size
        z, slopes = z.reshape(nx, free, order="F"), slopes.reshape(inequalities.size, free, order="F")
        self.f, self.g, self.gradient, self.lam_e, self.d, self.z = float(f[0]), g, gradient, lam_e, d, z
        self.both = lower, upper
        rows = nx + inequalities
        self.lower = np.concatenate((lower[:nx], lower[rows]))
        self.upper = np.concatenate((upper[:nx], upper[rows]))
        self.values = np.concatenate((self.x, g[inequalities]))
        self.offset, self.slopes = np.concatenate((d, offset)), np.concatenate((z, slopes))
        self.lam_g = np.zeros(g.size)
        self.lam_g[inequalities], self.lam_g[equations] = lam_i, lam_e
        self.multipliers = np.concatenate((iterate.lam_x, lam_i))
        everything = np.concatenate((self.x, g))
        beyond = np.maximum(np.maximum(lower - everything, everything - upper), 0.0)
        self.violation = float(beyond.sum())
        slack = np.where(self.multipliers > 0.0, self.upper - self.values, self.values - self.lower)
        pressed = self.multipliers != 0.0
        complementarity = np.abs(self.multipliers[pressed] * slack[pressed])
        self.residual = float(max(np.max(np.abs(reduced)), beyond.max(), np.max(complementarity, initial=0.0)))
        if not np.isfinite(self.residual):
            raise StepError("the model has no value on the way")

    def quadratic_model(self) -> tuple[FloatArray, FloatArray]:
        """Return Hessian and gradient of the model to the free variables, convex."""
        curved, along = self._of._second.call(self.x, self.p, self.lam_g, self.z.ravel(order="F"), self.d)
        hessian = self.z.T @ curved.reshape(self.z.shape, order="F")
        hessian = 0.5 * (hessian + hessian.T)
        slope = self.z.T @ (self.gradient + along)
        if _is_convex(hessian):
            return hessian, slope
        active = np.flatnonzero(self.multipliers)
        rows = self.slopes[active]
        target = np.where(self.multipliers > 0.0, self.upper, self.lower)[active]
        weight = ACTIVE_WEIGHT * max(float(np.abs(hessian).max()), 1e-6)
        # Vanishes, slope and all, where these bounds are active in the solution as well.
        convex = hessian + weight * (rows.T @ rows)
        shifted = slope - weight * rows.T @ (target - self.values[active] - self.offset[active])
        if _is_convex(convex):
            return convex, shifted
        eigenvalues, vectors = np.linalg.eigh(hessian)
        clipped = np.maximum(np.abs(eigenvalues), LEAST_CURVATURE * np.abs(eigenvalues).max())
        return (vectors * clipped) @ vectors.T, slope


def _is_convex(hessian: FloatArray) -> bool:
    shifted = hessian - LEAST_CURVATURE * np.abs(hessian.diagonal()).max() * np.eye(len(hessian))
    try:
        np.linalg.cholesky(shifted)
    except np.linalg.LinAlgError:
        return False
    return True


def _violation(values: FloatArray, lower: FloatArray, upper: FloatArray) -> float:
    return float(np.maximum(np.maximum(lower - values, values - upper), 0.0).sum())


def _dense(matrix: Any) -> FloatArray:
    found = np.zeros(matrix.shape)
    found[matrix.sparsity().get_triplet()] = matrix.nonzeros()
    return found


def _partition(equations: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Choose variables that the equations can be solved for, by complete pivoting; return them and the others.

    Raises
    ------
    StepError
        Equations depend on each other.
    """
    left = equations.copy()
    count, size = left.shape
    columns = np.arange(size)
    for step in range(count):
        rest = np.abs(left[step:, step:])
        row, column = divmod(int(rest.argmax()), size - step)
        if rest[row, column] < 1e-10:
            raise StepError("the equations depend on each other")
        row, column = row + step, column + step
        left[[step, row]] = left[[row, step]]
        left[:, [step, column]] = left[:, [column, step]]
        columns[[step, column]] = columns[[column, step]]
        left[step + 1 :, step:] -= np.outer(left[step + 1 :, step] / left[step, step], left[step, step:])
    return np.sort(columns[:count]), np.sort(columns[count:])
