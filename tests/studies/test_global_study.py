"""Global sensitivity: indices where they are known, the open-loop schedule, failures counted, the command line."""

from __future__ import annotations

import csv
import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from kiteocp import load_problem
from kiteocp.cli.main import main
from kiteocp.errors import InputError
from kiteocp.optimum.refine import optimise
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem, problem_from_dict
from kiteocp.report.document import Document
from kiteocp.studies.sensitivity.derivatives import LocalStudy
from kiteocp.studies.sensitivity.open_loop import OpenLoopCycle, fly_open_loop
from kiteocp.studies.sensitivity.sampling import Resolver, Sample, quantiles, uncertainties
from kiteocp.studies.sensitivity.sobol import GlobalStudy, base_samples, global_sensitivity, sobol_intervals
from kiteocp.studies.sensitivity.sobol_report import global_parts, global_summary

#: Uncertainties so small that the optimal power is linear in them.
TINY = {
    "uncertainty.environment.wind.reference_speed_m_s": {"relative_standard_deviation": 1e-3},
    "uncertainty.tether.drag_coefficient": {"range": [1.095, 1.105]},
    "uncertainty.limits.tether_force_max_N": {"standard_deviation": 5.0},
}


@cache
def tiny_study() -> GlobalStudy:
    # 32 base samples of 3 keys.
    return global_sensitivity(load_problem("strong-wind", TINY), samples=160, seed=3)


@cache
def resolver_of(problem: Problem) -> Resolver:
    nominal = optimise(problem, certificate="quick")
    return Resolver.of(problem, tuple(uncertainties(problem)[0]), nominal.solution, nominal.formulation)


def test_indices_of_a_linear_function_are_its_squared_shares() -> None:
    generator = np.random.default_rng(5)
    a, b = generator.standard_normal((2, 3, 2000))
    slopes = np.array([3.0, -1.0, 0.0])
    mixed = [np.where(np.arange(3)[:, None] == key, b, a) for key in range(3)]
    values = [slopes @ points for points in (a, b)]
    rows = sobol_intervals(values[0], values[1], np.array([slopes @ points for points in mixed]), 0)
    for row, share in zip(rows, (0.9, 0.1, 0.0), strict=True):
        for name in ("first_order", "total_order"):
            # Four standard errors of the estimate: an interval of 95 % misses one time in twenty.
            spread = (row[f"{name}_to"] - row[f"{name}_from"]) / 3.92
            assert row[name] == pytest.approx(share, abs=4 * spread + 1e-12)
            assert row[f"{name}_from"] <= row[name] <= row[f"{name}_to"]
    assert rows[2]["total_order"] == rows[2]["first_order"] == 0.0


def test_incomplete_base_samples_are_left_out_exactly() -> None:
    generator = np.random.default_rng(6)
    f_a, f_b = generator.standard_normal((2, 64))
    f_ab = generator.standard_normal((2, 64))
    holed = f_ab.copy()
    holed[1, 40:] = np.nan
    whole = sobol_intervals(f_a[:40], f_b[:40], f_ab[:, :40], 1)
    assert sobol_intervals(f_a, f_b, holed, 1) == whole
    # The formulas of Saltelli et al. (2010), table 2 (b) and (f), on the 40 that are complete.
    mean = np.mean([f_a[:40], f_b[:40]])
    variance = np.var([f_a[:40], f_b[:40]])
    first = np.mean((f_b[:40] - mean) * (f_ab[0, :40] - f_a[:40])) / variance
    total = 0.5 * np.mean((f_a[:40] - f_ab[0, :40]) ** 2) / variance
    assert (whole[0]["first_order"], whole[0]["total_order"]) == pytest.approx((first, total), rel=1e-12)
    nothing = sobol_intervals(f_a, f_b, np.full((1, 64), np.nan), 1)
    assert all(math.isnan(number) for number in nothing[0].values())


