"""Wind speed and air density over height (section 2.1 of the paper)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import casadi as ca


def logarithmic_wind_speed(height: Any, reference_speed: Any, reference_height: Any, roughness_length: Any) -> Any:
    """Wind speed of a neutral boundary layer (eq:windshear); zero at and below the roughness length."""
    # fmax: the logarithm turns negative below the roughness length, where there is no wind profile to speak of.
    relative = ca.fmax(height, roughness_length) / roughness_length
    return reference_speed * ca.log(relative) / ca.log(reference_height / roughness_length)


def power_law_wind_speed(height: Any, reference_speed: Any, reference_height: Any, exponent: Any) -> Any:
    """Wind speed of the power law, ``reference_speed * (height / reference_height)**exponent``."""
    # A small floor keeps the derivative finite at the ground; it is 1 mm high.
    return reference_speed * (ca.fmax(height, 1e-3) / reference_height) ** exponent


def tabulated_wind_speed(height: Any, heights: Sequence[Any], speeds: Sequence[Any]) -> Any:
    """Wind speed by monotone cubic Hermite interpolation (Fritsch and Carlson 1980), constant beyond the ends.

    The interpolant is continuously differentiable and nowhere leaves the range of its two neighbouring entries, so
    that it makes up no wind that the table does not have.

    Parameters
    ----------
    height
        Height above ground, m.
    heights, speeds
        The table, strictly increasing heights (m) and speeds (m/s), two entries or more.
    """
    steps = [upper - lower for lower, upper in itertools.pairwise(heights)]
    secants = [(b - a) / step for a, b, step in zip(speeds[:-1], speeds[1:], steps, strict=True)]
    # Zero slope at both ends joins the constant continuation with a continuous derivative.
    slopes: list[Any] = [0.0]
    for left, right, step_left, step_right in zip(secants[:-1], secants[1:], steps[:-1], steps[1:], strict=True):
        weight_left, weight_right = 2 * step_right + step_left, step_right + 2 * step_left
        denominator = weight_left * right + weight_right * left
        harmonic = (weight_left + weight_right) * left * right / ca.if_else(denominator == 0, 1.0, denominator)
        slopes.append(ca.if_else(left * right > 0, harmonic, 0.0))
    slopes.append(0.0)
    result: Any = speeds[0]
    for i, step in enumerate(steps):
        s = ca.fmin(ca.fmax((height - heights[i]) / step, 0.0), 1.0)
        cubic = (
            speeds[i]
            + step * slopes[i] * s
            + (3 * (speeds[i + 1] - speeds[i]) - step * (2 * slopes[i] + slopes[i + 1])) * s**2
            + (2 * (speeds[i] - speeds[i + 1]) + step * (slopes[i] + slopes[i + 1])) * s**3
        )
        result = result + (cubic - speeds[i])
    return result


def air_density(height: Any, density_sea_level: Any, scale_height: Any) -> Any:
    """Density of the isothermal atmosphere (eq:airdensity), kg/m3."""
    return density_sea_level * ca.exp(-height / scale_height)
