"""First-order optimality of a solution, computed from scratch, and the gradient of the optimum."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlp import Label, NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution


class KktResiduals(msgspec.Struct, frozen=True):
    """How far a point is from satisfying the first-order conditions, in the scaled units of the program.

    Attributes
    ----------
    stationarity
        Largest entry of grad f + (dg/dx)' lam_g + lam_x, over s_d.
    primal_feasibility
        Largest violation of a bound on x or g.
    complementarity
        Largest product of a multiplier and the distance to its bound, over s_d; for a multiplier of an infinite
        bound, its magnitude. Equalities are left out: their distance is in `primal_feasibility`.
    worst_variable, worst_row
        Where stationarity is worst, and where feasibility or complementarity is worst.

    Notes
    -----
    s_d = max(100, mean magnitude of the multipliers) / 100 as in Waechter and Biegler, "On the implementation of an
    interior-point filter line-search algorithm", Math. Program. 106 (2006), eq. 6.

    """

    stationarity: float
    primal_feasibility: float
    complementarity: float
    worst_variable: Label
    worst_row: Label

    @property
    def largest(self) -> float:
        """The largest of the three."""
        return max(self.stationarity, self.primal_feasibility, self.complementarity)


class Optimality:
    """Derivatives of a program needed to judge and differentiate its solutions, generated once.

    Parameters
    ----------
    program
        The program the solutions belong to.

    """

    def __init__(self, program: NonlinearProgram) -> None:
        self.program = program

    @cached_property
    def _bounds_gradient(self) -> Any:
        """``(p, sides) ->`` gradient to p of the sum of the bounds, each times the multiplier that presses on it."""
        bounds = ca.vertcat(*self.program.bounds(self.program.p))
        sides = ca.SX.sym("sides", bounds.numel())
        # Infinity times a multiplier is not a number, and has no gradient.
        finite = ca.vertcat(*(ca.SX(0) if bound.is_constant() else bound for bound in ca.vertsplit(bounds)))
        gradient = ca.gradient(ca.dot(sides, finite), self.program.p)
        return ca.Function("bounds_gradient", [self.program.p, sides], [ca.densify(gradient)])

    @cached_property
    def _lagrangian_gradient(self) -> BufferedFunction:
        return BufferedFunction(self.program.composition.lagrangian_gradient)

    @cached_property
    def _values(self) -> BufferedFunction:
        return BufferedFunction(self.program.composition.values)

    def objective(self, solution: Solution) -> float:
        """Compute the objective from the variables of a solution."""
        return float(self._values.call(solution.x, solution.p)[0][0])

    def residuals(self, solution: Solution) -> KktResiduals:
        """Scaled first-order residuals of a solution, nothing taken from the solver's own report."""
        lbx, ubx, lbg, ubg = self.program.numeric_bounds(solution.p)
        gradient, _ = self._lagrangian_gradient.call(solution.x, solution.p, solution.lam_g)
        _, g = self._values.call(solution.x, solution.p)
        value, multiplier = np.concatenate((solution.x, g)), np.concatenate((solution.lam_x, solution.lam_g))
        lower, upper = np.concatenate((lbx, lbg)), np.concatenate((ubx, ubg))
        scale = max(100.0, float(np.mean(np.abs(multiplier)))) / 100.0
        stationarity = np.abs(gradient + solution.lam_x) / scale
        violation = np.maximum(np.maximum(lower - value, value - upper), 0.0)
        slack = np.where(multiplier > 0.0, upper - value, value - lower)
        slack[~np.isfinite(slack)] = 1.0
        slack[lower == upper] = 0.0
        complementarity = np.abs(multiplier * slack) / scale
        labels = (*self.program.variables, *self.program.rows)
        return KktResiduals(
            float(stationarity.max()),
            float(violation.max()),
            float(complementarity.max()),
            labels[int(stationarity.argmax())],
            labels[int(np.maximum(violation, complementarity).argmax())],
        )

    def parametric_gradient(self, solution: Solution) -> FloatArray:
        """Differentiate the optimal objective with respect to the parameters, shape (parameters,).

        The envelope theorem, with the parameters that enter through bounds: df*/dp = grad_p (f + lam_g' g)
        - lam+ . d upper/dp - lam- . d lower/dp over x and g, where lam- = min(lam, 0). Where several bounds become
        active together (a vertex) the optimum has a kink and this is the derivative to one side.
        """
        # The sides carry their sign: a negative multiplier presses on the lower bound.
        sides = [part for lam in (solution.lam_x, solution.lam_g) for part in (np.minimum(lam, 0), np.maximum(lam, 0))]
        direct = self.program.composition.lagrangian_gradient(solution.x, solution.p, solution.lam_g)[1]
        gradient = direct - self._bounds_gradient(solution.p, np.concatenate(sides))
        return np.asarray(gradient.full().ravel(), dtype=np.float64)
