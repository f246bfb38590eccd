"""The verbs as a user meets them: what they print, write and leave, with the model replaced by a made-up result."""

from __future__ import annotations

import errno
import json
import os

import pytest
from made_result import make_optimum, make_result

import kiteocp.cycle
import kiteocp.optimum.solve
from kiteocp import CycleError, NoEquilibriumError, SolveError, shipped_problems, writing
from kiteocp.cli.main import main


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def made_up(monkeypatch):
    """Replace the calculations; what `simulate` was asked for is appended to the list returned."""
    asked = []

    def simulate(problem, **options):
        asked.append(options)
        return make_result(problem=problem)

    monkeypatch.setattr(kiteocp.cycle, "simulate", simulate)
    monkeypatch.setattr(kiteocp.optimum.solve, "solve", lambda _problem, **_options: make_optimum(), raising=False)
    return asked


def raising(error):
    def fail(*_arguments, **_options):
        raise error

    return fail


def one_sentence(capsys, status, *parts):
    """Assert that standard error holds one line with these parts, and return what went to standard output."""
    out, err = capsys.readouterr()
    assert status in {1, 2}
    assert err.startswith("kiteocp: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    for part in parts:
        assert part in err
    return out


def test_simulate_prints_writes_and_draws(tmp_path, capsys, made_up):
    assert main(["simulate", "strong-wind"]) == 0
    directory = tmp_path / "results" / "strong-wind" / "simulate"
    assert sorted(path.name for path in directory.iterdir()) == ["cycle.png", "summary.json", "timeseries.csv"]
    out, err = capsys.readouterr()
    assert "mean power" in out
    assert "results/strong-wind/simulate/cycle.png" in out
    assert err == ""
    assert made_up == [{"gravity": True, "time_step": None}]


def test_simulate_takes_its_options(capsys, made_up):
    words = ["simulate", "strong-wind", "--no-gravity", "--time-step", "0.01", "--set", "kite.mass_kg=20"]
    assert main([*words, "--set", "kite.mass_kg=21", "-o", "out", "--no-plot", "--json"]) == 0
    assert made_up == [{"gravity": False, "time_step": 0.01}]
    printed = json.loads(capsys.readouterr().out)
    with open("out/summary.json") as stream:
        assert printed == json.load(stream)
    assert printed["input"]["kite"]["mass_kg"] == 21.0
    assert sorted(os.listdir("out")) == ["summary.json", "timeseries.csv"]


@pytest.mark.usefixtures("made_up")
def test_solve_then_plot_draws_the_same_picture(capsys):
    assert main(["solve", "strong-wind", "-o", "out", "--format", "png", "--format", "svg"]) == 0
    assert "prescribed" in capsys.readouterr().out
    with open("out/cycle.png", "rb") as stream:
        drawn = stream.read()
    os.remove("out/cycle.png")
    assert main(["plot", "out"]) == 0
    with open("out/cycle.png", "rb") as stream:
        assert stream.read() == drawn
    assert sorted(os.listdir("out")) == [
        "cycle.png", "cycle.svg", "summary.json", "timeseries.csv", "timeseries_prescribed.csv"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (CycleError("transition", "the kite cannot descend", {"elevation_deg": 80.0}), "infeasible"),
        (NoEquilibriumError("the kite is too heavy", {"wind_speed_m_s": 2.0}), "infeasible"),
        (SolveError("three starts failed", {"starts": 3.0}), "failed"),
    ],
)
def test_a_calculation_without_an_answer_is_saved_and_said(capsys, monkeypatch, error, status):
    monkeypatch.setattr(kiteocp.optimum.solve, "solve", raising(error), raising=False)
    code = main(["solve", "strong-wind", "-o", "out"])
    assert code == 1
    one_sentence(capsys, code, "strong-wind", status, error.cause, "out")
    with open("out/summary.json") as stream:
        summary = json.load(stream)
    assert summary["status"] == status
    assert summary["message"] == str(error)
    assert summary["cycle"]["mean_power_W"] is None
    assert os.listdir("out") == ["summary.json"]


