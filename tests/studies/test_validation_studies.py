"""Convergence of the paper's scheme and the isolines of kite mass, against independent ways to the same numbers."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import kiteocp
from kiteocp.errors import NoEquilibriumError
from kiteocp.studies.paper.convergence import Convergence, Curve, convergence_study
from kiteocp.studies.paper.isolines import (
    ELEVATION_DEG,
    LIFT_TO_DRAG,
    REELING_FACTOR,
    isoline_problem,
    mass_isolines,
)


@cache
def study() -> Convergence:
    return convergence_study(np.geomspace(0.3, 1e-3, 8))


def test_scheme_converges_with_first_order_to_the_adaptive_integrator() -> None:
    assert len(study().curves) == 4
    for curve in study().curves.values():
        assert curve.ratios[-1] == 1.0
        assert curve.order == pytest.approx(1.0, abs=0.02)
        # The smallest time step is off by 0.2 %; extrapolation leaves less than a fiftieth of that.
        assert 1.5e-3 < curve.accurate_ratio - 1 < 2.5e-3
        assert curve.limit_ratio == pytest.approx(curve.accurate_ratio, abs=5e-5)
        assert np.all(np.diff(curve.steps) > 0)


def test_curves_are_those_of_simulate() -> None:
    curve = study().curves["moderate wind, gravity excluded"]
    problem = kiteocp.load_problem("moderate-wind")

    def factor(time_step: float | None) -> float:
        return float(kiteocp.simulate(problem, gravity=False, time_step=time_step).cycle["mean_harvesting_factor"] or 0)

    reference = factor(float(curve.time_steps[-1]))
    assert factor(float(curve.time_steps[3])) / reference == pytest.approx(curve.ratios[3], rel=1e-12)
    assert factor(None) / reference == pytest.approx(curve.accurate_ratio, rel=1e-12)
    assert study().paper_deviations["moderate wind, gravity excluded"] == pytest.approx(factor(0.01) / reference - 1)


def test_band_begins_where_it_is_said_to() -> None:
    for name, gravity in (("gravity included", True), ("gravity excluded", False)):
        problem, curve = kiteocp.load_problem("strong-wind"), study().curves[f"strong wind, {name}"]

        def ratio(time_step: float, problem: kiteocp.Problem = problem, gravity: bool = gravity) -> float:
            cycle = kiteocp.simulate(problem, gravity=gravity, time_step=time_step).cycle
            return float(cycle["mean_power_W"] or 0.0)

        reference, begin = ratio(float(curve.time_steps[-1])), study().band_time_steps[f"strong wind, {name}"]
        assert abs(ratio(begin) / reference - 1) <= 0.03
        assert abs(ratio(1.001 * begin) / reference - 1) > 0.03


def test_a_scheme_that_fails_is_missing_and_not_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps so long that the kite leaves the domain: said by what is not a number."""
    from kiteocp.studies.paper import convergence  # noqa: PLC0415

    heavy = kiteocp.load_problem("moderate-wind", {"kite.mass_kg": 30.0, "environment.wind.reference_speed_m_s": 4.5})
    monkeypatch.setattr(convergence, "CASES", {"moderate-wind": "moderate wind"})
    monkeypatch.setattr(convergence, "load_problem", lambda case: heavy)
    found = convergence_study(np.geomspace(0.8, 0.01, 4))
    curve = found.curves["moderate wind, gravity included"]
    assert np.isnan(curve.ratios[0])
    assert np.isnan(curve.steps[0])
    assert curve.ratios[-1] == 1.0


def test_order_and_limit_of_a_made_curve() -> None:
    steps = np.array([0.4, 0.2, 0.1])
    values = 3.0 - 2.0 * steps**2
    curve = Curve(steps, values / values[-1], 1.0, steps)
    assert curve.order == pytest.approx(2.0)
    assert curve.limit_ratio == pytest.approx(3.0 / values[-1])


def forward(mass: float, course: float) -> float:
    state = kiteocp.flight_state(
        isoline_problem(mass),
        tether_length_m=100.0,
        elevation_deg=ELEVATION_DEG,
        course_deg=course,
        reeling_factor=REELING_FACTOR,
    )
    return state["kinematic_ratio"]


def test_masses_solved_forward_fly_at_their_kinematic_ratio() -> None:
    found = mass_isolines()
    places = np.argwhere(np.isfinite(found.mass_kg) & (found.mass_kg > 0) & (found.mass_kg < 400))
    assert len(places) > 5000
    for row, column in np.random.default_rng(1).permutation(places)[:150]:
        ratio = forward(float(found.mass_kg[row, column]), float(found.course_deg[column]))
        assert ratio == pytest.approx(found.kinematic_ratio[row], rel=1e-6)


def test_every_kite_that_flies_is_on_the_isolines() -> None:
    """The other way round: solve forward for a mass, and find the mass at that kinematic ratio."""
    random, flying = np.random.default_rng(2), 0
    for course, mass in zip(random.uniform(0, 360, 60), random.uniform(0.5, 60, 60), strict=True):
        try:
            ratio = forward(float(mass), float(course))
        except NoEquilibriumError:
            continue
        if abs(ratio / LIFT_TO_DRAG - 1) < 0.02:
            continue  # where the sheets of two masses meet, the smaller is given
        flying += 1
        found = mass_isolines(np.array([course]), np.array([ratio]))
        assert found.mass_kg[0, 0] == pytest.approx(mass, rel=1e-6)
    assert flying > 25


def test_massless_kite_flies_at_its_lift_to_drag_ratio() -> None:
    found = mass_isolines(np.array([0.0, 135.0, 180.0, 270.0]), np.array([LIFT_TO_DRAG]))
    assert found.mass_kg[0] == pytest.approx([0.0] * 4, abs=1e-6)


def test_straight_up_and_down_against_the_angles_of_the_forces() -> None:
    """In the plane of the wind the force leans by the difference of the angles of the apparent wind and of the drag."""
    ratios = np.array([2.5, 4.0, 6.0, 9.0])
    found = mass_isolines(np.array([0.0, 180.0]), ratios)
    radial_wind = 7.0 * (np.cos(np.radians(25.0)) - 0.37)
    force = 0.5 * 1.225 * np.hypot(1.0, 0.2) * (radial_wind**2) * (1 + ratios**2) * 16.7
    lean = np.arctan(ratios) - np.arctan(5.0)
    expected = force * np.sin(lean) / (9.81 * np.cos(np.radians(25.0)))
    assert found.mass_kg[:, 0] == pytest.approx(np.where(expected >= 0, expected, np.nan), nan_ok=True, rel=1e-9)
    assert found.mass_kg[:, 1] == pytest.approx(np.where(expected <= 0, -expected, np.nan), nan_ok=True, rel=1e-9)


def test_horizontal_and_upward_flight_is_slower_and_downward_faster_than_the_massless() -> None:
    """What the paper reads off its figure."""
    found = mass_isolines()
    upward = (found.course_deg >= 90) & (found.course_deg <= 270)
    heavy = found.mass_kg > 1e-6
    ratios = np.broadcast_to(found.kinematic_ratio[:, None], heavy.shape)
    assert np.all(ratios[:, upward][heavy[:, upward]] < LIFT_TO_DRAG)
    steep = (found.course_deg < 75) | (found.course_deg > 285)
    assert np.all(ratios[:, steep][heavy[:, steep]] > LIFT_TO_DRAG)
    # The same on both sides of straight up.
    np.testing.assert_allclose(found.mass_kg, found.mass_kg[:, ::-1], rtol=1e-6, atol=1e-6)
