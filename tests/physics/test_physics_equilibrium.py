"""Independent ways to the same equilibrium with gravity: rootfinder, closed form, Newton form, the paper's iteration.

Tolerance 1e-9 on the inflow angle unless said otherwise: the residual, a cosine, is solved to 1e-14, and its slope at
the random states below is seldom under 1e-4.
"""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from paper import Places, StateTable, random_places

import kiteocp
from kiteocp.errors import NoEquilibriumError
from kiteocp.physics.flight import OperatingPoint, flight_state, solve_state
from kiteocp.physics.parameters import ParameterValues

COUNT = 4000


def radial_forces(at: Places, kite_force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial ground force (eq:force_tether, its sign turned) and the sag force of a tether force at the kite."""
    sag = 0.5 * np.sin(at.theta) * at.tether_mass * at.gravity
    with np.errstate(invalid="ignore"):
        return np.sqrt(kite_force**2 - sag**2) - np.cos(at.theta) * at.tether_mass * at.gravity, sag


def random_forces(count: int, seed: int) -> np.ndarray:
    """Tether forces from 10 N, where nothing flies, to 10 kN, even in the logarithm."""
    force: np.ndarray = 10 ** np.random.default_rng(seed).uniform(1, 4, count)
    return force


def state_or_reason(
    values: ParameterValues, row: np.ndarray, control: str, value: float
) -> tuple[dict[str, float], str | None]:
    """Solve a state with a bracketed root, or say in a word why there is none."""
    try:
        return solve_state(values, OperatingPoint(*row), control, value), None
    except NoEquilibriumError as error:
        return {}, error.reason


def test_closed_form_agrees_with_the_rootfinder(
    problem: kiteocp.Problem, values: ParameterValues, solved: StateTable, explicit: StateTable
) -> None:
    """Plain Newton from the angle of the massless kite, on every state that has a closed form."""
    table, force = random_places(2 * COUNT, seed=10), random_forces(2 * COUNT, seed=11)
    radial, _ = radial_forces(Places.of(problem, table), force)
    closed = explicit(values, table, radial)
    exists = np.isfinite(closed["inflow_angle"]) & (radial >= 0)
    assert exists.sum() > COUNT
    table, force, radial = table[exists], force[exists], radial[exists]
    closed = {name: column[exists] for name, column in closed.items()}
    state = solved(values, "tether_force_kite", table, force)
    there = np.abs(state["inflow_angle"] - closed["inflow_angle"]) < 1e-6
    assert there.mean() > 0.97
    assert_allclose(state["inflow_angle"][there], closed["inflow_angle"][there], rtol=0, atol=1e-9)
    # Newton without a bracket finds the other root, or none, of a few states at the edge; with a bracket it does.
    for index in np.flatnonzero(~there):
        safe = solve_state(values, OperatingPoint(*table[index]), "tether_force_kite", force[index])
        assert safe["inflow_angle"] == pytest.approx(closed["inflow_angle"][index], abs=1e-9)
    # The closed form solves the residual everywhere, the rest of the state follows from the angle.
    assert_allclose(closed["residual"], 0, atol=1e-11)
    for name in ("reeling_speed", "tangential_speed", "tether_force_ground", "power"):
        scale = np.maximum(1.0, np.abs(closed[name][there]))
        assert_allclose((state[name][there] - closed[name][there]) / scale, 0, atol=1e-7, err_msg=name)


def test_both_agree_on_existence(problem: kiteocp.Problem, values: ParameterValues, explicit: StateTable) -> None:
    """The bracketed solver finds what the closed form finds, and nothing where that has no state, on any branch."""
    table, force = random_places(1500, seed=12), random_forces(1500, seed=13)
    radial, _ = radial_forces(Places.of(problem, table), force)
    closed = explicit(values, table, radial)["inflow_angle"]
    exists = np.isfinite(closed) & (radial >= 0)
    assert 0.2 < exists.mean() < 0.8
    reasons = set()
    for row, value, angle, there in zip(table, force, closed, exists, strict=True):
        state, reason = state_or_reason(values, row, "tether_force_kite", value)
        assert there == (reason is None), f"{row}, {value} N: {reason}, closed form {angle}"
        reasons.add(reason)
        if there:
            assert state["inflow_angle"] == pytest.approx(angle, abs=1e-9)
    assert reasons == {None, "force_below_sag", "slack", "crosswind", "too_heavy", "falling"}


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    length=st.floats(50, 1500),
    elevation=st.floats(1, 100),
    azimuth=st.floats(-85, 85),
    course=st.one_of(st.sampled_from([0.0, 90.0, 180.0, -180.0]), st.floats(-360, 360)),
    force=st.floats(1, 20000),
)
def test_one_state_either_way(
    values: ParameterValues, explicit: StateTable, problem: kiteocp.Problem,
    length: float, elevation: float, azimuth: float, course: float, force: float,
) -> None:  # fmt: skip
    kite = problem.kite.powered
    row = np.array([[length, elevation, azimuth, course, kite.lift_coefficient, kite.kite_drag_coefficient]])
    closed = {name: column[0] for name, column in explicit(values, row, np.array([force])).items()}
    # Within 1e-6 of the border of existence the two may differ: the root of the residual is double there.
    if np.isfinite(closed["margin"]) and abs(closed["margin"]) < 1e-6:
        return
    state, reason = state_or_reason(values, row[0], "radial_ground_force", force)
    assert np.isfinite(closed["inflow_angle"]) == (reason is None), reason
    if reason is None:
        # Near a double root a residual error of 1e-14 moves the angle by its square root, 1e-7.
        assert state["inflow_angle"] == pytest.approx(closed["inflow_angle"], abs=1e-7)


def test_flying_down_agrees_with_the_rootfinder(
    problem: kiteocp.Problem, values: ParameterValues, solved: StateTable, flying_down: StateTable
) -> None:
    """Straight down in the plane of the wind, for any reeling speed below the wind's.

    Newton without a bracket finds the other root, or none, of some states with a large share of weight; the next test
    but one is about those.
    """
    table = random_places(COUNT, seed=20, plane=True)
    table[:, 3] = 0.0
    at = Places.of(problem, table)
    speed = at.b * at.v_w - np.random.default_rng(21).uniform(0.5, 25, COUNT)
    down = flying_down(values, table, speed)["radial_ground_force"]
    state = solved(values, "reeling_speed", table, speed)
    # Relative to the aerodynamic force: the radial ground force is what its radial part leaves above the weights.
    error = np.abs(down - state["radial_ground_force"]) / state["aerodynamic_force"]
    there = error < 1e-6
    assert there.mean() > 0.85
    assert error[there].max() < 1e-9


def test_flying_down_without_wind_along_the_tether_is_slack(values: ParameterValues, flying_down: StateTable) -> None:
    table = random_places(10, seed=22, plane=True)
    assert np.all(flying_down(values, table, np.full(10, 60.0))["radial_ground_force"] == -np.inf)


def test_flying_down_agrees_with_the_safe_solver_where_newton_fails(
    problem: kiteocp.Problem, values: ParameterValues, flying_down: StateTable
) -> None:
    """Weak radial wind: the weight is a large part of the force, or more than it, and there may be two roots."""
    table = random_places(400, seed=23, plane=True)
    table[:, 3] = 0.0
    at = Places.of(problem, table)
    speed = at.b * at.v_w - np.random.default_rng(24).uniform(0.3, 4, len(table))
    down = flying_down(values, table, speed)["radial_ground_force"]
    for row, value, radial in zip(table, speed, down, strict=True):
        state, reason = state_or_reason(values, row, "reeling_speed", value)
        if reason is not None:
            assert reason == "slack"
            assert radial < 0
        else:
            assert radial == pytest.approx(state["radial_ground_force"], abs=1e-8 * state["aerodynamic_force"])


def test_paper_iteration_gives_the_same_ratio_where_it_converges(
    problem: kiteocp.Problem, values: ParameterValues, solved: StateTable, iterated: StateTable
) -> None:
    """eq:kappa_iteration converges linearly where the weight is small beside the force, and breaks elsewhere."""
    table = random_places(COUNT, seed=30)
    at = Places.of(problem, table)
    f = at.b - np.random.default_rng(31).uniform(0.1, 1.5, COUNT)
    paper = iterated(values, table, f)
    converged = np.isfinite(paper["step"]) & (paper["step"] < 1e-12 * paper["kinematic_ratio"])
    assert 0.3 < converged.mean() < 1
    state = solved(values, "reeling_factor", table, f)
    both = converged & (np.abs(state["residual"]) < 1e-12)
    assert both.sum() > 0.9 * converged.sum()
    same = np.abs(state["kinematic_ratio"] / paper["kinematic_ratio"] - 1) < 1e-3
    # With the reeling speed given there may be two states; Newton may find the one of smaller force.
    assert same[both].mean() > 0.97
    assert_allclose(state["kinematic_ratio"][both & same], paper["kinematic_ratio"][both & same], rtol=1e-9)
    for index in np.flatnonzero(both & ~same)[:50]:
        safe = solve_state(values, OperatingPoint(*table[index]), "reeling_factor", f[index])
        assert safe["kinematic_ratio"] == pytest.approx(paper["kinematic_ratio"][index], rel=1e-8)


CONTROLS = ("reeling_speed_m_s", "reeling_factor", "tether_force_kite_N", "tether_force_ground_N")


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize(("setting", "azimuth", "course"), [("powered", 12.0, 101.0), ("depowered", 0.0, 180.0)])
def test_every_control_describes_the_same_state(
    problem: kiteocp.Problem, control: str, setting: str, azimuth: float, course: float
) -> None:
    """Holding any one of the four quantities at its value in a state gives that state again."""
    where = {"tether_length_m": 500.0, "elevation_deg": 35.0, "azimuth_deg": azimuth, "course_deg": course}
    where["setting"] = setting
    reference = flight_state(problem, **where, tether_force_kite_N=1500.0)
    again = flight_state(problem, **where, **{control: reference[control]})
    for name, value in reference.items():
        assert again[name] == pytest.approx(value, rel=1e-9, abs=1e-9), name


def test_a_wind_that_scales_scales_the_massless_state(problem: kiteocp.Problem) -> None:
    """Dimensional analysis: twice the wind at one reeling factor is four times the force, eight times the power."""
    twice = problem.with_values(
        {"environment.wind.reference_speed_m_s": 2 * problem.environment.wind.reference_speed_m_s}
    )
    slow, fast = (
        flight_state(p, tether_length_m=400, elevation_deg=30, course_deg=90, reeling_factor=0.2, gravity=False)
        for p in (problem, twice)
    )
    assert fast["tether_force_kite_N"] == pytest.approx(4 * slow["tether_force_kite_N"], rel=1e-12)
    assert fast["power_W"] == pytest.approx(8 * slow["power_W"], rel=1e-12)


def test_mirror_image(values: ParameterValues) -> None:
    """The model is symmetric about the plane of the wind."""
    place = OperatingPoint(450.0, 33.0, 20.0, 70.0, 0.7, 0.15)
    image = msgspec.structs.replace(place, azimuth_deg=-20.0, course_deg=-70.0)
    one, other = (solve_state(values, p, "tether_force_kite", 2000.0) for p in (place, image))
    for name in ("reeling_speed", "tangential_speed", "kinematic_ratio", "power"):
        assert one[name] == pytest.approx(other[name], rel=1e-10), name
