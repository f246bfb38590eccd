"""The airspeed sensor of a flight, gauged by the wind and the velocity of the kite."""

from __future__ import annotations

import numpy as np

from kiteocp.numerics.averages import average
from kiteocp.problem import Problem
from kiteocp.recording.data import FlightData
from kiteocp.studies.estimation.inversion import invert

#: Samples with an airspeed below which it says nothing about the wind.
FEWEST_AIRSPEEDS = 50


def airspeed_factor(flight: FlightData, problem: Problem) -> tuple[float | None, float | None]:
    """Return the ratio of the apparent wind speed that follows from wind and velocity to the measured one."""
    ratio = invert(flight, problem).quantities["apparent_wind_speed_m_s"] / flight.apparent_wind_speed_m_s
    ratio = np.where(np.isfinite(ratio), ratio, np.nan)
    if np.count_nonzero(np.isfinite(ratio)) < FEWEST_AIRSPEEDS:
        return None, None
    middle = float(np.nanmedian(ratio))
    spread = 1.4826 * float(np.nanmedian(np.abs(ratio - middle)))
    kept = np.where(np.abs(ratio - middle) <= 3.0 * spread + 1e-12, ratio, np.nan)
    found = average(flight.time_s, kept)
    return found.mean, found.standard_error
