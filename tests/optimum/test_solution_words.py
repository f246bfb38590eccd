"""What is said of a solution: words and numbers that fit it, once, and a warning where it is not what it seems."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from kiteocp import load_problem, solve
from kiteocp.cli.main import main
from kiteocp.cycle.phases import FlownPhase
from kiteocp.errors import CycleError
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.optimum.certificate import starts_check
from kiteocp.optimum.checks import LimitMargin, limits_check
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.problem import Problem, problem_from_dict


def a_kite(**blocks: Any) -> Problem:
    """Make a problem of a 20 m2 kite, its blocks replaced where given."""
    content: dict[str, Any] = {
        "name": "a-kite",
        "kite": {
            "projected_area_m2": 19.75,
            "mass_kg": 22.8,
            "powered": {"lift_coefficient": 0.9, "drag_coefficient": 0.2},
            "depowered": {"lift_coefficient": 0.2, "drag_coefficient": 0.1},
        },
        "tether": {"diameter_m": 0.004, "density_kg_m3": 724.0, "drag_coefficient": 1.1},
        "operation": {"tether_length_min_m": 200.0, "tether_length_max_m": 400.0},
        "limits": {"tether_force_min_N": 300.0, "tether_force_max_N": 5000.0},
    }
    return problem_from_dict(content | blocks)


def in_table(heights: list[float], speeds: list[float]) -> Problem:
    wind = {"profile": "table", "heights_m": heights, "speeds_m_s": speeds}
    return a_kite(environment={"wind": wind})


#: A wind that falls from 11 to 5 m/s within a metre.
STEP = [0.0, 120.0, 121.0, 400.0], [11.0, 11.0, 5.0, 5.0]


@pytest.fixture(scope="module")
def a_step() -> Any:
    return solve(in_table(*STEP))


def test_a_solution_that_cannot_be_flown_between_the_points_is_said_in_words_that_fit(a_step: Any) -> None:
    assert a_step.status == "not_certified"
    certificate = json.dumps(a_step.details["certificate"]) + a_step.details["message"]
    assert not re.search(r"\bnan\b", certificate)
    assert "prescribed cycle" not in certificate
    # Where on the step an optimum hangs, and so what fails, depends on the solver's version.
    assert "cannot be flown" not in certificate or "the optimal schedule cannot be flown" in certificate


def test_limits_of_what_has_no_state_are_said_to_be_without_comparison() -> None:
    check = limits_check([LimitMargin("limits.height_min_m", "transition", -np.inf)])
    assert not check.passed
    assert check.text.startswith("in the transition there is no steady flight between some mesh points")


def test_meshes_are_not_tried_for_ever_for_a_schedule_that_none_can_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    # It took 45 to 90 s, nearly all of it on the fourth mesh and on. Meshes are counted: a machine may be slow.
    found: list[int] = []
    plain = Solver.solve

    def counted(solver: Solver, *arguments: Any, near: bool = False, **options: Any) -> Solution:
        found.extend([len(solver.program.variables)] * near)
        return plain(solver, *arguments, near=near, **options)

    def unflyable(_cycle: OptimalCycle) -> list[FlownPhase]:
        raise CycleError("traction", "on a step")

    # Whether the schedule of a real step can be flown on some mesh depends on the versions of the solver.
    monkeypatch.setattr(Solver, "solve", counted)
    monkeypatch.setattr(OptimalCycle, "resimulate", unflyable)
    assert solve(load_problem("v3-kite")).status == "not_certified"
    assert len(found) == 2


def test_every_start_without_an_optimum_is_named(a_step: Any) -> None:
    [check] = [check for check in a_step.details["certificate"]["checks"] if check["name"] == "starts"]
    # Which starts fail on the step, if any, depends on the solver's version.
    for start in (start for start in a_step.details["starts"] if start["mean_power_W"] is None):
        assert f"'{start['start']}' ({start['status']})" in check["text"]
    assert starts_check([1000.0, None], {"short cycle": "Restoration_Failed"}).text == (
        "1 of 2 starts led to 1 local optimum; none from 'short cycle' (Restoration_Failed)"
    )
    assert starts_check([1000.0, 1000.0]).text == "2 of 2 starts led to 1 local optimum"
    assert starts_check([1000.0]).text == "solved from one start; a full certificate has a second opinion"


@pytest.mark.parametrize("certificate", ["quick", "full"])
def test_iterations_of_the_solver_and_of_the_certificate_are_one_story(certificate: Any) -> None:
    result = solve(load_problem("v3-kite"), certificate=certificate)
    lines = str(result).splitlines()
    [solver] = [line for line in lines if line.startswith("solver:")]
    [check] = [line for line in lines if "IPOPT:" in line]
    counts = [int(count) for count in re.findall(r"(\d+)(?= iterations| and \d+ iterations)", solver)]
    assert counts[0] == result.details["solver"]["iterations"]
    assert counts[1:] == [mesh["iterations"] for mesh in result.details["meshes"][1:]]
    assert len(counts) == len(result.details["meshes"])
    assert f"on mesh {tuple(result.details['meshes'][-1]['intervals'])} after {counts[-1]} iterations" in check


@pytest.mark.parametrize("json_output", [False, True])
def test_why_there_is_no_cycle_is_said_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], json_output: bool
) -> None:
    words = ["solve", "v3-kite", "--set", "limits.tether_force_min_N=4990", "--no-plot", "-o", str(tmp_path)]
    assert main(words + ["--json"] * json_output) == 1
    out, err = capsys.readouterr()
    sentence = json.loads((tmp_path / "summary.json").read_text())["message"]
    assert sentence.startswith("no cycle found")
    assert err.count(sentence) == 1
    assert out.count(sentence) == (2 if json_output else 0)  # JSON is the summary: message and explanation
    assert "solve: infeasible" in out or json_output


def test_a_prescribed_cycle_that_cannot_be_flown_is_said_beside_the_optimum(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = "operation.traction.tether_force_N=30000"
    assert main(["solve", "strong-wind", "--set", changed, "--no-plot", "-o", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["prescribed"] is None
    assert "its traction ends" in summary["prescribed_message"]
    [warning] = [text for text in summary["warnings"] if text.startswith("no comparison:")]
    assert summary["prescribed_message"] in warning
    assert warning in capsys.readouterr().out


def test_one_that_can_be_flown_is_no_warning() -> None:
    result = solve(load_problem("strong-wind"), certificate="quick")
    assert result.prescribed is not None
    assert "prescribed_message" not in result.summary()
    assert not any("no comparison" in text for text in result.warnings)


#: The kite of awesIO's example in little wind.
LITTLE_WIND = """
environment:
  wind: {profile: logarithmic, reference_speed_m_s: 5.0, reference_height_m: 200.0, roughness_length_m: 0.03}
