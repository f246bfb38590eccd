"""What `kiteocp solve --export` writes: tables that read back, laws whose losses are small and stated."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

import kiteocp
from kiteocp.cli.main import main
from kiteocp.optimum.refine import optimise
from kiteocp.studies.winch.export import WIND_FACTORS, winch_export
from kiteocp.studies.winch.setpoints import LENGTH_SAMPLES, branches

#: Percent of the optimal power that the force laws lose in the wind of the problem, as measured, rounded up.
MEASURED_LOSS = {"strong-wind": 0.34, "moderate-wind": 0.31, "v3-kite": 0.06}


@pytest.fixture(scope="module", params=sorted(MEASURED_LOSS))
def export(request):
    return winch_export(optimise(kiteocp.load_problem(request.param), certificate="quick"))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The v3 kite through the command line, with its directory and exit status."""
    directory = tmp_path_factory.mktemp("winch")
    words = ["solve", "v3-kite", "--certificate", "quick", "--no-plot", "-o", str(directory / "solve")]
    return directory, main([*words, "--export", str(directory / "winch")])


def read_csv(path):
    with path.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return {name: [row[index] for row in rows] for index, name in enumerate(header)}


def test_force_laws_lose_little_in_the_wind_of_the_problem(export):
    nominal = export.evaluation("force", 1.0)
    # The optimum is the best there is, to the accuracy of its mesh; and a half more than measured is a change to see.
    assert -0.01 <= nominal.loss_percent <= 1.5 * MEASURED_LOSS[export.problem.name]
    assert nominal.force_overshoot_percent <= 0.2
    lowest = min(record.output("tether_force_ground").min() for record in nominal.records)
    # Where the speed must change at the smallest force, the law trades 1 % of it for power; the report says so.
    assert lowest >= 0.985 * export.problem.limits.tether_force_min_N


def test_force_laws_complete_the_cycle_in_other_winds(export):
    for factor in WIND_FACTORS:
        one = export.evaluation("force", factor)
        assert one.message is None
        assert one.mean_power_W is not None
        assert one.optimal_mean_power_W is not None
        # Worst measured: 2.5 %, the strong wind case in less wind, whose optimum flies lower. Below the optimum of that
        # wind by nothing only where a limit is left.
        assert one.loss_percent < 4.0
        assert one.loss_percent > -0.01 or one.violations


def test_length_laws_are_a_feed_forward_only(export):
    assert abs(export.evaluation("length", 1.0).loss_percent) < 0.05
    # More wind goes into the force: this is why the force laws are the ones to fly.
    stronger = export.evaluation("length", 1.1)
    assert stronger.force_overshoot_percent > 20.0
    assert stronger.violations[0]["limit"] == "limits.tether_force_max_N"


def test_mean_power_is_that_of_its_time_series(export):
    one = export.evaluation("force", 0.9)
    energy = sum(np.trapezoid(record.output("power"), record.time_s) for record in one.records)
    pauses = 3 * export.problem.limits.phase_change_time_s
    duration = sum(record.duration_s for record in one.records) + pauses
    # Trapezoids over 241 samples of each phase, with kinks where the law has some.
    assert energy / duration == pytest.approx(one.mean_power_W, rel=2e-4)


def test_the_report_states_the_losses(export):
    assert f"force laws lose {export.evaluation().loss_percent:.2f} % (nominal)" in export.report
    assert "(wind -10 %)" in export.report


def test_strong_wind_tells_that_the_force_runs_away_in_a_stronger_one():
    # With 10 % more wind the kite outruns the fastest winch at this elevation: it must be said, not sold as a gain.
    export = winch_export(optimise(kiteocp.load_problem("strong-wind"), certificate="quick"))
    assert export.evaluation("force", 1.1).force_overshoot_percent > 10.0
    assert "more power than the optimum only because limits are left" in export.report


def test_the_command_line_writes_what_a_controller_takes(written, capsys):
    directory, status = written
    names = ["laws.json", "report.txt", "setpoints_length.csv", "setpoints_time.csv"]
    assert sorted(path.name for path in (directory / "winch").iterdir()) == names
    laws = json.loads((directory / "winch" / "laws.json").read_text())
    summary = json.loads((directory / "solve" / "summary.json").read_text())
    assert summary["winch"] == laws
    assert laws["certified"] == (summary["status"] == "certified")
    assert status == (0 if laws["certified"] else 1)
    law = laws["phases"]["traction"]["force_law"]
    assert law["quantity"] in law["knots"]
    assert law["valid_from"] < law["valid_to"]
    assert laws["phases"]["retraction"]["ends_when"]["tether_length_at_most_m"] == pytest.approx(200.0, abs=1e-3)


def test_set_points_over_time_read_back_and_count_the_phase_changes(written):
    directory, _ = written
    table = read_csv(directory / "winch" / "setpoints_time.csv")
    summary = json.loads((directory / "solve" / "summary.json").read_text())
    time = np.array(table["time_s"], float)
    assert np.all(np.diff(time) >= 0)
    assert time[-1] == pytest.approx(summary["cycle"]["duration_s"], rel=1e-9)
    assert list(dict.fromkeys(table["phase"])) == ["retraction", "change", "transition", "traction"]
    # The written numbers are those of the cycle, to the last digit.
    series = read_csv(directory / "solve" / "timeseries.csv")
    for column in ("tether_force_ground_N", "reeling_speed_m_s", "tether_length_m"):
        ours = [value for value, phase in zip(table[column], table["phase"], strict=True) if phase != "change"]
        assert ours == series[column]
    changes = np.array(table["phase"]) == "change"
    in_change = np.array(table["time_in_phase_s"], float)[changes]
    assert in_change.max() == pytest.approx(2.0)
    speed = np.array(table["reeling_speed_m_s"], float)
    first = np.flatnonzero(changes)[0]
    assert speed[first] == speed[first - 1]


def test_set_points_over_length_are_functions_of_it(written):
    directory, _ = written
    table = read_csv(directory / "winch" / "setpoints_length.csv")
    length, speed = (np.array(table[name], float) for name in ("tether_length_m", "reeling_speed_m_s"))
    for key in dict.fromkeys(zip(table["phase"], table["branch"], strict=True)):
        rows = [pair == key for pair in zip(table["phase"], table["branch"], strict=True)]
        steps = np.diff(length[rows])
        assert len(steps) == LENGTH_SAMPLES - 1
        np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
        # A speed whose sign is that of the branch, but for the samples on both sides of where it turns.
        assert np.mean(np.sign(speed[rows]) == np.sign(steps[0])) > 0.9


def test_branches_are_cut_where_the_length_turns():
    length = np.array([10.0, 9.0, 8.0, 9.0, 12.0, 12.0, 12.0, 11.99])
    assert branches(length) == [slice(0, 3), slice(2, 5)]


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    words = ["solve", "v3-kite", "--certificate", "quick", "--no-plot", "--export", "taken"]
    assert main(words) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_export_schedule_is_public(tmp_path, monkeypatch):
    problem = kiteocp.load_problem("v3-kite")
    monkeypatch.setattr("kiteocp.studies.winch.export.optimise", lambda p, **_: optimise(p, certificate="quick"))
    export = kiteocp.export_schedule(problem, tmp_path)
    assert (tmp_path / "report.txt").read_text() == export.report + "\n"
