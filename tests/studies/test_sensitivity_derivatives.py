"""Derivatives of the optimum against re-solving it, and what has no influence."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from kiteocp import load_problem, shipped_problems
from kiteocp.optimum.refine import optimise
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.studies.sensitivity.derivatives import LocalStudy, key_directions

#: A winch whose speed jumps between phases are limited, and bind.
WINCH = {"optimisation.speed_jumps": "limited", "limits.reeling_acceleration_max_m_s2": 4.5}

#: Tighter than the default, so that differences of re-solved powers have digits.
TIGHT = {"optimisation.tolerance": 1e-10}


@cache
def study_of(problem: Problem) -> LocalStudy:
    return LocalStudy.of(optimise(problem, certificate="quick"))


def resolved_power(study: LocalStudy, key: str, value: float) -> float:
    """Power with a key set as --set does, by IPOPT; nothing taken from the active-set method."""
    vector = parameter_values(study.optimum.problem.with_values({key: value})).vector
    solution = study.optimum.solver.solve(study.optimum.solution.x, vector, warm=study.optimum.solution)
    assert solution.success
    return -1e4 * solution.f


def central_difference(study: LocalStudy, key: str, share: float = 1e-3) -> float:
    """Re-solved central difference, its step a share of the value, inside the interval where the active set holds."""
    column = study.keys.index(key)
    value = study.polished.p[column]
    room = [abs(study.reach(column, sign * 0.05 * abs(value)).step) for sign in (-1.0, 1.0)]
    step = min(share * abs(value), 0.5 * min(room))
    assert step > 0.0
    ends = [resolved_power(study, key, value + sign * step) for sign in (1.0, -1.0)]
    return (ends[0] - ends[1]) / (2 * step)


def assert_derivatives_match(study: LocalStudy, keys: list[str], share: float = 1e-3) -> None:
    for key in keys:
        derivative = study.gradient[study.keys.index(key)]
        value = study.polished.p[study.keys.index(key)]
        # 1e-4 of itself; powers are re-solved to some 1e-6 W, which a derivative by 0.1 % of a value turns into this.
        noise = 1e-5 / (share * abs(value))
        assert central_difference(study, key, share) == pytest.approx(derivative, rel=1e-4, abs=noise), key


@pytest.mark.parametrize("name", list(shipped_problems()))
def test_against_resolved_central_differences(name: str) -> None:
    study = study_of(load_problem(name, TIGHT))
    felt = [key for key, slope in zip(study.keys, study.gradient, strict=True) if slope != 0.0]
    assert len(felt) >= 20
    # All keys of one problem, every third of the others: each takes two optima.
    assert_derivatives_match(study, felt if name == "strong-wind" else felt[::3])


@pytest.mark.parametrize("name", list(shipped_problems()))
def test_what_has_no_influence_shows_zero_and_not_noise(name: str) -> None:
    study = study_of(load_problem(name, TIGHT))
    for key in (
        "operation.traction.elevation_deg",
        "operation.traction.tether_force_N",
        "operation.retraction.tether_force_N",
        "limits.traction_elevation_rate_max_deg_s",
        "limits.reel_in_speed_max_m_s",
        "machine.generator_efficiency",
    ):
        column = study.keys.index(key)
        assert study.gradient[column] == 0.0
        assert all(side[column] == 0.0 for side in study.sides)
        assert not study.derivatives.x[:, column].any()


def test_defaults_that_follow_a_key_are_carried_along() -> None:
    problem = load_problem("v3-kite", TIGHT).with_values({"limits.tether_force_min_N": None})
    keys, directions = parameter_values(problem).structure.keys, key_directions(problem)
    largest, smallest = keys.index("limits.tether_force_max_N"), keys.index("limits.tether_force_min_N")
    longest = keys.index("operation.tether_length_max_m")
    # 3 % of the largest force, and the longest tether of the operation.
    assert directions[smallest, largest] == pytest.approx(0.03, rel=1e-12)
    assert directions[keys.index("limits.tether_length_max_m"), longest] == 1.0
    assert np.array_equal(directions[:, smallest].nonzero()[0], [smallest])
    assert_derivatives_match(study_of(problem), ["limits.tether_force_max_N", "operation.tether_length_max_m"])


def test_electrical_power_behind_generator_and_motor() -> None:
    values = {"optimisation.objective": "electrical", "machine.generator_efficiency": 0.9}
    study = study_of(load_problem("strong-wind", TIGHT).with_values({**values, "machine.motor_efficiency": 0.8}))
    keys = ["machine.generator_efficiency", "machine.motor_efficiency", "limits.tether_force_max_N", "kite.mass_kg"]
    assert study.gradient[study.keys.index(keys[0])] > 0.0
    assert_derivatives_match(study, keys)


def test_a_wind_table_entry_by_entry() -> None:
    table = {"profile": "table", "heights_m": [10.0, 60.0, 120.0, 200.0, 500.0], "speeds_m_s": [5.9, 7.4, 8.2, 8.8, 9]}
    study = study_of(load_problem("v3-kite", TIGHT).with_values({"environment.wind": table}))
    entries = [key for key in study.keys if key.startswith("environment.wind.")]
    assert len(entries) == 10
    # The kite flies between 60 and 210 m: the entries at the ends have no or little part in it.
    felt = [key for key in entries if abs(study.gradient[study.keys.index(key)]) > 1.0]
    assert {f"environment.wind.speeds_m_s[{i}]" for i in (1, 2, 3)} <= set(felt)
    # The interpolation bends at the entries: third derivatives over 0.1 % would leave 3e-4.
    assert_derivatives_match(study, felt, share=3e-4)


def test_second_derivatives_and_the_schedule_against_neighbouring_optima() -> None:
    problem = load_problem("strong-wind", TIGHT)
    study = study_of(problem)
    for key in ("kite.mass_kg", "limits.tether_force_max_N", "tether.drag_coefficient"):
        column = study.keys.index(key)
        value, step = study.polished.p[column], 1e-3 * study.polished.p[column]
        low, high = (study_of(problem.with_values({key: value + sign * step})) for sign in (-1.0, 1.0))
        second = -1e4 * study.derivatives.objective_second[column, column]
        # Third derivatives over a step of 0.1 % leave some 1e-5.
        assert (high.gradient[column] - low.gradient[column]) / (2 * step) == pytest.approx(second, rel=1e-3)
        change = (high.polished.x - low.polished.x) / (2 * step)
        size = float(np.max(np.abs(change)))
        assert study.derivatives.x[:, column] == pytest.approx(change, rel=1e-3, abs=1e-4 * size)


def test_a_product_of_two_keys_in_a_bound_has_its_cross_derivative() -> None:
    # Each speed jump is at most acceleration times phase-change time.
    problem = load_problem("strong-wind", {**TIGHT, **WINCH})
    study = study_of(problem)
    first, second = (
        study.keys.index(f"limits.{key}") for key in ("reeling_acceleration_max_m_s2", "phase_change_time_s")
    )
    assert study.gradient[first] > 0.0
    step = 1e-4 * study.polished.p[second]
    low, high = (
        study_of(problem.with_values({study.keys[second]: study.polished.p[second] + sign * step})) for sign in (-1, 1)
    )
    cross = (high.gradient[first] - low.gradient[first]) / (2 * step)
    assert -1e4 * study.derivatives.objective_second[first, second] == pytest.approx(cross, rel=1e-4)
