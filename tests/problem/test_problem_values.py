"""Problems as values: defaults, overrides, round trips, identity, shipped names, warnings."""

from __future__ import annotations

import contextlib
import hashlib
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiteocp.errors import CycleError, InputError, NoEquilibriumError
from kiteocp.problem import load_problem, parse_override, problem_from_dict, problem_path, shipped_problems

MINIMAL = {
    "name": "minimal",
    "environment": {"wind": {"profile": "uniform", "reference_speed_m_s": 8}},
    "kite": {
        "projected_area_m2": 10,
        "mass_kg": 15,
        "powered": {"lift_coefficient": 0.8, "lift_to_drag": 4},
        "depowered": {"lift_coefficient": 0.2, "drag_coefficient": 0.1},
    },
    "tether": {"diameter_m": 0.004, "density_kg_m3": 724, "drag_coefficient": 1.1},
    "limits": {"tether_force_max_N": 4000},
}


def test_the_shipped_problems_are_the_papers_cases_a_design_case_and_a_flown_kite() -> None:
    assert list(shipped_problems()) == ["moderate-wind", "strong-wind", "v3-kite", "v9-kite"]
    moderate, strong, v3, v9 = (load_problem(name) for name in shipped_problems())
    # Table of model input parameters of the paper, with the errata of the project's reading of it.
    assert moderate.kite.depowered.lift_coefficient == 0.192
    assert (moderate.kite.projected_area_m2, moderate.kite.mass_kg) == (19.8, 19.6)
    assert strong.operation.traction.tether_force_N == strong.limits.tether_force_max_N == 3008.0
    assert strong.operation.retraction.tether_force_N == strong.limits.tether_force_min_N == 749.0
    assert v3.kite.powered.kite_lift_to_drag == pytest.approx(4.5, rel=1e-15)
    # The kite and its control unit, from the description of the flight.
    assert v9.kite.mass_kg == 62.0 + 31.6
    assert all(problem.warnings() == [] for problem in (moderate, strong, v3, v9))


def test_defaults_are_filled_in() -> None:
    problem = problem_from_dict(MINIMAL)
    assert problem.limits.tether_force_min_N == pytest.approx(120.0)
    assert problem.operation.traction.tether_force_N == 4000.0
    assert problem.operation.retraction.tether_force_N == 1000.0
    assert (problem.limits.tether_length_min_m, problem.limits.tether_length_max_m) == (200.0, 400.0)
    assert problem.limits.generator_power_max_W is None
    assert problem.environment.gravity_m_s2 == 9.81
    assert (problem.optimisation.mesh.degree, problem.optimisation.tolerance) == (5, 1e-8)


def test_derived_defaults_follow_what_they_derive_from() -> None:
    problem = problem_from_dict(MINIMAL)
    changed = problem.with_values({"limits.tether_force_max_N": 8000, "operation.tether_length_max_m": 600})
    assert changed.limits.tether_force_min_N == pytest.approx(240.0)
    assert changed.operation.traction.tether_force_N == 8000.0
    assert changed.limits.tether_length_max_m == 600.0
    # A value that was given stays.
    kept = problem.with_values({"limits.tether_force_min_N": 300}).with_values({"limits.tether_force_max_N": 8000})
    assert kept.limits.tether_force_min_N == 300.0
    # The default of the retraction force stays above the smallest force.
    assert problem.with_values({"limits.tether_force_min_N": 2000}).operation.retraction.tether_force_N == 2000.0


@pytest.mark.parametrize("name", list(shipped_problems()))
def test_a_dumped_problem_loads_again_and_is_equal(name: str) -> None:
    problem = load_problem(name)
    again = problem_from_dict(problem.to_dict(), sha256=problem.sha256)
    assert again == problem
    assert hash(again) == hash(problem)
    assert again.sha256 == problem.sha256
    assert again.with_values({"kite.mass_kg": 1}).sha256 != problem.sha256


def test_problems_survive_a_process_pool() -> None:
    problem = load_problem("v3-kite", {"kite.mass_kg": 20})
    again = pickle.loads(pickle.dumps(problem))
    assert again == problem
    assert again.with_values({}).sha256 == problem.sha256


