"""Radau collocation coefficients against closed forms and exact polynomials."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from kiteocp.ocp.collocation import (
    MAX_DEGREE,
    PhaseMesh,
    differentiation_matrix,
    interpolation_matrix,
    radau_points,
    radau_weights,
)

DEGREES = range(1, 10)


@pytest.mark.parametrize("degree", DEGREES)
def test_points_against_casadi(degree: int) -> None:
    # Both are roots of the same polynomial to double precision.
    np.testing.assert_allclose(radau_points(degree), ca.collocation_points(degree, "radau"), rtol=0, atol=1e-14)
    assert radau_points(degree)[-1] == 1.0


def test_points_and_weights_against_hairer_and_wanner_table_5_6() -> None:
    """Radau IIA of order 5, the published Butcher tableau."""
    root = np.sqrt(6.0)
    np.testing.assert_allclose(radau_points(3), [(4 - root) / 10, (4 + root) / 10, 1.0], rtol=1e-15)
    np.testing.assert_allclose(radau_weights(3), [(16 - root) / 36, (16 + root) / 36, 1 / 9], rtol=1e-14)


@pytest.mark.parametrize("degree", DEGREES)
def test_quadrature_is_exact_to_degree_2d_minus_2_and_no_further(degree: int) -> None:
    points, weights = radau_points(degree), radau_weights(degree)
    for power in range(2 * degree - 1):
        assert weights @ points**power == pytest.approx(1.0 / (power + 1), abs=1e-14)
    assert abs(weights @ points ** (2 * degree - 1) - 1.0 / (2 * degree)) > 1e-12


def test_degree_one_weight_is_one_unlike_casadi() -> None:
    assert radau_weights(1).tolist() == [1.0]


@pytest.mark.parametrize("degree", DEGREES)
def test_differentiation_matrix_against_casadi(degree: int) -> None:
    derivative, _, _ = ca.collocation_coeff(ca.collocation_points(degree, "radau"))
    # CasADi's has one column per point and the derivative at node j in column j; rounding grows with the degree.
    np.testing.assert_allclose(differentiation_matrix(degree), np.array(derivative).T, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("degree", [0, -1, MAX_DEGREE + 1])
def test_degree_out_of_range_is_refused(degree: int) -> None:
    with pytest.raises(ValueError, match=f"between 1 and {MAX_DEGREE}"):
        radau_points(degree)


def test_highest_degree_is_still_accurate() -> None:
    points, weights = radau_points(MAX_DEGREE), radau_weights(MAX_DEGREE)
    assert np.all(np.diff(points) > 0.0)
    assert weights @ np.exp(points) == pytest.approx(np.e - 1.0, rel=1e-14)
    nodes = np.concatenate(([0.0], points))
    # Rounding of a differentiation matrix grows like degree^4 at worst: 20^4 * 1e-16 is 2e-11.
    np.testing.assert_allclose(differentiation_matrix(MAX_DEGREE) @ np.sin(nodes), np.cos(points), atol=1e-11)


@st.composite
def meshes(draw: st.DrawFn) -> PhaseMesh:
    """Random meshes whose longest interval is at most twenty times the shortest."""
    widths = np.array(draw(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=5)))
    return PhaseMesh(draw(st.integers(1, 7)), tuple((widths / widths.sum()).tolist()))


coefficients = st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8)


@given(meshes(), coefficients, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6))
def test_polynomials_are_exact_on_random_meshes(mesh: PhaseMesh, c: list[float], fractions: list[float]) -> None:
    polynomial = Polynomial(c[: mesh.degree + 1])
    start_and_points = np.concatenate(([0.0], mesh.points))
    # Sums of magnitudes up to 24, interpolation constants below 1e2: 1e-11 leaves room for rounding only.
    np.testing.assert_allclose(
        mesh.state_matrix(fractions) @ polynomial(start_and_points), polynomial(np.array(fractions)), atol=1e-11
    )
    # The slope divides by intervals as short as 1/80.
    np.testing.assert_allclose(
        mesh.slope_matrix(fractions) @ polynomial(start_and_points), polynomial.deriv()(np.array(fractions)), atol=1e-9
    )
    lower = Polynomial(c[: mesh.degree])
    np.testing.assert_allclose(
        mesh.control_matrix(fractions) @ lower(mesh.points), lower(np.array(fractions)), atol=1e-10
    )
    integrand = Polynomial(c[: max(1, 2 * mesh.degree - 1)])
    assert mesh.weights @ integrand(mesh.points) == pytest.approx(integrand.integ()(1.0), abs=1e-12)


def test_interpolation_at_nodes_is_the_identity() -> None:
    nodes = np.array([0.0, 0.3, 1.0])
    assert interpolation_matrix(nodes, nodes).tolist() == np.eye(3).tolist()


def test_controls_jump_at_borders_and_the_border_belongs_to_the_interval_that_ends_there() -> None:
    mesh = PhaseMesh.uniform(2, 2)
    values = np.array([0.0, 0.0, 1.0, 1.0])
    sampled = mesh.control_matrix([0.5, np.nextafter(0.5, 1.0)]) @ values
    np.testing.assert_allclose(sampled, [0.0, 1.0], atol=1e-12)


def test_refined_mesh_halves_every_interval() -> None:
    mesh = PhaseMesh(3, (0.25, 0.75)).refined()
    assert mesh.interval_fractions == (0.125, 0.125, 0.375, 0.375)
    assert mesh.intervals == 4


@pytest.mark.parametrize("fractions", [(), (0.5,), (1.5, -0.5), (0.5, float("nan"))])
def test_bad_interval_fractions_are_refused(fractions: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="must be positive and sum to 1"):
        PhaseMesh(3, fractions)


def test_no_interval_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one interval"):
        PhaseMesh.uniform(0, 3)


@pytest.mark.parametrize("fraction", [-0.01, 1.01, float("nan")])
def test_evaluation_outside_the_phase_is_refused(fraction: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        PhaseMesh.uniform(2, 3).state_matrix(fraction)
