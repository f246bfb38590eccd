"""Coefficients of single samples: the round trip is exact, and the paper's formulas are as far off as stated."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

import kiteocp
from kiteocp.errors import InputError
from kiteocp.physics.parameters import parameter_values
from kiteocp.recording import FlightData
from kiteocp.studies.estimation.bias import round_trip
from kiteocp.studies.estimation.fit import SETTING_OF_PHASE
from kiteocp.studies.estimation.inversion import invert
from kiteocp.studies.estimation.synthetic import flight_of_result

PROBLEMS = ("strong-wind", "moderate-wind", "v3-kite")


@pytest.fixture(scope="module", params=PROBLEMS)
def case(request: pytest.FixtureRequest) -> tuple[kiteocp.Problem, FlightData]:
    problem = kiteocp.load_problem(request.param)
    return problem, flight_of_result(kiteocp.simulate(problem))


def test_exact_inversion_gives_the_coefficients_back(case: tuple[kiteocp.Problem, FlightData]) -> None:
    problem, flight = case
    found, values = invert(flight, problem), parameter_values(problem)
    assert set(found.reasons["exact"]) == {""}
    for phase, setting in SETTING_OF_PHASE.items():
        inside = flight.phase == phase
        assert inside.sum() > 20
        lift = found.quantities["exact.lift_coefficient"][inside]
        drag = found.quantities["exact.kite_drag_coefficient"][inside]
        np.testing.assert_allclose(lift, values[f"kite.{setting}.lift_coefficient"], rtol=1e-8)
        np.testing.assert_allclose(drag, values.kite_drag_coefficient(setting), rtol=1e-8)
    np.testing.assert_allclose(found.quantities["apparent_wind_speed_m_s"], flight.apparent_wind_speed_m_s, rtol=1e-12)


@pytest.mark.parametrize("course_deg", [0.0, 40.0, 90.0, 155.0, 180.0, 250.0, 320.0])
@pytest.mark.parametrize("azimuth_deg", [-40.0, 0.0, 25.0])
def test_any_place_and_course_is_inverted(course_deg: float, azimuth_deg: float) -> None:
    problem = kiteocp.load_problem("v3-kite")
    place = {"tether_length_m": 310.0, "elevation_deg": 33.0, "azimuth_deg": azimuth_deg, "course_deg": course_deg}
    state = kiteocp.flight_state(problem, **place, reeling_speed_m_s=1.5)
    found = invert(_one_sample(state, place), problem).quantities
    assert found["exact.lift_coefficient"][0] == pytest.approx(0.9, rel=1e-8)
    assert found["exact.kite_drag_coefficient"][0] == pytest.approx(0.2, rel=1e-8)
    assert found["tether_force_kite_N"][0] == pytest.approx(state["tether_force_kite_N"], rel=1e-12)
    assert found["paper.kinematic_ratio"][0] == pytest.approx(state["kinematic_ratio"], rel=1e-9)


def test_paper_formulas_are_those_of_the_paper() -> None:
    """Against section 3.3 and 3.4 in plain numbers, none of the model's functions used."""
    problem = kiteocp.load_problem("strong-wind")
    r, beta, phi, chi = 520.0, np.radians(31.0), np.radians(12.0), np.radians(97.0)
    v_r, v_t, force = 4.1, 25.0, 2900.0
    place = {"tether_length_m": r, "elevation_deg": 31.0, "azimuth_deg": 12.0, "course_deg": 97.0}
    state = {"reeling_speed_m_s": v_r, "tangential_speed_m_s": v_t, "tether_force_ground_N": force}
    found = invert(_one_sample({**state, "height_m": r * np.sin(beta)}, place), problem).quantities

    p = problem.to_dict()
    g = p["environment"]["gravity_m_s2"]
    wind, air, kite, rope = p["environment"]["wind"], p["environment"]["air"], p["kite"], p["tether"]
    z = r * np.sin(beta)
    ratio = np.log(z / wind["roughness_length_m"]) / np.log(wind["reference_height_m"] / wind["roughness_length_m"])
    v_w = wind["reference_speed_m_s"] * ratio
    rho = air["density_sea_level_kg_m3"] * np.exp(-z / air["density_scale_height_m"])
    area, mass = kite["projected_area_m2"], kite["mass_kg"]
    m_t = rope["density_kg_m3"] * np.pi / 4 * rope["diameter_m"] ** 2 * r
    theta = np.pi / 2 - beta
    v_a = np.linalg.norm(
        [
            np.sin(theta) * np.cos(phi) * v_w - v_r,
            np.cos(theta) * np.cos(phi) * v_w - v_t * np.cos(chi),
            -np.sin(phi) * v_w - v_t * np.sin(chi),
        ]
    )
    f_ar = np.sqrt(force**2 - 0.25 * (np.sin(theta) * m_t * g) ** 2) + np.cos(theta) * (m_t + mass) * g
    f_a = np.hypot(f_ar, (m_t / 2 + mass) * g * np.sin(theta))
    c_r = 2 * f_a / (rho * v_a**2 * area)
    kappa = np.sqrt((v_a / (v_w * (np.sin(theta) * np.cos(phi) - v_r / v_w))) ** 2 - 1)
    ratios = [kappa]
    for _ in range(2):
        term = g * (m_t / 2 + mass) * np.sin(theta) * np.cos(chi) * np.sqrt(1 + ratios[-1] ** 2) / f_a
        ratios.append(kappa - np.sqrt(1 + kappa**2) * term)
    drag = f_a / np.sqrt(1 + ratios[2] ** 2)
    tether_drag = rho * rope["diameter_m"] * r * rope["drag_coefficient"] * v_a**2 / 8
    for name, expected in {
        "resultant_coefficient": c_r,
        "kinematic_ratio": kappa,
        "lift_to_drag_second": ratios[1],
        "lift_to_drag": ratios[2],
        "kite_lift_to_drag": ratios[2] * drag / (drag - tether_drag),
    }.items():
        assert found[f"paper.{name}"][0] == pytest.approx(expected, rel=1e-12), name


