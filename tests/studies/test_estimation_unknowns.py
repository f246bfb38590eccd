"""Intervals of the wind carry what the samples do not tell; a wind measured at height is the wind."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from made_flight import DATA, made_flight
from msgspec.structs import replace

from kiteocp.errors import InputError
from kiteocp.physics.parameters import parameter_values
from kiteocp.physics.wind import wind_function
from kiteocp.problem import Problem, load_problem
from kiteocp.recording import FlightData, load_flight
from kiteocp.recording.data import MeasuredWind
from kiteocp.studies.estimation.study import estimate
from kiteocp.studies.estimation.unknowns import WindUnknowns
from kiteocp.studies.prediction.cycle_wind import wind_of_cycle
from kiteocp.studies.prediction.kite import estimate_kite

LIDAR_DATA = DATA / "kitepower-2025-10-09" / "cycles-0-1.csv"

#: Mean of the lidar beside that flight over reel-out, at 100 m (m/s).
LIDAR_MEAN_M_S = 6.9


@pytest.fixture(scope="module")
def flight() -> FlightData:
    return made_flight()


@pytest.fixture(scope="module")
def problem() -> Problem:
    return load_problem("v9-kite")


def test_the_profile_between_sensor_and_kite_widens_the_wind_of_the_ground(
    flight: FlightData, problem: Problem
) -> None:
    """By the exponent times the logarithm of the ratio of the heights, and by the height's own share of the profile."""
    only = WindUnknowns(shear_exponent=0.1, sensor_height_share=0.0, airspeed_gauge=0.0)
    wind = estimate(flight, problem, wind="ground", ground_height_m=5.0, unknowns=only).wind
    reference = wind.reference_height_m
    assert reference is not None
    assert wind.systematic_shares["profile"] == pytest.approx(0.1 * abs(math.log(reference / 5.0)), rel=1e-12)
    low, high = wind.scale_interval or (math.nan, math.nan)
    half = math.hypot((high - low) / 2, 1.96 * wind.scale * wind.systematic_shares["profile"])
    assert wind.scale_total_interval == pytest.approx((max(wind.scale - half, 0.0), wind.scale + half), rel=1e-12)


def test_the_gauge_widens_the_wind_of_the_airspeed_and_nothing_unknown_leaves_it(
    flight: FlightData, problem: Problem
) -> None:
    none = estimate(flight, problem, wind="airspeed", unknowns=WindUnknowns(0.0, 0.0, 0.0)).wind
    assert none.scale_total_interval == pytest.approx(none.scale_interval, rel=1e-9)
    one, two = (
        estimate(flight, problem, wind="airspeed", unknowns=WindUnknowns(0.0, 0.0, share)).wind
        for share in (0.01, 0.02)
    )
    # A kite that flies faster than the wind blows takes an error of its airspeed for a larger one of the wind.
    share = one.systematic_shares["airspeed_gauge"]
    assert share > 0.01
    assert two.systematic_shares["airspeed_gauge"] == pytest.approx(2 * share, rel=0.1)
    assert (two.total_standard_error or 0.0) > (one.total_standard_error or 0.0)


def test_unknowns_are_checked() -> None:
    with pytest.raises(InputError, match="shear_exponent is -1; give a standard deviation of 0 or more"):
        WindUnknowns(shear_exponent=-1.0)


def test_a_wind_measured_at_height_is_the_wind(flight: FlightData, problem: Problem) -> None:
    """Of a profile of the shape of the problem's it gives the factor to rounding, and the direction."""
    heights = np.array([50.0, 100.0, 150.0, 200.0, 300.0])
    speeds = np.array([1.25 * _speed(problem, height) for height in heights])
    count = len(flight)
    seen = MeasuredWind(
        heights,
        np.tile(speeds, (count, 1)),
        np.full((count, heights.size), (flight.downwind_bearing_deg + 180.0 - 4.0) % 360.0),
    )
    found = estimate(replace(flight, wind_at_height=seen), problem)
    assert found.wind.source == "measured"
    assert found.wind.scale == pytest.approx(1.25, rel=1e-9)
    assert found.wind.direction_offset_deg == pytest.approx(4.0, abs=1e-9)
    assert found.wind.systematic_shares["profile"] == pytest.approx(0.0, abs=1e-9)


def _speed(problem: Problem, height_m: float) -> float:
    values = parameter_values(problem)
    return float(wind_function(values.structure)(height_m, values.vector))


@pytest.mark.skipif(not LIDAR_DATA.is_file(), reason="the flight data are not beside this checkout")
@pytest.mark.parametrize("source", ["measured", "airspeed", "ground", "fit"])
def test_every_route_holds_what_the_lidar_measured(source: str, tmp_path: Path) -> None:
    system = tmp_path / "v3-2025.yaml"
    system.write_text((LIDAR_DATA.parents[2] / "cases" / "v3-2025.yaml").read_text())
    wind = estimate(load_flight(LIDAR_DATA), load_problem(str(system)), wind=source).wind  # type: ignore[arg-type]
    low, high = wind.scale_total_interval or (math.nan, math.nan)
    speed = (wind.reference_speed_m_s or math.nan) / wind.scale
    assert low * speed < LIDAR_MEAN_M_S < high * speed
    # An interval that holds everything says nothing.
    assert (high - low) * speed < 12.0


@pytest.mark.skipif(not LIDAR_DATA.is_file(), reason="the flight data are not beside this checkout")
def test_a_prediction_takes_the_measured_wind_too(tmp_path: Path) -> None:
    system = tmp_path / "v3-2025.yaml"
    system.write_text((LIDAR_DATA.parents[2] / "cases" / "v3-2025.yaml").read_text())
    flight = load_flight(LIDAR_DATA)
    kite = estimate_kite(flight, load_problem(str(system)), [0])
    assert kite.wind.source == "measured"
    other = wind_of_cycle(flight, kite, 1)
    # Measured by itself: nothing of the wind of cycle 0 is in it.
    assert (other.estimate.source, other.slope) == ("measured", 0.0)
    assert other.estimate.scale != kite.wind.scale
