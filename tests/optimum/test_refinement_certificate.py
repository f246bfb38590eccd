"""The full certificate on meshes that adapt: fewer points for the same error, and a judgement that stays honest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.family import WIND_KEY, random_draws
from kiteocp import load_problem
from kiteocp.optimum import refine as solution
from kiteocp.optimum.certificate import MESH_TOLERANCE
from kiteocp.optimum.mesh_error import IntervalErrors, passed_limit
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import MeshSolution, Optimum, optimise
from kiteocp.problem import Problem


@pytest.fixture(scope="module")
def light_wind() -> Problem:
    """Return a problem of which no mesh of equal intervals is good: see `test_refinement_estimate`."""
    return load_problem("strong-wind", {WIND_KEY: 4.6})


@pytest.fixture(scope="module")
def adapted(light_wind: Problem) -> Optimum:
    return optimise(light_wind)


@pytest.fixture(scope="module")
def halved(light_wind: Problem) -> Optimum:
    """Return the optimum by halving alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solution, "_adapted", lambda *_: [])
        patch.setattr(solution, "ADAPTATIONS", 4)
        return optimise(light_wind)


def names(optimum: Optimum) -> list[list[int | str]]:
    return [mesh["intervals"] + ["adapted"] * mesh["adapted"] for mesh in optimum.facts["meshes"]]


def test_an_adapted_mesh_needs_fewer_points_than_one_of_equal_intervals(adapted: Optimum, halved: Optimum) -> None:
    assert adapted.certificate.status == halved.certificate.status == "certified"
    assert not any("adapted" in name for name in names(halved))
    assert "adapted" in names(adapted)[-1]
    # What is left of both errors is of first order in the first interval: the limit that the halved meshes tend to.
    coarse, fine = (mesh["mean_power_W"] for mesh in halved.facts["meshes"][-2:])
    limit = 2 * fine - coarse
    assert abs(adapted.mean_power_W - limit) < 0.4 * abs(halved.mean_power_W - limit)
    assert adapted.facts["meshes"][-1]["points"] < 0.75 * halved.facts["meshes"][-1]["points"]


def test_the_summary_says_what_the_meshes_are(adapted: Optimum) -> None:
    *_, before, last = adapted.facts["meshes"]
    trajectory = adapted.cycle.trajectory
    counts = tuple(phase.mesh.intervals for phase in trajectory.phases.values())
    assert (tuple(last["intervals"]), last["adapted"]) == (counts, True)
    assert last["points"] == sum(counts) * 5 == 2 * before["points"]
    shortest = min(np.diff(phase.mesh.borders).min() * phase.duration for phase in trajectory.phases.values())
    assert last["shortest_interval_s"] == pytest.approx(shortest, rel=1e-9)
    assert last["mean_power_W"] == adapted.mean_power_W
    [check] = [check for check in adapted.certificate.checks if check.name == "mesh"]
    first, second = (f"{tuple(mesh['intervals'])} adapted" for mesh in (before, last))
    assert f"from mesh {first} to {second}, its shortest interval {shortest:.2g} s" in check.text
    assert check.value == pytest.approx(abs(before["mean_power_W"] / last["mean_power_W"] - 1.0), rel=1e-3)


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "v3-kite"])
def test_where_one_halving_does_nothing_is_adapted(name: str) -> None:
    optimum = optimise(load_problem(name))
    first, second = optimum.facts["meshes"]
    counts = Formulation.of(optimum.problem).intervals
    assert first["intervals"] == list(counts)
    assert second["intervals"] == [2 * count for count in counts]