# Measured, in %: mean over a phase of a simulated cycle without noise, over the truth, less 1.
STATED_BIAS = {
    "strong-wind": {"retraction": (-0.2, 1.0), "transition": (0.0, -0.3), "traction": (-0.5, 5.8)},
    "moderate-wind": {"retraction": (-0.3, 2.3), "transition": (0.0, -0.5), "traction": (-0.4, 4.6)},
    "v3-kite": {"retraction": (-0.9, 3.1), "transition": (0.0, -0.9), "traction": (-0.2, 4.1)},
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_bias_of_the_paper_is_as_stated(name: str) -> None:
    trip = round_trip(kiteocp.load_problem(name))
    assert trip.exact < 1e-8
    for phase, (lift, drag) in STATED_BIAS[name].items():
        assert 100 * trip.paper[phase]["lift_coefficient"] == pytest.approx(lift, abs=0.1)
        assert 100 * trip.paper[phase]["kite_drag_coefficient"] == pytest.approx(drag, abs=0.1)


def test_without_weight_the_paper_is_exact() -> None:
    trip = round_trip(kiteocp.load_problem("v3-kite", {"environment.gravity_m_s2": 1e-9}))
    for biases in trip.paper.values():
        assert biases["kite_lift_to_drag"] == pytest.approx(0.0, abs=1e-6)


def test_samples_without_an_answer_are_counted_by_reason() -> None:
    problem = kiteocp.load_problem("v3-kite")
    whole = flight_of_result(kiteocp.simulate(problem))
    flight = whole.where(whole.phase == "traction")
    force, radial = flight.tether_force_ground_N.copy(), flight.radial_speed_m_s.copy()
    force[:3], force[3:5], radial[5:9] = np.nan, 1.0, 30.0
    polar = flight.polar_speed_m_s.copy()
    # Upwind of its own air: the force cannot follow.
    radial[9:11], polar[9:11] = 6.0, -60.0
    found = invert(
        replace(flight, tether_force_ground_N=force, radial_speed_m_s=radial, polar_speed_m_s=polar), problem
    )
    everything = np.ones(len(flight), dtype=bool)
    counts = found.counts("exact", everything)
    assert counts["missing"] == 3
    assert counts["slack"] == 2
    assert counts["no_radial_wind"] == 4
    assert sum(counts.values()) == 11
    assert np.count_nonzero(np.isfinite(found.quantities["exact.lift_coefficient"])) == len(flight) - 11


def test_a_flight_is_made_of_a_simulation_with_gravity_only() -> None:
    problem = kiteocp.load_problem("v3-kite")
    with pytest.raises(InputError, match="simulation with gravity"):
        flight_of_result(kiteocp.simulate(problem, gravity=False))
    with pytest.raises(InputError, match="must be positive"):
        flight_of_result(kiteocp.simulate(problem), cycles=0)


def _one_sample(state: dict[str, float], place: dict[str, float]) -> FlightData:
    course = np.radians(place["course_deg"])
    numbers = {
        "time_s": 0.0,
        "distance_m": place["tether_length_m"],
        "tether_length_m": place["tether_length_m"],
        "elevation_deg": place["elevation_deg"],
        "azimuth_deg": place["azimuth_deg"],
        "height_m": state["height_m"],
        "course_deg": place["course_deg"],
        "radial_speed_m_s": state["reeling_speed_m_s"],
        "polar_speed_m_s": state["tangential_speed_m_s"] * np.cos(course),
        "azimuthal_speed_m_s": state["tangential_speed_m_s"] * np.sin(course),
        "reeling_speed_m_s": state["reeling_speed_m_s"],
        "tether_force_ground_N": state["tether_force_ground_N"],
    }
    missing = ("ground_wind_speed_m_s", "ground_wind_direction_deg", "apparent_wind_speed_m_s")
    missing += ("angle_of_attack_deg", "power_setting")
    arrays = {name: np.array([value]) for name, value in numbers.items()}
    arrays |= {name: np.array([np.nan]) for name in missing}
    return FlightData(cycle=np.zeros(1, dtype=int), phase=np.array(["traction"]), **arrays)
