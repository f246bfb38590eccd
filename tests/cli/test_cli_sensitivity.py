"""``kiteocp sensitivity`` as a user runs it: table, files, pictures, variations, and mistakes."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from kiteocp.cli.main import main
from kiteocp.result import load_result


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_derivatives_intervals_and_pictures(capsys: pytest.CaptureFixture[str]) -> None:
    wind = "uncertainty.environment.wind.reference_speed_m_s={standard_deviation: 0.5}"
    drag = "uncertainty.tether.drag_coefficient={range: [1.0, 1.3]}"
    assert main(["sensitivity", "strong-wind", "--set", wind, "--set", drag]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for text in ("1 kN more tether force is worth", "without influence:", "warning: more kite.mass_kg raises"):
        assert text in out
    (directory,) = Path("results/strong-wind").iterdir()
    assert directory.name.startswith("sensitivity-")
    assert sorted(path.name for path in directory.iterdir()) == ["sensitivity.png", "summary.json"]
    summary = json.loads((directory / "summary.json").read_text())
    assert (summary["verb"], summary["status"]) == ("sensitivity", "certified")
    rows = {row["key"]: row for row in summary["sensitivities"]}
    power = summary["optimal_mean_power_W"]
    assert power == pytest.approx(summary["cycle"]["mean_power_W"], rel=1e-6)
    force = rows["limits.tether_force_max_N"]
    assert force["unit"] == "N"
    assert force["valid_from"] < force["value"] < force["valid_to"]
    assert force["elasticity"] == pytest.approx(force["derivative"] * force["value"] / power)
    assert force["derivative_below"] == force["derivative_above"] == force["derivative"]
    assert force["change_at_to_W"] == pytest.approx(0.01 * force["value"] * force["derivative"])
    # Re-solved, the change by 1 % differs by the curvature only.
    expected = force["change_at_to_W"] + 0.5 * force["second_derivative"] * (0.01 * force["value"]) ** 2
    assert force["resolved_change_at_to_W"] == pytest.approx(expected, rel=1e-3)
    assert rows["environment.wind.reference_speed_m_s"]["uncertainty_to"] == pytest.approx(10.4)
    assert rows["tether.drag_coefficient"]["uncertainty_from"] == 1.0
    silent = rows["limits.reel_in_speed_max_m_s"]
    assert silent["derivative"] == 0.0
    assert silent["valid_to"] is None
    assert set(force["schedule"]["traction"]) >= {"duration_s", "tether_length_end_m", "elevation_end_deg"}
    prices = {price["key"]: price for price in summary["shadow_prices"]}
    assert prices["limits.tether_force_max_N"]["phases"]["traction"] > 0.0
    for key, price in prices.items():
        assert sum(price["phases"].values()) == pytest.approx(rows[key]["derivative"], rel=1e-5)
    assert load_result(directory).details["sensitivities"] == summary["sensitivities"]


def test_vary_draws_the_curve_beside_its_tangent(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sensitivity", "strong-wind", "--no-intervals", "--vary", "kite.mass_kg=14:16:5", "-o", "out"]
    assert main(words) == 0
    assert "along kite.mass_kg:" in capsys.readouterr().out
    names = ["sensitivity.png", "summary.json", "variation.csv", "variation.png"]
    assert sorted(path.name for path in Path("out").iterdir()) == names
    points = json.loads(Path("out/summary.json").read_text())["variation"]["points"]
    assert [point["value"] for point in points] == [14.0, 14.5, 15.0, 15.5, 16.0]
    assert {point["status"] for point in points} == {"certified"}
    # The curve touches its tangent at the value of the file; 1 kg away it leaves it by some 0.3 W (second derivative).
    for point, tolerance in zip(points, (1.0, 0.3, 0.02, 0.3, 1.0), strict=True):
        assert point["mean_power_W"] == pytest.approx(point["tangent_W"], abs=tolerance)
    with open("out/variation.csv", newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [float(row["kite.mass_kg"]) for row in table] == [14.0, 14.5, 15.0, 15.5, 16.0]
    assert float(table[0]["traction:limits.tether_force_max_N"]) > 0.9


def test_a_table_has_the_same_columns_whatever_the_limits_met(capsys: pytest.CaptureFixture[str]) -> None:
    headers = []
    for values in ("kite.mass_kg=14,15", "environment.wind.reference_speed_m_s=7,12.5"):
        assert main(["sensitivity", "strong-wind", "--no-intervals", "--no-plot", "--vary", values, "-o", "out"]) == 0
        with open("out/variation.csv", newline="") as stream:
            headers.append(next(csv.reader(stream))[1:])
        points = json.loads(Path("out/summary.json").read_text())["variation"]["points"]
        assert [point["value"] for point in points] == [float(value) for value in values.split("=")[1].split(",")]
    first, second = headers
    assert first == second
    assert "retraction:limits.stroke_min_m" in first
    # Where a force is kept is a word, which cannot be active.
    assert not [name for name in first if name.endswith("_at")]


def test_values_without_a_cycle_are_points_too() -> None:
    words = ["sensitivity", "strong-wind", "--no-intervals", "--no-plot", "-o", "out"]
    assert main([*words, "--vary", "environment.wind.reference_speed_m_s=3:9.9:2"]) == 0
    low, high = json.loads(Path("out/summary.json").read_text())["variation"]["points"]
    assert low["status"] == "infeasible"
    assert low["mean_power_W"] is None
    assert high["status"] == "certified"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--vary", "kite.mass_kg"], "expected key=from:to:count"),
        (["--vary", "kite.mass_kg=10:20"], "expected key=from:to:count"),
        (["--vary", "kite.mass_kg=10:10:5"], "expected key=from:to:count"),
        (["--vary", "kite.mass_kg=10,x"], "expected key=from:to:count or key=value,value"),
        (["--vary", "kite.mass_kg=10,10"], "2 to 1000 different values"),
        (["--global", "--samples", "9" * 20], "is not a whole number above 0, 10000000 at most"),
        (["--vary", "kite.mas_kg=10:20:5"], "kite.mas_kg is not a known key; did you mean"),
        (["--vary", "kite.mass_kg=-1:20:5"], "kite.mass_kg is -1 kg; it must be greater than 0"),
        (["--vary", "optimisation.tolerance=1e-9:1e-8:2"], "is not a number that the optimum depends on"),
        (["--set", "uncertainty.kite.mas_kg={standard_deviation: 1}"], "did you mean kite.mass_kg"),
        (["--set", "uncertainty.kite.mass_kg={range: [16, 17]}"], "does not contain the value"),
    ],
)
def test_mistakes_are_one_sentence(capsys: pytest.CaptureFixture[str], words: list[str], expected: str) -> None:
    assert main(["sensitivity", "strong-wind", *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("kiteocp: ")
    assert err.count("\n") == 1
    assert expected in err
    assert not Path("results").exists()


def test_no_cycle_is_an_answer(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sensitivity", "strong-wind", "--set", "environment.wind.reference_speed_m_s=2"]) == 1
    out, err = capsys.readouterr()
    assert "infeasible" in out
    assert "no cycle found" in err
    directory = Path("results/strong-wind/sensitivity-reference_speed_m_s=2")
    assert json.loads((directory / "summary.json").read_text())["status"] == "infeasible"


def test_plot_draws_a_saved_study_again(tmp_path: Path) -> None:
    first = tmp_path / "first"
    assert main(["sensitivity", "v3-kite", "--no-intervals", "--no-plot", "-o", str(first)]) == 0
    assert main(["plot", str(first), "--format", "svg"]) == 0
    assert (first / "sensitivity.svg").stat().st_size > 10_000
