"""The optimal cycle of the shipped problems: certified, within limits, re-simulated, and no better on a finer mesh."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import kiteocp
from kiteocp.errors import InfeasibleError
from kiteocp.optimum.solve import solve

SHIPPED = ("strong-wind", "moderate-wind", "v3-kite")


@lru_cache
def solved(name: str) -> kiteocp.Result:
    """Cold, as a user solves it, with the full certificate."""
    return solve(kiteocp.load_problem(name))


def mesh(intervals: tuple[int, int, int], degree: int = 3) -> dict[str, Any]:
    names = ("retraction_intervals", "transition_intervals", "traction_intervals")
    return {"optimisation.mesh": {**dict(zip(names, intervals, strict=True)), "degree": degree}}


@pytest.mark.parametrize("name", SHIPPED)
def test_solved_cold_and_certified(name: str) -> None:
    result = solved(name)
    assert result.succeeded
    assert result.status == "certified"
    assert result.details["certificate"]["failures"] == []
    assert result.details["solver"]["status"] == "Solve_Succeeded"


@pytest.mark.parametrize("name", SHIPPED)
def test_resimulation_gives_the_same_energy(name: str) -> None:
    """The issue asks for 1e-3. On the certified mesh the schedules' polynomials leave some 2e-4."""
    facts = solved(name).details["resimulation"]
    assert facts["completed"]
    assert abs(facts["energy_gap"]) < 5e-4
    assert facts["energy_J"] == pytest.approx(solved(name).cycle["energy_J"], rel=1e-3)
    assert abs(facts["tether_length_gap_m"]) < 0.5
    assert abs(facts["elevation_gap_deg"]) < 0.05


def test_resimulation_gap_vanishes_with_the_mesh() -> None:
    """It is the mesh that leaves it: six times the intervals, a fifth of the gap or less."""
    problem = kiteocp.load_problem("strong-wind")
    coarse, fine = (
        abs(solve(problem.with_values(mesh(m)), certificate="quick").details["resimulation"]["energy_gap"])
        for m in ((2, 2, 1), (12, 12, 4))
    )
    assert fine < 0.2 * coarse
    # A fifth of what the certificate allows; what is left comes from a kink of the force inside an interval.
    assert fine < 2e-4


@pytest.mark.parametrize("name", SHIPPED)
def test_better_than_the_prescribed_cycle_on_equal_terms(name: str) -> None:
    """Both means count the same phase-change time. (The moderate prescribed cycle flies beyond elevation_max_deg.)"""
    result = solved(name)
    assert result.prescribed is not None
    assert result.prescribed.cycle["phase_change_time_total_s"] == 6.0
    assert result.cycle["phase_change_time_total_s"] == 6.0
    assert result.cycle["mean_power_W"] > result.prescribed.cycle["mean_power_W"]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_start_leads_to_the_same_optimum(name: str) -> None:
    """Long strokes and short cycles start on either side of it; 1e-7 is ten times the tolerance of IPOPT."""
    starts = solved(name).details["starts"]
    assert len(starts) >= 2
    powers = [start["mean_power_W"] for start in starts]
    assert powers == pytest.approx([powers[0]] * len(powers), rel=1e-7)


@pytest.mark.parametrize("name", SHIPPED)
def test_power_does_not_depend_on_the_mesh(name: str) -> None:
    """Twice the intervals in all phases change the power of a moderate mesh by less than 1e-4."""
    problem = kiteocp.load_problem(name)
    powers = [
        solve(problem.with_values(mesh(m)), certificate="quick").cycle["mean_power_W"] for m in ((4, 4, 2), (8, 8, 4))
    ]
    assert powers[0] == pytest.approx(powers[1], rel=1e-4)
    assert solved(name).cycle["mean_power_W"] == pytest.approx(powers[1], rel=1e-4)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_cycle_is_periodic(name: str) -> None:
    """Where a phase ends the next one begins, to the tolerance of the solver in its scaled units."""
    phases = list(solved(name).phases.values())
    for before, after in zip(phases, [*phases[1:], phases[0]], strict=True):
        assert before["tether_length_end_m"] == pytest.approx(after["tether_length_start_m"], abs=1e-4)
        assert before["elevation_end_deg"] == pytest.approx(after["elevation_start_deg"], abs=1e-4)


