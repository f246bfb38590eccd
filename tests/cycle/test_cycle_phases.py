"""What the prescribed cycle does in each phase, on the time series that a user gets."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Simulated
from numpy.testing import assert_allclose

import kiteocp

SHIPPED = ("strong-wind", "moderate-wind", "v3-kite")


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("reference", ["kite", "ground"])
def test_held_forces(problem: kiteocp.Problem, reference: str, gravity: bool) -> None:
    """Retraction and traction hold their force where `operation.force_reference` says; power is that at the ground."""
    result = kiteocp.simulate(problem.with_values({"operation.force_reference": reference}), gravity=gravity)
    for phase, force in (("retraction", 749.0), ("traction", 3008.0)):
        assert_allclose(result.channel(f"tether_force_{reference}_N", phase), force, rtol=1e-9)
        other = "ground" if reference == "kite" else "kite"
        elsewhere = result.channel(f"tether_force_{other}_N", phase)
        if gravity:
            # The tether hangs on the kite.
            assert np.all((elsewhere < force) if other == "ground" else (elsewhere > force))
        else:
            assert_allclose(elsewhere, force, rtol=1e-9)
    assert_allclose(result["power_W"], result["tether_force_ground_N"] * result["reeling_speed_m_s"], rtol=1e-12)


def test_retraction_and_traction_fly_as_prescribed(simulated: Simulated) -> None:
    result = simulated("strong-wind")
    assert np.all(np.diff(result.channel("elevation_deg", "retraction")) > 0)
    assert np.all(result.channel("azimuth_deg", "retraction") == 0)
    assert_allclose(result.channel("elevation_deg", "traction"), 27.0, rtol=1e-12)
    assert np.all(result.channel("azimuth_deg", "traction") == 10.5)
    assert np.all(np.diff(result.channel("elevation_deg", "transition")) < 0)


@pytest.mark.parametrize("name", SHIPPED)
def test_massless_retraction_starts_by_reeling_out(simulated: Simulated, name: str) -> None:
    """Depowered and low in the wind the massless kite pulls harder than the set force (paper, section 3)."""
    speed = simulated(name, gravity=False).channel("reeling_speed_m_s", "retraction")
    assert speed[0] > 0
    assert speed[-1] < 0


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("name", SHIPPED)
def test_transition_reels_only_to_keep_the_force_within_limits(simulated: Simulated, name: str, gravity: bool) -> None:
    """At rest between the two forces, at the upper one reeling out, at the lower one reeling in."""
    result = simulated(name, gravity)
    operation = kiteocp.load_problem(name).operation
    low, high = operation.retraction.tether_force_N, operation.traction.tether_force_N
    force, speed = (result.channel(name, "transition") for name in ("tether_force_kite_N", "reeling_speed_m_s"))
    rest = np.abs(speed) < 1e-9
    assert_allclose(force[speed > 1e-9], high, rtol=1e-9)
    assert_allclose(force[speed < -1e-9], low, rtol=1e-9)
    assert np.all((force[rest] >= low * (1 - 1e-9)) & (force[rest] <= high * (1 + 1e-9)))
    length = result.channel("tether_length_m", "transition")
    still = rest[:-1] & rest[1:]
    # Samples between steps of the integrator are interpolated by cubics, good to 1e-3 of the step's change.
    assert np.abs(np.diff(length))[still].max(initial=0) < 0.05


def test_transition_flies_all_three_branches(simulated: Simulated) -> None:
    """The moderate case without weight is slack at first, then rests, then reels out."""
    speed = simulated("moderate-wind", gravity=False).channel("reeling_speed_m_s", "transition")
    signs = np.sign(np.where(np.abs(speed) < 1e-9, 0, speed))
    assert list(dict.fromkeys(signs)) == [-1, 0, 1]
    assert np.all(np.diff(signs) >= 0)


@pytest.mark.parametrize("gravity", [True, False])
def test_beyond_the_zenith_the_kite_is_slack_and_reeled_in(simulated: Simulated, gravity: bool) -> None:
    """At an elevation above 90 deg there is no equilibrium at zero reeling speed; r falls below r_min."""
    result = simulated("moderate-wind", gravity)
    behind = result.channel("elevation_deg", "transition") > 90
    assert behind.any()
    assert_allclose(result.channel("tether_force_kite_N", "transition")[behind], 750.0, rtol=1e-9)
    assert np.all(result.channel("reeling_speed_m_s", "transition")[behind] < 0)
    assert result["tether_length_m"].min() < 234 - 1


@pytest.mark.parametrize("scale_height", [8550.0, 1e9])
def test_massless_traction_in_closed_form(problem: kiteocp.Problem, scale_height: float) -> None:
    """Uniform wind and a tether without drag: dr/dt = v_w (b - k exp(r sin(beta) / 2 H)), which integrates.

    From eq:reeloutfactor_fixedforce with the density of eq:airdensity; k belongs to the density at the ground.
    """
    wind, beta, phi = 14.0, math.radians(27), math.radians(10.5)
    other = problem.with_values(
        {
            "environment.wind": {"profile": "uniform", "reference_speed_m_s": wind},
            "environment.air.density_scale_height_m": scale_height,
            "tether.drag_coefficient": 0.0,
        }
    )
    result = kiteocp.simulate(other, gravity=False)
    traction = result.phases["traction"]
    pressure_area = 0.5 * 1.225 * wind**2 * problem.kite.projected_area_m2
    c_r = 0.69 * math.sqrt(1 + 1 / 16)
    k = math.sqrt(3008 / (pressure_area * c_r * 17))
    b, c = math.cos(beta) * math.cos(phi), math.sin(beta) / (2 * scale_height)

    def time(r: float) -> float:
        return (r - math.log(b - k * math.exp(c * r)) / c) / (wind * b)

    start, end = traction["tether_length_start_m"], 720.0
    # With a scale height of 1e9 m the two terms of the formula cancel to eight digits; the speed is constant then.
    exact = time(end) - time(start) if scale_height < 1e6 else (end - start) / (wind * (b - k))
    assert traction["duration_s"] == pytest.approx(exact, rel=2e-6)
    assert traction["energy_J"] == pytest.approx(3008 * (end - start), rel=1e-9)


def test_cycle_numbers(simulated: Simulated) -> None:
    """eq:pc_P_general, eq:meanharvestfact, eq:meantractionaltitude with the wind there (18.2 m/s in the paper)."""
    result = simulated("strong-wind")
    cycle, phases = result.cycle, result.phases.values()
    assert cycle["duration_s"] == pytest.approx(sum(p["duration_s"] for p in phases), rel=1e-12)
    weighted = sum(p["mean_power_W"] * p["duration_s"] for p in phases)
    assert cycle["mean_power_W"] == pytest.approx(weighted / cycle["duration_s"], rel=1e-12)
    z = 0.5 * math.sin(math.radians(27)) * (390 + 720)
    assert cycle["mean_traction_altitude_m"] == pytest.approx(z, rel=1e-12)
    v_w = 9.9 * math.log(z / 0.07) / math.log(6 / 0.07)
    assert cycle["wind_speed_at_mean_traction_altitude_m_s"] == pytest.approx(v_w, rel=1e-12)
    wind_power = 0.5 * 1.225 * math.exp(-z / 8550) * v_w**3
    assert cycle["mean_harvesting_factor"] == pytest.approx(cycle["mean_power_W"] / wind_power / 10.2, rel=1e-12)
    assert cycle["phase_change_time_total_s"] == 0


def test_phase_change_time_counts_in_the_means(problem: kiteocp.Problem, simulated: Simulated) -> None:
    plain, paused = simulated("strong-wind"), kiteocp.simulate(problem, phase_change_time_s=2.0)
    assert paused.cycle["energy_J"] == plain.cycle["energy_J"]
    assert paused.cycle["duration_s"] == pytest.approx(plain.cycle["duration_s"] + 6, rel=1e-12)
    assert paused.cycle["mean_power_W"] == pytest.approx(plain.cycle["energy_J"] / paused.cycle["duration_s"])
    assert paused["time_s"][-1] == pytest.approx(plain["time_s"][-1] + 4, rel=1e-12)
