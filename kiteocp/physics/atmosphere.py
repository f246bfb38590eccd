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


def tabulated_wind_speed(height: Any, heights: Sequence[Any], coefficients: Any) -> Any:
    """Wind speed by monotone cubic Hermite interpolation (Fritsch and Carlson 1980), constant beyond the ends.

    The interpolant is continuously differentiable and nowhere leaves the range of its two neighbouring entries, so
    that it makes up no wind that the table does not have.

    The numbers of the cubic that holds at a height are picked out by comparisons, a dozen operations an entry; its
    derivatives cost nothing more, as comparisons have none.

    Parameters
    ----------
    height
        Height above ground, m.
    heights
        Strictly increasing, m, two or more.
    coefficients
        Those of `table_coefficients`, which do not depend on the height.
    """
    inside = ca.fmin(ca.fmax(height, heights[0]), heights[-1])
    # One where a piece has begun; exact, so that no other cubic leaves a trace.
    begun = [1.0, *(inside > border for border in heights[1:-1]), 0.0]
    holding = sum(
        (now - later) * coefficients[CUBIC * piece : CUBIC * (piece + 1)]
        for piece, (now, later) in enumerate(itertools.pairwise(begun))
    )
    start, value, slope, square, cube = (holding[index] for index in range(CUBIC))
    distance = inside - start
    return value + distance * (slope + distance * (square + distance * cube))


#: Numbers of a cubic: where it starts, and its coefficients there, lowest first.
CUBIC = 5


def table_coefficients(heights: Sequence[Any], speeds: Sequence[Any]) -> Any:
    """Return the coefficients of `tabulated_wind_speed`, cubic by cubic.

    Returns
    -------
    column, shape (CUBIC * (entries - 1),)
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
    cubics = [
        ca.vertcat(
            heights[i],
            speeds[i],
            slopes[i],
            (3 * secants[i] - 2 * slopes[i] - slopes[i + 1]) / step,
            (slopes[i] + slopes[i + 1] - 2 * secants[i]) / step**2,
        )
        for i, step in enumerate(steps)
    ]
    return ca.vertcat(*cubics)


def air_density(height: Any, density_sea_level: Any, scale_height: Any) -> Any:
    """Density of the isothermal atmosphere (eq:airdensity), kg/m3."""
    return density_sea_level * ca.exp(-height / scale_height)