kite:
  projected_area_m2: 19.75
  mass_kg: 22.8
  powered: {lift_coefficient: 0.63, drag_coefficient: 0.14}
  depowered: {lift_coefficient: 0.4, drag_coefficient: 0.12}
tether: {diameter_m: 0.01, density_kg_m3: 724.0, drag_coefficient: 1.1}
limits: {tether_force_max_N: 8200.0, generator_power_max_W: 40000.0, height_max_m: 500.0, height_min_m: 100.0}
operation: {tether_length_min_m: 150.0, tether_length_max_m: 340.0}
"""


def test_a_degenerate_optimum_is_named() -> None:
    problem = a_kite(**yaml.safe_load(LITTLE_WIND))
    result = solve(problem)
    assert result.status == "certified"
    [warning] = [text for text in result.warnings if "degenerate" in text]
    stroke = result.phases["traction"]["tether_length_end_m"] - result.phases["traction"]["tether_length_start_m"]
    assert f"its stroke of {stroke:.3g} m" in warning
    assert "limits.stroke_min_m" in warning
    # What it asks for helps, and a useful cycle is not called so.
    for changes in ({"limits.stroke_min_m": 40.0}, {"environment.wind.reference_speed_m_s": 10.0}):
        other = solve(problem.with_values(changes), certificate="quick")
        assert not any("degenerate" in text for text in other.warnings)
