"""Wind and coefficients from whole flights: the round trip with noise, gaps and wrong samples, and a real kite."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from made_flight import RECORDING
from msgspec.structs import replace
from scipy.stats import binom

import kiteocp
from kiteocp.errors import InputError
from kiteocp.recording import FlightData, load_flight
from kiteocp.studies.estimation.fit import fit_coefficients
from kiteocp.studies.estimation.inversion import invert
from kiteocp.studies.estimation.study import estimate
from kiteocp.studies.estimation.synthetic import Noise, flight_of_result
from kiteocp.studies.estimation.wind import WindEstimate, wind_from_airspeed, wind_from_ground, wind_of_problem

#: Sizes of errors as of good sensors; 5 % of the samples are wrong.
NOISE = Noise(
    speed_m_s=0.2, force_share=0.03, angle_deg=0.2, distance_m=1.0, airspeed_m_s=0.5, wind_share=0.1, wrong_share=0.05
)
TRUTH = {
    "powered.lift_coefficient": 0.9,
    "powered.drag_coefficient": 0.2,
    "depowered.lift_coefficient": 0.2,
    "depowered.drag_coefficient": 0.1,
}


@cache
def result() -> kiteocp.Result:
    return kiteocp.simulate(kiteocp.load_problem("v3-kite"))


def problem_in_wind(speed_m_s: float = 8.0) -> kiteocp.Problem:
    return kiteocp.load_problem("v3-kite", {"environment.wind.reference_speed_m_s": speed_m_s})


def made(**options: object) -> FlightData:
    return flight_of_result(result(), **options)  # type: ignore[arg-type]


def test_fit_without_noise_is_exact() -> None:
    flight, problem = made(), problem_in_wind()
    fit = fit_coefficients(flight, problem, invert(flight, problem)).fit
    for name, truth in TRUTH.items():
        assert fit.value(name) == pytest.approx(truth, rel=1e-8)
    assert not fit.outliers.any()


def test_fit_with_the_wind_free_finds_wind_and_direction_too() -> None:
    # The wind is 8 m/s; the problem says 10, and the frame of the flight is 12 deg off.
    flight, problem = made(), problem_in_wind(10.0)
    askew = replace(flight, azimuth_deg=flight.azimuth_deg + 12.0)
    found = fit_coefficients(askew, problem, invert(askew, problem), fit_wind=True)
    for name, truth in TRUTH.items():
        assert found.fit.value(name) == pytest.approx(truth, rel=1e-6)
    assert found.fit.value("wind_scale") == pytest.approx(0.8, rel=1e-6)
    assert found.fit.value("wind_direction_offset_deg") == pytest.approx(12.0, abs=1e-4)
    assert found.wind_identified


def test_wrong_samples_alone_do_not_move_the_fit() -> None:
    flight, problem = made(noise=Noise(wrong_share=0.05), seed=3), problem_in_wind()
    found = fit_coefficients(flight, problem, invert(flight, problem))
    for name, truth in TRUTH.items():
        assert found.fit.value(name) == pytest.approx(truth, rel=1e-8)
    assert found.rejected["powered"]["missing"] > 0
    assert found.outliers["powered"] > 20
    assert found.outliers["depowered"] > 10


def covered(seeds: range, fit_wind: bool) -> tuple[int, int]:
    """How many of all true values lie in their intervals, and of how many."""
    hits = trials = 0
    problem = problem_in_wind()
    truths = {**TRUTH, "wind_scale": 1.0, "wind_direction_offset_deg": 0.0}
    for seed in seeds:
        flight = made(noise=NOISE, cycles=2, seed=seed, gaps=((20.0, 27.0), (150.0, 154.0)))
        fit = fit_coefficients(flight, problem, invert(flight, problem), fit_wind=fit_wind).fit
        for name in fit.names:
            low, high = fit.interval(name)
            hits, trials = hits + (low <= truths[name] <= high), trials + 1
    return hits, trials


def test_intervals_of_the_fit_hold_what_they_promise() -> None:
    hits, trials = covered(range(5), fit_wind=False)
    # The parameters of one flight are not independent of each other: the bound is that of half as many trials.
    assert hits >= 2 * binom.ppf(0.005, trials // 2, 0.93)


@pytest.mark.slow
@pytest.mark.parametrize("fit_wind", [False, True])
def test_intervals_of_the_fit_over_many_flights(fit_wind: bool) -> None:
    hits, trials = covered(range(100, 160), fit_wind)
    assert 2 * binom.ppf(0.005, trials // 2, 0.91) <= hits < trials


def test_intervals_shrink_with_independent_data_only() -> None:
    problem, noise = problem_in_wind(), replace(NOISE, correlation_time_s=2.0)
    sizes = []
    for rate, cycles in ((5.0, 1), (20.0, 1), (5.0, 4)):
        logarithms = []
        for seed in (1, 2):
            flight = made(noise=noise, sample_rate_Hz=rate, cycles=cycles, seed=seed)
            fit = fit_coefficients(flight, problem, invert(flight, problem)).fit
            logarithms.append(np.log(fit.standard_errors))
        sizes.append(float(np.exp(np.mean(logarithms))))
    # Four times the samples of the same minutes tell little more; four times the minutes halve the error.
    assert sizes[1] / sizes[0] > 0.75
    assert sizes[2] / sizes[0] == pytest.approx(0.5, abs=0.13)


def test_a_wind_that_cannot_be_told_is_not_told() -> None:
    # In one steady state a stronger wind and smaller coefficients are the same.
    flight, problem = made(noise=NOISE, seed=2), problem_in_wind()
    steady = flight.where((flight.phase == "traction") & (flight.time_s < flight.time_s[-1] - 40.0))
    found = fit_coefficients(steady, problem, invert(steady, problem), fit_wind=True)
    assert found.wind_identified is False
    estimation = estimate(steady, problem, wind="fit")
    assert estimation.wind.source == "airspeed"
    assert any("does not tell the wind from the coefficients" in text for text in estimation.warnings)
    assert any("too few depowered samples" in text for text in estimation.warnings)


def test_wind_from_airspeed_with_a_sensor_that_shows_too_little() -> None:
    flight = made()
    askew = replace(
        flight,
        azimuth_deg=flight.azimuth_deg - 7.0,
        apparent_wind_speed_m_s=0.9 * flight.apparent_wind_speed_m_s,
    )
    found = wind_from_airspeed(askew, problem_in_wind(10.0))
    assert found.scale == pytest.approx(0.8, rel=1e-6)
    assert found.direction_offset_deg == pytest.approx(-7.0, abs=1e-4)
    assert found.airspeed_gain == pytest.approx(0.9, rel=1e-6)
    assert found.reference_speed_m_s == pytest.approx(8.0, rel=1e-6)
    np.testing.assert_allclose(found.turned(askew).azimuth_deg, flight.azimuth_deg, atol=1e-4)
    # Bearings grow with the clock, azimuths against it.
    assert found.turned(askew).downwind_bearing_deg == pytest.approx(askew.downwind_bearing_deg + 7.0, abs=1e-4)
    # Taken at its word, the sensor passes for a calm.
    assert wind_from_airspeed(askew, problem_in_wind(10.0), calibrate=False).scale < 0.75


@pytest.mark.parametrize("seed", [0, 13])
def test_wind_from_airspeed_with_noise_and_wrong_samples(seed: int) -> None:
    found = wind_from_airspeed(made(noise=NOISE, cycles=2, seed=seed), problem_in_wind(10.0))
    assert found.scale_standard_error is not None
    assert found.direction_standard_error_deg is not None
    assert 0.002 < found.scale_standard_error < 0.04
    # Four standard errors: some 1 in 10 000.
    assert abs(found.scale - 0.8) < 4 * found.scale_standard_error
    assert abs(found.direction_offset_deg) < 4 * found.direction_standard_error_deg
    assert found.outliers > 10


@pytest.mark.parametrize(
    "wind",
    [
        {"profile": "uniform", "reference_speed_m_s": 7.0},
        {"profile": "power-law", "reference_speed_m_s": 6.0, "reference_height_m": 50.0, "exponent": 0.2},
        {"profile": "table", "heights_m": [0.0, 50.0, 150.0, 400.0], "speeds_m_s": [0.0, 7.0, 9.0, 10.0]},
    ],
)
def test_every_profile_scales(wind: dict[str, object]) -> None:
    problem = kiteocp.load_problem("v3-kite", {"environment.wind": wind, "uncertainty": None})
    flight = flight_of_result(kiteocp.simulate(problem))
    weaker = WindEstimate("problem", 0.7).applied(problem)
    assert wind_from_airspeed(flight, weaker).scale == pytest.approx(1 / 0.7, rel=1e-6)
    ground = wind_from_ground(flight, weaker)
    assert ground.scale == pytest.approx(1 / 0.7, rel=1e-9)
    assert invert(flight, ground.applied(weaker)).quantities["exact.lift_coefficient"].max() < 0.9001


def test_wind_sources_that_are_not_there() -> None:
    flight = made(sample_rate_Hz=2.0)
    blind = replace(flight, apparent_wind_speed_m_s=np.full(len(flight), np.nan))
    with pytest.raises(InputError, match="apparent wind speed"):
        wind_from_airspeed(blind, problem_in_wind())
    assert estimate(blind, problem_in_wind()).wind.source == "ground"
    blinder = replace(blind, ground_wind_speed_m_s=np.full(len(flight), np.nan))
    with pytest.raises(InputError, match="at the ground"):
        wind_from_ground(blinder, problem_in_wind())
    assert estimate(blinder, problem_in_wind()).wind == wind_of_problem(problem_in_wind())


def test_the_wrong_kite_is_refused() -> None:
    flight = made(sample_rate_Hz=2.0)
    with pytest.raises(InputError, match=r"kite\.projected_area_m2"):
        estimate(flight, kiteocp.load_problem("v3-kite", {"kite.projected_area_m2": 1.0}))
    with pytest.raises(InputError, match="has no cycle 3; it has 0"):
        estimate(flight, problem_in_wind(), cycles=[3])


def test_derivatives_of_the_fit_are_those_of_its_residuals() -> None:
    from kiteocp.studies.estimation.fit import _residuals  # noqa: PLC0415
    from kiteocp.studies.estimation.inversion import measured_samples  # noqa: PLC0415

    flight = made(noise=replace(NOISE, wrong_share=0.0), sample_rate_Hz=1.0)
    groups = (flight.phase == "retraction").astype(np.int64)
    residuals = _residuals(problem_in_wind(), measured_samples(flight), groups, 2, True)
    at = np.array([0.8, 0.15, 0.25, 0.12, 1.1, 5.0])
    slopes = residuals(at)[1]
    for index in range(at.size):
        step = np.zeros(at.size)
        step[index] = 1e-6
        difference = (residuals(at + step)[0] - residuals(at - step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[:, :, index], difference, rtol=1e-6, atol=1e-6)


@pytest.mark.skipif(not RECORDING.exists(), reason="the recording is not here")
def test_a_real_kite() -> None:
    # Every third sample tells as much: they are correlated over seconds.
    whole = load_flight(RECORDING)
    flight = whole.where(np.arange(len(whole)) % 3 == 0)
    found = estimate(flight, kiteocp.load_problem("v9-kite"))
    lift, drag = found.fit.coefficients("powered")
    depowered_lift, _ = found.fit.coefficients("depowered")
    assert 0.5 < lift < 1.1
    assert 3.0 < lift / drag < 8.0
    assert 0.2 < depowered_lift < 0.7 * lift
    # Airspeed and equilibrium are two ways to the same wind; the sensor shows too little.
    assert found.fit_with_wind.wind_identified
    low, high = found.fit_with_wind.fit.interval("wind_scale")
    assert low < 1.0 < high
    assert found.wind.airspeed_gain == pytest.approx(0.88, abs=0.04)
    assert sorted(found.winds) == [0, 1, 2, 3]
    assert all(0.6 < wind.scale / found.wind.scale < 1.4 for wind in found.winds.values())
    # Each half of the flight by itself gives much the same.
    for cycles in ([0, 1], [2, 3]):
        half = flight.select(cycles)
        problem = wind_from_airspeed(half, found.problem).applied(found.problem)
        fit = fit_coefficients(half, problem, invert(half, problem))
        assert fit.coefficients("powered")[0] == pytest.approx(lift, rel=0.1)
