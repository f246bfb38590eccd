"""Flights for tests: of a known system, and as a recording in the layout of the shipped column map."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import kiteocp
from kiteocp.recording import FlightData
from kiteocp.studies.estimation.synthetic import Noise, flight_of_result

#: What the flown system is, where it is not the shipped v9-kite: nobody who estimates it is told.
TRUTH = {
    "environment.wind.reference_speed_m_s": 10.2,
    "kite.powered.lift_coefficient": 0.8,
    "kite.powered.drag_coefficient": 0.17,
    "kite.depowered.lift_coefficient": 0.3,
    "kite.depowered.drag_coefficient": 0.12,
}

#: Field data beside the checkout, or where the variable says; tests that need them are skipped without.
DATA = Path(os.environ.get("KITEOCP_FLIGHT_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
RECORDING = DATA / "kitepower-2023-05-12" / "cycles-0-3.csv"

LABELS = {"retraction": "pp-ri", "transition": "pp-riro", "traction": "pp-ro", "turn": "pp-rori", "": "none"}


@cache
def true_result() -> kiteocp.Result:
    return kiteocp.simulate(kiteocp.load_problem("v9-kite", TRUTH))


def made_flight(cycles: int = 2, noise: Noise | None = None, **options: Any) -> FlightData:
    """A flight of the true system."""
    extra = {} if noise is None else {"noise": noise}
    return flight_of_result(true_result(), cycles=cycles, **extra, **options)


def kitepower_rows(flight: FlightData) -> list[dict[str, Any]]:
    """A flight as rows in the layout of the shipped map, north being 30 deg off the wind."""
    beta, phi = np.radians(flight.elevation_deg), np.radians(flight.azimuth_deg)
    bearing0 = np.radians(flight.downwind_bearing_deg)
    bearing = bearing0 - phi
    across, up = flight.distance_m * np.cos(beta), flight.distance_m * np.sin(beta)
    radial, polar, azimuthal = flight.radial_speed_m_s, flight.polar_speed_m_s, flight.azimuthal_speed_m_s
    outwards = radial * np.cos(beta) + polar * np.sin(beta)
    downwind = outwards * np.cos(phi) - azimuthal * np.sin(phi)
    left = outwards * np.sin(phi) + azimuthal * np.cos(phi)
    columns = {
        "time": 1.6e9 + flight.time_s,
        "cycle": flight.cycle,
        "flight_phase": [LABELS[phase] for phase in flight.phase.tolist()],
        "kite_pos_east": across * np.sin(bearing),
        "kite_pos_north": across * np.cos(bearing),
        "kite_height": up,
        "kite_azimuth": -phi,
        "kite_0_vx": downwind * np.cos(bearing0) + left * np.sin(bearing0),
        "kite_0_vy": downwind * np.sin(bearing0) - left * np.cos(bearing0),
        "kite_0_vz": polar * np.cos(beta) - radial * np.sin(beta),
        "kite_course": np.radians(180.0 - flight.course_deg) % (2 * np.pi),
        "ground_tether_length": flight.tether_length_m,
        "ground_tether_reelout_speed": flight.reeling_speed_m_s,
        "ground_tether_force": flight.tether_force_ground_N / 9.80665,
        "ground_wind_velocity": flight.ground_wind_speed_m_s,
        "ground_upwind_direction": flight.ground_wind_direction_deg,
        "airspeed_apparent_windspeed": flight.apparent_wind_speed_m_s,
        "airspeed_angle_of_attack": np.zeros(len(flight)),
        "kite_actual_depower": 62.0 - 24.0 * flight.power_setting,
    }
    table = {name: np.asarray(values).tolist() for name, values in columns.items()}
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


def write_csv(
    path: Path, rows: list[dict[str, Any]], spoil: Callable[[list[dict[str, Any]]], Any] | None = None
) -> Path:
    """Write rows, after they were spoilt in place."""
    rows = [dict(row) for row in rows]
    if spoil is not None:
        spoil(rows)
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path
