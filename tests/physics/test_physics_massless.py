"""Without weight the kite has closed forms (sections 2.3 and 2.4 of the paper); the package must give them exactly.

Tolerance 1e-10 relative: the rootfinder stops at a residual of 1e-14, and the states stay away from a zero radicand
of eq:tangentialkitevelocityfactor, where a square root would magnify rounding.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from paper import Places, StateTable, random_places

import kiteocp
from kiteocp.physics.flight import flight_state
from kiteocp.physics.parameters import ParameterValues

COUNT = 3000
RADICAND_MIN = 1e-2


@pytest.fixture(scope="module")
def reeling_states(problem: kiteocp.Problem) -> tuple[np.ndarray, np.ndarray, Places]:
    """Random places at any azimuth and course with reeling factors at which the paper's formulas hold."""
    table = random_places(2 * COUNT, seed=1)
    places = Places.of(problem, table)
    f = places.b - np.random.default_rng(2).uniform(0.05, 1.5, len(table))
    keep = np.flatnonzero(places.discriminant(places.lift / places.drag, f) > RADICAND_MIN)[:COUNT]
    assert keep.size > COUNT / 2
    return table[keep], f[keep], Places.of(problem, table[keep])


def test_closed_forms_of_the_reeling_factor(
    massless: ParameterValues, solved: StateTable, reeling_states: tuple[np.ndarray, np.ndarray, Places]
) -> None:
    table, f, at = reeling_states
    state = solved(massless, "reeling_factor", table, f)
    glide = at.lift / at.drag
    assert_allclose(state["wind_speed"], at.v_w, rtol=1e-13)
    assert_allclose(state["air_density"], at.rho, rtol=1e-13)
    # eq:triangle_similarity, eq:Vapp_final, eq:tangentialkitevelocityfactor, eq:tetherforce, eq:power
    assert_allclose(state["kinematic_ratio"], glide, rtol=1e-10)
    assert_allclose(state["apparent_wind_speed"] / at.v_w, (at.b - f) * np.sqrt(1 + glide**2), rtol=1e-10)
    assert_allclose(state["tangential_speed_factor"], at.factor(glide, f), rtol=1e-10, atol=1e-10)
    traction = at.c_r * (1 + glide**2) * (at.b - f) ** 2
    assert_allclose(state["tether_force_kite"], at.q * at.area * traction, rtol=1e-10)
    assert_allclose(state["tether_force_ground"], at.q * at.area * traction, rtol=1e-10)
    zeta = state["power"] / (0.5 * at.rho * at.v_w**3 * at.area)
    assert_allclose(zeta, f * traction, rtol=1e-10, atol=1e-12)


def test_force_given_has_the_reeling_factor_of_the_paper(
    massless: ParameterValues, solved: StateTable, reeling_states: tuple[np.ndarray, np.ndarray, Places]
) -> None:
    """eq:reeloutfactor_fixedforce with the minus sign: the wind along the tether exceeds the reel-out speed."""
    table, f, at = reeling_states
    force = at.q * at.area * at.c_r * (1 + (at.lift / at.drag) ** 2) * (at.b - f) ** 2
    for control in ("tether_force_kite", "tether_force_ground"):
        state = solved(massless, control, table, force)
        expected = at.b - np.sqrt(force / (at.q * at.area * at.c_r * (1 + (at.lift / at.drag) ** 2)))
        assert_allclose(state["reeling_factor"], expected, rtol=1e-10, atol=1e-10)
        assert_allclose(state["kinematic_ratio"], at.lift / at.drag, rtol=1e-10)


def test_the_closed_form_is_exact_too(
    massless: ParameterValues, explicit: StateTable, reeling_states: tuple[np.ndarray, np.ndarray, Places]
) -> None:
    table, f, at = reeling_states
    force = at.q * at.area * at.c_r * (1 + (at.lift / at.drag) ** 2) * (at.b - f) ** 2
    state = explicit(massless, table, force)
    assert_allclose(state["kinematic_ratio"], at.lift / at.drag, rtol=1e-10)
    assert_allclose(state["reeling_factor"], f, rtol=1e-10, atol=1e-10)


def test_larger_root_may_drift_backwards(problem: kiteocp.Problem) -> None:
    """A depowered kite high up that reels out on its way up drifts back: lambda < 0 is a valid state."""
    state = flight_state(
        problem, tether_length_m=500, elevation_deg=70, course_deg=180, reeling_factor=0.3, setting="depowered",
        gravity=False,
    )  # fmt: skip
    assert state["tangential_speed_factor"] < 0
    assert state["tangential_speed_m_s"] == pytest.approx(state["tangential_speed_factor"] * state["wind_speed_m_s"])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    length=st.floats(50, 1500),
    elevation=st.floats(5, 89),
    azimuth=st.floats(-80, 80),
    course=st.floats(-360, 360),
    below=st.floats(0.02, 2.0),
)
def test_public_state_of_any_place(
    problem: kiteocp.Problem, length: float, elevation: float, azimuth: float, course: float, below: float
) -> None:
    """`flight_state` over everything a user may type."""
    kite = problem.kite.powered
    row = np.array([[length, elevation, azimuth, course, kite.lift_coefficient, kite.kite_drag_coefficient]])
    at = Places.of(problem, row)
    f = at.b - below
    glide = at.lift / at.drag
    assume(at.discriminant(glide, f)[0] > RADICAND_MIN)
    state = flight_state(
        problem, tether_length_m=length, elevation_deg=elevation, azimuth_deg=azimuth, course_deg=course,
        reeling_factor=float(f[0]), gravity=False,
    )  # fmt: skip
    assert state["kinematic_ratio"] == pytest.approx(glide[0], rel=1e-10)
    assert state["tangential_speed_factor"] == pytest.approx(at.factor(glide, f)[0], rel=1e-10, abs=1e-10)
