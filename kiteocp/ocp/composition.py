"""A program put together from its points: derivatives of the model once for each phase, assembled sparsely.

Transcribed problems evaluate one and the same model at many points. With the outputs w of all points as variables of
their own, objective and rows are short expressions F(x, w, p) and G(x, w, p), and the chain rule gives

    dg/dx = G_x + G_w W_x,    H = L_xx + L_xw W_x + (L_xw W_x)' + W_x' L_ww W_x + sum of mu_k (second derivative of w_k)

with L the Lagrangian, W_x the derivatives of the outputs, and mu = L_w. The derivatives of w are those of one point
(`kiteocp.ocp.point_model`), generated once and mapped over the mesh, so that the work of building them does not grow
with the mesh. They are exact. The gradient of the objective has a reverse sweep of its own, a quarter of the work.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.ocp.point_model import PointModel


class PointBlock(msgspec.Struct, frozen=True, eq=False):
    """The points of one phase.

    Attributes
    ----------
    model
        The model at one of them.
    variables
        Index in x of each variable of each point, shape (variables of a point, points).
    fractions
        Time of each point over the duration of the phase, shape (points,).
    outputs
        ``SX`` symbols of the outputs of all points, shape (outputs, points); F and G are written with them.
    used
        The outputs that F or G depend on, at any point.
    """

    model: PointModel
    variables: NDArray[np.intp]
    fractions: NDArray[np.float64]
    outputs: Any
    used: tuple[int, ...] = ()

    @property
    def points(self) -> int:
        """Number of points."""
        return self.fractions.size

    @property
    def symbols(self) -> Any:
        """Symbols of the used outputs, a column, point by point."""
        return ca.vec(self.outputs[list(self.used), :])

    def needed_for(self, wanted: Any) -> PointBlock:
        """Return the block with the outputs that some expressions depend on."""
        depends = np.array(ca.which_depends(wanted, ca.vec(self.outputs), 1, False), dtype=bool)
        used = np.flatnonzero(depends.reshape(self.points, -1).any(axis=0))
        return PointBlock(self.model, self.variables, self.fractions, self.outputs, tuple(map(int, used)))

    def over_points(self, function: Any, x: Any, q: Any, *weights: Any) -> Any:
        """Evaluate a function of `PointModel` at all points: each result of a point beside that of the one before."""
        mapped = function.map(f"{function.name()}_all", "serial", self.points, [2], [])
        variables = ca.reshape(x[self.variables.T.ravel().tolist()], *self.variables.shape)
        return mapped(variables, self.fractions[None, :], q, *weights)

    def places(self, shared: NDArray[np.intp]) -> NDArray[np.intp]:
        """Index of the variables of each point, then of what all points share, shape (both, points)."""
        return np.vstack([self.variables, np.repeat(shared[:, None], self.points, axis=1)])


class Composition:
    """Values and derivatives of a program, each function built when it is first asked for.

    Parameters
    ----------
    x, p
        ``SX`` columns: variables and parameters.
    f, g
        ``SX``: objective and rows, as expressions of x, p and the outputs of the blocks.
    blocks
        Where the outputs come from; without any this is an ordinary program.
    point_parameters
        CasADi function from p to what the models of the points take: p, and what follows from it alone.
    """

    def __init__(
        self, x: Any, p: Any, f: Any, g: Any, blocks: Sequence[PointBlock] = (), point_parameters: Any = None
    ) -> None:
        self._point_parameters = point_parameters or ca.Function("point_parameters", [p], [p])
        self.x, self.p, self.f, self.g = x, p, ca.densify(f), ca.densify(g)
        kept = [block.needed_for(ca.vertcat(f, g)) for block in blocks]
        self.blocks = [block for block in kept if block.used]
        self.w = ca.vertcat(ca.SX(0, 1), *(block.symbols for block in self.blocks))
        self.lam_f, self.lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.numel())
        self.lagrangian = self.lam_f * f + ca.dot(self.lam_g, g)

    @cached_property
    def expressions(self) -> tuple[Any, Any]:
        """Objective and rows as ``SX`` expressions of x and p alone."""
        outputs, q = [], self._point_parameters(self.p)
        for block in self.blocks:
            point = block.model.values(block.used)
            for variables, fraction in zip(block.variables.T, block.fractions, strict=True):
                outputs += point.call([self.x[variables.tolist()], fraction, q])
        f, g = self._light.call([self.x, ca.vertcat(ca.SX(0, 1), *outputs), self.p])
        return f, g

    @cached_property
    def values(self) -> Any:
        """``(x, p) -> f, g``."""
        x, p = self._arguments
        return ca.Function("nlp_fg", [x, p], self._light.call([x, self._outputs, p]), ["x", "p"], ["f", "g"])

    @cached_property
    def gradient(self) -> Any:
        """``(x, p) -> f, its gradient to x``."""
        x, p = self._arguments
        f, own, mu = ca.Function(
            "light_gradient", [self.x, self.w, self.p], [self.f, *_gradients(self.f, self.x, self.w)]
        ).call([x, self._outputs, p])
        return ca.Function("nlp_grad_f", [x, p], [f, own + self._swept(mu)], ["x", "p"], ["f", "grad_f_x"])

    @cached_property
    def jacobian(self) -> Any:
        """``(x, p) -> g, its sparse Jacobian to x``."""
        x, p = self._arguments
        return ca.Function("nlp_jac_g", [x, p], self._to_x.rows(x, p), ["x", "p"], ["g", "jac_g_x"])

    @cached_property
    def slopes(self) -> Any:
        """``(x, p) -> f, its gradient, g, its sparse Jacobian to x``, which together cost little more than one."""
        x, p = self._arguments
        return ca.Function("nlp_slopes", [x, p], self._to_x.everything(x, p))

    @cached_property
    def hessian(self) -> Any:
        """``(x, p, lam_f, lam_g) -> upper triangle of the Hessian of lam_f f + lam_g' g to x``, sparse."""
        return _hessian_function(self._arguments, self.g.numel(), self._to_x.hessian)

    def of_rows(self, rows: list[int]) -> tuple[Any, Any]:
        """Return ``jacobian`` and ``hessian`` of the program that has only these rows."""
        x, p = self._arguments
        g, slopes = self.jacobian(x, p)
        jacobian = ca.Function("nlp_jac_g", [x, p], [g[rows], slopes[rows, :]], ["x", "p"], ["g", "jac_g_x"])

        def hessian(x: Any, p: Any, lam_f: Any, lam_g: Any) -> Any:
            multipliers = ca.MX.zeros(self.g.numel(), 1)
            multipliers[rows] = lam_g
            return self.hessian(x, p, lam_f, multipliers)

        return jacobian, _hessian_function(self._arguments, len(rows), hessian)

    @cached_property
    def first_order(self) -> Any:
        """``(x, p, lam_g) -> gradient of f + lam_g' g, its Hessian, and the Jacobian of g``, to x and p together."""
        x, p = self._arguments
        lam_g = ca.MX.sym("lam_g", self.g.numel())
        both = _Chain(self, with_parameters=True)
        hessian = ca.triu2symm(both.hessian(x, p, ca.MX(1.0), lam_g))
        jacobian = both.rows(x, p)[1]
        if self._derived:
            # From the parameters of the points to those of the program.
            nx = self.x.numel()
            slopes, bent = self._of_parameters(p, self._lagrangian_slopes(x, p, lam_g)[nx:])
            way = ca.diagcat(ca.MX.eye(nx), slopes)
            hessian = way.T @ hessian @ way + ca.diagcat(ca.MX(nx, nx), bent)
            jacobian = jacobian @ way
        gradient = ca.vertcat(*self.lagrangian_gradient(x, p, lam_g))
        return ca.Function("first_order", [x, p, lam_g], [gradient, hessian, jacobian])

    @cached_property
    def lagrangian_gradient(self) -> Any:
        """``(x, p, lam_g) -> gradient of f + lam_g' g to x, and to p``."""
        x, p = self._arguments
        lam_g = ca.MX.sym("lam_g", self.g.numel())
        total, nx = self._lagrangian_slopes(x, p, lam_g), self.x.numel()
        to_p = self._of_parameters(p, total[nx:])[0].T @ total[nx:] if self._derived else total[nx:]
        return ca.Function("lagrangian_gradient", [x, p, lam_g], [total[:nx], to_p])

    def _lagrangian_slopes(self, x: Any, p: Any, lam_g: Any) -> Any:
        """Return the gradient of f + lam_g' g to x and the parameters of the points, in terms of `_arguments`."""
        lagrangian = self.f + ca.dot(self.lam_g, self.g)
        derived = ca.SX.sym("derived", self._derived)
        both = ca.vertcat(self.x, self.p, derived)
        own, mu = ca.Function(
            "light_gradient", [self.x, self.w, self.p, self.lam_g], _gradients(lagrangian, both, self.w)
        ).call([x, self._outputs, p, lam_g])
        return own + self._swept(mu, with_parameters=True)

    @property
    def _derived(self) -> int:
        """How many of the points' parameters are derived from those of the program."""
        return int(self._point_parameters.numel_out(0)) - int(self.p.numel())

    @cached_property
    def _of_parameters(self) -> Any:
        """``(p, weights) -> derivatives of the points' parameters to p, second ones of their weighted sum``."""
        (q,), weights = self._point_parameters.call([self.p]), ca.SX.sym("weights", self.p.numel() + self._derived)
        bent, _ = ca.hessian(ca.dot(weights, q), self.p)
        return ca.Function("of_parameters", [self.p, weights], [ca.jacobian(q, self.p), bent])

    @cached_property
    def _arguments(self) -> tuple[Any, Any]:
        return ca.MX.sym("x", self.x.numel()), ca.MX.sym("p", self.p.numel())

    @cached_property
    def _light(self) -> Any:
        return ca.Function("light", [self.x, self.w, self.p], [self.f, self.g])

    @cached_property
    def _outputs(self) -> Any:
        """Outputs of all points, a column, in terms of `_arguments`."""
        x, p = self._arguments
        q = self._point_parameters(p)
        found = (ca.vec(block.over_points(block.model.values(block.used), x, q)) for block in self.blocks)
        return ca.vertcat(ca.MX(0, 1), *found)

    @cached_property
    def _to_x(self) -> _Chain:
        return _Chain(self)

    def _swept(self, mu: Any, *, with_parameters: bool = False) -> Any:
        """Return W_x' mu (or to x and p): the part of a gradient that goes through the points."""
        nx, (x, p) = self.x.numel(), self._arguments
        q = self._point_parameters(p)
        shared = np.arange(nx, nx + q.numel() if with_parameters else nx, dtype=np.intp)
        total = ca.MX.zeros(nx + shared.size, 1)
        for block, weights in zip(self.blocks, self.by_block(mu), strict=True):
            sweep = block.model.sweep(block.used, with_parameters)
            found = block.over_points(sweep, x, q, weights)
            places = block.places(shared).T.ravel()
            # Rows of the sum, columns of the parts.
            pattern = ca.Sparsity.triplet(nx + shared.size, places.size, places.tolist(), list(range(places.size)))
            total += ca.DM(pattern, 1.0) @ ca.vec(found)
        return total

    def by_block(self, column: Any) -> list[Any]:
        """Split a column with an entry for each of w into one matrix for each block, a column for each point."""
        ends = np.cumsum([0, *(len(block.used) * block.points for block in self.blocks)]).tolist()
        parts = ca.vertsplit(column, ends) if self.blocks else []
        return [ca.reshape(part, -1, block.points) for part, block in zip(parts, self.blocks, strict=True)]


