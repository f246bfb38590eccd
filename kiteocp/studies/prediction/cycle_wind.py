"""The wind of a predicted cycle, measured or from its gauged airspeed, and all that a prediction depends on."""

from __future__ import annotations

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.physics.wind import in_wind
from kiteocp.recording.cleaning import FloatArray
from kiteocp.recording.data import FlightData
from kiteocp.studies.estimation.wind import WindEstimate, wind_from_airspeed, wind_from_heights
from kiteocp.studies.prediction.kite import DIRECTION, SLOPE_STEP, WIND, EstimatedKite
from kiteocp.studies.prediction.sensor import FEWEST_AIRSPEEDS, airspeed_factor

#: What the airspeed of the predicted cycle itself gets wrong of its wind.
OWN_WIND, OWN_DIRECTION = "wind_scale_of_cycle", "wind_direction_offset_of_cycle_deg"


class CycleWind(msgspec.Struct, frozen=True):
    """Wind of one cycle.

    Attributes
    ----------
    estimate
        Factor on the wind of the problem, and direction.
    covariance
        Of factor and direction (deg) from this cycle's own measurement alone, shape (2, 2); zero where the wind is that
        of other cycles.
    slope, direction_slope
        Change of factor and direction per change of those of the estimation cycles, which the sensor was gauged with.
    """

    estimate: WindEstimate
    covariance: FloatArray
    slope: float
    direction_slope: float


def wind_of_cycle(flight: FlightData, kite: EstimatedKite, cycle: int) -> CycleWind:
    """Estimate the wind of a cycle: measured at height, or from its airspeed, gauged on the estimation cycles.

    It is that of the estimation cycles where the cycle has neither.
    """
    chosen = flight.select([cycle])
    if chosen.wind_at_height is not None:
        measured = wind_from_heights(chosen, kite.base)
        return CycleWind(measured, np.diag([(measured.scale_standard_error or 0.0) ** 2, 0.0]), 0.0, 0.0)
    usable = np.isfinite(chosen.apparent_wind_speed_m_s) & np.isfinite(chosen.polar_speed_m_s)
    if kite.airspeed_factor is None or np.count_nonzero(usable) < FEWEST_AIRSPEEDS:
        return CycleWind(kite.wind, np.zeros((2, 2)), 1.0, 1.0)

    def found(factor: float) -> WindEstimate:
        gauged = replace(chosen, apparent_wind_speed_m_s=factor * chosen.apparent_wind_speed_m_s)
        return wind_from_airspeed(gauged, kite.base, calibrate=False)

    estimate = found(kite.airspeed_factor)
    # A stronger wind on the estimation cycles gauges the sensor higher, and that shows a stronger wind here.
    slope_of_wind = (found(kite.airspeed_factor * (1 + SLOPE_STEP)).scale - estimate.scale) / (
        kite.airspeed_factor * SLOPE_STEP
    )
    turned = kite.wind.turned(flight.select(kite.cycles))
    stronger = replace(kite.wind, scale=kite.wind.scale * (1 + SLOPE_STEP)).applied(kite.base)
    factor = airspeed_factor(turned, stronger)[0]
    slope_of_factor = ((factor or kite.airspeed_factor) - kite.airspeed_factor) / (kite.wind.scale * SLOPE_STEP)
    errors = np.array([estimate.scale_standard_error or 0.0, estimate.direction_standard_error_deg or 0.0])
    covariance = np.outer(errors, errors) * np.array(
        [[1.0, estimate.correlation or 0.0], [estimate.correlation or 0.0, 1.0]]
    )
    covariance[0, 0] += (slope_of_wind * (kite.airspeed_factor_error or 0.0)) ** 2
    return CycleWind(estimate, covariance, slope_of_wind * slope_of_factor, 0.0)


def covariance_of_cycle(kite: EstimatedKite, wind: CycleWind) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and covariance of everything that a prediction of a cycle depends on, its own wind last."""
    size = len(kite.names)
    covariance = np.zeros((size + 2, size + 2))
    covariance[:size, :size] = kite.covariance
    covariance[size:, size:] = wind.covariance
    return (*kite.names, OWN_WIND, OWN_DIRECTION), covariance


def shifted(values: ParameterValues, name: str, change: float, wind: CycleWind) -> tuple[ParameterValues, float]:
    """Return the numbers of a cycle's problem and the turn of its wind (deg) with one parameter changed.

    The parameters are those of `covariance_of_cycle`.
    """
    if name in (DIRECTION, OWN_DIRECTION):
        return values, change * (wind.direction_slope if name == DIRECTION else 1.0)
    if name not in (WIND, OWN_WIND):
        return values.replaced({name: values[name] + change}), 0.0
    ratio = 1.0 + change * (wind.slope if name == WIND else 1.0) / wind.estimate.scale
    return in_wind(values, ratio), 0.0


def values_of_cycle(kite: EstimatedKite, wind: CycleWind) -> ParameterValues:
    """Return the numbers of the problem in the wind of a cycle."""
    return parameter_values(wind.estimate.applied(kite.base))