def test_errors_survive_a_process_pool() -> None:
    for error in (
        InputError("is wrong", file="a.yaml", line=3, key="kite"),
        NoEquilibriumError("the kite is too heavy", {"elevation_deg": 70.0}),
        CycleError("transition", "no lift", {"time_s": 1.0}),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert str(again) == str(error)
        assert again.exit_status == error.exit_status


def test_digest_is_that_of_the_file_and_of_the_values_set() -> None:
    problem = load_problem("strong-wind")
    assert problem.sha256 == hashlib.sha256(shipped_problems()["strong-wind"].read_bytes()).hexdigest()
    one = problem.with_values({"kite.mass_kg": 20, "tether.diameter_m": 0.005})
    other = problem.with_values({"tether.diameter_m": 0.005}).with_values({"kite.mass_kg": 20})
    assert one.sha256 == other.sha256 != problem.sha256


def test_alternative_keys_replace_each_other() -> None:
    problem = load_problem("strong-wind", {"kite.powered.drag_coefficient": 0.2})
    assert "lift_to_drag" not in problem.to_dict()["kite"]["powered"]
    assert problem.kite.powered.kite_lift_to_drag == pytest.approx(0.69 / 0.2)
    back = problem.with_values({"kite.powered.lift_to_drag": 5})
    assert back.kite.powered.kite_drag_coefficient == pytest.approx(0.69 / 5)
    with pytest.raises(InputError, match="gives both"):
        load_problem("strong-wind", {"kite.powered.lift_to_drag": 5, "kite.powered.drag_coefficient": 0.2})


def test_a_new_wind_profile_drops_the_keys_it_does_not_have() -> None:
    values = {"environment.wind.exponent": 0.14, "environment.wind.profile": "power-law"}
    assert load_problem("strong-wind", values).to_dict()["environment"]["wind"] == {
        "profile": "power-law",
        "reference_speed_m_s": 9.9,
        "reference_height_m": 6.0,
        "exponent": 0.14,
    }
    with pytest.raises(InputError, match="belongs where profile is power-law"):
        load_problem("strong-wind", {"environment.wind.exponent": 0.14})


def test_entries_of_lists_and_whole_blocks_can_be_set() -> None:
    table = {"profile": "table", "heights_m": [0, 200, 800], "speeds_m_s": [3, 6, 9]}
    problem = load_problem("strong-wind", {"environment.wind": table, "environment.wind.speeds_m_s[1]": np.int64(7)})
    assert problem.to_dict()["environment"]["wind"]["speeds_m_s"] == (3.0, 7.0, 9.0)
    again = problem.with_values({"environment.wind.speeds_m_s": np.array([4.0, 5.0, 6.0])})
    assert again.to_dict()["environment"]["wind"]["speeds_m_s"] == (4.0, 5.0, 6.0)
    with pytest.raises(InputError, match="has 3 entries"):
        problem.with_values({"environment.wind.speeds_m_s[3]": 1})


def test_values_that_are_no_file_are_refused_like_a_file() -> None:
    for content in ({**MINIMAL, 1: 2}, {**MINIMAL, "kite": []}, {**MINIMAL, "name": object()}, [], {}):
        with pytest.raises(InputError, match=r"^my design: "):
            problem_from_dict(content, "my design")  # type: ignore[arg-type]
    assert problem_from_dict(MINIMAL).sha256 != problem_from_dict({**MINIMAL, "name": "other"}).sha256


def test_none_takes_a_key_out_and_an_override_mends_a_file(tmp_path: Path) -> None:
    restored = load_problem("strong-wind", {"limits.tether_force_min_N": None})
    assert restored.limits.tether_force_min_N == pytest.approx(0.03 * 3008)
    path = tmp_path / "light.yaml"
    path.write_text(shipped_problems()["strong-wind"].read_text().replace("mass_kg: 15.0", "mass_kg: -1"))
    assert load_problem(path, {"kite.mass_kg": 15}).kite.mass_kg == 15.0


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("kite.mas_kg", "did you mean kite.mass_kg"),
        ("mass_kg", "did you mean kite.mass_kg"),
        ("kite.mass_g", "give it in kg, as mass_kg"),
        ("kit.mass_kg", "did you mean kite.mass_kg"),
        ("kite.mass_kg[0]", "is not a list"),
        ("nonsense", "`kiteocp new NAME`"),
    ],
)
def test_unknown_key_path_names_the_nearest(key: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        load_problem("strong-wind", {key: 1})
    assert expected in str(caught.value)
    assert str(caught.value).startswith("strong-wind: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("kite.mass_kg=2e1", ("kite.mass_kg", 20.0)),
        ("operation.force_reference = ground", ("operation.force_reference", "ground")),
        ("environment.wind.heights_m=[0, 1e2]", ("environment.wind.heights_m", [0, 100.0])),
        ("description=a=b", ("description", "a=b")),
        ("limits.stroke_min_m=null", ("limits.stroke_min_m", None)),
    ],
)
def test_override_texts(text: str, expected: tuple[str, object]) -> None:
    assert parse_override(text) == expected


@pytest.mark.parametrize("text", ["kite.mass_kg", "=3", "kite.mass_kg=", "kite.mass_kg= ", "a=[", ""])
def test_override_texts_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match=r"^--set "):
        parse_override(text)


@given(st.text(max_size=40) | st.text(max_size=20).map("kite.mass_kg={}".format))
def test_any_text_is_an_override_or_an_input_error(text: str) -> None:
    # Anything but an InputError fails.
    with contextlib.suppress(InputError):
        key, value = parse_override(text)
        load_problem("strong-wind", {key: value})


def test_problem_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "strong-wind").write_text("")
    (tmp_path / "mine.yaml").write_text("")
    assert problem_path("strong-wind") == shipped_problems()["strong-wind"]
    assert problem_path("./strong-wind") == Path("strong-wind")
    assert problem_path("mine.yaml") == Path("mine.yaml")
    with pytest.raises(InputError, match=r"write \./mine\.yaml"):
        problem_path("mine")
    with pytest.raises(InputError, match="did you mean strong-wind"):
        problem_path("strongwind")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"limits.tether_force_max_N": 2000}, "operation.traction.tether_force_N (3008) is above limits"),
        ({"operation.retraction.tether_force_N": 700}, "(700) is below limits.tether_force_min_N (749)"),
        ({"limits.tether_length_min_m": 400}, "operation.tether_length_min_m (390) is below"),
        ({"limits.tether_length_max_m": 700}, "operation.tether_length_max_m (720) is above"),
        ({"operation.traction.elevation_deg": 65}, "elevation_deg (65) is above limits.traction_elevation_max_deg"),
        ({"operation.traction.elevation_deg": 10}, "elevation_deg (10) is below limits.traction_elevation_min_deg"),
        ({"limits.height_max_m": 300}, "is above limits.height_max_m (300)"),
        ({"limits.height_min_m": 200}, "is below limits.height_min_m (200)"),
        ({"limits.height_max_m": 600}, "logarithmic wind profile no longer holds"),
        ({"tether.breaking_force_N": 3000}, "where the tether breaks"),
    ],
)
def test_warnings_say_what_lies_outside(values: dict[str, object], expected: str) -> None:
    warnings = load_problem("strong-wind", values).warnings()
    assert any(expected in warning for warning in warnings)
    assert all("\n" not in warning for warning in warnings)
