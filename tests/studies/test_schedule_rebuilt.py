"""A written optimum flown again from its files alone: length, elevation and energy come out."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from kiteocp.cli.main import main
from kiteocp.physics import kinematics
from kiteocp.physics.equilibrium import explicit_state
from kiteocp.physics.kinematics import Course
from kiteocp.physics.model import Model, Position
from kiteocp.physics.parameters import parameter_values, parameters_of
from kiteocp.problem import load_problem

OPTIONS = {
    "plain": {},
    "traction power": {"optimisation.power_setting": "traction"},
    "all power": {"optimisation.power_setting": "all"},
    "steered": {"optimisation.traction_elevation": "course-coupled"},
    "linear": {"optimisation.traction_elevation": "linear"},
    "free": {"optimisation.traction_elevation": "free"},
}
SHIPPED = ("strong-wind", "moderate-wind", "v3-kite", "v9-kite")

#: Steps of the classical Runge-Kutta method between two samples: its error is far below that of the interpolation.
STEPS = 2

Columns = dict[str, np.ndarray]


def flight_of(problem: Any) -> tuple[ca.Function, np.ndarray]:
    """``(length, elevation, azimuth, course, power setting, force at the ground, p) -> speeds``: the physics alone."""
    values = parameter_values(problem)
    parameters = parameters_of(values.structure)
    model = Model(parameters)
    length, elevation, azimuth, course, setting, force = (ca.SX.sym(n) for n in "rbacuf")
    position = Position(length, elevation, azimuth, Course.of_angle(course))
    around = model.conditions(position, model.coefficients(setting))
    state = explicit_state(model, position, around, model.radial_ground_force(around, force, "ground"))
    inputs = [length, elevation, azimuth, course, setting, force, parameters.vector]
    return ca.Function("flight", inputs, [state.reeling_speed, state.tangential_speed, state.power]), values.vector


def read_columns(path: Path) -> dict[str, Columns]:
    """Read a time series by phase."""
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {
        phase: {
            name: np.array([float(row[name]) for row in rows if row["phase"] == phase])
            for name in rows[0]
            if name != "phase"
        }
        for phase in ("retraction", "transition", "traction")
    }


def flown(problem: Any, phase: str, table: Columns, place: np.ndarray, steered: bool) -> np.ndarray:
    """Fly a phase by the columns of its time series from a place (length, elevation in rad, energy)."""
    flight, vector = flight_of(problem)
    names = ("tether_force_ground_N", "power_setting", "course_deg", "azimuth_deg", "elevation_rate_deg_s")
    curves = {name: PchipInterpolator(table["time_s"], table[name]) for name in names}
    mean_course = np.radians(problem.operation.traction.course_deg)

    def rates(time: float, at: np.ndarray) -> np.ndarray:
        now = {name: float(curve(time)) for name, curve in curves.items()}
        course = np.radians(now["course_deg"])
        speed, along, power = (
            float(v)
            for v in flight(
                *at[:2],
                np.radians(now["azimuth_deg"]),
                course,
                now["power_setting"],
                now["tether_force_ground_N"],
                vector,
            )
        )
        if phase != "traction":
            climb = kinematics.elevation_rate(along, Course(np.cos(course), 0.0), at[0])
        elif steered:
            climb = kinematics.elevation_rate(along, Course(np.cos(course) - np.cos(mean_course), 0.0), at[0])
        else:
            climb = np.radians(now["elevation_rate_deg_s"])
        return np.array([speed, climb, power])

    for start, end in zip(table["time_s"][:-1], table["time_s"][1:], strict=True):
        step = (end - start) / STEPS
        for time in start + step * np.arange(STEPS):
            first = rates(time, place)
            second = rates(time + step / 2, place + step / 2 * first)
            third = rates(time + step / 2, place + step / 2 * second)
            fourth = rates(min(time + step, end), place + step * third)
            place = place + step / 6 * (first + 2 * second + 2 * third + fourth)
    return place


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("name", [n if n == "v3-kite" else pytest.param(n, marks=pytest.mark.slow) for n in SHIPPED])
def test_a_written_optimum_can_be_flown_from_its_files(name: str, option: str, tmp_path: Path) -> None:
    words = ["solve", name, "--no-plot", "--certificate", "quick", "-o", str(tmp_path)]
    for key, value in OPTIONS[option].items():
        words += ["--set", f"{key}={value}"]
    main(words)
    summary = json.loads((tmp_path / "summary.json").read_text())
    problem = load_problem(name, OPTIONS[option])
    tables = read_columns(tmp_path / "timeseries.csv")
    traction = summary["phases"]["traction"]
    stroke = traction["tether_length_end_m"] - traction["tether_length_start_m"]
    energy = abs(traction["energy_J"])
    for phase, table in tables.items():
        start = np.array([table["tether_length_m"][0], np.radians(table["elevation_deg"][0]), 0.0])
        length, elevation, work = flown(problem, phase, table, start, option == "steered")
        # Gaps that a quick certificate leaves to a phase (0.4 %), and as much again for 121 samples of it.
        assert abs(length - table["tether_length_m"][-1]) <= 8e-3 * stroke
        assert abs(np.degrees(elevation) - table["elevation_deg"][-1]) <= 0.8
        assert abs(work - summary["phases"][phase]["energy_J"]) <= 8e-3 * energy
        assert summary["phases"][phase]["mean_power_setting"] == pytest.approx(
            np.trapezoid(table["power_setting"], table["time_s"]) / np.ptp(table["time_s"]), abs=1e-9
        )
        climbed = np.trapezoid(table["elevation_rate_deg_s"], table["time_s"])
        assert climbed == pytest.approx(np.ptp(table["elevation_deg"][[0, -1]]) * np.sign(climbed), abs=0.8)


@pytest.mark.parametrize("option", ["all power", "steered"])
def test_the_export_names_what_was_optimised(option: str, tmp_path: Path) -> None:
    words = ["solve", "v3-kite", "--no-plot", "--certificate", "quick", "-o", str(tmp_path / "solve")]
    for key, value in OPTIONS[option].items():
        words += ["--set", f"{key}={value}"]
    main([*words, "--export", str(tmp_path / "winch")])
    written = read_columns(tmp_path / "solve" / "timeseries.csv")
    exported = read_columns(tmp_path / "winch" / "setpoints_time.csv")
    for phase, table in written.items():
        for column in ("power_setting", "course_deg", "elevation_rate_deg_s"):
            np.testing.assert_allclose(exported[phase][column], table[column], rtol=1e-12)
    for column in ("power_setting", "course_deg", "elevation_rate_deg_s"):
        assert column in (tmp_path / "winch" / "setpoints_length.csv").read_text().splitlines()[0].split(",")
    if option == "steered":
        assert np.ptp(written["traction"]["course_deg"]) > 10.0


def test_a_prescribed_cycle_names_what_it_holds(tmp_path: Path) -> None:
    assert main(["simulate", "v3-kite", "--no-plot", "-o", str(tmp_path)]) == 0
    tables = read_columns(tmp_path / "timeseries.csv")
    held = {phase: (table["power_setting"], table["course_deg"]) for phase, table in tables.items()}
    course = load_problem("v3-kite").operation.traction.course_deg
    for phase, expected in (("retraction", (0.0, 180.0)), ("transition", (1.0, 0.0)), ("traction", (1.0, course))):
        for samples, value in zip(held[phase], expected, strict=True):
            np.testing.assert_allclose(samples, value)
