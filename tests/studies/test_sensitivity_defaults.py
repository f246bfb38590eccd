"""A derivative along a key that others follow by default says so, and what it is alone."""

from __future__ import annotations

from typing import Any

import pytest

from kiteocp.problem import Problem, problem_from_dict
from kiteocp.studies.sensitivity.local import sensitivities

FORCE, LEAST = "limits.tether_force_max_N", "limits.tether_force_min_N"


def a_kite(wind_speed_m_s: float, **limits: float) -> Problem:
    """Make a kite whose smallest force is 3 % of the largest, unless it is given."""
    wind = {"profile": "logarithmic", "reference_speed_m_s": wind_speed_m_s, "reference_height_m": 100.0}
    return problem_from_dict(
        {
            "name": "a-kite",
            "environment": {"wind": wind | {"roughness_length_m": 0.03}},
            "kite": {
                "projected_area_m2": 20.0,
                "mass_kg": 23.0,
                "powered": {"lift_coefficient": 0.9, "lift_to_drag": 4.5},
                "depowered": {"lift_coefficient": 0.2, "lift_to_drag": 2.0},
            },
            "tether": {"diameter_m": 0.004, "density_kg_m3": 724.0, "drag_coefficient": 1.1},
            "operation": {"tether_length_min_m": 200.0, "tether_length_max_m": 400.0},
            "limits": {"tether_force_max_N": 5000.0, **limits},
        }
    )


def price(problem: Problem, key: str) -> dict[str, Any]:
    details = sensitivities(problem, intervals=False).details
    [row] = [row for row in details["sensitivities"] if row["key"] == key]
    found = {"row": row, "price": next(p for p in details["shadow_prices"] if p["key"] == key)}
    return found


@pytest.mark.parametrize("wind_speed_m_s", [5.0, 8.0])
def test_the_derivative_alone_is_that_of_the_file_that_gives_the_default_as_a_number(wind_speed_m_s: float) -> None:
    mixed = price(a_kite(wind_speed_m_s), FORCE)
    given = price(a_kite(wind_speed_m_s, tether_force_min_N=150.0), LEAST)
    assert mixed["row"]["followed_by"] == [LEAST]
    # The default is 3 % of the largest force.
    total = mixed["row"]["derivative_alone"] + 0.03 * given["row"]["derivative"]
    assert mixed["row"]["derivative"] == pytest.approx(total, rel=1e-6, abs=1e-9)
    assert f"as {LEAST} follows it by default; with that held, it" in mixed["price"]["text"]


def test_a_file_that_gives_every_number_has_nothing_to_add() -> None:
    problem = a_kite(8.0, tether_force_min_N=150.0)
    result = sensitivities(problem, intervals=False)
    [row] = [row for row in result.details["sensitivities"] if row["key"] == FORCE]
    assert row["derivative_alone"] == pytest.approx(row["derivative"])
    assert not any("by default" in price["text"] for price in result.details["shadow_prices"])
