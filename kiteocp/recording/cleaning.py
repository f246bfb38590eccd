"""What is wrong with recorded values, and what is done about it: found, counted by reason, set to missing or repaired.

Rules, in the order they are applied: values outside what a kite power system can show; sensors frozen at one value;
single spikes (Hampel filter); positions that do not fit the reeled-out tether; wind directions turned by half a circle.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Values outside are no measurement, by the names of `FlightData`; forces in N.
RANGES: Mapping[str, tuple[float, float]] = {
    "distance_m": (1.0, 5000.0),
    "cartesian_m": (-5000.0, 5000.0),
    "elevation_deg": (-30.0, 150.0),
    "tether_length_m": (0.0, 5000.0),
    "speed_m_s": (-100.0, 100.0),
    "reeling_speed_m_s": (-40.0, 40.0),
    "tether_force_ground_N": (0.0, 1e6),
    "ground_wind_speed_m_s": (0.0, 60.0),
    "apparent_wind_speed_m_s": (0.0, 100.0),
    "angle_of_attack_deg": (-90.0, 90.0),
}

#: A sensor is frozen where it repeats one value for so long (and so many samples); one that does so for more than a
#: share of the recording is constant by nature, as in a simulated flight.
FROZEN_S, FROZEN_SAMPLES, CONSTANT_SHARE = 3.0, 10, 0.2

#: Hampel filter: samples on either side, within so many seconds; a spike is off the median by so many (robust) standard
#: deviations of its neighbours, and by a share of the standard deviation of the whole recording.
HAMPEL_SIDE, HAMPEL_S, HAMPEL_SIGMAS, HAMPEL_SHARE = 5, 2.0, 5.0, 0.25

#: From the median absolute deviation to the standard deviation of a normal distribution.
MAD_TO_SIGMA = 1.4826

#: Straight distance less tether length may depart from its median by this share of the tether length, or so many m.
OFF_TETHER_SHARE, OFF_TETHER_M = 0.05, 10.0


def clip_range(values: FloatArray, quantity: str) -> int:
    """Set values outside the range of a quantity to missing, in place, and return how many."""
    low, high = RANGES[quantity]
    with np.errstate(invalid="ignore"):
        wrong = ~((values >= low) & (values <= high)) & ~np.isnan(values)
    values[wrong] = np.nan
    return int(wrong.sum())


def drop_frozen(values: FloatArray, time_s: FloatArray) -> int:
    """Set all but the first of a long run of equal values to missing, in place, and return how many."""
    if values.size < FROZEN_SAMPLES:
        return 0
    with np.errstate(invalid="ignore"):
        starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    ends = np.r_[starts[1:], values.size]
    frozen = np.zeros(values.size, dtype=bool)
    for start, end in zip(starts, ends, strict=True):
        if end - start >= FROZEN_SAMPLES and time_s[end - 1] - time_s[start] >= FROZEN_S:
            frozen[start + 1 : end] = True
    if frozen.mean() > CONSTANT_SHARE:
        return 0
    values[frozen] = np.nan
    return int(frozen.sum())


def drop_spikes(values: FloatArray, time_s: FloatArray) -> int:
    """Set single values far off the median of their neighbours to missing, in place, and return how many.

    A value between those before and after it is none: where a phase ends, force and speed may change in a few samples.
    Recordings so slow that the window would span a manoeuvre are left alone.
    """
    good = np.flatnonzero(np.isfinite(values))
    width = 2 * HAMPEL_SIDE + 1
    if good.size < 3 * width or np.median(np.diff(time_s)) * HAMPEL_SIDE > HAMPEL_S:
        return 0
    kept = values[good]
    windows = sliding_window_view(np.pad(kept, HAMPEL_SIDE, mode="reflect"), width)
    median = np.median(windows, axis=1)
    deviation = np.median(np.abs(windows - median[:, None]), axis=1)
    # So few samples happen to lie close together now and then: there the usual deviation counts.
    deviation = np.maximum(deviation, np.median(deviation))
    # The spread of the recording by quartiles, so that the spikes do not hide themselves.
    spread = float(np.subtract(*np.percentile(kept, [75, 25]))) / 1.349
    spread = max(spread, MAD_TO_SIGMA * float(np.median(np.abs(kept - np.median(kept)))))
    off = np.abs(kept - median)
    spikes = (off > HAMPEL_SIGMAS * MAD_TO_SIGMA * deviation) & (off > HAMPEL_SHARE * spread) & (off > 0)
    before, after = kept - np.r_[kept[1], kept[:-1]], kept - np.r_[kept[1:], kept[-2]]
    spikes &= (before * after > 0) & (np.minimum(np.abs(before), np.abs(after)) > 0.5 * off)
    values[good[spikes]] = np.nan
    return int(spikes.sum())


def off_tether(distance_m: FloatArray, tether_length_m: FloatArray) -> NDArray[np.bool_]:
    """Return where the straight distance does not fit the tether length, shape (n,).

    The two differ by an offset (the drum's zero, the bridle) and by sag; a position that departs from the median of
    that difference is a fault of the satellite receiver.
    """
    difference = distance_m - tether_length_m
    if not np.isfinite(difference).any():
        return np.zeros(distance_m.size, dtype=bool)
    allowed = np.maximum(OFF_TETHER_M, OFF_TETHER_SHARE * tether_length_m)
    with np.errstate(invalid="ignore"):
        off: NDArray[np.bool_] = np.abs(difference - np.nanmedian(difference)) > allowed
    return off


def turn_directions(direction_deg: FloatArray, downwind_bearing_deg: float) -> tuple[FloatArray, int]:
    """Turn wind directions by 180 deg that point the wrong way, and return them with their number.

    A vane may jump by half a circle; the kite flies downwind, so that the wind comes from within 90 deg of the bearing
    opposite to the middle of its figures.
    """
    off = wrapped(direction_deg - (downwind_bearing_deg + 180.0))
    turned = np.abs(off) > 90.0
    return np.where(turned, direction_deg + 180.0, direction_deg) % 360.0, int(turned.sum())


def wrapped(angle_deg: FloatArray) -> FloatArray:
    """Return angles in [-180, 180) deg."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def circular_median_deg(angle_deg: FloatArray) -> float:
    """Return the median of angles that may straddle a full circle, in [0, 360) deg."""
    radians = np.radians(angle_deg[np.isfinite(angle_deg)])
    middle = np.degrees(np.arctan2(np.sin(radians).mean(), np.cos(radians).mean()))
    return float((middle + np.median(wrapped(np.degrees(radians) - middle))) % 360.0)
