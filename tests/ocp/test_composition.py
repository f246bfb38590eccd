"""Derivatives put together from those of the points are those of the whole expression."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from vehicle import GUESS, MESHES, P, there_and_back

from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.composition import Composition
from kiteocp.ocp.first_order import FirstOrderSystem
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.point_model import point_model
from kiteocp.ocp.transcription import transcribe

#: Sums of some ten terms of order one, in another order.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def program() -> NonlinearProgram:
    return transcribe(there_and_back(), MESHES)


@pytest.fixture(scope="module")
def whole(program: NonlinearProgram) -> Any:
    """Everything that is compared, from the expressions of objective and rows."""
    f, g = program.composition.expressions
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.numel())
    both = ca.vertcat(program.x, program.p)
    lagrangian = lam_f * f + ca.dot(lam_g, g)
    results = [f, g, ca.gradient(f, program.x), ca.jacobian(g, both), *ca.hessian(lagrangian, both)]
    return ca.Function("whole", [program.x, program.p, lam_f, lam_g], results)


def point(program: NonlinearProgram) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    return program.pack(GUESS) + random.normal(0.0, 0.1, program.x.numel()), random.normal(size=len(program.rows))


def test_derivatives_are_those_of_the_whole_expression(program: NonlinearProgram, whole: Any) -> None:
    x, lam_g = point(program)
    f, g, gradient, jacobian, hessian, slope = (part.full() for part in whole(x, P, 0.7, lam_g))
    composed, n = program.composition, program.x.numel()
    values = composed.values(x, P)
    assert float(values[0]) == pytest.approx(f.item(), abs=ROUNDING)
    np.testing.assert_allclose(values[1].full(), g, atol=ROUNDING)
    np.testing.assert_allclose(composed.gradient(x, P)[1].full(), gradient, atol=ROUNDING)
    np.testing.assert_allclose(composed.jacobian(x, P)[1].full(), jacobian[:, :n], atol=ROUNDING)
    upper = composed.hessian(x, P, 0.7, lam_g)
    np.testing.assert_allclose(ca.triu2symm(upper).full(), hessian[:n, :n], atol=ROUNDING)
    f, g, gradient, jacobian, hessian, slope = (part.full() for part in whole(x, P, 1.0, lam_g))
    for found, expected in zip(composed.first_order(x, P, lam_g), (slope, hessian, jacobian), strict=True):
        np.testing.assert_allclose(found.full(), expected, atol=ROUNDING)
    to_x, to_p = composed.lagrangian_gradient(x, P, lam_g)
    np.testing.assert_allclose(np.vstack((to_x.full(), to_p.full())), slope, atol=ROUNDING)
    f_again, g_again, by_x, curved, rows = FirstOrderSystem(program).newton(x, np.array(P), lam_g)
    assert f_again == pytest.approx(f.item(), abs=ROUNDING)
    np.testing.assert_allclose(g_again, g.ravel(), atol=ROUNDING)
    np.testing.assert_allclose(by_x, slope[:n, 0], atol=ROUNDING)
    np.testing.assert_allclose(curved.full(), hessian[:n, :n], atol=ROUNDING)
    np.testing.assert_allclose(rows.full(), jacobian[:, :n], atol=ROUNDING)


def test_some_of_the_rows_have_their_own_derivatives(program: NonlinearProgram, whole: Any) -> None:
    x, lam_g = point(program)
    kept = list(range(0, len(program.rows), 2))
    multipliers = np.zeros(lam_g.size)
    multipliers[kept] = lam_g[kept]
    _, _, _, expected_rows, expected, _ = (part.full() for part in whole(x, P, 1.0, multipliers))
    jacobian, hessian = program.composition.of_rows(kept)
    n = program.x.numel()
    np.testing.assert_allclose(jacobian(x, P)[1].full(), expected_rows[kept, :n], atol=ROUNDING)
    found = ca.triu2symm(hessian(x, P, 1.0, lam_g[kept])).full()
    np.testing.assert_allclose(found, expected[:n, :n], atol=ROUNDING)


def test_meshes_of_one_problem_share_the_functions_of_its_points() -> None:
    problem = there_and_back()
    models = [point_model(problem, phase) for phase in problem.phases]
    for mesh in (MESHES, {name: PhaseMesh.uniform(3, 3) for name in MESHES}):
        blocks = transcribe(problem, mesh).composition.blocks
        assert [block.model for block in blocks] == models


def test_a_program_without_points_is_an_ordinary_one() -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 1)
    plain = Composition(x, p, x[0] ** 3 * p, x[0] * x[1])
    assert float(plain.values([2.0, 3.0], [5.0])[0]) == pytest.approx(40.0)
    assert plain.gradient([2.0, 3.0], [5.0])[1].full().ravel() == pytest.approx([60.0, 0.0])
    assert ca.triu2symm(plain.hessian([2.0, 3.0], [5.0], 1.0, [2.0])).full() == pytest.approx(
        np.array([[60.0, 2.0], [2.0, 0.0]])
    )