def test_tiny_uncertainties_against_the_derivatives_of_the_local_study() -> None:
    problem, study = load_problem("strong-wind", TINY), tiny_study()
    local = LocalStudy.of(optimise(problem, certificate="quick"))
    deviations = [problem.uncertainty[key].deviation(parameter_values(problem)[key]) for key in study.keys]
    slopes = [local.gradient[local.keys.index(key)] for key in study.keys]
    parts = np.square(np.multiply(slopes, deviations))
    assert study.summary["sample_status"]["solved"] == study.summary["samples"] == 160
    for row, share in zip(study.summary["indices"], parts / parts.sum(), strict=True):
        for name in ("first_order", "total_order"):
            # Half the width of the interval is two standard errors; twice that is four.
            width = row[f"{name}_to"] - row[f"{name}_from"]
            assert row[name] == pytest.approx(share, abs=width + 0.01)
    spread = study.summary["distribution"]
    # Of 64 points of a Sobol sequence the deviation is off by some percent, the mean by some percent of the deviation.
    assert spread["standard_deviation_W"] == pytest.approx(math.sqrt(parts.sum()), rel=0.1)
    assert spread["mean_W"] == pytest.approx(local.mean_power_W, abs=0.2 * spread["standard_deviation_W"])
    # Every sample is the linear prediction; second derivatives leave little of so small a spread.
    nominal = [parameter_values(problem)[key] for key in study.keys]
    linear = local.mean_power_W + (study.points - nominal) @ np.array(slopes)
    powers = [sample.mean_power_W for sample in study.samples]
    assert powers == pytest.approx(linear, abs=0.02 * spread["standard_deviation_W"])


def test_a_seed_gives_the_same_again_and_processes_the_same_as_one() -> None:
    problem = load_problem("strong-wind", {"uncertainty.kite.mass_kg": {"standard_deviation": 1.0}})
    one, two = (global_sensitivity(problem, samples=24, seed=7, jobs=jobs) for jobs in (1, 2))
    other = global_sensitivity(problem, samples=24, seed=8)
    assert np.array_equal(one.points, two.points)
    assert not np.array_equal(one.points, other.points)
    assert one.summary["indices"] == two.summary["indices"]
    assert one.samples == two.samples
    # One key has all the variance; its total index is estimated with little noise.
    assert one.summary["indices"][0]["total_order"] == pytest.approx(1.0, abs=0.25)


def test_samples_without_a_cycle_are_counted() -> None:
    wind = {"uncertainty.environment.wind.reference_speed_m_s": {"range": [2.0, 9.9]}}
    resolver = resolver_of(load_problem("strong-wind", wind))
    assert resolver.sample([2.0]).status == "infeasible"
    assert resolver.sample([-1.0]).status == "invalid"
    problem, entries = resolver.problem, uncertainties(resolver.problem)[0]
    lost, good = (
        Sample("infeasible", open_loop=OpenLoopCycle("not_flown")),
        Sample("solved", 100.0, None, OpenLoopCycle("not_closed")),
    )
    summary = global_summary(problem, entries, True, [lost, good, good, good, lost, good], 2, [{}], None)
    assert summary["sample_status"] == {"solved": 4, "infeasible": 2, "failed": 0, "invalid": 0}
    assert summary["base_samples_complete"] == 1
    assert summary["distribution"]["samples"] == 4
    assert summary["distribution"]["solved"] == 3
    # Of the independent samples; the mixed ones serve the indices only.
    assert summary["reoptimising"]["open_loop_status"] == {"flown": 0, "not_flown": 1, "not_closed": 3}
    assert summary["reoptimising"]["all_flown"]["samples"] == 0


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind"])
def test_the_open_loop_schedule_on_its_own_numbers_is_the_optimum(name: str) -> None:
    resolver = resolver_of(load_problem(name))
    values = parameter_values(resolver.problem)
    nominal = np.array([values[key] for key in resolver.keys])
    flown = resolver.sample(nominal, open_loop=True).open_loop
    assert flown is not None
    assert flown.status == "flown"
    assert not flown.exceeded
    # The independent integrator against the collocation on the mesh of the file, as the certificate allows.
    assert flown.mean_power_W == pytest.approx(-1e4 * resolver.nominal.f, rel=1e-3)
    stronger = nominal.copy()
    stronger[resolver.keys.index("kite.powered.lift_coefficient")] *= 1.02
    sample = resolver.sample(stronger, open_loop=True)
    assert sample.open_loop is not None
    if not sample.open_loop.exceeded:
        # Nothing within the limits beats the optimum; the margin is that of the flight above.
        assert sample.open_loop.mean_power_W < sample.mean_power_W * (1 + 1e-3)


