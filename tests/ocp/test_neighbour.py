"""Solutions followed to other parameters by sequential quadratic programming, and its quadratic programs.

Programs with known solutions, by hand; tolerance 1e-7, since iterations end at first-order residuals of 1e-8.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from kiteocp.ocp.composition import Composition
from kiteocp.ocp.declaration import OptimalControlProblem
from kiteocp.ocp.neighbour import Neighbourhood
from kiteocp.ocp.nlp import Label, NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.optimality import Optimality
from kiteocp.ocp.quadratic import LOT, StepError, solve_quadratic

TOLERANCE = 1e-7


def program(f: Any, x: Any, p: Any, rows: list[tuple[Any, Any, Any]], lower: Any, upper: Any) -> NonlinearProgram:
    lbg, ubg = (ca.vertcat(*(ca.SX(row[side]) for row in rows)) for side in (1, 2))
    return NonlinearProgram(
        composition=Composition(x, p, f, ca.vertcat(*(row[0] for row in rows))),
        bounds=ca.Function("bounds", [p], [ca.SX(lower), ca.SX(upper), lbg, ubg]),
        variables=tuple(Label("static", f"x{i}") for i in range(x.numel())),
        rows=tuple(Label("link", f"row {i}") for i in range(len(rows))),
        problem=OptimalControlProblem([], 0.0),
        mesh={},
        layouts={},
        functions={},
    )


def nearest_point() -> tuple[NonlinearProgram, Solution]:
    """The point nearest to (p0, 0, 0) on the sphere of radius p1 with a height x2 of at least p2."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 3)
    away = (x[0] - p[0]) ** 2 + x[1] ** 2 + x[2] ** 2
    rows = [(ca.sumsqr(x) - p[1] ** 2, 0.0, 0.0), (x[2] - p[2], 0.0, np.inf)]
    built = program(away, x, p, rows, -10 * np.ones(3), 10 * np.ones(3))
    return built, Solver(built).solve([1.0, 0.3, 0.8], [3.0, 1.0, 0.5])


def solution_of_nearest_point(p: list[float]) -> list[float]:
    height = max(p[2], 0.0)
    return [np.sqrt(p[1] ** 2 - height**2), 0.0, height]


@pytest.mark.parametrize(
    "p",
    [[3.0, 1.0, 0.5], [2.0, 1.4, 0.9], [5.0, 0.8, 0.1], [3.0, 1.0, -0.5]],
    ids=["itself", "higher", "lower", "height not active"],
)
def test_a_solution_is_followed_to_the_known_one(p: list[float]) -> None:
    built, base = nearest_point()
    found = Neighbourhood(built, base).solve(p)
    assert found is not None
    assert found.method == "SQP"
    assert found.x == pytest.approx(solution_of_nearest_point(p), abs=TOLERANCE)
    # Multipliers too: the conditions are recomputed from the whole program.
    assert Optimality(built).residuals(found).largest < TOLERANCE
    assert (found.lam_g[1] == 0.0) == (p[2] < 0.0)


def test_a_solution_is_followed_from_another_than_the_base() -> None:
    built, base = nearest_point()
    neighbourhood = Neighbourhood(built, base)
    near = neighbourhood.solve([3.0, 1.2, 0.7])
    found = neighbourhood.solve([3.0, 1.21, 0.71], near)
    assert near is not None
    assert found is not None
    assert found.iterations < 4
    assert found.x == pytest.approx(solution_of_nearest_point([3.0, 1.21, 0.71]), abs=TOLERANCE)


@pytest.mark.parametrize("p", [[3.0, 1.0, 1.5], [3.0, np.nan, 0.5]], ids=["infeasible", "not a number"])
def test_where_there_is_no_solution_there_is_none(p: list[float]) -> None:
    built, base = nearest_point()
    assert Neighbourhood(built, base).solve(p) is None


def test_an_indefinite_hessian_does_not_stop_the_way() -> None:
    """Minimise x0 x1 under x0 + x1 + x2 = p and bounds: curved downwards, the solution is a corner."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 1)
    built = program(-x[0] * x[1] + 0.1 * x[2], x, p, [(ca.sum1(x) - p, 0.0, 0.0)], np.zeros(3), [1.0, 2.0, 5.0])
    base = Solver(built).solve([0.9, 1.5, 0.6], [3.0])
    found = Neighbourhood(built, base).solve([4.0])
    assert found is not None
    assert found.x == pytest.approx([1.0, 2.0, 1.0], abs=TOLERANCE)


def test_crossed_bounds_have_no_solution() -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 1)
    built = program(ca.sumsqr(x), x, p, [(x[0] + x[1], 1.0, 1.0)], ca.vertcat(p, 0.0), np.ones(2))
    base = Solver(built).solve([0.5, 0.5], [0.2])
    assert Neighbourhood(built, base).solve([1.5]) is None


@pytest.mark.parametrize("rows", [3, LOT - 1, LOT + 1, 3 * LOT])
def test_a_quadratic_program_keeps_the_conditions_of_its_solution(rows: int) -> None:
    random = np.random.default_rng(rows)
    root = random.normal(size=(8, 8))
    hessian, slope = root @ root.T + np.eye(8), random.normal(size=8)
    matrix = random.normal(size=(rows, 8))
    inside = matrix @ random.normal(size=8)
    lower, upper = inside - random.uniform(0.0, 0.5, rows), inside + random.uniform(0.0, 0.5, rows)
    upper[::3] = np.inf
    z, multipliers = solve_quadratic(hessian, slope, matrix, lower, upper)
    assert hessian @ z + slope + matrix.T @ multipliers == pytest.approx(np.zeros(8), abs=TOLERANCE)
    assert np.all(matrix @ z >= lower - TOLERANCE)
    assert np.all(matrix @ z <= upper + TOLERANCE)
    gap = np.where(multipliers > 0.0, upper, lower) - matrix @ z
    assert gap[multipliers != 0.0] == pytest.approx(0.0, abs=TOLERANCE)
    assert np.count_nonzero(multipliers) > 0


def test_a_quadratic_program_without_a_solution_says_so() -> None:
    rows = np.array([[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(StepError, match="no step"):
        solve_quadratic(np.eye(2), np.zeros(2), rows, np.array([1.0, -2.0]), np.array([2.0, -1.0]))
