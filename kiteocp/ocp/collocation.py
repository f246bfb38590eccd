"""Radau collocation on [0, 1]: points, weights, differentiation and interpolation.

The right Radau points contain the end of the interval, so the last collocation point of an interval is the start of
the next one and a stiff component is damped (the scheme is the Radau IIA Runge-Kutta method [1]_). The weights are
computed here from the closed form because ``casadi.collocation_coeff`` gives 0.5 instead of 1 for degree 1.

References
----------
.. [1] E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, Springer, 1996, section IV.5.
.. [2] J.-P. Berrut and L. N. Trefethen, "Barycentric Lagrange interpolation", SIAM Review 46 (2004) 501-517.
.. [3] R. T. Farouki, "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric Design 29
   (2012) 379-419.

"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property
from math import comb

import msgspec
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

MAX_DEGREE = 20
"""Above this the equations are dense and ill-scaled; more intervals are the better choice."""


def _frozen(values: FloatArray) -> FloatArray:
    """Return the array marked read-only, since cached results are shared."""
    values.setflags(write=False)
    return values


@cache
def radau_points(degree: int) -> FloatArray:
    """Right Radau points on (0, 1], the last one exactly 1.

    Parameters
    ----------
    degree
        Number of points, 1 to `MAX_DEGREE`.

    Returns
    -------
    ndarray, shape (degree,)
        Increasing; exact for polynomials up to degree ``2 degree - 2`` with `radau_weights`.

    Raises
    ------
    ValueError
        If the degree is outside its range.

    """
    if not 1 <= degree <= MAX_DEGREE:
        raise ValueError(f"collocation degree must be between 1 and {MAX_DEGREE}, not {degree}")
    # On [-1, 1] the right Radau points are the roots of P_d - P_(d-1), which has the root 1.
    coefficients = np.zeros(degree + 1)
    coefficients[-2:] = -1.0, 1.0
    roots = np.sort(legendre.legroots(coefficients).real)
    slope = legendre.legder(coefficients)
    for _ in range(3):  # Newton: the companion matrix loses a few digits at high degree
        roots -= legendre.legval(roots, coefficients) / legendre.legval(roots, slope)
    points = (roots + 1.0) / 2.0
    points[-1] = 1.0
    return _frozen(points)


@cache
def radau_weights(degree: int) -> FloatArray:
    """Quadrature weights at `radau_points`, summing to 1, shape (degree,)."""
    roots = 2.0 * radau_points(degree) - 1.0
    previous = legendre.legval(roots, np.eye(degree)[-1])  # P_(d-1), which is 1 at the right end
    return _frozen((1.0 + roots) / (2.0 * degree**2 * previous**2))


def _barycentric_weights(nodes: FloatArray) -> FloatArray:
    """Weights of the barycentric formula, scaled to a largest magnitude of 1 ([2]_, eq. 3.2)."""
    difference = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(difference, 1.0)
    weights = 1.0 / np.prod(4.0 * difference, axis=1)  # 4 = 1 / capacity of [0, 1]: no under- or overflow
    return np.asarray(weights / np.max(np.abs(weights)), dtype=np.float64)


def interpolation_matrix(nodes: FloatArray, targets: ArrayLike) -> FloatArray:
    """Matrix that takes values at `nodes` to the values of their polynomial at `targets`.

    Parameters
    ----------
    nodes
        Distinct nodes, shape (n,).
    targets
        Where to evaluate, shape (m,); outside the nodes the polynomial is extrapolated.

    Returns
    -------
    ndarray, shape (m, n)

    """
    weights = _barycentric_weights(nodes)
    difference = np.atleast_1d(np.asarray(targets, dtype=float))[:, None] - nodes[None, :]
    hit = np.abs(difference) < 1e-200  # nearer than this the quotients overflow, and the value is the node's
    ratio = weights / np.where(hit, 1.0, difference)
    rows = hit.any(axis=1)
    ratio[rows] = hit[rows]
    return np.asarray(ratio / np.sum(ratio, axis=1, keepdims=True), dtype=np.float64)


@cache
def differentiation_matrix(degree: int) -> FloatArray:
    """Differentiate at the Radau points the polynomial through the interval start and them.

    Returns
    -------
    ndarray, shape (degree, degree + 1)
        Row k, applied to the values at 0 and at the `radau_points`, gives the slope at point k per unit of interval.

    """
    nodes = np.concatenate(([0.0], radau_points(degree)))
    weights = _barycentric_weights(nodes)
    difference = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(difference, 1.0)
    matrix = (weights[None, :] / weights[:, None]) / difference
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))  # constants have no slope, to the last bit
    return _frozen(matrix[1:])


@cache
def continuous_nodes(degree: int, first: bool) -> FloatArray:
    """Nodes on [0, 1] of a continuous curve in one interval: its points, and the end of the interval before.

    The first interval of a phase has none before it.
    """
    points = radau_points(degree)
    return points if first else _frozen(np.concatenate(([0.0], points)))


@cache
def slope_bounds_matrix(degree: int, first: bool) -> FloatArray:
    """Matrix from values at `continuous_nodes` to the Bernstein coefficients of the slope of their polynomial.

    A polynomial lies between the least and the largest of its Bernstein coefficients [3]_: where these are within
    bounds the slope is within them everywhere in the interval, not only at its points.

    Returns
    -------
    ndarray, shape (len(nodes) - 1, len(nodes))
        Per unit of interval.

    """
    nodes = continuous_nodes(degree, first)
    order = nodes.size - 1
    basis = [
        [comb(order, k) * node**k * (1.0 - node) ** (order - k) for k in range(order + 1)] for node in nodes.tolist()
    ]
    # The slope has the differences of a polynomial's Bernstein coefficients, times its degree, for its own.
    return _frozen(order * np.diff(np.linalg.inv(np.array(basis)), axis=0))


class PhaseMesh(msgspec.Struct, frozen=True, dict=True):
    """How one phase is divided: a polynomial degree and the share of each interval.

    Attributes
    ----------
    degree
        Number of Radau points per interval, 1 to `MAX_DEGREE`.
    interval_fractions
        Length of each interval as a fraction of the phase; positive, summing to 1.

    """

    degree: int
    interval_fractions: tuple[float, ...]

    def __post_init__(self) -> None:
        radau_points(self.degree)  # rejects a degree out of range
        fractions = np.asarray(self.interval_fractions, dtype=float)
        if not fractions.size or not np.all(fractions > 0.0) or abs(fractions.sum() - 1.0) > 1e-9:
            raise ValueError(f"interval fractions must be positive and sum to 1, not {self.interval_fractions}")

    @classmethod
    def uniform(cls, intervals: int, degree: int) -> PhaseMesh:
        """Mesh of equal intervals."""
        if intervals < 1:
            raise ValueError(f"a phase needs at least one interval, not {intervals}")
        return cls(degree, (1.0 / intervals,) * intervals)

    @property
    def intervals(self) -> int:
        """Number of intervals."""
        return len(self.interval_fractions)

    @cached_property
    def borders(self) -> FloatArray:
        """Interval borders on [0, 1], shape (intervals + 1,)."""
        borders = np.concatenate(([0.0], np.cumsum(self.interval_fractions)))
        borders[-1] = 1.0
        return _frozen(borders)

    @cached_property
    def points(self) -> FloatArray:
        """Collocation points on (0, 1], shape (intervals * degree,)."""
        widths = np.diff(self.borders)
        inside = self.borders[:-1, None] + widths[:, None] * radau_points(self.degree)[None, :]
        inside[:, -1] = self.borders[1:]
        return _frozen(inside.ravel())

    @cached_property
    def weights(self) -> FloatArray:
        """Quadrature weights at `points`, summing to 1, shape (intervals * degree,)."""
        return _frozen(np.outer(np.diff(self.borders), radau_weights(self.degree)).ravel())

    def refined(self, factor: int = 2) -> PhaseMesh:
        """Mesh with every interval divided into `factor` equal parts."""
        parts: Sequence[float] = [f / factor for f in self.interval_fractions for _ in range(factor)]
        return PhaseMesh(self.degree, tuple(parts))

    def divided(self, chosen: NDArray[np.bool_], parts: int) -> PhaseMesh:
        """Mesh with the chosen intervals, a mask of shape (intervals,), divided into equal parts."""
        counts = np.where(chosen, parts, 1)
        shares = np.asarray(self.interval_fractions) / counts
        return PhaseMesh(self.degree, tuple(np.repeat(shares, counts).tolist()))

    def state_matrix(self, fractions: ArrayLike) -> FloatArray:
        """Matrix from state values at start and collocation points to values at `fractions`.

        Each interval has the polynomial of degree `degree` through its start and its points.

        Returns
        -------
        ndarray, shape (len(fractions), intervals * degree + 1)

        """
        nodes = np.concatenate(([0.0], radau_points(self.degree)))
        return self._piecewise_matrix(fractions, nodes, self.points.size + 1)

    def slope_matrix(self, fractions: ArrayLike) -> FloatArray:
        """Like `state_matrix`, for the derivative with respect to the fraction of the phase."""
        # The slope is a polynomial of degree d - 1: known at the d collocation points, hence everywhere.
        slopes = np.zeros((self.points.size, self.points.size + 1))
        for i, width in enumerate(self.interval_fractions):
            first, last = i * self.degree, (i + 1) * self.degree
            slopes[first:last, first : last + 1] = differentiation_matrix(self.degree) / width
        return np.asarray(self.control_matrix(fractions) @ slopes, dtype=np.float64)

    def control_matrix(self, fractions: ArrayLike) -> FloatArray:
        """Matrix from values at the collocation points to values at `fractions`.

        Each interval has the polynomial of degree ``degree - 1`` through its points, so the curve may jump at an
        interval border; a border itself belongs to the interval that ends there (it is a collocation point).

        Returns
        -------
        ndarray, shape (len(fractions), intervals * degree)

        """
        return self._piecewise_matrix(fractions, radau_points(self.degree), self.points.size)

    def continuous_matrix(self, fractions: ArrayLike) -> FloatArray:
        """Like `control_matrix`, for a curve without jumps.

        Each interval has the polynomial of degree `degree` through its points and the end of the interval before; the
        first one has none before it, and the polynomial of degree ``degree - 1`` through its points.

        Returns
        -------
        ndarray, shape (len(fractions), intervals * degree)

        """
        wanted = np.atleast_1d(np.asarray(fractions, dtype=float))
        later = wanted > self.borders[1]
        matrix = np.empty((wanted.size, self.points.size))
        matrix[~later] = self.control_matrix(wanted[~later])
        # A node at the start of the phase, where the first interval has none, does not touch the later intervals.
        matrix[later] = self.state_matrix(wanted[later])[:, 1:]
        return matrix

    def _piecewise_matrix(self, fractions: ArrayLike, nodes: FloatArray, columns: int) -> FloatArray:
        """Place the interpolation matrix of every interval in its columns."""
        wanted = np.atleast_1d(np.asarray(fractions, dtype=float))
        if not np.all((wanted >= 0.0) & (wanted <= 1.0)):
            raise ValueError("fractions of a phase must lie between 0 and 1")
        owner = np.clip(np.searchsorted(self.borders, wanted, side="left") - 1, 0, self.intervals - 1)
        matrix = np.zeros((wanted.size, columns))
        # Not `np.unique`, which imports numpy.ma: 15 ms.
        for i in sorted(set(owner.tolist())):
            rows = np.flatnonzero(owner == i)
            local = (wanted[rows] - self.borders[i]) / (self.borders[i + 1] - self.borders[i])
            start = i * self.degree
            matrix[rows, start : start + nodes.size] = interpolation_matrix(nodes, local)
        return matrix
