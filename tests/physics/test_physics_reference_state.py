"""Reference intermediates of two states of the strong-wind case.

Self-made, not the paper's: computed once in plain Python (`math`, and `scipy.optimize.brentq` on eq:F_a_projection for
the kinematic ratio), straight from the equations of the paper, to nine digits.
"""

from __future__ import annotations

import pytest

import kiteocp
from kiteocp.physics.flight import flight_state

CROSSWIND = {
    "height_m": 286.788218,
    "wind_speed_m_s": 18.5009839,
    "air_density_kg_m3": 1.18459194,
    "drag_coefficient": 0.226421569,
    "resultant_coefficient": 0.726200197,
    "sag_N": 18.2777177,
    "radial_ground_force_N": 2982.34808,
    "tether_force_ground_N": 2982.40409,
    "weight_across_N": 138.815941,
    "aerodynamic_force_N": 3095.46041,
    "apparent_wind_speed_m_s": 26.5622568,
    "kinematic_ratio": 2.81012824,
    "reeling_factor": 0.319910752,
    "tangential_speed_factor": 0.94122253,
    "reeling_speed_m_s": 5.91866367,
    "tangential_speed_m_s": 17.4135429,
    "kite_speed_m_s": 18.3919019,
    "power_W": 17651.8467,
}

REEL_IN = {
    "height_m": 459.626666,
    "wind_speed_m_s": 19.550078,
    "air_density_kg_m3": 1.16088581,
    "drag_coefficient": 0.119544592,
    "resultant_coefficient": 0.207824227,
    "sag_N": 17.2110033,
    "radial_ground_force_N": 707.779681,
    "tether_force_ground_N": 707.988909,
    "weight_across_N": 111.7972,
    "aerodynamic_force_N": 868.749156,
    "apparent_wind_speed_m_s": 26.5716958,
    "kinematic_ratio": 1.09097291,
    "reeling_factor": -0.275601489,
    "tangential_speed_factor": 0.235893183,
    "reeling_speed_m_s": -5.38803061,
    "tangential_speed_m_s": 4.61173013,
    "kite_speed_m_s": 7.09217376,
    "power_W": -3814.66591,
}


def test_crosswind_flight(problem: kiteocp.Problem) -> None:
    state = flight_state(
        problem, tether_length_m=500, elevation_deg=35, azimuth_deg=12, course_deg=101, tether_force_kite_N=3008
    )
    assert {name: state[name] for name in CROSSWIND} == pytest.approx(CROSSWIND, rel=5e-9)


def test_reel_in_flight(problem: kiteocp.Problem) -> None:
    state = flight_state(problem, tether_length_m=600, elevation_deg=50, setting="depowered", tether_force_kite_N=749)
    assert {name: state[name] for name in REEL_IN} == pytest.approx(REEL_IN, rel=5e-9)
