"""Velocities from positions: derivatives over time that single wrong samples do not bend."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from kiteocp.recording.cleaning import MAD_TO_SIGMA, FloatArray
from kiteocp.recording.clock import GAP_STEPS

#: A parabola is fitted to the samples within so many s to either side (a motion of 0.2 Hz loses 2 % of its speed), and
#: to so many samples at least.
SIDE_S, SIDE_SAMPLES = 0.4, 2

#: Fewest samples in a window, rounds of reweighting, and the constant of Huber's weights (95 % as efficient as least
#: squares where all errors are normal).
FEWEST, ROUNDS, HUBER = 4, 3, 1.345


def derivative(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the derivative of a series, nan where too few neighbours are known, shape (n,).

    Parameters
    ----------
    time_s, values
        Ascending times (s) and what was measured then, shape (n,); nan entries are gaps.
    """
    if time_s.size < 2:
        return np.full(time_s.size, np.nan)
    step = float(np.median(np.diff(time_s)))
    side = max(SIDE_SAMPLES, round(SIDE_S / step))
    shape = (side, side)
    times = sliding_window_view(np.pad(time_s, shape, constant_values=np.nan), 2 * side + 1) - time_s[:, None]
    near = sliding_window_view(np.pad(values, shape, constant_values=np.nan), 2 * side + 1)
    reach = side * step * (1.0 + 1e-6)
    inside = np.isfinite(near) & (np.abs(np.nan_to_num(times, nan=np.inf)) <= reach + 0.5 * step)
    enough = (inside.sum(axis=1) >= FEWEST) & _both_sides(times, inside, GAP_STEPS * step)
    slopes = np.full(time_s.size, np.nan)
    if enough.any():
        slopes[enough] = _slopes(times[enough] / reach, near[enough], inside[enough]) / reach
    return slopes


def _slopes(times: FloatArray, values: FloatArray, inside: NDArray[np.bool_]) -> FloatArray:
    """Return the slope at time 0 of a parabola through each row, by Huber's weights."""
    x = np.where(inside, times, 0.0)
    known = np.where(inside, values, np.nan)
    y = np.where(inside, values - np.nanmedian(known, axis=1, keepdims=True), 0.0)
    basis = np.stack([np.ones_like(x), x, x**2], axis=2)
    weight = inside.astype(float)
    for _ in range(ROUNDS):
        normal = np.einsum("nk,nki,nkj->nij", weight, basis, basis) + 1e-12 * np.eye(3)
        right = np.einsum("nk,nki,nk->ni", weight, basis, y)
        solution = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        off = np.abs(y - np.einsum("nki,ni->nk", basis, solution))
        spread = MAD_TO_SIGMA * np.nanmedian(np.where(inside, off, np.nan), axis=1, keepdims=True)
        weight = inside * np.minimum(1.0, HUBER * np.maximum(spread, 1e-12) / np.maximum(off, 1e-12))
    found: FloatArray = solution[:, 1]
    return found


def _both_sides(times: FloatArray, inside: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Return where a sample has known neighbours close before and after it: at an edge a parabola extrapolates."""
    before = np.any(inside & (times < 0) & (times >= -reach), axis=1)
    after = np.any(inside & (times > 0) & (times <= reach), axis=1)
    found: NDArray[np.bool_] = before & after
    return found
