"""Wind profiles, one object each: speed over height, which numbers are speeds, where it is given and how far it holds.

A new profile is its keys in `kiteocp.problem.wind` and an entry of `PROFILES` here. Every profile is linear in its
speeds, so that a wind times a factor is the same profile.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.physics.atmosphere import (
    logarithmic_wind_speed,
    power_law_wind_speed,
    table_coefficients,
    tabulated_wind_speed,
)
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure, parameters_of
from kiteocp.problem import Problem
from kiteocp.problem.wind import LOGARITHMIC_LAW_HEIGHT_MAX_M
from kiteocp.report.words import rounded

#: Stands for the wind speed where keys are named; of a table it is all its speeds.
WIND = "environment.wind"

_SPEED, _HEIGHT = f"{WIND}.reference_speed_m_s", f"{WIND}.reference_height_m"

#: Height at which wind is measured by convention (World Meteorological Organization), m.
STANDARD_HEIGHT_M = 10.0

Numbers = Parameters | ParameterValues


class WindProfile(msgspec.Struct, frozen=True):
    """A kind of wind profile.

    Attributes
    ----------
    speed
        From height (m) and parameters to the wind speed, m/s.
    reference_height
        Height at which it is given, m.
    speeds
        Key of the number that is a speed, or of the list of them.
    words
        From the numbers and a speed as text to the wind's name in a sentence.
    remark
        From the numbers and the lowest and highest height flown (m) to a sentence, if it does not hold there.
    """

    speed: Callable[[Any, Parameters], Any]
    reference_height: Callable[[Numbers], Any] = lambda numbers: numbers[_HEIGHT]
    speeds: str = _SPEED
    words: Callable[[ParameterValues, str], str] = lambda v, number: f"{number} m/s of wind at {v[_HEIGHT]:g} m"
    remark: Callable[[ParameterValues, float, float], str | None] = lambda _values, _lowest, _highest: None


def _heights(numbers: Numbers) -> list[Any]:
    return [numbers[key] for key in numbers.structure.keys if key.startswith(f"{WIND}.heights_m[")]


def _above_the_law(_values: ParameterValues, _lowest: float, highest: float) -> str | None:
    if highest <= LOGARITHMIC_LAW_HEIGHT_MAX_M + 0.5:
        return None
    return (
        f"the kite flies up to {highest:.0f} m; the logarithmic wind profile is meant for heights up to "
        f"{LOGARITHMIC_LAW_HEIGHT_MAX_M:.0f} m"
    )


def _beyond_the_table(values: ParameterValues, lowest: float, highest: float) -> str | None:
    heights = _heights(values)
    if min(heights) <= lowest and highest <= max(heights):
        return None
    return (
        f"the kite flies between {lowest:.0f} and {highest:.0f} m, beyond the wind table "
        f"({min(heights):.0f} to {max(heights):.0f} m), whose end values are held there"
    )


#: By the word of ``environment.wind.profile``.
PROFILES: dict[str, WindProfile] = {
    "logarithmic": WindProfile(
        lambda height, p: logarithmic_wind_speed(height, p[_SPEED], p[_HEIGHT], p[f"{WIND}.roughness_length_m"]),
        remark=_above_the_law,
    ),
    "power-law": WindProfile(
        lambda height, p: power_law_wind_speed(height, p[_SPEED], p[_HEIGHT], p[f"{WIND}.exponent"])
    ),
    "uniform": WindProfile(
        lambda _height, p: p[_SPEED],
        reference_height=lambda _numbers: STANDARD_HEIGHT_M,
        words=lambda _values, number: f"{number} m/s of wind",
    ),
    "table": WindProfile(
        lambda height, p: tabulated_wind_speed(
            height,
            p.series(f"{WIND}.heights_m"),
            p.derived(WIND, lambda: table_coefficients(p.series(f"{WIND}.heights_m"), p.series(f"{WIND}.speeds_m_s"))),
        ),
        reference_height=lambda numbers: _heights(numbers)[-1],
        speeds=f"{WIND}.speeds_m_s",
        words=lambda _values, number: f"a wind of up to {number} m/s",
        remark=_beyond_the_table,
    ),
}


def profile_of(structure: Structure) -> WindProfile:
    """Return the wind profile of a problem."""
    return PROFILES[structure.choice(f"{WIND}.profile")]


def wind_keys(structure: Structure) -> list[str]:
    """Keys of the numbers that scale the wind speed: the reference speed, or the speeds of a table."""
    speeds = profile_of(structure).speeds
    return [key for key in structure.keys if key.partition("[")[0] == speeds]


def in_wind(values: ParameterValues, factor: float) -> ParameterValues:
    """Return the same with the wind speed times a factor."""
    return values.replaced({name: factor * values[name] for name in wind_keys(values.structure)})


def problem_in_wind(problem: Problem, factor: float) -> Problem:
    """Return the problem with all wind speeds times a factor."""
    wind = problem.to_dict()["environment"]["wind"]
    key = PROFILES[wind["profile"]].speeds
    speeds = wind[key.rpartition(".")[2]]
    changed = [factor * speed for speed in speeds] if isinstance(speeds, list | tuple) else factor * speeds
    return problem.with_values({key: changed})


def scaled_wind(parameters: Parameters, scale: Any) -> Any:
    """Return the parameter vector with the wind speed scaled, symbolically."""
    speeds = wind_keys(parameters.structure)
    factors = [scale if key in speeds else 1.0 for key in parameters.structure.keys]
    return parameters.vector * ca.vertcat(*factors)


def reference_height(numbers: Numbers) -> Any:
    """Height at which a wind profile is given, m: the last of a table, and 10 m where the wind is uniform."""
    return profile_of(numbers.structure).reference_height(numbers)


def ground_height(numbers: Numbers) -> Any:
    """Height of a wind sensor at the ground where none is given: that of the profile, 10 m at most."""
    return ca.fmin(reference_height(numbers), STANDARD_HEIGHT_M)


@lru_cache(maxsize=32)
def prepared_parameters(structure: Structure) -> tuple[Parameters, Any]:
    """Return symbols of a structure that keep what is derived from its numbers, and all of them, a column."""
    parameters = Parameters(structure, keeps_derived=True)
    profile_of(structure).speed(ca.SX.sym("height"), parameters)
    return parameters, ca.vertcat(parameters.vector, parameters.all_derived[0])


@lru_cache(maxsize=32)
def _prepare(structure: Structure) -> ca.Function | None:
    parameters, everything = prepared_parameters(structure)
    if everything.numel() == parameters.vector.numel():
        return None
    derived = ca.vertcat(parameters.vector, parameters.all_derived[1])
    return ca.Function("prepare", [parameters.vector], [derived], {"cse": True})


def prepared(values: ParameterValues) -> np.ndarray:
    """Return the numbers of a problem and what is derived from them, in the order of `prepared_parameters`."""
    function = _prepare(values.structure)
    return values.vector if function is None else np.asarray(function(values.vector), dtype=np.float64).ravel()


@lru_cache(maxsize=32)
def wind_function(structure: Structure) -> ca.Function:
    """Build (once) ``(height, p) -> wind speed``."""
    parameters, height = parameters_of(structure), ca.SX.sym("height")
    return ca.Function("wind", [height, parameters.vector], [profile_of(structure).speed(height, parameters)])


def wind_text(values: ParameterValues, factor: float) -> str:
    """Name the wind of a problem at a factor, as its file does; a changed one rounded away from the given."""
    speed = factor * value_of(values, WIND)
    number = f"{speed:.4g}" if factor == 1.0 else rounded(speed, up=factor > 1.0)
    return profile_of(values.structure).words(values, number)


def value_of(values: ParameterValues, key: str) -> float:
    """Return the number of a key; of the wind its reference speed, or the largest speed of a table."""
    return max(values[name] for name in wind_keys(values.structure)) if key == WIND else values[key]
