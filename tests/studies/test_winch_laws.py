"""The winch laws: they never fall, keep to the winch's speeds, and meet the kite where the closed form says."""

from __future__ import annotations

import numpy as np
import pytest

from kiteocp import CycleError, load_problem
from kiteocp.cycle.phases import PHASES
from kiteocp.optimum.refine import optimise
from kiteocp.physics.flight import flight_state
from kiteocp.physics.wind import problem_in_wind
from kiteocp.studies.winch.evaluation import violations_of
from kiteocp.studies.winch.flight import HeldQuantities, Switching, fly_laws
from kiteocp.studies.winch.law import (
    FORCE_BAND,
    WinchLaw,
    fit_force_law,
    fit_length_law,
    ground_force_limits,
    is_monotone,
)


@pytest.fixture(scope="module")
def cycle():
    return optimise(load_problem("v3-kite"), certificate="quick").cycle


@pytest.fixture(scope="module")
def laws(cycle):
    return {record.name: fit_force_law(record, [], cycle.values) for record in cycle.records}


@pytest.fixture(scope="module")
def flown(cycle, laws):
    return fly_laws(cycle.values, laws, Switching.of(cycle), held_of(cycle))


def held_of(cycle):
    return {name: HeldQuantities.of(cycle, name) for name in PHASES}


def constant_law(phase, speed):
    return WinchLaw(phase, "force", "tether_force_ground_N", np.array([1.0, 2.0]), np.full(2, speed), (1, 2), 0.0, 0.0)


@pytest.mark.parametrize("phase", PHASES)
def test_a_force_law_rises_between_the_fastest_speeds(cycle, laws, phase):
    law, limits = laws[phase], load_problem("v3-kite").limits
    assert np.all(np.diff(law.knots) > 0)
    assert np.all(np.diff(law.reeling_speed_m_s) >= 0)
    assert law.reeling_speed_m_s[0] == -limits.reel_in_speed_max_m_s
    assert law.reeling_speed_m_s[-1] == limits.reel_out_speed_max_m_s
    speeds = limits.reel_in_speed_max_m_s + limits.reel_out_speed_max_m_s
    # Rounding of the knots' differences only.
    assert law.steepest_slope <= speeds / (FORCE_BAND * limits.tether_force_max_N) * (1 + 1e-9)


@pytest.mark.parametrize("phase", PHASES)
def test_a_force_law_is_near_the_optimum(laws, phase):
    # 0.11 m/s was measured (retraction, whose speed is no function of the force); the speeds themselves are 2 to 5 m/s.
    assert laws[phase].error_rms_m_s < 0.2
    assert laws[phase].error_rms_m_s <= laws[phase].error_max_m_s


def test_force_limits_are_moved_to_where_the_winch_measures(cycle):
    traction = cycle.records[-1]
    lowest, highest = ground_force_limits(traction, cycle.values)
    assert lowest == 300.0  # acts at the ground already
    # The tether weighs less than 4 kg: the two forces differ by less than 40 N.
    assert 4960.0 < highest < 5000.0
    assert highest <= traction.output("tether_force_ground").max() + 1e-6


def test_kite_and_winch_agree_along_the_flight(laws, flown):
    for record in flown:
        met = laws[record.name](record.output("tether_force_ground"))
        # The samples lie between the integrator's steps; the steepest law turns 0.1 N into 0.008 m/s.
        np.testing.assert_allclose(record.output("reeling_speed"), met, atol=2e-5)


def test_the_flight_obeys_the_residual_of_the_model(flown):
    """The same states by `casadi.rootfinder` on the implicit equilibrium."""
    problem = load_problem("v3-kite")
    record = flown[0]
    for index in (0, 60, 120, 240):
        state = flight_state(
            problem,
            tether_length_m=float(record.tether_length_m[index]),
            elevation_deg=float(np.degrees(record.elevation_rad[index])),
            setting="depowered",
            tether_force_ground_N=float(record.output("tether_force_ground")[index]),
        )
        assert state["reeling_speed_m_s"] == pytest.approx(float(record.output("reeling_speed")[index]), abs=1e-6)


