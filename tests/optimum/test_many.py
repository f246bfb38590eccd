"""Many optima at once: those that `solve` finds, in the order given, whatever the number of processes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kiteocp
from kiteocp.errors import InfeasibleError, InputError
from kiteocp.optimum.neighbours import Family
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

#: What is changed by up to 20 %, all at once.
KEYS = (
    "environment.wind.reference_speed_m_s",
    "kite.mass_kg",
    "kite.projected_area_m2",
    "kite.powered.lift_coefficient",
    "kite.depowered.lift_coefficient",
    "limits.tether_force_min_N",
    "limits.tether_force_max_N",
)

#: Numbers of ``moderate-wind`` with which starts lead to two local optima.
BISTABLE = {
    "environment.wind.reference_speed_m_s": 4.81,
    "kite.projected_area_m2": 19.5,
    "kite.mass_kg": 19.8,
    "kite.powered.lift_coefficient": 0.487,
    "kite.powered.lift_to_drag": 4.11,
    "kite.depowered.lift_coefficient": 0.203,
    "kite.depowered.lift_to_drag": 3.63,
    "limits.tether_force_max_N": 3490.0,
    "limits.tether_force_min_N": 678.0,
}

#: Optima of two searches are one where their powers differ by no more: the solvers stop at 1e-8, and a refined mesh or
#: a divided interval may lie between.
SAME = 2e-4


def designs(name: str, count: int, seed: int = 3, spread: float = 0.2) -> list[Problem]:
    problem, random = kiteocp.load_problem(name), np.random.default_rng(seed)
    values = parameter_values(problem)
    return [
        problem.with_values({key: values[key] * random.uniform(1 - spread, 1 + spread) for key in KEYS})
        for _ in range(count)
    ]


def powers(results: list[Any]) -> list[float | None]:
    return [result.cycle["mean_power_W"] if isinstance(result, kiteocp.Result) else None for result in results]


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "v3-kite"])
def test_random_designs_have_the_optima_that_solve_finds(name: str) -> None:
    problems = designs(name, 8)
    found = kiteocp.solve_many(problems)
    for problem, result in zip(problems, found, strict=True):
        assert isinstance(result, kiteocp.Result)
        assert result.status == "certified"
        assert result.problem is problem
        alone = kiteocp.solve(problem, certificate="quick")
        assert result.cycle["mean_power_W"] == pytest.approx(alone.cycle["mean_power_W"], rel=SAME)
    assert sum(result.details["solver"]["name"] == "sqp" for result in found) >= 6  # type: ignore[union-attr]


def test_a_wide_range_of_winds_is_followed_from_neighbour_to_neighbour() -> None:
    problem = kiteocp.load_problem("v3-kite")
    winds = np.linspace(5.0, 14.0, 10)
    found = kiteocp.solve_many([problem.with_values({"environment.wind.reference_speed_m_s": wind}) for wind in winds])
    assert all(isinstance(result, kiteocp.Result) and result.succeeded for result in found)
    assert np.all(np.diff(np.array(powers(found), dtype=float)) > 0.0)


def test_processes_change_nothing_and_the_order_is_kept() -> None:
    problems = designs("strong-wind", 12, spread=0.1)
    assert powers(kiteocp.solve_many(problems, jobs=2)) == pytest.approx(powers(kiteocp.solve_many(problems)), rel=1e-9)


def test_families_and_failures_keep_their_places() -> None:
    hopeless = kiteocp.load_problem("strong-wind").with_values({"environment.wind.reference_speed_m_s": 1.0})
    problems = [designs("v3-kite", 1)[0], hopeless, designs("strong-wind", 1)[0], designs("v3-kite", 2)[1]]
    done: list[tuple[int, int]] = []
    found = kiteocp.solve_many(problems, progress=lambda count, total: done.append((count, total)))
    assert [type(result) for result in found] == [kiteocp.Result, InfeasibleError, kiteocp.Result, kiteocp.Result]
    assert [result.problem.name for result in found if isinstance(result, kiteocp.Result)] == [
        "v3-kite",
        "strong-wind",
        "v3-kite",
    ]
    assert done == [(count, 4) for count in range(1, 5)]


def test_no_problems_have_no_optima() -> None:
    assert kiteocp.solve_many([]) == []


def test_levels_are_those_of_solve_and_none_certifies_nothing() -> None:
    problems = designs("strong-wind", 2)
    [full, _] = kiteocp.solve_many(problems, certificate="full")
    [bare, _] = kiteocp.solve_many(problems, certificate="none")
    assert isinstance(full, kiteocp.Result)
    assert isinstance(bare, kiteocp.Result)
    assert full.status == "certified"
    assert "mesh" in [check["name"] for check in full.details["certificate"]["checks"]]
    assert bare.status == "not_certified"
    assert "no certificate was asked for" in bare.details["message"]
    assert [check["name"] for check in bare.details["certificate"]["checks"] if check["passed"]] == [
        "solver",
        "optimality",
        "objective",
    ]


@pytest.mark.parametrize(
    ("options", "words"), [({"jobs": 0}, "jobs: 0"), ({"certificate": "some"}, "certificate")], ids=["jobs", "level"]
)
def test_options_that_make_no_sense_are_said(options: dict[str, Any], words: str) -> None:
    with pytest.raises((InputError, ValueError), match=words):
        kiteocp.solve_many([], **options)


def test_a_rival_optimum_is_followed_too_and_wins_where_it_is_better() -> None:
    """A design with two local optima, 1.3 % apart; with the worse one in front the better one is found all the same."""
    problem = kiteocp.load_problem("moderate-wind").with_values(BISTABLE)
    family = Family.around(problem)
    assert len(family.optima) > 1
    turned = Family(family.structure, family.formulation, family.options, tuple(reversed(family.optima)))
    values = parameter_values(problem.with_values({"kite.mass_kg": parameter_values(problem)["kite.mass_kg"] * 1.01}))
    best = min(attempt.solution.f for attempt in family.attempts(values))
    found = [attempt.solution.f for attempt in turned.attempts(values)]
    assert len(found) > 1
    assert min(found) == pytest.approx(best, rel=SAME)
    assert found[0] > best * (1 - SAME)
