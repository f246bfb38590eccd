"""Crosswind-resolved traction: the paper's representative state checked against a flown figure (section traction)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from kiteocp.errors import InputError
from kiteocp.execution import one_at_a_time
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem
from kiteocp.result import Result
from kiteocp.studies.crosswind.course import (
    RepresentativeCourse,
    compare,
    matching_path,
    representative_states,
    weightless_power,
)
from kiteocp.studies.crosswind.flight import FlownPath, UnflyableError, Winch, fly_path
from kiteocp.studies.crosswind.path import PATHS, FlightPath

#: The path where none is named: down at the sides, as the kite of the open flight data flies.
DEFAULT_PATH = "eight-down"
#: Masses of the sweep over that of the problem.
MASS_RATIOS: tuple[float, ...] = tuple(np.linspace(0.0, 3.0, 13).tolist())

#: Channel of the time series to the output of the model.
_CHANNELS = {
    "height_m": "height",
    "reeling_speed_m_s": "reeling_speed",
    "kite_speed_m_s": "kite_speed",
    "wind_speed_m_s": "wind_speed",
    "apparent_wind_speed_m_s": "apparent_wind_speed",
    "kinematic_ratio": "kinematic_ratio",
    "tether_force_kite_N": "tether_force_kite",
    "tether_force_ground_N": "tether_force_ground",
    "power_W": "power",
    "tangential_speed_m_s": "tangential_speed",
}
#: Quantities of the representative state beside the averages of the figure.
_COMPARED = {
    "power_W": "power",
    "reeling_speed_m_s": "reeling_speed",
    "tether_force_kite_N": "tether_force_kite",
    "tether_force_ground_N": "tether_force_ground",
    "kite_speed_m_s": "kite_speed",
    "path_speed_m_s": "tangential_speed",
    "wind_speed_m_s": "wind_speed",
    "kinematic_ratio": "kinematic_ratio",
}


@one_at_a_time
def representative_course(
    problem: Problem,
    path: str | FlightPath = DEFAULT_PATH,
    mass_kg: float | None = None,
    *,
    tether_length_m: float | None = None,
    reeling_speed_m_s: float | None = None,
    gravity: bool = True,
) -> RepresentativeCourse:
    """Find the representative course angle of the traction phase for a kite of given mass.

    Parameters
    ----------
    problem
        The problem; ``operation.traction`` has the representative place and the force that the winch holds.
    path
        One of ``eight-up``, ``eight-down``, ``circle``, of the size whose averaged cosines are the problem's
        representative place; or a path.
    mass_kg
        Mass of the kite; the problem's where left out.
    tether_length_m
        Length of the tether; the mean of shortest and longest where left out.
    reeling_speed_m_s
        Reeling speed that the winch holds, instead of the force.
    gravity
        False leaves out all weights.

    Returns
    -------
    RepresentativeCourse
        The course and what it makes equal.

    Raises
    ------
    InputError
        A mass, length or path that cannot be.
    UnflyableError
        The path cannot be flown.
    """
    values = parameter_values(problem, gravity=gravity)
    winch, length = _winch(problem, reeling_speed_m_s), _length(problem, tether_length_m)
    if isinstance(path, str):
        path = matching_path(values, path, length, winch)
    if mass_kg is not None:
        if not (np.isfinite(mass_kg) and mass_kg >= 0.0):
            raise InputError(f"the mass of the kite is {mass_kg} kg; give a finite number of at least 0")
        values = values.replaced({"kite.mass_kg": mass_kg})
    return compare(values, fly_path(values, path, length, winch), winch)


@one_at_a_time
def crosswind(
    problem: Problem,
    kind: str = DEFAULT_PATH,
    *,
    centre_elevation_deg: float | None = None,
    amplitude_deg: float | None = None,
    elevation_amplitude_deg: float | None = None,
    tether_length_m: float | None = None,
    reeling_speed_m_s: float | None = None,
    gravity: bool = True,
    mass_ratios: Sequence[float] = MASS_RATIOS,
) -> Result:
    """Fly a figure with the quasi-steady model, and compare its averages with the representative state.

    Parameters
    ----------
    problem, tether_length_m, reeling_speed_m_s, gravity
        As `representative_course`.
    kind
        One of ``eight-up``, ``eight-down``, ``circle``.
    centre_elevation_deg, amplitude_deg, elevation_amplitude_deg
        Size of the figure: elevation of its centre, azimuth amplitude (of a circle the angular radius) and elevation
        amplitude. What is left out follows from the problem's representative place and
        `kiteocp.studies.crosswind.path.ASPECT`.
    mass_ratios
        Masses of the kite over that of the problem at which the best course is found, for every kind of path.

    Returns
    -------
    Result
        Verb ``crosswind``: time series of one figure, and ``details["crosswind"]``.

    Raises
    ------
    InputError, UnflyableError
        As `representative_course`.
    """
    values = parameter_values(problem, gravity=gravity)
    winch, length = _winch(problem, reeling_speed_m_s), _length(problem, tether_length_m)
    sizes = {
        "centre_elevation_deg": centre_elevation_deg,
        "amplitude_deg": amplitude_deg,
        "elevation_amplitude_deg": elevation_amplitude_deg,
    }
    path = matching_path(values, kind, length, winch, **sizes)
    flown = fly_path(values, path, length, winch)
    comparison = compare(values, flown, winch)
    averages = flown.averages()
    changes = _length_effect(values, flown, winch, averages["mean_power_W"])
    details = {
        "path": kind,
        "centre_elevation_deg": path.centre_elevation_deg,
        "azimuth_amplitude_deg": path.azimuth_amplitude_deg,
        "elevation_amplitude_deg": path.elevation_amplitude_deg,
        "tether_length_m": length,
        "control": winch.control,
        "control_value": winch.value,
        "gravity": gravity,
        "points": len(flown.time_s),
        "relative_error_of_averaging": flown.halving_error(),
        "period_s": flown.period_s,
        "path_length_m": float(length * np.sum(path.length_rad)),
        "turning_radius_min_m": flown.turning_radius_m(),
        "turning_radius_over_root_of_area": flown.turning_radius_m() / values["kite.projected_area_m2"] ** 0.5,
        "turn_rate_max_deg_s": flown.turn_rate_deg_s(),
        **averages,
        **changes,
        "representative": _representative(values, comparison, length, winch),
        "comparison": comparison.to_dict(),
        "lengths": _length_rows(values, path, winch, problem),
        "masses": _mass_sweep(values, kind, path, length, winch, mass_ratios),
    }
    return Result(
        verb="crosswind",
        problem=problem,
        warnings=tuple(problem.warnings()),
        channels=_channels(flown),
        details={"crosswind": details},
    )


def _winch(problem: Problem, reeling_speed_m_s: float | None) -> Winch:
    if reeling_speed_m_s is not None:
        if not np.isfinite(reeling_speed_m_s) or reeling_speed_m_s == 0.0:
            raise InputError(f"a reeling speed of {reeling_speed_m_s} m/s leaves no power to compare; give another")
        return Winch("reeling_speed", reeling_speed_m_s)
    operation = problem.operation
    return Winch(f"tether_force_{operation.force_reference}", operation.traction.tether_force_N)


def _length(problem: Problem, tether_length_m: float | None) -> float:
    """Return the length given, or the one of the mean traction altitude (eq:meantractionaltitude)."""
    if tether_length_m is None:
        return 0.5 * (problem.operation.tether_length_min_m + problem.operation.tether_length_max_m)
    if not (np.isfinite(tether_length_m) and tether_length_m > 0.0):
        raise InputError(f"the tether length is {tether_length_m} m; give a finite number above 0")
    return tether_length_m


def _length_effect(values: ParameterValues, flown: FlownPath, winch: Winch, mean_power_W: float) -> dict[str, Any]:
    """Return by how much the tether changes in one figure, and what that would do to the mean power.

    The figure is flown at the lengths of its start and its end too, and Simpson's rule taken over the three.
    """
    change = flown.mean(flown.states["reeling_speed"]) * flown.period_s
    try:
        ends = [
            fly_path(values, flown.path, flown.tether_length_m + 0.5 * part * change, winch).averages()["mean_power_W"]
            for part in (-1.0, 1.0)
        ]
    except UnflyableError:
        effect = None
    else:
        effect = (sum(ends) + 4.0 * mean_power_W) / (6.0 * mean_power_W) - 1.0
    return {"tether_length_change_m": change, "relative_effect_of_length_change": effect}


def _representative(
    values: ParameterValues, comparison: RepresentativeCourse, length_m: float, winch: Winch
) -> dict[str, Any]:
    """Return the representative state at the problem's course, by the names of the averages."""
    states = representative_states(
        values,
        length_m,
        comparison.elevation_deg,
        comparison.azimuth_deg,
        np.array([comparison.problem_course_deg]),
        winch,
    )
    return {name: float(states[output][0]) for name, output in _COMPARED.items()}