def test_energy_and_length_are_the_integrals_of_the_time_series(flown):
    for record in flown:
        # Trapezoids over 241 samples of a curve with a few kinks.
        energy = np.trapezoid(record.output("power"), record.time_s)
        assert energy == pytest.approx(record.energy_J, rel=1e-4)
        length = np.trapezoid(record.output("reeling_speed"), record.time_s)
        assert length == pytest.approx(record.tether_length_m[-1] - record.tether_length_m[0], rel=1e-4)


def test_phases_end_where_the_switching_conditions_say(cycle, flown):
    ends = Switching.of(cycle)
    assert flown[0].tether_length_m[-1] == pytest.approx(ends.retraction_length_m, abs=1e-9)
    assert np.degrees(flown[1].elevation_rad[-1]) == pytest.approx(ends.transition_elevation_deg, abs=1e-9)
    assert flown[2].tether_length_m[-1] == pytest.approx(ends.traction_length_m, abs=1e-9)


def test_the_retraction_also_ends_at_the_highest_elevation(cycle, laws):
    values = cycle.values.replaced({"limits.elevation_max_deg": 50.0})
    ends = Switching(200.0, 50.0, 20.0, 400.0, 20.0, 400.0)
    retraction = fly_laws(values, laws, ends, held_of(cycle))[0]
    assert np.degrees(retraction.elevation_rad[-1]) == pytest.approx(50.0, abs=1e-9)
    assert retraction.tether_length_m[-1] > 250.0


def test_a_law_that_cannot_fly_says_where(cycle, laws):
    hopeless = {**laws, "traction": constant_law("traction", 9.9)}
    with pytest.raises(CycleError, match="no steady state") as caught:
        fly_laws(cycle.values, hopeless, Switching.of(cycle), held_of(cycle))
    assert caught.value.phase == "traction"
    resting = {**laws, "traction": constant_law("traction", 0.0)}
    with pytest.raises(CycleError, match="does not end"):
        fly_laws(cycle.values, resting, Switching.of(cycle), held_of(cycle))


def test_a_phase_without_a_direction_has_no_length_law(cycle):
    retraction = cycle.records[0]
    assert fit_length_law(retraction) is not None
    turned = type(retraction)(
        retraction.name,
        retraction.time_s,
        np.abs(retraction.tether_length_m - 300.0) + 200.0,
        retraction.elevation_rad,
        retraction.outputs,
        retraction.energy_J,
        retraction.electrical_energy_J,
    )
    assert fit_length_law(turned) is None
    assert not is_monotone(np.array([0.0, 1.0, 1.0]))


def test_violations_name_the_worst_of_a_phase_in_the_unit_of_the_file(cycle, flown):
    values = cycle.values.replaced({"limits.tether_force_max_N": 4000.0, "limits.traction_elevation_min_deg": 25.0})
    found = {(v["limit"], v["phase"]): v for v in violations_of(flown, values, cycle.limits)}
    force = found["limits.tether_force_max_N", "traction"]
    assert force["reached"] == pytest.approx(5000.0, rel=1e-3)
    assert force["excess_percent"] == pytest.approx(25.0, abs=0.1)
    low = found["limits.traction_elevation_min_deg", "traction"]
    assert low["reached"] == pytest.approx(20.0, abs=1e-6)
    assert low["excess_percent"] == pytest.approx(20.0, abs=1e-6)


def test_wind_is_scaled_in_any_profile():
    weaker = problem_in_wind(load_problem("strong-wind"), 0.9)
    assert weaker.environment.wind.reference_speed_m_s == pytest.approx(0.9 * 9.9)
    table = {"profile": "table", "heights_m": [0.0, 100.0, 1000.0], "speeds_m_s": [5.0, 10.0, 12.0]}
    stronger = problem_in_wind(load_problem("strong-wind", {"environment.wind": table}), 1.1)
    np.testing.assert_allclose(stronger.environment.wind.speeds_m_s, [5.5, 11.0, 13.2])
