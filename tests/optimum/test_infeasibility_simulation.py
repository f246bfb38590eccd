"""Prescribed cycles that cannot be flown, and what would make them fly."""

from __future__ import annotations

import json

import pytest

from kiteocp import load_problem
from kiteocp.cycle.remedies import ACCURACY, explain_simulation
from kiteocp.cycle.simulation import simulate
from kiteocp.errors import CycleError
from kiteocp.report.words import listed, rounded

WIND = "environment.wind.reference_speed_m_s"


@pytest.mark.parametrize(
    ("changes", "first"),
    [
        ({WIND: 5.0}, "environment.wind"),
        ({"operation.traction.elevation_deg": 70.0}, "operation.traction.elevation_deg"),
        ({"operation.traction.tether_force_N": 20000.0}, "operation.traction.tether_force_N"),
        ({"operation.retraction.tether_force_N": 200.0}, "operation.retraction.tether_force_N"),
    ],
)
def test_the_number_to_blame_is_found_and_the_cycle_then_flies(changes: dict[str, float], first: str) -> None:
    problem = load_problem("strong-wind").with_values(changes)
    with pytest.raises(CycleError) as caught:
        simulate(problem)
    found = explain_simulation(problem, caught.value)
    assert found.sentence.startswith(str(caught.value))
    assert first in {remedy.key for remedy in found.remedies}
    for remedy in found.remedies:
        key = WIND if remedy.key == "environment.wind" else remedy.key
        assert simulate(problem.with_values({key: remedy.needed})).status == "ok"
        # It is the nearest such number: a little nearer, by twice the accuracy of the search, the cycle fails.
        nearer = remedy.needed * (1 - 2 * ACCURACY if remedy.needed > remedy.value else 1 + 2 * ACCURACY)
        with pytest.raises(CycleError):
            simulate(problem.with_values({key: nearer}))
    changes_found = [abs(remedy.relative_change) for remedy in found.remedies]
    assert changes_found == sorted(changes_found)


def test_the_sentence_has_the_numbers_rounded_to_the_safe_side() -> None:
    problem = load_problem("strong-wind").with_values({WIND: 5.0})
    with pytest.raises(CycleError) as caught:
        simulate(problem)
    found = explain_simulation(problem, caught.value)
    wind, force = found.remedies
    assert f"{rounded(wind.needed, up=True)} m/s of wind at 6 m" in found.sentence
    assert f"a traction force of {rounded(force.needed, up=False)} N" in found.sentence
    assert json.loads(json.dumps(found.to_dict()))["remedies"][0]["key"] == "environment.wind"


def test_a_table_of_wind_scales_as_a_whole() -> None:
    problem = load_problem("v3-kite").with_values(
        {
            "environment.wind.profile": "table",
            "environment.wind.heights_m": [0.0, 100.0, 600.0],
            "environment.wind.speeds_m_s": [1.0, 4.0, 5.0],
        }
    )
    with pytest.raises(CycleError) as caught:
        simulate(problem)
    (wind,) = [r for r in explain_simulation(problem, caught.value).remedies if r.key == "environment.wind"]
    assert wind.value == 5.0
    speeds = [speed * wind.needed / wind.value for speed in (1.0, 4.0, 5.0)]
    assert simulate(problem.with_values({"environment.wind.speeds_m_s": speeds})).status == "ok"


@pytest.mark.parametrize(
    ("number", "up", "text"),
    [(4.4141, True, "4.42"), (4.4141, False, "4.41"), (443.2, False, "443"), (16900.1, True, "17000"), (0.0, True, "0"),
     (60.0, True, "60"), (60.0, False, "60"), (0.45847, False, "0.458")],
)  # fmt: skip
def test_rounding_keeps_to_its_side(number: float, up: bool, text: str) -> None:
    assert rounded(number, up=up) == text


def test_lists_read_as_a_sentence() -> None:
    assert listed([], "or") == ""
    assert listed(["a"], "or") == "a"
    assert listed(["a", "b"], "and") == "a and b"
    assert listed(["a", "b", "c"], "or") == "a, b, or c"