class _Chain:
    """The chain rule to x, or to x and p: W_x from the slopes of the points, and what is made of it."""

    def __init__(self, owner: Composition, *, with_parameters: bool = False) -> None:
        self._owner, self._with_parameters = owner, with_parameters
        # What is derived from the parameters stands beside them; the expressions of the program do not know it.
        derived = ca.SX.sym("derived", owner._derived)
        self._u = ca.vertcat(owner.x, owner.p, derived) if with_parameters else owner.x
        nx = owner.x.numel()
        self._shared = np.arange(nx, self._u.numel(), dtype=np.intp)
        self._slopes = [block.model.slopes(block.used, with_parameters) for block in owner.blocks]
        self._slope_symbols, offset = [], 0
        self._w_u = ca.SX(owner.w.numel(), self._u.numel())
        for block, function in zip(owner.blocks, self._slopes, strict=True):
            pattern = function.sparsity_out(1)
            symbols = ca.SX.sym("slope", ca.repmat(pattern, 1, block.points))
            self._slope_symbols.append(symbols)
            row, column = (np.array(part, dtype=np.intp) for part in pattern.get_triplet())
            rows = (offset + np.arange(block.points)[:, None] * len(block.used) + row).ravel()
            columns = block.places(self._shared)[column].T.ravel()
            self._w_u += _scattered(rows, columns, symbols, self._w_u.shape)
            offset += len(block.used) * block.points

    def rows(self, x: Any, p: Any) -> list[Any]:
        """Return rows and their Jacobian."""
        owner = self._owner
        w, slopes = self._points(x, p)
        jacobian = ca.jacobian(owner.g, self._u) + ca.jacobian(owner.g, owner.w) @ self._w_u
        arguments = [owner.x, owner.w, owner.p, *self._slope_symbols]
        return list(ca.Function("rows", arguments, [owner.g, jacobian]).call([x, w, p, *slopes]))

    def everything(self, x: Any, p: Any) -> list[Any]:
        """Return the objective, its gradient, the rows and their Jacobian."""
        owner = self._owner
        w, slopes = self._points(x, p)
        both = ca.vertcat(owner.f, owner.g)
        jacobian = ca.jacobian(both, self._u) + ca.jacobian(both, owner.w) @ self._w_u
        arguments = [owner.x, owner.w, owner.p, *self._slope_symbols]
        results = [owner.f, ca.densify(jacobian[0, :].T), owner.g, jacobian[1:, :]]
        return list(ca.Function("everything", arguments, results).call([x, w, p, *slopes]))

    def hessian(self, x: Any, p: Any, lam_f: Any, lam_g: Any) -> Any:
        """Return the upper triangle of the Hessian of the Lagrangian."""
        owner = self._owner
        own, gradient = ca.hessian(owner.lagrangian, self._u)
        mu = ca.gradient(owner.lagrangian, owner.w)
        mixed = ca.jacobian(gradient, owner.w) @ self._w_u
        total = own + mixed + mixed.T + self._w_u.T @ ca.jacobian(mu, owner.w) @ self._w_u
        light = [owner.x, owner.w, owner.p, owner.lam_f, owner.lam_g]
        w, slopes = self._points(x, p)
        q = owner._point_parameters(p)
        weights = ca.Function("weights", light, [ca.densify(mu)])(x, w, p, lam_f, lam_g)
        curvatures, symbols = [], []
        for block, weight in zip(owner.blocks, owner.by_block(weights), strict=True):
            function = block.model.curvature(block.used, self._with_parameters)
            curvatures.append(block.over_points(function, x, q, weight))
            pattern = function.sparsity_out(0)
            symbols.append(ca.SX.sym("curvature", ca.repmat(pattern, 1, block.points)))
            row, column = (np.array(part, dtype=np.intp) for part in pattern.get_triplet())
            places = block.places(self._shared)
            total += _scattered(places[row].T.ravel(), places[column].T.ravel(), symbols[-1], total.shape)
        arguments = [*light, *self._slope_symbols, *symbols]
        assembled = ca.Function("hessian", arguments, [ca.triu(total)])
        return assembled(x, w, p, lam_f, lam_g, *slopes, *curvatures)

    def _points(self, x: Any, p: Any) -> tuple[Any, list[Any]]:
        """Evaluate the outputs of all points, a column, and their slopes, block by block."""
        owner = self._owner
        q = owner._point_parameters(p)
        found = [block.over_points(f, x, q) for block, f in zip(owner.blocks, self._slopes, strict=True)]
        return ca.vertcat(ca.MX(0, 1), *(ca.vec(w) for w, _ in found)), [slopes for _, slopes in found]


def _gradients(expression: Any, *to: Any) -> list[Any]:
    return [ca.densify(ca.gradient(expression, part)) for part in to]


def _hessian_function(arguments: tuple[Any, Any], rows: int, of: Any) -> Any:
    """Return a Hessian with the signature that CasADi's solvers take."""
    inputs = [*arguments, ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)]
    return ca.Function("nlp_hess_l", inputs, [of(*inputs)], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])


def _scattered(rows: NDArray[np.intp], columns: NDArray[np.intp], values: Any, shape: tuple[int, int]) -> Any:
    """Put the nonzeros of a matrix at these places of another; where a place repeats they are added."""
    pattern = ca.Sparsity.triplet(*shape, rows.tolist(), columns.tolist())
    at, parts = pattern.get_nz((rows + shape[0] * columns).tolist()), list(range(rows.size))
    added = ca.DM(ca.Sparsity.triplet(pattern.nnz(), rows.size, at, parts), 1.0) @ ca.SX(
        ca.Sparsity.dense(rows.size, 1), values.nz[:]
    )
    return ca.SX(pattern, added)