def test_a_course_that_steers_is_trimmed_so_that_the_cycle_closes() -> None:
    resolver = resolver_of(load_problem("v3-kite", {"optimisation.traction_elevation": "course-coupled"}))
    flown = fly_open_loop(resolver.cycle, parameter_values(resolver.problem), "mechanical")
    assert flown.status == "flown"
    assert flown.mean_power_W is not None
    # On the coarse mesh of the file the course is only roughly resolved: trimmed, 96 % of the power remain. Untrimmed,
    # the traction ends 11 deg too high and 88 % remain.
    assert 0.93 < flown.mean_power_W / (-1e4 * resolver.nominal.f) < 1.0


def test_distributions_stay_where_a_problem_file_may_go() -> None:
    entry = {"standard_deviation": 0.2}
    problem = load_problem("strong-wind", {"uncertainty.machine.generator_efficiency": entry})
    key = "machine.generator_efficiency"
    values = quantiles(problem, key, problem.uncertainty[key], np.array([0.0, 0.5, 1.0]))
    # Half a normal distribution below 1: its median is the 25 % quantile of the whole.
    assert values[1] == pytest.approx(1.0 - 0.2 * 0.67449, abs=1e-4)
    assert 0.0 < values[0] < values[1] < values[2] <= 1.0
    with pytest.raises(InputError, match="too few for 1 uncertain keys; give at least 24"):
        base_samples(problem, 23)
    assert base_samples(problem, 2000) == 512


def test_without_stated_uncertainties_the_usual_ones_are_named() -> None:
    content = {block: values for block, values in load_problem("v3-kite").to_dict().items() if block != "uncertainty"}
    entries, stated = uncertainties(problem_from_dict(content))
    assert not stated
    assert "kite.powered.drag_coefficient" in entries
    assert "kite.powered.lift_to_drag" not in entries
    assert len(entries) == 9


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entry = "uncertainty.tether.drag_coefficient={relative_standard_deviation: 0.1}"
    words = ["sensitivity", "strong-wind", "--no-intervals", "--set", entry, "--global", "--samples", "24"]
    assert main([*words, "--jobs", "1", "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    for text in ("24 of 24 samples solved", "value of re-optimising", "first order"):
        assert text in out
    names = ["global.csv", "global.png", "sensitivity.png", "summary.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    summary = json.loads((tmp_path / "summary.json").read_text())
    found = summary["global"]
    assert Document("", global_parts(found)).text().strip() in out
    assert found["uncertainty_stated"] is True
    assert (found["nominal_status"], found["nominal_message"]) == ("certified", None)
    assert (
        "refine optimisation.mesh" in Document("", global_parts({**found, "nominal_message": "a check failed"})).text()
    )
    assert found["nominal_mean_power_W"] == pytest.approx(summary["optimal_mean_power_W"], rel=1e-6)
    assert sum(found["histogram"]["counts"]) == found["distribution"]["solved"] == 16
    with open(tmp_path / "global.csv", newline="") as stream:
        table = list(csv.DictReader(stream))
    assert len(table) == 24
    assert {row["status"] for row in table} == {"solved"}
    assert [row["open_loop_status"] != "" for row in table] == [True] * 16 + [False] * 8


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--global", "--samples", "10"], "--samples 10: too few for 9 uncertain keys; give at least 88"),
        (["--global", "--jobs", "0"], "'0' is not a whole number above 0"),
        (["--samples", "500"], "add --global"),
    ],
)
def test_mistakes_are_one_sentence(capsys: pytest.CaptureFixture[str], words: list[str], expected: str) -> None:
    assert main(["sensitivity", "strong-wind", *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert expected in err
