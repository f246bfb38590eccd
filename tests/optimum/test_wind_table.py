"""A table of wind in the program: what is derived from its numbers is computed once, and all derivatives know it."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from kiteocp import load_problem
from kiteocp.ocp.first_order import FirstOrderSystem
from kiteocp.ocp.point_model import point_model
from kiteocp.optimum.certificate import optimality_of
from kiteocp.optimum.program import Formulation, cycle_problem
from kiteocp.optimum.refine import Optimum, optimise
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

#: In relation to the largest entry: sums of thousands of terms in another order.
ROUNDING = 1e-9

SPEED = "environment.wind.speeds_m_s[{}]"


def in_table(entries: int) -> Problem:
    """``strong-wind`` with its own logarithmic profile as a table."""
    problem = load_problem("strong-wind")
    wind = problem.to_dict()["environment"]["wind"]
    heights = np.linspace(5.0, 500.0, entries)
    law = np.log(heights / wind["roughness_length_m"]) / np.log(wind["reference_height_m"] / wind["roughness_length_m"])
    table = {
        "profile": "table",
        "heights_m": heights.tolist(),
        "speeds_m_s": (wind["reference_speed_m_s"] * law).tolist(),
    }
    return problem.with_values({"environment.wind": table})


@pytest.fixture(scope="module")
def optimum() -> Optimum:
    return optimise(in_table(8), certificate="quick")


def test_derivatives_to_the_parameters_are_those_of_the_whole_expression(optimum: Optimum) -> None:
    program, solution = optimum.solver.program, optimum.solution
    f, g = program.composition.expressions
    lam = ca.SX.sym("lam", g.numel())
    both = ca.vertcat(program.x, program.p)
    hessian, gradient = ca.hessian(f + ca.dot(lam, g), both)
    whole: Any = ca.Function("whole", [program.x, program.p, lam], [gradient, hessian, ca.jacobian(g, both)])
    expected = whole(solution.x, solution.p, solution.lam_g)
    found = FirstOrderSystem(program).first(solution.x, solution.p, solution.lam_g)
    for one, other in zip(found, expected, strict=True):
        size = np.abs(other.full()).max()
        np.testing.assert_allclose(one.full(), other.full(), atol=ROUNDING * size)


def test_the_optimum_knows_every_speed_of_the_table(optimum: Optimum) -> None:
    """The envelope theorem against re-solved differences; 1e-3 of a speed, so that both have some six digits."""
    slope = optimality_of(optimum.solver.program).parametric_gradient(optimum.solution)
    keys = optimum.values.structure.keys
    for entry in (1, 2, 4):
        place = keys.index(SPEED.format(entry))
        step = 1e-3 * optimum.values.vector[place]
        ends = []
        for sign in (-1.0, 1.0):
            moved = optimum.values.vector.copy()
            moved[place] += sign * step
            ends.append(optimum.solver.solve(optimum.solution.x, moved, warm=optimum.solution).f)
        assert (ends[1] - ends[0]) / (2 * step) == pytest.approx(slope[place], rel=2e-3, abs=1e-7)
    assert abs(slope[keys.index(SPEED.format(2))]) > 1e-4


def test_points_compute_nothing_of_the_table_but_its_place() -> None:
    """Fifty heights add some hundred operations to a point; its second derivatives add no more of them."""
    counts = {}
    for entries in (10, 50):
        table = in_table(entries)
        problem = cycle_problem(parameter_values(table).structure, Formulation.of(table))
        model = point_model(problem, problem.phases[0])
        used = tuple(range(model.outputs))
        counts[entries] = model.values(used).n_instructions(), model.curvature(used, False).n_instructions()
    added, curved = (counts[50][kind] - counts[10][kind] for kind in (0, 1))
    assert added < 20 * 40
    assert curved == pytest.approx(added, rel=0.1)
