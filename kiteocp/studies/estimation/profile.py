"""The wind profile of a problem: which of its numbers are speeds, and at which height it is given."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

from kiteocp.physics.model import Model
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure, parameters_of
from kiteocp.physics.wind import wind_keys

#: Height at which wind is measured by convention (World Meteorological Organization), m.
STANDARD_HEIGHT_M = 10.0


def scaled_wind(parameters: Parameters, scale: Any) -> Any:
    """Return the parameter vector with the wind speed scaled (every profile is linear in its speeds)."""
    speeds = wind_keys(parameters.structure)
    factors = [scale if key in speeds else 1.0 for key in parameters.structure.keys]
    return parameters.vector * ca.vertcat(*factors)


def reference_height(numbers: Parameters | ParameterValues) -> Any:
    """Height at which a wind profile is given, m: the last of a table, and 10 m where the wind is uniform."""
    if "environment.wind.reference_height_m" in numbers:
        return numbers["environment.wind.reference_height_m"]
    heights = [key for key in numbers.structure.keys if key.startswith("environment.wind.heights_m[")]
    return numbers[heights[-1]] if heights else STANDARD_HEIGHT_M


def ground_height(numbers: Parameters | ParameterValues) -> Any:
    """Height of a wind sensor at the ground where none is given: that of the profile, 10 m at most."""
    return ca.fmin(reference_height(numbers), STANDARD_HEIGHT_M)


@lru_cache(maxsize=32)
def wind_function(structure: Structure) -> ca.Function:
    """Build (once) ``(height, p) -> wind speed``."""
    parameters, height = parameters_of(structure), ca.SX.sym("height")
    return ca.Function("wind", [height, parameters.vector], [Model(parameters).wind_speed(height)])