@pytest.mark.parametrize("name", SHIPPED)
def test_limits_hold_between_the_points_of_the_mesh(name: str) -> None:
    """At all samples of the time series, within the 0.5 % that the certificate allows."""
    result, limits = solved(name), kiteocp.load_problem(name).limits
    bounds: list[tuple[str, float, float]] = [
        ("tether_force_kite_N", 0.0, limits.tether_force_max_N),
        ("tether_force_ground_N", limits.tether_force_min_N, np.inf),
        ("reeling_speed_m_s", -limits.reel_in_speed_max_m_s, limits.reel_out_speed_max_m_s),
        ("height_m", limits.height_min_m, limits.height_max_m),
        ("tether_length_m", limits.tether_length_min_m, limits.tether_length_max_m),
        ("elevation_deg", 0.0, limits.elevation_max_deg),
    ]
    for channel, lower, upper in bounds:
        values = result[channel]
        assert values.min() >= lower - 5e-3 * abs(lower), channel
        assert values.max() <= upper * (1 + 5e-3), channel
    low, high = limits.traction_elevation_min_deg, limits.traction_elevation_max_deg
    traction = result.channel("elevation_deg", "traction")
    assert low - 1e-4 <= traction.min() <= traction.max() <= high + 1e-4
    assert result.phases["traction"]["duration_s"] >= limits.traction_duration_min_s - 1e-4


@pytest.mark.parametrize("name", SHIPPED)
def test_active_limits_are_those_that_the_time_series_touches(name: str) -> None:
    result = solved(name)
    limits = kiteocp.load_problem(name).limits
    active = result.details["active_limits"]
    listed = {phase: {entry["limit"]: entry for entry in entries} for phase, entries in active.items()}
    # All three ride the upper force all through the traction, which ends at the longest tether.
    assert listed["traction"]["limits.tether_force_max_N"]["share"] == pytest.approx(1.0, abs=0.01)
    assert "limits.tether_length_max_m" in listed["traction"]
    assert listed["retraction"]["limits.tether_force_min_N"]["value"] == limits.tether_force_min_N
    for phase, entries in listed.items():
        force = result.channel("tether_force_kite_N", phase)
        touched = bool(np.any(force > 0.998 * limits.tether_force_max_N))
        assert ("limits.tether_force_max_N" in entries) == touched
        assert all(0 < entry["share"] <= 1 for entry in entries.values())
    # What acts for a while comes before what is touched at an end.
    shares = [entry["share"] for entry in active["retraction"]]
    assert shares == sorted(shares, key=lambda share: -round(share, 3))


def test_relaxing_an_active_limit_helps_and_an_inactive_one_does_not() -> None:
    """More force pays (it is at its limit all through the traction); more height does not (it is not reached)."""
    problem = kiteocp.load_problem("strong-wind")
    given = solve(problem, certificate="quick").cycle["mean_power_W"]

    def power(**changes: float) -> float:
        values = {f"limits.{key}": value for key, value in changes.items()}
        return float(solve(problem.with_values(values), certificate="quick").cycle["mean_power_W"])  # type: ignore[arg-type]

    assert power(tether_force_max_N=3050.0) > given * 1.005
    assert power(height_max_m=600.0) == pytest.approx(given, rel=1e-6)
    assert power(reel_in_speed_max_m_s=8.0) < given


def test_force_limits_act_where_the_file_says() -> None:
    """`limits.tether_force_max_at: ground` allows more force at the kite, and so more power, by up to 1 %."""
    problem = kiteocp.load_problem("strong-wind")
    result = solve(problem.with_values({"limits.tether_force_max_at": "ground"}), certificate="quick")
    assert result["tether_force_ground_N"].max() == pytest.approx(3008.0, rel=5e-3)
    assert result["tether_force_kite_N"].max() > 3008.0 * 1.002
    gain = result.cycle["mean_power_W"] / solve(problem, certificate="quick").cycle["mean_power_W"] - 1
    assert 0 < gain < 0.02


def test_an_infeasible_problem_is_said_to_be() -> None:
    """A retraction force that this reel-in speed cannot hold."""
    changes = {"limits.tether_force_min_N": 3007.0, "limits.reel_in_speed_max_m_s": 0.1}
    problem = kiteocp.load_problem("strong-wind").with_values(changes)
    with pytest.raises(InfeasibleError) as caught:
        solve(problem, certificate="quick")
    assert str(caught.value).startswith("no cycle found")
    assert "3007 N" in str(caught.value)
    assert "\n" not in str(caught.value)
