"""What no number of samples tells of the wind: the profile, the height of a sensor, the gauge of an airspeed sensor.

The error of a mean says how well the samples agree. It says nothing of what they share: a profile that is not that of
the problem, a mast of another height, a sensor that shows a few percent too much while reeling out. Each such unknown
has a standard deviation here, changes the wind by a share, and widens the interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.errors import InputError
from kiteocp.physics.parameters import parameter_values
from kiteocp.physics.wind import ground_height, reference_height, wind_function
from kiteocp.problem import Problem
from kiteocp.recording import FlightData
from kiteocp.studies.estimation.wind import WindEstimate

#: Standard normal quantile of a 95 % interval.
QUANTILE = 1.96


class WindUnknowns(msgspec.Struct, frozen=True):
    """Standard deviations of what the data do not tell.

    Attributes
    ----------
    shear_exponent
        Of the power-law exponent of the real profile about that of the problem's. Over land it runs from 0.05 on a
        convective afternoon to 0.4 on a stable night about a mean of 0.14 to 0.2 (Touma 1977, J. Air Pollut. Control
        Assoc. 27; van den Berg 2008, Wind Energy 11): a standard deviation of 0.1.
    sensor_height_share
        Of the height of the sensor at the ground, which the problem file does not give: 20 %.
    airspeed_gauge
        Of the gain of the airspeed sensor between the ways in which the kite flies: what a Pitot tube shows depends on
        the angle of the flow, which a constant gain does not know. An assumption: 3 %.
    """

    shear_exponent: float = 0.1
    sensor_height_share: float = 0.2
    airspeed_gauge: float = 0.03

    def __post_init__(self) -> None:
        for name, value in msgspec.structs.asdict(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"WindUnknowns: {name} is {value:g}; give a standard deviation of 0 or more", key=name)


def with_unknowns(
    wind: WindEstimate,
    flight: FlightData,
    problem: Problem,
    unknowns: WindUnknowns,
    refit: Callable[[float], WindEstimate],
    ground_height_m: float | None = None,
) -> WindEstimate:
    """Return a wind whose intervals carry what is not known beside the scatter of the samples.

    Parameters
    ----------
    wind
        With the statistical errors only.
    flight, problem
        What it was found from.
    unknowns
        How far off these may be.
    refit
        The wind found where the gain of the airspeed sensor is this times that of `wind`; called for the source
        ``airspeed``.
    ground_height_m
        Height of the sensor at the ground, if given.
    """
    if wind.source == "problem":
        return wind
    values = parameter_values(problem)
    reference = float(reference_height(values))
    shares: dict[str, float] = {}
    if wind.source == "ground":
        height = float(ground_height(values)) if ground_height_m is None else ground_height_m
        off = unknowns.sensor_height_share
        low, high = (
            float(wind_function(values.structure)(height * math.exp(way * off), values.vector)) for way in (-1, 1)
        )
        shares["sensor_height"] = 0.5 * math.log(high / low) if low > 0 else 0.0
    else:
        height = float(np.nanmean(flight.height_m))
    shares["profile"] = unknowns.shear_exponent * abs(math.log(reference / height)) if height > 0 else 0.0
    if wind.source == "measured":
        # The instrument sees the heights; what is left is how badly the shape of the problem's profile fits them.
        shares = {"profile": (wind.residual_m_s or 0.0) / (wind.reference_speed_m_s or math.inf)}
    if wind.source == "airspeed" and unknowns.airspeed_gauge > 0:
        off = unknowns.airspeed_gauge
        shares["airspeed_gauge"] = 0.5 * abs(refit(1 + off).scale - refit(1 - off).scale) / wind.scale
    systematic = wind.scale * math.sqrt(sum(share**2 for share in shares.values()))
    low, high = wind.scale_interval or (wind.scale, wind.scale)
    half = math.hypot(0.5 * (high - low), QUANTILE * systematic)
    return replace(
        wind,
        systematic_shares=shares,
        scale_total_standard_error=math.hypot(wind.scale_standard_error or 0.0, systematic),
        scale_total_interval=(max(wind.scale - half, 0.0), wind.scale + half),
    )
