"""States that do not exist: which, and why, in one sentence; and what a caller may ask for."""

from __future__ import annotations

import pickle
from typing import Any

import pytest

import kiteocp
from kiteocp.errors import InputError, NoEquilibriumError
from kiteocp.physics.flight import flight_state

#: Reason, what the sentence says about it, the state.
MISSING = [
    ("force_below_sag", "20 N is less than the sag", {"tether_force_kite_N": 20.0, "elevation_deg": 20.0}),
    ("slack", "with 40 N the tether is slack", {"tether_force_kite_N": 40.0, "elevation_deg": 70.0}),
    (
        "slack",
        "at a reeling speed of 2.9 m/s the tether is slack",
        {"reeling_speed_m_s": 2.9, "elevation_deg": 80.0, "course_deg": 0.0},
    ),
    ("reeling_too_fast", "reels out at 25 m/s, but the wind blows only at", {"reeling_speed_m_s": 25.0}),
    ("reeling_too_fast", "along the tether", {"reeling_factor": 1.01}),
    (
        "crosswind",
        "stronger than the apparent wind that the force allows",
        {"tether_force_ground_N": 300.0, "elevation_deg": 80.0, "course_deg": 90.0},
    ),
    ("too_heavy", "too heavy", {"tether_force_kite_N": 80.0, "elevation_deg": 20.0, "setting": "depowered"}),
    ("too_heavy", "too heavy", {"reeling_speed_m_s": 14.0, "elevation_deg": 30.0}),
    ("falling", "pulls the kite down", {"tether_force_kite_N": 80.0, "elevation_deg": 10.0, "course_deg": 0.0}),
]


@pytest.mark.parametrize(("reason", "says", "state"), MISSING)
def test_every_reason(problem: kiteocp.Problem, reason: str, says: str, state: dict[str, Any]) -> None:
    asked = {"tether_length_m": 700.0, "elevation_deg": 40.0} | state
    with pytest.raises(NoEquilibriumError) as caught:
        flight_state(problem, **asked)
    message = str(caught.value)
    assert caught.value.reason == reason
    assert says in message
    # Which state: its place is in the sentence, and with all numbers among the facts.
    assert f"at 700 m of tether, {asked['elevation_deg']:.3g} deg elevation" in message
    assert "\n" not in message
    facts = caught.value.facts
    assert facts["tether_length_m"] == 700.0
    assert facts["elevation_deg"] == asked["elevation_deg"]
    [control] = [name for name in asked if name.startswith(("tether_force", "reeling"))]
    assert control in facts
    restored = pickle.loads(pickle.dumps(caught.value))
    assert (str(restored), restored.reason, restored.facts) == (message, reason, facts)


def test_nothing_appears_on_the_terminal(problem: kiteocp.Problem, capfd: pytest.CaptureFixture[str]) -> None:
    for _, _, state in MISSING:
        with pytest.raises(NoEquilibriumError):
            flight_state(problem, **({"tether_length_m": 700.0, "elevation_deg": 40.0} | state))
    assert capfd.readouterr() == ("", "")


def test_a_state_beside_the_fold_is_found(problem: kiteocp.Problem) -> None:
    """Reeling out faster, two roots of a climbing kite meet; the solver finds the state to the last 0.1 mm/s."""

    def exists(speed: float) -> bool:
        try:
            flight_state(problem, tether_length_m=500, elevation_deg=30, reeling_speed_m_s=speed)
        except NoEquilibriumError:
            return False
        return True

    low, high = 5.0, 14.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if exists(middle) else (low, middle)
    # At the fold the residual touches zero: just below it the angle moves with the square root of the gap, four times
    # which moves it twice as far. 0.1 mm/s missed, and the next term of the expansion, make up to 0.25 of that.
    near, nearer = (
        flight_state(problem, tether_length_m=500, elevation_deg=30, reeling_speed_m_s=low - gap)["inflow_angle_rad"]
        for gap in (4e-3, 1e-3)
    )
    last = flight_state(problem, tether_length_m=500, elevation_deg=30, reeling_speed_m_s=low)["inflow_angle_rad"]
    assert (near - last) / (nearer - last) == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize("controls", [{}, {"reeling_factor": 0.1, "tether_force_kite_N": 1000.0}])
def test_exactly_one_control(problem: kiteocp.Problem, controls: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"exactly one of .*; {len(controls)} were given"):
        flight_state(problem, tether_length_m=400, elevation_deg=30, **controls)
