"""Where the active set of an optimum changes, and what its derivatives are to either side, against re-solving."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from kiteocp import load_problem
from kiteocp.optimum.refine import optimise
from kiteocp.problem import Problem
from kiteocp.studies.sensitivity.derivatives import LocalStudy

TIGHT = {"optimisation.tolerance": 1e-10}
STRONG = load_problem("strong-wind", TIGHT)


@cache
def study_of(problem: Problem) -> LocalStudy:
    return LocalStudy.of(optimise(problem, certificate="quick"))


def fastest_reel_out(study: LocalStudy) -> float:
    """Largest reeling speed at the mesh points."""
    phases = study.optimum.cycle.trajectory.phases.values()
    return max(float(np.max(phase.values["reeling_speed"])) for phase in phases)


def changes(one: LocalStudy, other: LocalStudy) -> set[str]:
    """Return the active bounds in one optimum only.

    A tether length at the end of a phase is one at the start of the next too; which of the two presses says nothing.
    """
    program = one.method.program
    sets = [np.concatenate((study.polished.active.variables, study.polished.active.rows)) for study in (one, other)]
    found = [(*program.variables, *program.rows)[index] for index in np.flatnonzero(sets[0] != sets[1])]
    return {str(label) for label in found if not (label.name == "tether_length" and label.fraction in {0.0, 1.0})}


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("key", ["kite.mass_kg", "limits.tether_force_max_N", "tether.diameter_m"])
def test_borders_against_optima_solved_anew(key: str, sign: float) -> None:
    study = study_of(STRONG)
    column = study.keys.index(key)
    reach = study.reach(column, sign * 0.5 * study.polished.p[column])
    assert reach.ended_by is not None
    value = study.polished.p[column]
    inside, outside = (study_of(STRONG.with_values({key: value + share * reach.step})) for share in (0.98, 1.02))
    assert changes(inside, study) == set()
    assert changes(outside, study) == {str(reach.ended_by)}


def test_an_inactive_limit_holds_until_the_optimum_meets_it() -> None:
    study = study_of(STRONG)
    column = study.keys.index("limits.reel_out_speed_max_m_s")
    fastest = fastest_reel_out(study)
    reach = study.reach(column, -9.0)
    assert study.polished.p[column] + reach.step == pytest.approx(fastest, rel=1e-7)
    assert np.isinf(study.reach(column, 1.0).step)


def test_a_limit_at_the_value_of_the_optimum_is_a_change_of_the_active_set() -> None:
    key = "limits.reel_out_speed_max_m_s"
    fastest = fastest_reel_out(study_of(STRONG))
    study = study_of(STRONG.with_values({key: fastest}))
    column = study.keys.index(key)
    # Below, the limit begins to press: the power falls from there with the square of the distance.
    assert study.reach(column, -1.0).step == 0.0
    assert np.isinf(study.reach(column, 1.0).step)
    # The solver leaves it at 1e-8 of its value, where the slope is some 1e-4 W per m/s.
    assert [side[column] for side in study.sides] == pytest.approx([0.0, 0.0], abs=1e-2)


def test_a_kink_has_a_derivative_to_each_side() -> None:
    # The largest force and the fastest reel-out meet at the end of the traction, and so does their product: one of
    # three active bounds follows from the other two.
    speed = round(0.98 * fastest_reel_out(study_of(STRONG)), 3)
    values = {"limits.tether_force_max_at": "ground", "limits.reel_out_speed_max_m_s": speed}
    study = study_of(STRONG.with_values({**values, "limits.generator_power_max_W": 3008.0 * speed}))
    below, above = study.sides
    kinks = ("limits.generator_power_max_W", "limits.reel_out_speed_max_m_s", "limits.tether_force_max_N")
    for key in kinks:
        column = study.keys.index(key)
        step = 1e-5 * study.polished.p[column]
        for side, sign in ((below, -1.0), (above, 1.0)):
            power = study.power_at(column, sign * step)
            assert power is not None
            # Curvature over the step, and 1e-6 W of the solver.
            noise = 2e-6 / step
            assert sign * (power - study.mean_power_W) / step == pytest.approx(side[column], rel=2e-3, abs=noise)
        assert below[column] > above[column]
    # More generator power alone is worth nothing.
    assert above[study.keys.index(kinks[0])] == pytest.approx(0.0, abs=1e-9)
    # Mass moves no bound: its derivative is the same to both sides.
    mass = study.keys.index("kite.mass_kg")
    assert below[mass] == pytest.approx(above[mass], rel=1e-9)
