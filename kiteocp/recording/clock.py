"""The clock of a recording: times that count more coarsely than the samples come."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiteocp.recording.cleaning import FloatArray

#: A step in time longer than so many usual steps is a gap.
GAP_STEPS = 3.0

#: Where more than this share of the rows carries the time of the row before it, the clock is coarse. Rows written twice
#: by a fault are few.
COARSE_SHARE = 0.2


def is_coarse(time_s: FloatArray, repeats: NDArray[np.bool_]) -> bool:
    """Return whether a clock ticks more slowly than the samples come.

    Parameters
    ----------
    time_s
        Times in the order of the file, shape (n,).
    repeats
        Rows that are a copy of the row before them, shape (n,): they are no new samples.
    """
    step = np.diff(time_s)
    if step.size == 0 or np.any(step < 0) or not np.any(step > 0):
        return False
    return float(np.mean((step == 0) & ~repeats[1:])) > COARSE_SHARE


def rebuilt(time_s: FloatArray) -> tuple[FloatArray, float]:
    """Return times spread between the ticks of a coarse clock, and the usual step between samples (s).

    Each stretch without a gap is one straight line of time over rows where all its ticks lie on it within a sample, as
    with a steady rate; else the rows of each tick are spread evenly over it. A tick counts where it is first met, so
    that the times are at most one sample late.

    Parameters
    ----------
    time_s
        Ascending times with repetitions, shape (n,).
    """
    first = np.flatnonzero(np.r_[True, np.diff(time_s) > 0])
    ticks = time_s[first]
    tick = float(np.median(np.diff(ticks)))
    counts = np.diff(np.r_[first, time_s.size])
    # The first and the last tick may be cut; a tick before a gap is not.
    inner = counts[1:-1] if counts.size > 2 else counts
    step = tick / float(np.mean(inner[inner >= np.median(inner) / 2.0]))
    found = np.empty_like(time_s)
    starts = np.flatnonzero(np.r_[True, np.diff(ticks) > GAP_STEPS * tick])
    for start, end in zip(starts, np.r_[starts[1:], ticks.size], strict=True):
        rows = np.arange(first[start], first[end] if end < ticks.size else time_s.size)
        # The rows before the first full tick belong to a tick that began before the recording (or the gap) did.
        anchors = slice(start + 1, end) if end - start > 2 else slice(start, end)
        found[rows] = _spread(rows.astype(float), first[anchors].astype(float), ticks[anchors], step)
    return found, step


def _spread(rows: FloatArray, anchor_rows: FloatArray, anchors: FloatArray, step: float) -> FloatArray:
    """Return the times of rows from those of the anchors."""
    if anchors.size > 1:
        slope, offset = np.polyfit(anchor_rows, anchors - anchors[0], 1)
        if np.max(np.abs(slope * anchor_rows + offset - (anchors - anchors[0]))) <= step:
            line: FloatArray = slope * rows + offset + anchors[0]
            return line
    times = np.interp(rows, anchor_rows, anchors)
    before, after = rows < anchor_rows[0], rows > anchor_rows[-1]
    times[before] = anchors[0] + step * (rows[before] - anchor_rows[0])
    times[after] = anchors[-1] + step * (rows[after] - anchor_rows[-1])
    return times