def test_where_an_adapted_mesh_cannot_be_solved_the_last_one_is_halved(
    light_wind: Problem, halved: Optimum, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = MeshSolution.on

    def on(self: MeshSolution, *arguments: Any, halved: bool = False) -> MeshSolution | None:
        return honest(self, *arguments, halved=True) if halved else None

    monkeypatch.setattr(MeshSolution, "on", on)
    optimum = optimise(light_wind)
    assert names(optimum) == names(halved)[: len(names(optimum))]
    assert len(names(optimum)) > 2


def test_an_adapted_mesh_alone_is_no_mesh_check(light_wind: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two adapted meshes may agree by having the same faults; only one with every interval halved may certify."""
    honest = MeshSolution.on

    def on(self: MeshSolution, formulation: Formulation, *arguments: Any, halved: bool = False) -> MeshSolution | None:
        fails = halved and formulation.interval_fractions is not None
        return None if fails else honest(self, formulation, *arguments, halved=halved)

    monkeypatch.setattr(MeshSolution, "on", on)
    optimum = optimise(light_wind)
    assert optimum.certificate.status == "not_certified"
    assert [check.name for check in optimum.certificate.failures] == ["mesh"]


def test_any_mesh_makes_a_formulation_that_can_be_looked_up() -> None:
    formulation = Formulation.of(load_problem("strong-wind"))
    same = formulation.on_mesh(formulation.mesh)
    assert same.intervals == formulation.intervals
    assert same.mesh == formulation.mesh
    assert hash(same) == hash(formulation.on_mesh(formulation.mesh))
    assert same.refined().intervals == formulation.refined().intervals
    for name, mesh in same.refined().mesh.items():
        np.testing.assert_allclose(mesh.borders[::2], formulation.mesh[name].borders, atol=1e-15)


def test_a_limit_that_is_passed_between_points_is_named_where_it_matters() -> None:
    mesh = Formulation.of(load_problem("strong-wind")).mesh
    none = {
        name: IntervalErrors(*(np.full(phase.intervals, 1e-6) for _ in range(3)), ("",) * phase.intervals)
        for name, phase in mesh.items()
    }
    assert passed_limit(none, mesh) is None
    excess = np.array([0.0, 1e-3, 0.0])
    passed = IntervalErrors(0.1 * excess, excess, 0.1 * excess, ("", "limits.generator_power_max_W", ""))
    text = passed_limit({**none, "retraction": passed}, mesh)
    assert text is not None
    assert "limits.generator_power_max_W" in text
    assert "in the retraction at 33.3 to 66.7 % of its time" in text
    bent = IntervalErrors(excess, 0.1 * excess, excess, ("", "limits.generator_power_max_W", ""))
    assert passed_limit({**none, "retraction": bent}, mesh) is None


def draw(name: str) -> Problem:
    [problem] = [member.problem for member in random_draws(400) if member.name == name]
    return problem


@pytest.mark.slow
def test_a_draw_with_a_jump_of_force_in_the_transition_is_certified() -> None:
    """Four halvings of the default mesh left 0.15 %, at 480 points."""
    optimum = optimise(draw("strong-wind draw 249"))
    assert optimum.certificate.status == "certified", optimum.certificate.message
    assert optimum.facts["meshes"][-1]["points"] < 300


@pytest.mark.slow
def test_schedules_with_kinks_are_certified() -> None:
    optimum = optimise(load_problem("v3-kite", {"optimisation.traction_elevation": "course-coupled"}))
    assert optimum.certificate.status == "certified", optimum.certificate.message


@pytest.mark.slow
@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "moderate-wind draw 351"])
def test_a_speed_that_bends_between_the_points_is_not_certified_and_the_power_holds(name: str) -> None:
    """Where force and power setting change within moments, the winch would have to be faster than it is.

    The program bounds the slope of the polynomial through the reeling speeds; between the points the speed that follows
    from force and power setting is another. The power, and all else, is that of the finest mesh.
    """
    problem = draw(name) if "draw" in name else load_problem(name, {"optimisation.power_setting": "all"})
    optimum = optimise(problem)
    assert [check.name for check in optimum.certificate.failures] == ["limits"]
    assert "limits.reeling_acceleration_max_m_s2 exceeded by" in optimum.certificate.message


@pytest.mark.slow
def test_an_optimum_that_slips_through_a_limit_between_points_is_not_certified_and_says_so() -> None:
    """At the end of the traction this draw jumps over speeds whose power is beyond the generator's.

    Wherever the points are a little apart it does so there, and the power is that of the mesh.
    """
    optimum = optimise(draw("v3-kite draw 306"))
    [check] = optimum.certificate.failures
    assert check.name == "mesh"
    assert check.value is not None
    assert check.value > MESH_TOLERANCE
    assert "between two points of the mesh, in the traction" in check.text