def _length_rows(values: ParameterValues, path: FlightPath, winch: Winch, problem: Problem) -> list[dict[str, Any]]:
    """Return the comparison at the shortest, the middle and the longest tether: one course stands for all of them."""
    operation = problem.operation
    rows: list[dict[str, Any]] = []
    for length in np.linspace(operation.tether_length_min_m, operation.tether_length_max_m, 3).tolist():
        try:
            row = compare(values, fly_path(values, path, length, winch), winch).to_dict()
        except UnflyableError as error:
            row = {"mass_kg": values["kite.mass_kg"], "message": str(error)}
        rows.append({"tether_length_m": length, **row})
    return rows


def _mass_sweep(
    values: ParameterValues, kind: str, path: FlightPath, length_m: float, winch: Winch, mass_ratios: Sequence[float]
) -> dict[str, list[dict[str, Any]]]:
    """Return a row for each mass by kind of path; the path asked for as it is, the others of matching size."""
    sweep: dict[str, list[dict[str, Any]]] = {}
    for other in PATHS:
        rows: list[dict[str, Any]] = []
        sweep[other] = rows
        try:
            flown_path = path if other == kind else matching_path(values, other, length_m, winch)
            light = weightless_power(values, flown_path, length_m, winch)
        except (UnflyableError, InputError) as error:
            rows.append({"mass_kg": values["kite.mass_kg"], "message": str(error)})
            continue
        for ratio in mass_ratios:
            numbers = values.replaced({"kite.mass_kg": ratio * values["kite.mass_kg"]})
            try:
                flown = fly_path(numbers, flown_path, length_m, winch)
            except UnflyableError as error:
                rows.append({"mass_kg": numbers["kite.mass_kg"], "message": str(error)})
                continue
            rows.append(compare(numbers, flown, winch, light).to_dict())
    return sweep


def _channels(flown: FlownPath) -> dict[str, npt.NDArray[Any]]:
    """Return the time series of one figure, its first point again at the end."""
    path, count = flown.path, len(flown.time_s)
    closed = np.append(np.arange(count), 0)
    return {
        "time_s": np.append(flown.time_s, flown.period_s),
        "phase": np.full(count + 1, "traction"),
        "tether_length_m": np.full(count + 1, flown.tether_length_m),
        "elevation_deg": np.rad2deg(path.elevation_rad)[closed],
        "azimuth_deg": np.rad2deg(path.azimuth_rad)[closed],
        **{name: flown.states[output][closed] for name, output in _CHANNELS.items()},
        "course_deg": (np.rad2deg(path.course_rad) % 360.0)[closed],
        "turning_radius_m": (flown.tether_length_m / np.maximum(np.abs(path.curvature), 1e-12))[closed],
    }
