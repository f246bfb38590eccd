"""Prescribed cycles that cannot be flown, and cycles flown beyond the validity of model or machine."""

from __future__ import annotations

from typing import Any

import pytest
from conftest import Simulated

import kiteocp
from kiteocp.errors import CycleError

UNIFORM = {"profile": "uniform", "reference_speed_m_s": 18.0}

#: Phase that fails, reason, what the sentence says, changes to the strong-wind problem.
IMPOSSIBLE: list[tuple[str, str, str, dict[str, Any]]] = [
    ("retraction", "force_below_sag", "less than the sag", {"operation.retraction.tether_force_N": 15.0}),
    ("retraction", "slack", "slack at the ground", {"operation.retraction.tether_force_N": 40.0}),
    ("retraction", "too_heavy", "too heavy", {"operation.retraction.tether_force_N": 70.0}),
    ("transition", "falling", "pulls the kite down", {"kite.mass_kg": 150.0}),
    (
        "transition", "domain", "the retraction ends at 72.6 deg, not above",
        {"operation.retraction.tether_force_N": 500.0, "operation.traction.elevation_deg": 75.0},
    ),
    ("traction", "force_too_high", "cannot hold 2e+04 N", {"operation.traction.tether_force_N": 20000.0}),
    (
        "traction", "endless", "does not end",
        {"operation.traction.tether_force_N": 10000.0, "environment.wind": UNIFORM},
    ),
    (
        "traction", "domain", "beyond the 720 m where traction ends",
        {"operation.retraction.tether_force_N": 1500.0, "operation.tether_length_min_m": 650.0,
         "environment.wind.reference_speed_m_s": 13.5},
    ),
]  # fmt: skip


@pytest.mark.parametrize(("phase", "reason", "says", "changes"), IMPOSSIBLE)
def test_impossible_cycles(
    problem: kiteocp.Problem, phase: str, reason: str, says: str, changes: dict[str, Any]
) -> None:
    other = problem.with_values({"limits.tether_force_min_N": 5.0, "limits.tether_force_max_N": 30000.0, **changes})
    with pytest.raises(CycleError) as caught:
        kiteocp.simulate(other)
    error, message = caught.value, str(caught.value)
    assert (error.phase, error.reason) == (phase, reason)
    assert message.startswith(f"the prescribed cycle cannot be flown, its {phase} ends ")
    assert says in message
    assert "\n" not in message
    assert {"tether_length_m", "elevation_deg"} <= error.facts.keys()


def test_rootfinder_and_finite_differences_find_the_same_reason(problem: kiteocp.Problem) -> None:
    other = problem.with_values({"limits.tether_force_min_N": 5.0, "operation.retraction.tether_force_N": 40.0})
    for options in ({"equilibrium": "rootfinder"}, {"time_step": 0.01}):
        with pytest.raises(CycleError) as caught:
            kiteocp.simulate(other, **options)
        assert caught.value.reason == "slack"


def test_cycles_outside_validity_are_flown_and_say_so(simulated: Simulated, problem: kiteocp.Problem) -> None:
    assert simulated("v3-kite").warnings == ()
    # The paper holds 750 N at the kite; the limit counts at the ground, where the weight of the tether is missing.
    (warning,) = simulated("strong-wind").warnings
    assert warning.startswith("the prescribed cycle is outside limits.tether_force_min_N (749 N): it needs a minimum")
    high = simulated("strong-wind", gravity=False).warnings
    assert any("logarithmic wind profile is meant for heights up to 500 m" in sentence for sentence in high)
    assert any("outside limits.height_max_m (500 m)" in sentence for sentence in high)
    fast = kiteocp.simulate(problem.with_values({"limits.reel_in_speed_max_m_s": 5.0})).warnings
    assert any("outside limits.reel_in_speed_max_m_s (5 m/s): it needs a reel-in speed of up to" in s for s in fast)
    steep = simulated("moderate-wind").warnings
    assert any("limits.elevation_max_deg (85 deg): it needs a highest elevation of 90.7 deg" in s for s in steep)
    assert any("outside limits.tether_length_min_m (234 m): it needs a shortest tether of 229" in s for s in steep)
    weak = kiteocp.simulate(problem.with_values({"limits.generator_power_max_W": 1e4, "limits.height_min_m": 200.0}))
    assert any("limits.generator_power_max_W (10000 W): it needs a generator power" in s for s in weak.warnings)
    # Said once: what the problem alone tells is not told again of the flight.
    assert len([text for text in weak.warnings if "limits.height_min_m (200" in text]) == 1
    thick = kiteocp.simulate(problem.with_values({"tether.diameter_m": 0.009})).warnings
    assert any("the tether weighs up to" in sentence for sentence in thick)
    wind = {"profile": "table", "heights_m": [5.0, 100.0, 510.0], "speeds_m_s": [9.0, 15.0, 18.0]}
    table = kiteocp.simulate(problem.with_values({"environment.wind": wind}), gravity=False).warnings
    assert any("beyond the wind table (5 to 510 m)" in sentence for sentence in table)
