"""``kiteocp estimate`` as a user runs it: tables, files, picture, the estimated kite flown again, and mistakes."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from made_flight import TRUTH, kitepower_rows, made_flight, write_csv

import kiteocp
from kiteocp.cli.main import main
from kiteocp.result import load_result
from kiteocp.studies.estimation.synthetic import Noise

NOISE = Noise(speed_m_s=0.2, force_share=0.03, airspeed_m_s=0.4, wind_share=0.1, wrong_share=0.02)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rows = kitepower_rows(made_flight(cycles=2, noise=NOISE, seed=5, sample_rate_Hz=5.0))
    # A value that is not there is an empty cell.
    rows = [{name: "" if str(value) == "nan" else value for name, value in row.items()} for row in rows]
    return write_csv(tmp_path_factory.mktemp("flight") / "made.csv", rows)


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_tables_files_and_the_estimated_kite(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["estimate", str(recording), "--system", "v9-kite"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for text in ("wind by airspeed: 10.", "by the equilibrium alone:", "bias of the paper's formulas", "not used:"):
        assert text in out
    directory = Path("results/v9-kite/estimate")
    names = ["estimate.png", "estimated.yaml", "summary.json", "timeseries.csv"]
    assert sorted(path.name for path in directory.iterdir()) == names
    summary = json.loads((directory / "summary.json").read_text())
    assert (summary["verb"], summary["status"], summary["problem"]) == ("estimate", "ok", "v9-kite")
    estimates = summary["estimates"]
    settings = estimates["fit"]["settings"]
    for setting in ("powered", "depowered"):
        for name, tolerance in (("lift_coefficient", 0.03), ("drag_coefficient", 0.06)):
            found = settings[setting][name]
            assert found["value"] == pytest.approx(TRUTH[f"kite.{setting}.{name}"], rel=tolerance)
            assert found["interval"][0] < found["value"] < found["interval"][1]
            # The error of the wind comes on top of that of the fit.
            assert found["interval_with_wind_error"][0] < found["interval"][0]
            assert found["interval_with_wind_error"][1] > found["interval"][1]
    assert estimates["wind"]["scale"] == pytest.approx(10.2 / 9.0, rel=0.03)
    traction = estimates["phases"]["traction"]
    assert set(traction) == {"paper", "exact"}
    exact = traction["exact"]
    assert exact["lift_coefficient"]["mean"] == pytest.approx(0.8, rel=0.03)
    assert exact["lift_coefficient"]["effective_samples"] < exact["used"] <= exact["samples"]
    assert exact["samples"] == exact["used"] + sum(exact["rejected"].values())
    _check_time_series(directory / "timeseries.csv", estimates["samples"])

    estimated = kiteocp.load_problem(directory / "estimated.yaml")
    assert estimated.kite.powered.lift_coefficient == pytest.approx(
        settings["powered"]["lift_coefficient"]["value"], 1e-4
    )
    true = kiteocp.simulate(kiteocp.load_problem("v9-kite", TRUTH)).cycle["mean_power_W"]
    assert kiteocp.simulate(estimated).cycle["mean_power_W"] == pytest.approx(true, rel=0.06)
    assert load_result(directory).details["estimates"] == estimates


def _check_time_series(path: Path, samples: int) -> None:
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == samples
    row = next(row for row in rows if row["phase"] == "traction" and row["exact_lift_coefficient"])
    power = float(row["tether_force_ground_N"]) * float(row["reeling_speed_m_s"])
    assert float(row["power_W"]) == pytest.approx(power)
    assert {"kinematic_ratio", "paper_lift_to_drag", "exact_resultant_coefficient", "height_m"} <= row.keys()
    assert any(not row["exact_lift_coefficient"] for row in rows)


@pytest.mark.parametrize(
    ("words", "source"),
    [
        (["--wind", "ground", "--ground-height", "10"], "ground"),
        (["--wind", "fit", "--cycles", "1"], "fit"),
        (["--wind", "problem", "--set", "environment.wind.reference_speed_m_s=10.2"], "problem"),
        (["--wind", "airspeed", "--trust-airspeed", "--cycles", "0-1"], "airspeed"),
    ],
)
def test_where_the_wind_comes_from(
    recording: Path, words: list[str], source: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(recording), "--system", "v9-kite", "--no-plot", "--json", "-o", "out", *words]) == 0
    estimates: dict[str, Any] = json.loads(capsys.readouterr().out)["estimates"]
    assert estimates["wind"]["source"] == source
    assert estimates["wind"]["reference_speed_m_s"] == pytest.approx(10.2, rel=0.06)
    assert estimates["fit"]["settings"]["powered"]["lift_coefficient"]["value"] == pytest.approx(0.8, rel=0.06)
    assert estimates["cycles"] == ([1] if "1" in words else [0, 1])
    assert not Path("out/estimate.png").exists()


def test_plot_draws_the_estimate_again(recording: Path) -> None:
    assert main(["estimate", str(recording), "--system", "v9-kite", "--no-plot", "-o", "out"]) == 0
    assert main(["plot", "out", "--format", "svg"]) == 0
    assert Path("out/estimate.svg").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["absent.csv", "--system", "v9-kite"], "absent.csv: there is no such file"),
        (["{recording}"], "--system"),
        (["{recording}", "--system", "v8-kite"], "v9-kite"),
        (["{recording}", "--system", "v9-kite", "--cycles", "7"], "has no cycle 7; it has 0, 1"),
        (["{recording}", "--system", "v9-kite", "--cycles", "one"], "'one' is no list of cycle numbers"),
        (["{recording}", "--system", "v9-kite", "--wind", "tower"], "invalid choice: 'tower'"),
        (["{recording}", "--system", "v9-kite", "--columns", "nowhere.yaml"], "nowhere.yaml"),
        (["{recording}", "--system", "v9-kite", "--set", "kite.projected_area_m2=0.5"], "kite.projected_area_m2"),
        (["{recording}", "--system", "v9-kite", "--set", "kite.mas_kg=1"], "did you mean kite.mass_kg"),
    ],
)
def test_mistakes_are_one_sentence(
    recording: Path, words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", *(word.format(recording=recording) for word in words)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("kiteocp: ")
    assert err.count("\n") == 1
    assert expected in err
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("column", "change", "expected"),
    [
        ("ground_tether_force", lambda row: row.pop("ground_tether_force"), "has no column ground_tether_force"),
        ("flight_phase", lambda row: row.update(flight_phase="pp-ri"), "no sample of the traction"),
        ("ground_tether_force", lambda row: row.update(ground_tether_force=1e4), "C_R"),
    ],
)
def test_bad_recordings_are_one_sentence(
    tmp_path: Path, column: str, change: Any, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = kitepower_rows(made_flight(cycles=1, sample_rate_Hz=2.0))
    for row in rows:
        change(row)
    path = write_csv(tmp_path / "bad.csv", rows)
    words = ["--columns", "kitepower"] if "no column" in expected else []
    assert main(["estimate", str(path), "--system", "v9-kite", *words]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert expected in err, column


def test_empty_files_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, content in (("empty.csv", b""), ("binary.csv", b"\xff\xfe\x00\x01" * 50)):
        (tmp_path / name).write_bytes(content)
        assert main(["estimate", name, "--system", "v9-kite"]) == 2
        assert capsys.readouterr().err.count("\n") == 1
