"""Every mistake a problem file can hold is one sentence with its line, key, value and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from kiteocp.errors import InputError
from kiteocp.problem import load_problem, problem_from_dict, shipped_problems

STRONG = shipped_problems()["strong-wind"].read_text()
WIND = "wind: {profile: logarithmic, reference_speed_m_s: 9.9, reference_height_m: 6.0, roughness_length_m: 0.07}"
MAX = "tether_force_max_N: 3008.0"


def message(tmp_path: Path, old: str, new: str) -> str:
    """Return the message for the strong-wind file with one text replaced, its file and line cut off."""
    assert STRONG.count(old) == 1
    path = tmp_path / "case.yaml"
    path.write_text(STRONG.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_problem(path)
    text = str(caught.value)
    assert "\n" not in text
    assert caught.value.line is not None
    place, _, rest = text.partition(": ")
    assert place == f"{path}:{caught.value.line}"
    assert caught.value.key is not None
    return rest


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("mass_kg: 15.0", "mas_kg: 15.0", "kite.mas_kg is not a known key; did you mean kite.mass_kg?"),
        ("limits:", "limit:", "limit is not a known key; did you mean limits?"),
        ("mass_kg: 15.0", "mass_g: 15000", "give it in kg, as mass_kg"),
        ("mass_kg: 15.0", "mass: 15", "give it in kg, as mass_kg"),
        ("elevation_deg: 27.0", "elevation_rad: 0.47", "give it in deg, as elevation_deg"),
        ("diameter_m: 0.004", "diameter_mm: 4", "give it in m, as diameter_m"),
        (MAX, f"{MAX}\n  generator_power_max_kW: 20", "give it in W, as generator_power_max_W"),
        ("name: strong-wind", "name: x\nmass_kg: 3", "mass_kg is not a known key; it belongs to kite.mass_kg"),
        (
            "profile: logarithmic",
            "profile: power-law",
            "roughness_length_m is not a known key; it belongs where profile",
        ),
        ("name: strong-wind", "name: x\n1: 2", "1 is not a known key; the file has the keys name,"),
    ],
)
def test_unknown_key_names_what_was_meant(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in message(tmp_path, old, new)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("  mass_kg: 15.0", "", "kite.mass_kg is missing; give a number in kg"),
        (MAX, "", "limits.tether_force_max_N is missing"),
        ("profile: logarithmic, ", "", "environment.wind.profile is missing; give one of logarithmic,"),
        ("mass_kg: 15.0", "mass_kg:", "kite.mass_kg is empty; expected a number in kg"),
        ("mass_kg: 15.0", "mass_kg: true", "kite.mass_kg is the truth value true; expected a number in kg"),
        ("mass_kg: 15.0", "mass_kg: [15]", "kite.mass_kg is a list; expected a number in kg"),
        ("mass_kg: 15.0", "mass_kg: '15'", "kite.mass_kg is the text '15'; give a bare number in kg without quotes"),
        (MAX, "tether_force_max_N: 3 kN", "is the text '3 kN'; give a bare number in N without text"),
        (MAX, f"{MAX}\n  stroke_min_m: none", "give a bare number in m without text, or null for no limit"),
        (MAX, f"{MAX}\n  tether_length_min_m:", "is empty; give a bare number in m or leave the key out"),
        ("name: strong-wind", "name: 12", "name is the number 12; expected a text"),
        ("name: strong-wind", "name: ../up", "as it becomes a directory name"),
        ("name: strong-wind", "name: x\nmachine: 3", "machine is the number 3; expected a block with"),
        ("force_reference: kite", "force_reference: grund", "did you mean ground?"),
        ("profile: logarithmic", "profile: log", "did you mean logarithmic?"),
        ("name: strong-wind", "name: x\noptimisation: {mesh: {degree: 2.5}}", "degree is 2.5; expected a whole number"),
    ],
)
def test_missing_keys_and_wrong_types(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in message(tmp_path, old, new)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("mass_kg: 15.0", "mass_kg: -15", "kite.mass_kg is -15 kg; it must be greater than 0 kg"),
        ("mass_kg: 15.0", "mass_kg: .nan", "kite.mass_kg is nan; give a finite number in kg"),
        ("mass_kg: 15.0", "mass_kg: 1e999", "kite.mass_kg is inf"),
        ("mass_kg: 15.0", "mass_kg: " + "9" * 400, "kite.mass_kg is inf"),
        ("mass_kg: 15.0", "mass_kg: " + "9" * 5000, "kite.mass_kg is inf"),
        ("elevation_deg: 27.0", "elevation_deg: 90", "elevation_deg is 90 deg; it must be less than 90 deg"),
        ("elevation_deg: 27.0", "elevation_deg: 0", "elevation_deg is 0 deg; it must be greater than 0 deg"),
        ("lift_to_drag: 4.0", "lift_to_drag: 0", "kite.powered.lift_to_drag is 0; it must be greater than 0"),
        ("name: strong-wind", "name: x\nmachine: {motor_efficiency: 90}", "is 90; it must be at most 1"),
        ("name: strong-wind", "name: x\noptimisation: {mesh: {degree: 0}}", "degree is 0; it must be at least 1"),
        ("roughness_length_m: 0.07", "roughness_length_m: 6", "not less than the reference height (6 m)"),
        ("lift_to_drag: 4.0", "lift_to_drag: 4.0, drag_coefficient: 0.2", "gives both lift_to_drag 4 and drag_coef"),
        (", lift_to_drag: 4.0", "", "gives neither lift_to_drag nor drag_coefficient"),
    ],
)
def test_values_out_of_range(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in message(tmp_path, old, new)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("_min_m: 390.0", "_min_m: 720", "operation.tether_length_min_m (720) is not less than"),
        ("tether_force_N: 749.0", "tether_force_N: 3008", "operation.retraction.tether_force_N (3008) is not less"),
        ("  tether_force_min_N: 749.0", "  tether_force_min_N: 3009", "limits.tether_force_min_N (3009) is greater"),
        (MAX, f"{MAX}\n  tether_length_min_m: 720", "limits.tether_length_min_m (720) is not less than limits."),
        (MAX, f"{MAX}\n  height_min_m: 501", "(501) is greater than limits.height_max_m (500, its default)"),
        (MAX, f"{MAX}\n  traction_elevation_max_deg: 19", "limits.traction_elevation_max_deg (19)"),
        (MAX, f"{MAX}\n  elevation_max_deg: 15", "is greater than limits.elevation_max_deg (15)"),
        (MAX, f"{MAX}\n  stroke_min_m: 331", "leave only 330 m"),
        # 400 m sin(60 deg) = 346.4 m is the highest a kite gets in traction.
        (MAX, f"{MAX}\n  tether_length_max_m: 400\n  height_min_m: 347", "reaches only 346.41 m"),
        # 390 m sin(20 deg) = 133.4 m is the lowest.
        (MAX, f"{MAX}\n  height_max_m: 133", "is already at 133.39 m"),
    ],
)
def test_contradictions_between_keys(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in message(tmp_path, old, new)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("heights_m: [0, 499], speeds_m_s: [3, 5]", "covers 0 to 499 m, but the kite flies between 50 and 500 m"),
        ("heights_m: [51, 600], speeds_m_s: [3, 5]", "covers 51 to 600 m"),
        ("heights_m: [0, 600], speeds_m_s: [3, 5, 6]", "2 heights_m and 3 speeds_m_s"),
        ("heights_m: [0, 9, 9, 600], speeds_m_s: [3, 4, 5, 6]", "heights_m[2] is 9 m after 9 m"),
        ("heights_m: [0, 600], speeds_m_s: [3, -5]", "speeds_m_s[1] is -5 m/s; it must be at least 0 m/s"),
        ("heights_m: [0, 600], speeds_m_s: [3, x]", "speeds_m_s[1] is the text 'x'"),
        ("heights_m: [0, 600], speeds_m_s: [0, 0]", "a kite needs wind"),
        ("heights_m: [600], speeds_m_s: [5]", "too few entries (1); give at least 2"),
        ("heights_m: 5, speeds_m_s: [3]", "expected a list of numbers in m"),
    ],
)
def test_wind_table(tmp_path: Path, table: str, expected: str) -> None:
    assert expected in message(tmp_path, WIND, f"wind: {{profile: table, {table}}}")


def test_wind_table_that_covers_the_flight_altitude_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(STRONG.replace(WIND, "wind: {profile: table, heights_m: [50, 500], speeds_m_s: [3, 5]}"))
    assert load_problem(path).to_dict()["environment"]["wind"]["speeds_m_s"] == (3.0, 5.0)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (
            "kite.mas_kg: {standard_deviation: 1}",
            "kite.mas_kg is not the key of a number in this problem; did you mean",
        ),
        ("kite.mass_kg: {standard_deviation: -1}", "standard_deviation is -1; it must be greater than 0"),
        ("kite.mass_kg: {sd: 1}", "uncertainty.kite.mass_kg.sd is not a known key; uncertainty has the keys"),
        ("kite.mass_kg: {}", "uncertainty.kite.mass_kg gives nothing; give exactly one of standard_deviation,"),
        ("kite.mass_kg: 3", "uncertainty.kite.mass_kg is the number 3; expected a block"),
        ("kite.mass_kg: {range: [16, 17]}", "does not contain the value of kite.mass_kg (15)"),
        ("kite.mass_kg: {range: [17, 14]}", "range is [17, 14]; give the lowest and the highest value"),
        ("kite.mass_kg: {range: [14]}", "range has too few entries (1); give at least 2"),
        (
            "kite.mass_kg: {range: [14, 16], standard_deviation: 1}",
            "gives standard_deviation and range; give exactly one",
        ),
        ("3: {standard_deviation: 1}", "uncertainty holds the number 3 as a key; give key paths"),
    ],
)
def test_uncertainties_that_make_no_sense(tmp_path: Path, block: str, expected: str) -> None:
    assert expected in message(tmp_path, "limits:", f"uncertainty:\n  {block}\nlimits:")


def test_a_number_that_is_replaced_takes_its_uncertainty_along() -> None:
    stated = {
        "uncertainty.environment.wind.roughness_length_m": {"standard_deviation": 0.01},
        "uncertainty.kite.powered.lift_to_drag": {"standard_deviation": 0.5},
        "uncertainty.kite.mass_kg": {"standard_deviation": 0.5},
    }
    problem = load_problem("strong-wind", stated)
    changed = problem.with_values({"environment.wind.profile": "uniform", "kite.powered.drag_coefficient": 0.2})
    assert list(changed.uncertainty) == ["kite.mass_kg"]
    assert set(problem.uncertainty) == {key.removeprefix("uncertainty.") for key in stated}
    # What is stated for a key that is not there is a mistake all the same.
    with pytest.raises(InputError, match=r"roughness_length_m is not the key of a number"):
        changed.with_values({"uncertainty.environment.wind.roughness_length_m": {"standard_deviation": 0.01}})


def test_an_uncertainty_is_one_standard_deviation_or_a_range() -> None:
    stated = {
        "uncertainty.kite.mass_kg": {"standard_deviation": 0.5},
        "uncertainty.kite.projected_area_m2": {"relative_standard_deviation": 0.1},
        "uncertainty.tether.drag_coefficient": {"range": [1.0, 1.3]},
    }
    problem = load_problem("strong-wind", stated)
    assert problem.uncertainty["kite.mass_kg"].bounds(15.0) == (14.5, 15.5)
    assert problem.uncertainty["kite.projected_area_m2"].bounds(10.2) == pytest.approx((9.18, 11.22))
    assert problem.uncertainty["tether.drag_coefficient"].bounds(1.1) == (1.0, 1.3)
    # A uniform distribution of width 0.3.
    assert problem.uncertainty["tether.drag_coefficient"].deviation(1.1) == pytest.approx(0.3 / 12**0.5)
    assert problem_from_dict(problem.to_dict()) == problem
    assert problem.with_values(dict.fromkeys(stated)) == load_problem("strong-wind")
