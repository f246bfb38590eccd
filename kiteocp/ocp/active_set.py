"""A solution on its active set: polished to rounding and differentiated with respect to the parameters.

An interior-point solution leaves its mark on every multiplier: what is not active carries some 1e-9. Here the active
constraints become equations and Newton's method solves the first-order conditions exactly; inactive constraints have
no multiplier at all, so that a parameter without influence has a derivative of zero. The same linear system gives the
derivatives of the solution with respect to the parameters (Fiacco, *Introduction to Sensitivity and Stability
Analysis in Nonlinear Programming*, 1983). `kiteocp.ocp.continuation` goes on from here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiteocp.ocp.active_solution import ActiveSet, ActiveSetError, Derivatives, PolishedSolution
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.first_order import FirstOrderSystem, dense
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution

#: Newton's method takes its last step below the first, in the scaled units of the program, and none below the second:
#: rounding leaves about 1e-13.
POLISHED, EXACT = 1e-9, 1e-12
NEWTON_STEPS = 12

#: A bound is active where its multiplier exceeds its slack, both scaled; where the two are within this factor of each
#: other the solver has not decided, and neither side may be trusted.
UNDECIDED = 1e2

#: A constraint whose gradient has no more than this of itself outside the span of the others is implied by them.
INDEPENDENT = 1e-9

#: Bounds that may change sides before a solution counts as lost.
CHANGES = 12

#: The least slack and multiplier that a polished solution may show with the wrong sign.
ROUNDING = 1e-9


class ActiveSetMethod:
    """Newton's method and derivatives on the active set of one program."""

    def __init__(self, program: NonlinearProgram) -> None:
        self.program = program
        self._system = FirstOrderSystem(program)
        self.nx, self.np_, self.ng = program.x.numel(), program.p.numel(), program.g.numel()

    def active_set_of(self, solution: Solution) -> ActiveSet:
        """Read the active set off an interior-point solution."""
        lower, upper = self._system.sides(solution.p)
        value = np.concatenate((solution.x, solution.g))
        multiplier = np.concatenate((solution.lam_x, solution.lam_g))
        slack_low, slack_high = value - lower, upper - value
        pressing_low = -multiplier > slack_low
        pressing_high = multiplier > slack_high
        active = np.where(pressing_low, -1, np.where(pressing_high, 1, 0)).astype(np.int8)
        active[lower == upper] = 1
        slack = np.where(multiplier < 0, slack_low, slack_high)
        size = np.abs(multiplier)
        near = (slack < 1e-3) & (size < 1e-3) & (lower != upper)
        ratio = size / np.maximum(slack, 1e-300)
        undecided = near & (ratio > 1 / UNDECIDED) & (ratio < UNDECIDED)
        labels = (*self.program.variables, *self.program.rows)
        weak = tuple(labels[i] for i in np.flatnonzero(undecided))
        active[self._dependent(solution, active, multiplier)] = 0
        return ActiveSet(active[: self.nx], active[self.nx :], weak)

    def _dependent(self, solution: Solution, active: NDArray[np.int8], multiplier: FloatArray) -> NDArray[np.intp]:
        """Find active bounds that the others imply, such as a length bounded on both sides of a phase change.

        Equalities come first, then bounds by multiplier; one that adds nothing to those before it is implied.
        """
        jacobian = dense(self._system.newton(solution.x, solution.p, solution.lam_g)[4])
        rows = np.vstack((np.eye(self.nx), jacobian))
        lower, upper = self._system.sides(solution.p)
        own = np.flatnonzero(active)
        own = own[np.lexsort((-np.abs(multiplier[own]), lower[own] != upper[own]))]
        columns = rows[own].T / np.maximum(np.linalg.norm(rows[own], axis=1), 1e-12)
        independent: list[int] = []
        basis = np.zeros((self.nx, 0))
        for position in range(own.size):
            column = columns[:, position]
            rest = column - basis @ (basis.T @ column)
            rest -= basis @ (basis.T @ rest)
            length = float(np.linalg.norm(rest))
            if length > INDEPENDENT:
                independent.append(position)
                basis = np.column_stack((basis, rest / length))
        return np.delete(own, independent)

    def polish(self, solution: Solution | PolishedSolution, active: ActiveSet, p: FloatArray) -> PolishedSolution:
        """Solve the first-order conditions with the active bounds as equations, from a nearby solution.

        Raises
        ------
        ActiveSetError
            The system is singular, or Newton's method does not converge.
        """
        x, lam_g = solution.x.copy(), np.where(active.rows != 0, solution.lam_g, 0.0)
        lam_x = np.where(active.variables != 0, solution.lam_x, 0.0)
        own, _ = self._system.own_rows(active)
        lower, upper = self._system.sides(p)
        bounds = np.where(np.concatenate((active.variables, active.rows)) > 0, upper, lower)[own]
        multipliers = np.concatenate((lam_x, lam_g))
        for _ in range(NEWTON_STEPS):
            f, g, gradient, hessian, rows = self._system.newton(x, p, multipliers[self.nx :])
            distance = np.concatenate((x, g))[own] - bounds
            residual = np.concatenate((gradient + multipliers[: self.nx], distance))
            size = float(np.max(np.abs(residual)))
            if not np.isfinite(size):
                raise ActiveSetError("the model has no value on the way")
            if size > EXACT:
                step = self._system.solve(hessian, rows, own, -residual[:, None])[:, 0]
                x = x + step[: self.nx]
                multipliers[own] += step[self.nx :]
            if size <= POLISHED:
                lam_x, lam_g = multipliers[: self.nx].copy(), multipliers[self.nx :].copy()
                value = np.concatenate((x, g))
                nearer_lower = value - lower < upper - value
                return PolishedSolution(x, g, lam_x, lam_g, p, f, active, nearer_lower)
        raise ActiveSetError("Newton's method does not converge on this active set")

    def polish_and_correct(
        self, solution: Solution | PolishedSolution, active: ActiveSet, p: FloatArray
    ) -> PolishedSolution:
        """Polish, changing one bound at a time until the active set is right.

        An interior-point solution may not tell which of two neighbouring points a limit is left at.

        Raises
        ------
        ActiveSetError
            As `polish`, or no right active set is found near the given one.
        """
        for _ in range(CHANGES):
            polished = self.polish(solution, active, p)
            slacks, pressures = self.margins(polished)
            worst = np.minimum(slacks, pressures)
            index = int(np.argmin(worst))
            if worst[index] >= -ROUNDING:
                return polished
            both = np.concatenate((active.variables, active.rows))
            if both[index]:
                both[index] = 0
            else:
                both[index] = -1 if polished.nearer_lower[index] else 1
            active = ActiveSet(both[: self.nx], both[self.nx :], active.weak)
            solution = polished
        raise ActiveSetError("no active set near the solution satisfies the first-order conditions")

    def derivatives(self, polished: PolishedSolution, directions: FloatArray | None = None) -> Derivatives:
        """Differentiate a polished solution along directions of the parameter vector.

        Parameters
        ----------
        polished
            The solution.
        directions
            Shape (parameters, directions); each parameter for itself where left out.

        Raises
        ------
        ActiveSetError
            The system is singular.
        """
        way = np.eye(self.np_) if directions is None else directions
        gradient, hessian, jacobian = (dense(v) for v in self._system.first(polished.x, polished.p, polished.lam_g))
        bounds = dense(self._system.bound_slopes(polished.p)) @ way
        own, side = self._system.own_rows(self._sided(polished))
        rows = np.vstack((np.eye(self.nx), jacobian[:, : self.nx]))
        direct = np.vstack((np.zeros((self.nx, way.shape[1])), jacobian[:, self.nx :] @ way))
        # Distance of each active bound: value - bound(p).
        distance = direct[own] - bounds[side]
        cross = hessian[: self.nx, self.nx :] @ way
        _, _, _, curved, linear = self._system.newton(polished.x, polished.p, polished.lam_g)
        slopes = self._system.solve(curved, linear, own, -np.vstack((cross, distance)))
        x, multiplier = slopes[: self.nx], slopes[self.nx :]
        pressing = np.concatenate((polished.lam_x, polished.lam_g))[own]
        objective = gradient[self.nx :, 0] @ way - pressing @ bounds[side]
        weights = np.zeros(bounds.shape[0])
        weights[side] = pressing
        # Total derivative of the gradient of the Lagrangian, its bounds included, along the solution.
        curvature = hessian[self.nx :, self.nx :] - dense(self._system.curvature(polished.p, weights))
        second = way.T @ curvature @ way + cross.T @ x + distance.T @ multiplier
        multipliers, pressed = np.zeros((2, self.nx + self.ng, way.shape[1]))
        multipliers[own], pressed[own] = multiplier, bounds[side]
        x_lower, x_upper, g_lower, g_upper = np.split(bounds, np.cumsum([self.nx, self.nx, self.ng]))
        lower, upper = np.vstack((x_lower, g_lower)), np.vstack((x_upper, g_upper))
        return Derivatives(objective, x, rows @ x + direct, multipliers, lower, upper, pressed, second)

    def _sided(self, polished: PolishedSolution) -> ActiveSet:
        """Return the active set with what equal bounds fix at that of the two which its multiplier speaks for."""
        lower, upper = self._system.sides(polished.p)
        active = np.concatenate((polished.active.variables, polished.active.rows))
        multiplier = np.concatenate((polished.lam_x, polished.lam_g))
        active[(lower == upper) & (active != 0) & (multiplier < 0.0)] = -1
        return ActiveSet(active[: self.nx], active[self.nx :])

    def margins(self, polished: PolishedSolution) -> tuple[FloatArray, FloatArray]:
        """Slacks of the inactive bounds and signed multipliers of the active ones; negative means another active set.

        Returns
        -------
        slacks : ndarray, shape (variables + rows,)
            Distance to the nearest bound, infinite for active ones.
        pressures : ndarray, shape (variables + rows,)
            Multiplier in the direction in which the bound may press, infinite for inactive ones and equalities.
        """
        lower, upper = self._system.sides(polished.p)
        value = np.concatenate((polished.x, polished.g))
        active = np.concatenate((polished.active.variables, polished.active.rows))
        multiplier = np.concatenate((polished.lam_x, polished.lam_g))
        slacks = np.where(active == 0, np.minimum(value - lower, upper - value), np.inf)
        pressures = np.where((active != 0) & (lower != upper), active * multiplier, np.inf)
        return slacks, pressures

    def pressing(
        self, polished: PolishedSolution, directions: FloatArray, within: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
        """Collect all bounds that a solution sits at, whether or not they carry a multiplier.

        Parameters
        ----------
        polished
            The solution.
        directions
            Of the parameters, shape (parameters, directions).
        within
            Distance (scaled) up to which it sits at a bound.

        Returns
        -------
        gradients : ndarray, shape (bounds, variables)
            Of the variables and rows.
        slopes : ndarray, shape (bounds, directions)
            Of value minus bound, with the variables held.
        multipliers, signs : ndarray, shape (bounds,)
            The multipliers of this solution, and the sign that each must have (0: any).
        held : ndarray, shape (bounds,)
            Which belong to the active set.
        """
        lower, upper = self._system.sides(polished.p)
        value = np.concatenate((polished.x, polished.g))
        low, high = value - lower <= within, upper - value <= within
        side = np.where(low & high, 0, np.where(high, 1, -1))
        at = np.flatnonzero(low | high)
        _, _, jacobian = (dense(v) for v in self._system.first(polished.x, polished.p, polished.lam_g))
        rows = np.vstack((np.eye(self.nx, self.nx + self.np_), jacobian))[at]
        pressed = np.where(low | high, np.where(side < 0, -1, 1), 0).astype(np.int8)
        bounds = dense(self._system.bound_slopes(polished.p))[
            self._system.own_rows(ActiveSet(pressed[: self.nx], pressed[self.nx :]))[1]
        ]
        multipliers = np.concatenate((polished.lam_x, polished.lam_g))[at]
        held = np.concatenate((polished.active.variables, polished.active.rows))[at] != 0
        slopes = (rows[:, self.nx :] - bounds) @ directions
        return rows[:, : self.nx], slopes, multipliers, side[at].astype(float), held

    def combinations(self, polished: PolishedSolution, gradients: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Write gradients as combinations of those of the active bounds, as far as they can be.

        Parameters
        ----------
        polished
            The solution.
        gradients
            Shape (variables, gradients).

        Returns
        -------
        rest : ndarray, shape (variables, gradients)
            Zero for a gradient that is such a combination.
        shares : ndarray, shape (active bounds, gradients)
            Of each active bound.
        """
        own, _ = self._system.own_rows(polished.active)
        _, _, _, hessian, rows = self._system.newton(polished.x, polished.p, polished.lam_g)
        right = np.vstack((gradients, np.zeros((own.size, gradients.shape[1]))))
        return tuple(np.split(self._system.solve(hessian, rows, own, right), [self.nx]))  # type: ignore[return-value]
