"""Wind profiles and air density: values of their formulas, and derivatives without a step."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import kiteocp
from kiteocp.physics import atmosphere
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import parameter_values, parameters_of

HEIGHTS = [10.0, 60.0, 100.0, 250.0, 300.0, 600.0]
SPEEDS = [4.0, 7.0, 6.0, 6.0, 9.0, 14.0]


def wind_of(problem: kiteocp.Problem) -> ca.Function:
    """Wind speed of a problem over height, in double precision."""
    values = parameter_values(problem)
    parameters, height = parameters_of(values.structure), ca.SX.sym("z")
    speed = ca.Function("w", [height, parameters.vector], [Model(parameters).wind_speed(height)])
    argument = ca.SX.sym("z")
    return ca.Function("wind", [argument], [speed(argument, values.vector)])


def sampled(function: ca.Function, heights: np.ndarray) -> np.ndarray:
    return np.asarray(function(heights)).ravel()


def test_logarithmic_profile(problem: kiteocp.Problem) -> None:
    """eq:windshear; the strong case's 18.2 m/s at the mean traction altitude of 252 m (the paper's table)."""
    z = np.linspace(1, 900, 50)
    wind = wind_of(problem)
    assert_allclose(sampled(wind, z), 9.9 * np.log(z / 0.07) / np.log(6 / 0.07), rtol=1e-14)
    assert float(wind(252.0)) == pytest.approx(18.2, abs=0.05)
    assert float(wind(0.07)) == 0.0
    assert float(wind(0.0)) == 0.0
    assert float(wind(-10.0)) == 0.0


def test_power_law_profile(problem: kiteocp.Problem) -> None:
    law = {"profile": "power-law", "reference_speed_m_s": 8.0, "reference_height_m": 50.0, "exponent": 0.14}
    wind = wind_of(problem.with_values({"environment.wind": law}))
    z = np.linspace(1, 900, 50)
    assert_allclose(sampled(wind, z), 8 * (z / 50) ** 0.14, rtol=1e-13)
    slope = ca.Function("d", [s := ca.SX.sym("z")], [ca.jacobian(wind(s), s)])
    assert np.isfinite(float(slope(0.0)))


def test_uniform_profile(problem: kiteocp.Problem) -> None:
    wind = wind_of(problem.with_values({"environment.wind": {"profile": "uniform", "reference_speed_m_s": 7.5}}))
    assert_allclose(sampled(wind, np.array([1.0, 100.0, 900.0])), 7.5)


def test_table_through_a_problem_file(problem: kiteocp.Problem) -> None:
    table = {"profile": "table", "heights_m": [10.0, 200.0, 500.0, 800.0], "speeds_m_s": [5.0, 9.0, 11.0, 10.0]}
    wind = wind_of(problem.with_values({"environment.wind": table}))
    assert_allclose(sampled(wind, np.array(table["heights_m"])), table["speeds_m_s"], rtol=1e-14)


def table_function(heights: list[float], speeds: list[float]) -> tuple[ca.Function, ca.Function]:
    z = ca.SX.sym("z")
    speed = ca.SX(1.0) * atmosphere.tabulated_wind_speed(z, heights, atmosphere.table_coefficients(heights, speeds))
    return ca.Function("wind", [z], [speed]), ca.Function("slope", [z], [ca.jacobian(speed, z)])


def test_table_passes_through_its_entries_and_is_constant_beyond() -> None:
    wind, _ = table_function(HEIGHTS, SPEEDS)
    assert_allclose(sampled(wind, np.array(HEIGHTS)), SPEEDS, rtol=1e-14)
    assert_allclose(sampled(wind, np.array([-50.0, 0.0, 700.0])), [4.0, 4.0, 14.0], rtol=1e-14)


def test_table_is_monotone_between_entries() -> None:
    wind, _ = table_function(HEIGHTS, SPEEDS)
    for lower, upper, a, b in zip(HEIGHTS[:-1], HEIGHTS[1:], SPEEDS[:-1], SPEEDS[1:], strict=True):
        steps = np.diff(sampled(wind, np.linspace(lower, upper, 200))) * np.sign(b - a + 1e-30)
        assert steps.min() >= -1e-13
        assert a != b or np.abs(steps).max() < 1e-13


def test_table_has_a_continuous_derivative() -> None:
    """From both sides of every entry, the ends included; the second derivative is at most about 0.01 1/(m s)."""
    _, slope = table_function(HEIGHTS, SPEEDS)
    z = np.array(HEIGHTS)
    assert_allclose(sampled(slope, z - 1e-7), sampled(slope, z + 1e-7), atol=1e-7)
    inside = np.linspace(5, 700, 3000)
    assert np.abs(np.diff(sampled(slope, inside))).max() < 0.02


def test_table_of_a_straight_line_is_straight_in_the_middle() -> None:
    """Equal secants give equal slopes: away from the flat ends the interpolant is the line itself."""
    heights = [0.0, 100.0, 250.0, 300.0, 400.0]
    wind, _ = table_function(heights, [0.01 * h for h in heights])
    z = np.linspace(100, 300, 21)
    assert_allclose(sampled(wind, z), 0.01 * z, rtol=1e-12)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.floats(1, 200), st.floats(0, 30)), min_size=2, max_size=8))
def test_table_never_leaves_the_range_of_its_neighbours(entries: list[tuple[float, float]]) -> None:
    heights = np.cumsum([step for step, _ in entries]).tolist()
    speeds = [speed for _, speed in entries]
    wind, _ = table_function(heights, speeds)
    for lower, upper, a, b in zip(heights[:-1], heights[1:], speeds[:-1], speeds[1:], strict=True):
        between = sampled(wind, np.linspace(lower, upper, 40))
        assert between.min() >= min(a, b) - 1e-12 * 30
        assert between.max() <= max(a, b) + 1e-12 * 30


def test_air_density() -> None:
    """eq:airdensity."""
    assert atmosphere.air_density(0.0, 1.225, 8550.0) == 1.225
    assert atmosphere.air_density(252.0, 1.225, 8550.0) == pytest.approx(1.225 * np.exp(-252 / 8550), rel=1e-15)