def test_a_result_that_is_not_certified_is_saved_drawn_and_exit_status_1(capsys, monkeypatch):
    reached = make_result("solve", status="not_certified", details={"message": "the mesh is too coarse"})
    monkeypatch.setattr(kiteocp.optimum.solve, "solve", lambda _problem, **_options: reached, raising=False)
    code = main(["solve", "strong-wind", "-o", "out"])
    assert code == 1
    one_sentence(capsys, code, "not_certified: the mesh is too coarse")
    assert sorted(os.listdir("out")) == ["cycle.png", "summary.json", "timeseries.csv"]


@pytest.mark.usefixtures("made_up")
def test_a_full_disk_is_one_sentence(capsys, monkeypatch):
    monkeypatch.setattr(writing.os, "replace", raising(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    one_sentence(capsys, main(["simulate", "strong-wind", "-o", "out"]), "No space left on device", "out")
    assert os.listdir("out") == []


@pytest.mark.usefixtures("made_up")
def test_a_file_in_place_of_the_directory_is_one_sentence(capsys):
    with open("out", "w") as stream:
        stream.write("mine")
    one_sentence(capsys, main(["simulate", "strong-wind", "-o", "out"]), "out", "cannot be written")


@pytest.mark.usefixtures("made_up")
def test_a_picture_that_cannot_be_written_does_not_cost_the_numbers(capsys):
    os.makedirs("out/cycle.png")
    code = main(["simulate", "strong-wind", "-o", "out"])
    out = one_sentence(capsys, code, "out/cycle.png: cannot be written")
    assert code == 2
    assert "written: out/summary.json, out/timeseries.csv" in out
    assert {"summary.json", "timeseries.csv"} <= set(os.listdir("out"))


def test_an_interruption_is_one_line_and_status_130(capsys, monkeypatch):
    monkeypatch.setattr(kiteocp.cycle, "simulate", raising(KeyboardInterrupt()))
    assert main(["simulate", "strong-wind", "-o", "out"]) == 130
    assert capsys.readouterr().err == "kiteocp: interrupted; nothing was reached yet, as the summary in out says\n"
    with open("out/summary.json") as stream:
        assert json.load(stream)["status"] == "interrupted"


@pytest.mark.usefixtures("made_up")
def test_an_interruption_that_reached_nothing_keeps_the_earlier_result(capsys, monkeypatch):
    assert main(["simulate", "strong-wind", "-o", "out"]) == 0
    before = sorted(os.listdir("out"))
    monkeypatch.setattr(kiteocp.cycle, "simulate", raising(KeyboardInterrupt()))
    assert main(["simulate", "strong-wind", "-o", "out"]) == 130
    assert "the earlier result in out is kept" in capsys.readouterr().err
    assert sorted(os.listdir("out")) == before


def test_an_internal_error_is_a_sentence_and_with_debug_a_traceback(capsys, monkeypatch):
    monkeypatch.setattr(kiteocp.cycle, "simulate", raising(ZeroDivisionError("a\nb")))
    one_sentence(capsys, main(["simulate", "strong-wind"]), "internal error (ZeroDivisionError: a b)", "--debug")
    with pytest.raises(ZeroDivisionError):
        main(["simulate", "strong-wind", "--debug"])


def test_list_names_every_shipped_problem_with_its_description(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_problems())
    assert all(len(line.split()) > 2 for line in lines)


def test_check_reports_every_problem(capsys):
    assert main(["check", *shipped_problems()]) == 0
    out, err = capsys.readouterr()
    assert out.count(": ok\n") == len(shipped_problems())
    assert "logarithmic wind 9.9 m/s at 6 m; kite 10.2 m2, 15 kg; tether 390 to 720 m; force 749 to 3008 N" in out
    assert err == ""


def test_check_goes_on_after_a_wrong_problem_and_counts_warnings_as_ok(capsys):
    words = ["check", "nowhere.yaml", "strong-wind", "--set", "operation.traction.tether_force_N=4000"]
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert "strong-wind: ok" in out
    assert "warning: " in out
    assert "nowhere.yaml" in err
    assert err.count("\n") == 1


def test_check_of_a_table_of_wind_speeds(capsys):
    words = ["--set", "environment.wind.profile=table", "--set", "environment.wind.heights_m=[0, 200, 1000]"]
    assert main(["check", "strong-wind", *words, "--set", "environment.wind.speeds_m_s=[0, 10, 12]"]) == 0
    assert "table wind; kite" in capsys.readouterr().out


def test_new_writes_a_file_that_checks_and_is_not_overwritten(capsys):
    assert main(["new", "my-kite"]) == 0
    assert capsys.readouterr().out == "written: my-kite.yaml\n"
    assert main(["check", "my-kite.yaml"]) == 0
    capsys.readouterr()
    code = main(["new", "my-kite.yaml"])
    assert code == 2
    one_sentence(capsys, code, "my-kite.yaml: is there already")
    os.mkdir("kites")
    assert main(["new", "other", "-o", "kites"]) == 0
    assert os.listdir("kites") == ["other.yaml"]


@pytest.mark.parametrize("name", ["", "a/b", "../up", " "])
def test_new_refuses_what_is_not_a_name(capsys, name):
    code = main(["new", name])
    assert code == 2
    one_sentence(capsys, code)
    assert os.listdir() == []


def test_schema_is_json(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert "kite" in json.dumps(schema)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ([], ["name a verb", "simulate"]),
        (["sove", "strong-wind"], ["no verb 'sove'", "did you mean 'solve'?"]),
        (["xyzzy"], ["known are list, new"]),
        (["solve"], ["PROBLEM"]),
        (["solve", "strong-wind", "--no-plt"], ["no option '--no-plt'", "did you mean '--no-plot'?"]),
        (["solve", "strong-wind", "--jso=1"], ["did you mean '--json'?"]),
        (["solve", "strong-wind", "--out", "x"], ["did you mean '--output'?"]),
        (["--versoin"], ["did you mean '--version'?"]),
        (["solve", "strong-wind", "moderate-wind"], ["unexpected argument 'moderate-wind'"]),
        (["solve", "strong-wind", "--set"], ["--set"]),
        (["solve", "strong-wind", "--set", "kite.mas_kg=3"], ["kite.mas_kg", "did you mean kite.mass_kg"]),
        (["solve", "strong-wind", "--set", "kite.mass_kg"], ["kite.mass_kg"]),
        (["solve", "strong-wnd"], ["strong-wind"]),
        (["solve", "strong-wind", "--format", "jpg"], ["no picture format 'jpg'", "did you mean 'png'?"]),
        (["simulate", "strong-wind", "--time-step", "0"], ["'0' is not a number above 0"]),
        (["simulate", "strong-wind", "--time-step", "-1"], ["'-1' is not a number above 0"]),
        (["simulate", "strong-wind", "--time-step", "inf"], ["'inf' is not a number above 0"]),
        (["simulate", "strong-wind", "--time-step", "fast"], ["'fast' is not a number above 0"]),
        (["plot", "nowhere"], ["nowhere", "summary.json"]),
        (["check", "."], ["."]),
        (["check"], ["PROBLEM"]),
        (["list", "all"], ["unexpected argument 'all'"]),
    ],
)
def test_every_mistake_is_one_sentence_and_status_2(capsys, words, parts):
    code = main(words)
    assert code == 2
    assert one_sentence(capsys, code, *parts) == ""
    assert os.listdir() == []


@pytest.mark.parametrize("words", [["--help"], ["solve", "--help"], ["simulate", "-h"], ["--debug", "list", "-h"]])
def test_help_is_printed_with_status_0(capsys, words):
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert out.startswith("usage: kiteocp")
    assert err == ""


def test_an_export_to_no_folder_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["solve", "v3-kite", "--export", ""]) == 2
    assert "--export: give the folder to write to" in capsys.readouterr().err
