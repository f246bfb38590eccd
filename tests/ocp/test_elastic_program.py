"""Elastic programs with known answers: small linear programs, by hand.

Tolerance 1e-5: the elastic solver stops at 1e-6 and the numbers are of order one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

from kiteocp.ocp.composition import Composition
from kiteocp.ocp.declaration import OptimalControlProblem
from kiteocp.ocp.elastic import SQUARE_WEIGHT, ElasticProgram, ElasticSlack, PenaltyWeight
from kiteocp.ocp.nlp import Label, NonlinearProgram

TOLERANCE = 1e-5


def program(x: Any, p: Any, rows: Sequence[tuple[Any, Any, Any]], lower: Any, upper: Any) -> NonlinearProgram:
    """A program without objective: rows are (expression, lower bound, upper bound)."""
    lbg, ubg = (ca.vertcat(*(ca.SX(row[side]) for row in rows)) for side in (1, 2))
    return NonlinearProgram(
        composition=Composition(x, p, ca.SX(0.0), ca.vertcat(*(row[0] for row in rows))),
        bounds=ca.Function("bounds", [p], [lower, upper, lbg, ubg]),
        variables=tuple(Label("static", f"x{i}") for i in range(x.numel())),
        rows=tuple(Label("link", f"row {i}") for i in range(len(rows))),
        problem=OptimalControlProblem([], 0.0),
        mesh={},
        layouts={},
        functions={},
    )


@pytest.fixture(scope="module")
def budget() -> ElasticProgram:
    """Two shares of at most p1 and p2 must make up at least p0; p3 has nothing to do with it."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 4)
    rows = [(x[0] + x[1], p[0], np.inf)]
    small = program(x, p, rows, ca.SX.zeros(2), p[1:3])
    return ElasticProgram(
        small, [ElasticSlack(name, (i,)) for i, name in enumerate(("need", "first", "second", "idle"))]
    )


#: 4 is needed of two shares of at most 1: two are missing.
NUMBERS = [4.0, 1.0, 1.0, 7.0]
PRICES = {"need": PenaltyWeight(-4.0, 1.0), "first": PenaltyWeight(1.0, 9.0), "second": PenaltyWeight(1.0, 9.0)}


def test_a_relief_that_nothing_depends_on_is_left_out(budget: ElasticProgram) -> None:
    assert [term.name for term in budget.terms] == ["need", "first", "second"]


def test_the_cheapest_relief_takes_it_all(budget: ElasticProgram) -> None:
    """A slack of one lowers the need by 4 and raises a share by 1, at the same price."""
    found = budget.solve([0.5, 0.5], NUMBERS, PRICES)
    assert found.success
    assert found.slacks == pytest.approx({"need": 0.5, "first": 0.0, "second": 0.0}, abs=TOLERANCE)
    np.testing.assert_allclose(found.p, [2.0, 1.0, 1.0, 7.0], atol=TOLERANCE)
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=TOLERANCE)


def test_savings_are_the_shadow_prices(budget: ElasticProgram) -> None:
    """One more unit of anything saves a quarter of a slack of the need."""
    found = budget.solve([0.5, 0.5], NUMBERS, PRICES)
    marginal = 1.0 + 2 * SQUARE_WEIGHT * 0.5
    for name, saving in (("need", marginal), ("first", marginal / 4), ("second", marginal / 4)):
        rows = budget.savings(found, name)
        assert rows.sum() == pytest.approx(saving, abs=TOLERANCE)
        # It saves through the one row that it moves.
        assert np.count_nonzero(np.abs(rows) > TOLERANCE) == 1
    (place,) = np.flatnonzero(np.abs(budget.savings(found, "first")) > TOLERANCE)
    assert budget.rows[place].name == "x0"


def test_equal_reliefs_share_where_the_cheapest_is_held(budget: ElasticProgram) -> None:
    found = budget.solve([0.5, 0.5], NUMBERS, {name: PRICES[name] for name in ("first", "second")})
    assert found.slacks == pytest.approx({"need": 0.0, "first": 1.0, "second": 1.0}, abs=TOLERANCE)


def test_a_large_weight_tells_what_one_relief_can_do_alone(budget: ElasticProgram) -> None:
    heavy = {
        "need": PenaltyWeight(-4.0, 1.0, 100.0),
        "first": PenaltyWeight(1.0, 9.0),
        "second": PenaltyWeight(1.0, 9.0, 100.0),
    }
    found = budget.solve([0.5, 0.5], NUMBERS, heavy)
    assert found.slacks == pytest.approx({"need": 0.0, "first": 2.0, "second": 0.0}, abs=TOLERANCE)
    # With too short a reach the others must help, and show it.
    short = budget.solve([0.5, 0.5], NUMBERS, heavy | {"first": PenaltyWeight(1.0, 1.5)})
    assert short.slacks["first"] == pytest.approx(1.5, abs=TOLERANCE)
    assert short.slacks["need"] == pytest.approx(0.5 / 4, abs=TOLERANCE)


def test_nothing_moves_where_the_program_is_feasible(budget: ElasticProgram) -> None:
    found = budget.solve([0.1, 0.1], [1.5, 1.0, 1.0, 7.0], {**PRICES, "need": PenaltyWeight(-1.5, 1.0)})
    assert found.success
    assert sum(found.slacks.values()) < TOLERANCE


def test_without_any_relief_the_solver_does_not_succeed(budget: ElasticProgram) -> None:
    assert not budget.solve([0.5, 0.5], NUMBERS, {}).success


def test_a_parameter_inside_a_row_moves_too() -> None:
    """x^2 <= 4 a with -x <= -3, both sides of a two-sided row moving: a must grow from 1 to 9/4."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p", 2)
    rows = [(x**2 / p[0], -p[1], p[1]), (x, 3.0, np.inf)]
    small = program(x, p, rows, ca.SX(-10.0), ca.SX(10.0))
    elastic = ElasticProgram(small, [ElasticSlack("a", (0,)), ElasticSlack("both", (0, 1))])
    found = elastic.solve([1.0], [1.0, 4.0], {"a": PenaltyWeight(1.0, 9.0)})
    assert found.slacks["a"] == pytest.approx(1.25, abs=TOLERANCE)
    # One term of two parameters: (1 + s) (4 + s) = 9.
    found = elastic.solve([1.0], [1.0, 4.0], {"both": PenaltyWeight([1.0, 1.0], 9.0)})
    assert found.slacks["both"] == pytest.approx((np.sqrt(45.0) - 5.0) / 2.0, abs=TOLERANCE)
