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

import contextlib
import copy
import time
from functools import cached_property
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import replace
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


class _Iterate(msgspec.Struct, frozen=True):
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
        self._entries = np.concatenate((np.arange(nx), nx + self._inequalities))
        jacobian = _dense(program.composition.jacobian(base.x, base.p)[1])
        self._basic, self._free = _partition(jacobian[self._equations])
        self._inverse = np.linalg.inv(jacobian[np.ix_(self._equations, self._basic)])
        self._rows = jacobian[self._inequalities]

    @cached_property
    def _first(self) -> BufferedFunction:
        """What an iterate is judged by: see `_Linearisation`."""
        composed, (e, i) = self.program.composition, (self._equations.tolist(), self._inequalities.tolist())
        b, n = self._basic.tolist(), self._free.tolist()
        nx, np_ = len(self.program.variables), composed.p.numel()
        x, p = ca.MX.sym("x", nx), ca.MX.sym("p", np_)
        lam_x, lam_i = ca.MX.sym("lam_x", nx), ca.MX.sym("lam_i", len(i))
        f, gradient, g, jacobian = composed.slopes(x, p)
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
    def _lagrangian_gradient(self) -> BufferedFunction:
        return BufferedFunction(self.program.composition.lagrangian_gradient)

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
            iterate = self._home if start is self.base else self._decided(start)
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

    @cached_property
    def _home(self) -> _Iterate:
        return self._decided(self.base)

    @cached_property
    def _at_home(self) -> _Linearisation:
        """The linearisation at the base, with memory of its own."""
        at = _Linearisation(self, self.base.p, self._home, self._bounds_of(self.base.p))
        for name in ("g", "gradient", "lam_e", "d", "z"):
            setattr(at, name, getattr(at, name).copy())
        hessian, slope, curved = at._model
        at._model = hessian, slope, curved.copy()
        return at

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
        sides = self._bounds_of(p)
        if iterate is self._home:
            # Without a step from there the iterations begin at the base itself.
            with contextlib.suppress(StepError):
                iterate = self._step(self._at_home.with_parameters(p, sides), iterate, p)
        for count in range(MOST_ITERATIONS):
            at = _Linearisation(self, p, iterate, sides)
            if at.residual <= CONVERGED:
                return replace(iterate, lam_g=at.lam_g), at.f, at.g.copy(), count
            iterate = self._step(at, iterate, p)
        raise StepError("it does not converge")

    def _step(self, at: _Linearisation, iterate: _Iterate, p: FloatArray) -> _Iterate:
        """Take one step."""
        low, high = at.lower - at.values - at.offset, at.upper - at.values - at.offset
        z, multipliers = solve_quadratic(*at.quadratic_model(), at.slopes, low, high)
        nx = iterate.x.size
        step = at.d + at.z @ z
        # Equalities have their multipliers from the next linearisation.
        lam_x, lam_i = multipliers[:nx], multipliers[nx:]
        lam_g = np.zeros(at.g.size)
        lam_g[self._inequalities], lam_g[self._equations] = lam_i, at.lam_e
        largest = max(np.max(np.abs(at.lam_e), initial=0.0), np.max(np.abs(multipliers), initial=0.0))
        share = self._share(at, iterate.x, p, step, 2.0 * float(largest) + 1.0)
        if share < 1.0:
            lam_x = iterate.lam_x + share * (lam_x - iterate.lam_x)
            lam_g = iterate.lam_g + share * (lam_g - iterate.lam_g)
        return _Iterate(iterate.x + share * step, lam_x, lam_g)

    def _share(self, at: _Linearisation, x: FloatArray, p: FloatArray, step: FloatArray, price: float) -> float:
        """Return how much of a step decreases the l1 merit function, a violation of one costing the price, enough."""
        merit = at.f + price * at.violation
        descent = min(float(at.gradient @ step) - price * at.violation, 0.0)
        share = 1.0
        while share >= LEAST_SHARE:
            (f,), g = self._values.call(x + share * step, p)
            here = float(f) + price * float(_beyond(np.concatenate((x + share * step, g)), *at.sides).sum())
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
    lam_e, lam_g, multipliers
        Multipliers of the equations that fit those of the inequalities, of all rows, of variables and inequalities.
    sides
        Bounds of variables and rows.
    values, lower, upper
        Of variables and inequalities, and their bounds.
    d, z, offset, slopes
        A step is d + z times the free step; values change by offset + slopes times the free step.
    violation, residual
        Sum of what bounds are exceeded by, and the largest first-order residual.
    """

    def __init__(
        self, of: Neighbourhood, p: FloatArray, iterate: _Iterate, sides: tuple[FloatArray, FloatArray]
    ) -> None:
        self._of, self._p, self._iterate = of, p, iterate
        nx, free, lam_i = iterate.x.size, of._free.size, iterate.lam_g[of._inequalities]
        f, self.g, self.gradient, self.lam_e, reduced, self.d, z, offset, slopes = of._first.call(
            iterate.x, p, iterate.lam_x, lam_i
        )
        self.f = float(f[0])
        self.z, slopes = z.reshape((nx, free), order="F"), slopes.reshape((lam_i.size, free), order="F")
        self.offset, self.slopes = np.concatenate((self.d, offset)), np.concatenate((self.z, slopes))
        self.lam_g = np.zeros(self.g.size)
        self.lam_g[of._inequalities], self.lam_g[of._equations] = lam_i, self.lam_e
        self.multipliers = np.concatenate((iterate.lam_x, lam_i))
        beyond = self._compare(sides)
        pressed = np.flatnonzero(self.multipliers)
        complementarity = np.abs(self.multipliers[pressed] * self._distances()[pressed])
        self.residual = float(max(np.max(np.abs(reduced)), beyond, np.max(complementarity, initial=0.0)))
        if not np.isfinite(self.residual):
            raise StepError("the model has no value on the way")

    def _compare(self, sides: tuple[FloatArray, FloatArray]) -> float:
        """Compare the values with their bounds; return by how much one is exceeded at most."""
        self.sides, entries = sides, self._of._entries
        everything = np.concatenate((self._iterate.x, self.g))
        self.lower, self.upper, self.values = sides[0][entries], sides[1][entries], everything[entries]
        beyond = _beyond(everything, *sides)
        self.violation = float(beyond.sum())
        return float(beyond.max())

    def _distances(self) -> FloatArray:
        """Return how far each value is from the bound that its multiplier presses on."""
        pressed = np.where(self.multipliers > 0.0, self.upper, self.lower)
        return np.asarray(pressed - self.values, dtype=np.float64)

    @cached_property
    def _model(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Hessian and gradient to the free variables, and the Hessian times z of the Lagrangian."""
        curved, along = self._of._second.call(self._iterate.x, self._p, self.lam_g, self.z.ravel(order="F"), self.d)
        curved = curved.reshape(self.z.shape, order="F")
        hessian = self.z.T @ curved
        return 0.5 * (hessian + hessian.T), self.z.T @ (self.gradient + along), curved

    def with_parameters(self, p: FloatArray, sides: tuple[FloatArray, FloatArray]) -> _Linearisation:
        """Return the same with values at other parameters, and derivatives as they are.

        A step from there is nearly as good as one with derivatives at these parameters, and takes a tenth of the time:
        where these change by some per cent, so does the solution.
        """
        of, x = self._of, self._iterate.x
        moved = copy.copy(self)
        (moved.f,), g = of._values.call(x, p)
        moved.g = g.copy()
        to_x, _ = of._lagrangian_gradient.call(x, p, self.lam_g)
        hessian, _, curved = self._model
        moved._compare(sides)
        d = np.zeros(x.size)
        d[of._basic] = -of._inverse @ moved.g[of._equations]
        moved.d, moved.offset = d, np.concatenate((d, of._rows @ d))
        # The multipliers of this point, at which the gradient is that of the Lagrangian of all rows.
        lam_i = self.multipliers[x.size :]
        slope = self.z.T @ to_x - self.slopes[x.size :].T @ lam_i + curved.T @ d
        moved._model = hessian, slope, curved
        return moved

    def quadratic_model(self) -> tuple[FloatArray, FloatArray]:
        """Return Hessian and gradient of the model to the free variables, convex."""
        hessian, slope, _ = self._model
        if _is_convex(hessian):
            return hessian, slope
        active = np.flatnonzero(self.multipliers)
        rows = self.slopes[active]
        weight = ACTIVE_WEIGHT * max(float(np.abs(hessian).max()), 1e-6)
        # Vanishes, slope and all, where these bounds are active in the solution as well.
        convex = hessian + weight * (rows.T @ rows)
        if _is_convex(convex):
            return convex, slope - weight * rows.T @ (self._distances() - self.offset)[active]
        eigenvalues, vectors = np.linalg.eigh(hessian)
        clipped = np.maximum(np.abs(eigenvalues), LEAST_CURVATURE * np.abs(eigenvalues).max())
        return (vectors * clipped) @ vectors.T, slope


def _is_convex(hessian: FloatArray) -> bool:
    diagonal = hessian.diagonal()
    shifted = hessian.copy()
    np.fill_diagonal(shifted, diagonal - LEAST_CURVATURE * np.abs(diagonal).max())
    try:
        np.linalg.cholesky(shifted)
    except np.linalg.LinAlgError:
        return False
    return True


def _beyond(values: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return by how much each value exceeds its bounds."""
    return np.asarray(np.maximum(np.maximum(lower - values, values - upper), 0.0), dtype=np.float64)


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
