"""Forces on kite and tether as Cartesian vectors built here, and the conversions between the tether's forces.

Tolerances of 1e-9 of the tether force: the equilibrium is solved to 1e-12 of it, or better, and the rest is rounding.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from paper import Places, StateTable, random_places

import kiteocp
from kiteocp.physics import aerodynamics, tether
from kiteocp.physics.parameters import ParameterValues

COUNT = 2000


@pytest.fixture(scope="module")
def states(
    problem: kiteocp.Problem, values: ParameterValues, solved: StateTable
) -> tuple[Places, dict[str, np.ndarray], np.ndarray]:
    """Solved states at any azimuth and course, with the velocity of the air past the kite as Cartesian vectors."""
    table = random_places(COUNT, seed=40)
    force = 10 ** np.random.default_rng(41).uniform(2.5, 4, COUNT)
    state = solved(values, "tether_force_kite", table, force)
    angle = state["inflow_angle"]
    keep = (np.abs(state["residual"]) < 1e-12) & (state["radial_ground_force"] > 0) & (angle > 0) & (angle < np.pi / 2)
    assert keep.sum() > COUNT / 2
    at = Places.of(problem, table[keep])
    state = {name: column[keep] for name, column in state.items()}
    radial, polar, azimuthal = at.unit_vectors()
    kite = state["reeling_speed"] * radial + state["tangential_speed"] * (
        np.cos(at.chi) * polar + np.sin(at.chi) * azimuthal
    )
    wind = at.v_w * np.array([[1.0], [0.0], [0.0]])
    return at, state, wind - kite  # eq:Vapp_definition


def dot(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    product: np.ndarray = np.sum(one * other, axis=0)
    return product


def test_apparent_wind(states: tuple[Places, dict[str, np.ndarray], np.ndarray]) -> None:
    at, state, apparent = states
    radial = dot(apparent, at.unit_vectors()[0])
    assert_allclose(state["apparent_wind_speed"], np.linalg.norm(apparent, axis=0), rtol=1e-9)
    assert_allclose(state["radial_apparent_wind_speed"], radial, rtol=1e-9)
    tangential = np.sqrt(dot(apparent, apparent) - radial**2)
    assert_allclose(state["kinematic_ratio"], tangential / radial, rtol=1e-7)


def test_force_triangle_closes(states: tuple[Places, dict[str, np.ndarray], np.ndarray]) -> None:
    """F_t + m g + F_a = 0: what tether and weight leave has the size and the drag of the aerodynamic force.

    Tether force by eq:tether_force, its sign turned (the paper gives what the kite does to the tether); drag by
    eq:F_a_projection, lift by eq:lift.
    """
    at, state, apparent = states
    radial, polar, _ = at.unit_vectors()
    sag = 0.5 * np.sin(at.theta) * at.tether_mass * at.gravity
    pull = -np.sqrt(state["tether_force_kite"] ** 2 - sag**2) * radial + sag * polar
    weight = at.mass * at.gravity * np.array([[0.0], [0.0], [-1.0]])
    aerodynamic = -(pull + weight)
    speed = np.linalg.norm(apparent, axis=0)
    pressure_area = 0.5 * at.rho * speed**2 * at.area
    size = np.linalg.norm(aerodynamic, axis=0)
    assert_allclose(size, pressure_area * at.c_r, rtol=1e-9)
    assert_allclose(size, state["aerodynamic_force"], rtol=1e-9)
    drag = dot(aerodynamic, apparent) / speed
    assert_allclose(drag / size, at.drag / at.c_r, atol=1e-9)
    assert_allclose(np.sqrt(size**2 - drag**2), pressure_area * at.lift, rtol=1e-8)
    # eq:F_a_theta: across the tether the air carries the kite and half the tether, along the azimuth nothing.
    assert_allclose(-dot(aerodynamic, polar), state["weight_across"], rtol=1e-9)


def test_tether_is_in_equilibrium(states: tuple[Places, dict[str, np.ndarray], np.ndarray]) -> None:
    """The forces at both ends of the tether carry its weight, and their moment about the ground station vanishes."""
    at, state, _ = states
    radial, polar, _ = at.unit_vectors()
    sag = state["sag"]
    at_kite = np.sqrt(state["tether_force_kite"] ** 2 - sag**2) * radial - sag * polar
    at_ground = -state["radial_ground_force"] * radial - sag * polar
    weight = at.tether_mass * at.gravity * np.array([[0.0], [0.0], [-1.0]])
    scale = state["tether_force_kite"]
    assert_allclose((at_kite + at_ground + weight) / scale, 0, atol=1e-12)
    moment = np.cross(radial, at_kite + 0.5 * weight, axis=0)
    assert_allclose(moment / scale, 0, atol=1e-12)
    assert_allclose(np.linalg.norm(at_ground, axis=0), state["tether_force_ground"], rtol=1e-12)
    assert_allclose(state["power"], state["tether_force_ground"] * state["reeling_speed"], rtol=1e-12)


def test_ground_force_by_the_formula_of_the_paper() -> None:
    """The equation after eq:tether_force, and back, for forces above the sag force."""
    rng = np.random.default_rng(42)
    samples = zip(rng.uniform(50, 1000, 300), rng.uniform(0, 1.5, 300), rng.uniform(100, 5000, 300), strict=True)
    for length, elevation, force in samples:
        theta = np.pi / 2 - elevation
        mass = tether.tether_mass(length, 0.004, 724.0)
        assert mass == pytest.approx(724 * 4e-6 * np.pi * length, rel=1e-14)
        tangential = 0.5 * np.sin(theta) * mass * 9.81
        ground = np.hypot(np.sqrt(force**2 - tangential**2) - np.cos(theta) * mass * 9.81, tangential)
        sag, along = tether.sag_force(mass, elevation, 9.81), tether.weight_along(mass, elevation, 9.81)
        radial = tether.radial_force_of_kite_force(force, sag, along)
        assert tether.force_at_ground(radial, sag) == pytest.approx(ground, rel=1e-13)
        assert tether.force_at_kite(radial, sag, along) == pytest.approx(force, rel=1e-13)
        assert tether.radial_force_of_ground_force(ground, sag) == pytest.approx(radial, rel=1e-9)


def test_numbers_and_symbols_give_the_same() -> None:
    """The physics are plain functions of either (`kiteocp.physics`)."""
    symbol = ca.SX.sym("x")
    expression = aerodynamics.total_drag_coefficient(0.17, 10.2, symbol, 0.004, 1.1)
    function = ca.Function("f", [symbol], [expression])
    plain = aerodynamics.total_drag_coefficient(0.17, 10.2, 720.0, 0.004, 1.1)
    assert float(function(720.0)) == pytest.approx(plain, rel=1e-15)
    # eq:tetherdrag: a quarter of the drag of a tether that flew at the kite's speed all along.
    assert plain - 0.17 == pytest.approx(0.004 * 720 * 1.1 / 8 / (0.5 * 10.2), rel=1e-13)


def test_harvesting_factor_is_power_over_wind_power() -> None:
    """eq:power and eq:powerdensity."""
    assert aerodynamics.harvesting_factor(6000.0, 1.2, 18.0, 10.2) == pytest.approx(6000 / (0.6 * 18**3 * 10.2))


def test_apparent_wind_speed_of_a_force_inverts_it() -> None:
    force = aerodynamics.aerodynamic_force(1.2, 0.7, 25.0, 10.2)
    assert force == pytest.approx(0.5 * 1.2 * 0.7 * 625 * 10.2, rel=1e-14)
    assert aerodynamics.apparent_wind_speed_of_force(force, 1.2, 0.7, 10.2) == pytest.approx(25.0, rel=1e-14)


def test_relative_gravitational_force() -> None:
    """eq:rel_gravitational_Force: 750 N against 720 m of tether give a small gamma, as the paper says."""
    weight = tether.tether_mass(720.0, 0.004, 724.0) * 9.81
    assert tether.relative_gravitational_force(weight, 749.0) == pytest.approx(0.0858, abs=1e-4)
