"""Choices of the ``optimisation`` block: more freedom never loses, and what changes nothing changes nothing.

On a mesh on which the re-simulation agrees; a larger set of cycles contains the smaller one, up to 1e-5 for the
polynomials of the mesh, which differ from mode to mode.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import kiteocp
from kiteocp.optimum.solve import solve

MESH = {"retraction_intervals": 4, "transition_intervals": 4, "traction_intervals": 2, "degree": 3}

#: A rate that the linear schedules of the optima do not exceed: `free` is limited by it, `linear` is not.
RATE_DEG_S = 0.6


@lru_cache
def solved(name: str, elevation: str = "constant", setting: str = "fixed", rate: float = RATE_DEG_S) -> kiteocp.Result:
    changes: dict[str, Any] = {
        "optimisation.traction_elevation": elevation,
        "optimisation.power_setting": setting,
        "optimisation.mesh": MESH,
        "limits.traction_elevation_rate_max_deg_s": rate,
    }
    return solve(kiteocp.load_problem(name, changes), certificate="quick")


def power(*choices: Any) -> float:
    return float(solved(*choices).cycle["mean_power_W"])  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "v3-kite"])
def test_more_freedom_of_the_elevation_never_loses(name: str) -> None:
    constant, linear, free = (power(name, mode) for mode in ("constant", "linear", "free"))
    assert linear >= constant * (1 - 1e-5)
    assert free >= linear * (1 - 1e-5)
    # The course that holds the elevation is one that may be chosen.
    assert power(name, "course-coupled") >= constant * (1 - 1e-5)


def test_elevation_schedules_are_what_they_say() -> None:
    name = "moderate-wind"
    constant, linear, free = (solved(name, mode) for mode in ("constant", "linear", "free"))
    assert np.ptp(constant.channel("elevation_deg", "traction")) < 1e-9
    time, elevation = (linear.channel(channel, "traction") for channel in ("time_s", "elevation_deg"))
    slopes = np.diff(elevation) / np.diff(time)
    assert slopes == pytest.approx(np.full(slopes.size, slopes[0]), abs=1e-6)
    assert 0.01 < slopes[0] < RATE_DEG_S
    time, elevation = (free.channel(channel, "traction") for channel in ("time_s", "elevation_deg"))
    # Between the points of the mesh the rate is a polynomial, which may pass its limit a little.
    assert np.abs(np.diff(elevation) / np.diff(time)).max() < RATE_DEG_S * 1.3


def test_a_faster_elevation_pays() -> None:
    """Only the mean flight state is resolved: moving the elevation costs nothing, and so its rate pays."""
    powers = [power("strong-wind", "constant"), *(power("strong-wind", "free", "fixed", rate) for rate in (0.1, 0.3))]
    assert powers[0] < powers[1] < powers[2]


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "v3-kite"])
def test_a_free_power_setting_in_traction_never_loses(name: str) -> None:
    """In these winds full power is best throughout: the freedom is found to be worth nothing, not less."""
    assert power(name, "constant", "traction") >= power(name) * (1 - 1e-5)


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "v3-kite"])
def test_a_free_power_setting_in_all_phases_never_loses(name: str) -> None:
    assert power(name, "constant", "all") >= power(name) * (1 - 1e-5)


def test_electrical_power_without_losses_is_mechanical_power() -> None:
    problem = kiteocp.load_problem("strong-wind", {"optimisation.mesh": MESH})
    electrical = problem.with_values({"optimisation.objective": "electrical"})
    result = solve(electrical, certificate="quick")
    assert result.cycle["mean_power_W"] == pytest.approx(power("strong-wind"), rel=1e-9)
    # With losses the cycle is another: the mechanical power of it is less than the best mechanical power.
    lossy = electrical.with_values({"machine.generator_efficiency": 0.9, "machine.motor_efficiency": 0.8})
    other = solve(lossy, certificate="quick")
    assert other.cycle["mean_power_W"] < result.cycle["mean_power_W"]
    best = max(start["mean_power_W"] for start in other.details["starts"] if start["mean_power_W"] is not None)
    # What was maximised is what the result has by name and prints, beside the mechanical power.
    assert other.details["objective"] == "electrical"
    assert other.cycle["mean_electrical_power_W"] == pytest.approx(best, rel=1e-9)
    assert f"mean electrical cycle power {best / 1e3:.2f} kW" in str(other)
    # By hand, on the time series of this cycle and on that of the mechanical optimum: the first is the better.
    assert best == pytest.approx(electrical_power(other), rel=1e-3)
    assert electrical_power(other) > electrical_power(result)
    for phase in other.phases.values():
        factor = 0.9 if phase["mean_power_W"] > 0 else 1 / 0.8
        # Within a phase the power hardly changes its sign.
        assert phase["mean_electrical_power_W"] == pytest.approx(factor * phase["mean_power_W"], rel=2e-3)


def test_every_route_to_the_electrical_power_agrees() -> None:
    """The program's quadrature, the independent integration of it, trapezoids on what is written, and `simulate`."""
    lossy = {"machine.generator_efficiency": 0.85, "machine.motor_efficiency": 0.7}
    problem = kiteocp.load_problem("strong-wind", {"optimisation.objective": "electrical", **lossy})
    result = solve(problem)
    assert result.status == "certified"
    flown = result.details["resimulation"]
    assert flown["electrical_energy_J"] == pytest.approx(result.cycle["electrical_energy_J"], rel=1e-3)
    assert abs(flown["electrical_energy_gap"]) < 1e-3
    cycle = kiteocp.simulate(problem)
    time, power = cycle.channel("time_s"), cycle.channel("electrical_power_W")
    assert cycle.cycle["electrical_energy_J"] == pytest.approx(float(np.trapezoid(power, time)), rel=1e-4)
    assert cycle.cycle["mean_electrical_power_W"] < cycle.cycle["mean_power_W"]


def electrical_power(result: kiteocp.Result) -> float:
    """Mean of 0.9 of the generated and 1 / 0.8 of the consumed power, by trapezoids within each phase."""
    energy = 0.0
    for phase in result.phases:
        mechanical = result.channel("power_W", phase)
        flow = np.where(mechanical > 0, 0.9 * mechanical, mechanical / 0.8)
        energy += float(np.trapezoid(flow, result.channel("time_s", phase)))
    return energy / float(result.cycle["duration_s"])  # type: ignore[arg-type]
