"""A small result with round numbers, made by hand: for tests of what is done with results, not of physics."""

from __future__ import annotations

from typing import Any

import numpy as np

from kiteocp import Problem, Result, load_problem

PHASES = ("retraction", "transition", "traction")
DURATIONS_S = (60.0, 6.0, 40.0)
MEAN_POWERS_W = (-3000.0, 500.0, 20000.0)
SAMPLES_OF_A_PHASE = 5


def make_channels(power_factor: float = 1.0) -> dict[str, Any]:
    n = SAMPLES_OF_A_PHASE
    start_s = np.concatenate([[0.0], np.cumsum(DURATIONS_S)[:-1]])
    time_s = np.concatenate([s + np.linspace(0.0, d, n) for s, d in zip(start_s, DURATIONS_S, strict=True)])
    length_m = np.concatenate([np.linspace(720, 390, n), np.full(n, 390.0), np.linspace(390, 720, n)])
    elevation_deg = np.concatenate([np.linspace(27, 70, n), np.linspace(70, 27, n), np.full(n, 27.0)])
    # One third cannot be written in a few decimals: the round trip must keep it exactly.
    force_N = np.repeat([749.0, 2000.0 / 3.0, 3008.0], n)
    return {
        # Deliberately not in the order of the contract.
        "power_W": power_factor * np.repeat(MEAN_POWERS_W, n),
        "time_s": time_s,
        "phase": np.repeat(PHASES, n),
        "tether_length_m": length_m,
        "elevation_deg": elevation_deg,
        "azimuth_deg": np.zeros(3 * n),
        "height_m": length_m * np.sin(np.deg2rad(elevation_deg)),
        "reeling_speed_m_s": np.repeat([-5.5, 0.0, 8.25], n),
        "kite_speed_m_s": np.full(3 * n, 20.0),
        "wind_speed_m_s": np.full(3 * n, 18.0),
        "apparent_wind_speed_m_s": np.full(3 * n, 25.0),
        "kinematic_ratio": np.full(3 * n, 3.5),
        "tether_force_kite_N": force_N,
        "tether_force_ground_N": force_N - 35.0,
        "winch_torque_N_m": force_N / 10.0,
    }


def make_result(
    verb: str = "simulate", problem: Problem | None = None, power_factor: float = 1.0, **changes: Any
) -> Result:
    phases = {
        name: {
            "duration_s": duration,
            "mean_power_W": power_factor * power,
            "energy_J": power_factor * power * duration,
            "tether_length_start_m": {"retraction": 720.0}.get(name, 390.0),
            "tether_length_end_m": {"traction": 720.0}.get(name, 390.0),
            "elevation_start_deg": {"transition": 70.0}.get(name, 27.0),
            "elevation_end_deg": {"retraction": 70.0}.get(name, 27.0),
        }
        for name, duration, power in zip(PHASES, DURATIONS_S, MEAN_POWERS_W, strict=True)
    }
    energy_J = sum(phase["energy_J"] for phase in phases.values())
    values: dict[str, Any] = {
        "verb": verb,
        "problem": problem or load_problem("strong-wind"),
        "status": "ok",
        "warnings": ("the kite rises above 500 m",),
        "phases": phases,
        "cycle": {
            "duration_s": 112.0,
            "phase_change_time_total_s": 6.0,
            "mean_power_W": energy_J / 112.0,
            "energy_J": energy_J,
            "mean_harvesting_factor": 0.17,
            "mean_traction_altitude_m": 252.0,
            "wind_speed_at_mean_traction_altitude_m_s": 18.2,
        },
        "channels": make_channels(power_factor),
    }
    return Result(**{**values, **changes})


def make_optimum() -> Result:
    details = {
        "solver": {"status": "Solve_Succeeded", "iterations": 34, "time_s": 0.042, "build_time_s": 1.31, "starts": 1},
        "active_limits": {
            "retraction": [{"limit": "limits.tether_force_min_N", "value": 749.0, "share": 0.93}],
            "transition": [{"limit": "limits.elevation_max_deg", "value": 85.0, "share": 0.0}],
            "traction": [
                {"limit": "limits.tether_force_max_N", "value": 30080.0, "share": 1.0},
                {"limit": "limits.tether_length_max_m", "value": None, "share": None},
            ],
        },
    }
    return make_result("solve", power_factor=1.25, details=details, prescribed=make_result())
