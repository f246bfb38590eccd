"""The representative state of the traction phase beside the flown figure, and the course that makes them agree.

The paper stands for the crosswind manoeuvre with one state at averaged cosines (eq:averagepositions) and leaves the
course angle of that state open. Here the course is found at which its power is the time average of the figure.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import asdict
from scipy.optimize import brentq

from kiteocp.errors import InputError
from kiteocp.ocp.collocation import FloatArray
from kiteocp.physics.parameters import ParameterValues
from kiteocp.studies.crosswind.flight import FlownPath, UnflyableError, Winch, fly_path, solve_places, weightless
from kiteocp.studies.crosswind.path import FlightPath, make_path

#: Courses at which the representative power is looked at for changes of sign, from straight down to straight up.
_COURSES = 61
#: Relative change of power over all courses below which a course means nothing: the residual of a weightless kite.
_FLAT = 1e-9
#: Angles within this of each other are one (deg).
_CLOSE_DEG = 1e-9
_MOST_MATCHES = 60


class RepresentativeCourse(msgspec.Struct, frozen=True):
    """A flown figure beside the representative state of its averaged cosines.

    Attributes
    ----------
    mass_kg : float
        Mass of the kite.
    course_deg : float or None
        Course whose state has the mean power of the figure; None where there is none, `note` says why.
    note : str
        Why there is no such course, or which others there are; empty otherwise.
    gravity_course_deg : float or None
        Course whose state loses the same share of its power to gravity as the figure, which leaves out what the
        averaging of the place alone does.
    gravity_note : str
        As `note`.
    mean_course_deg : float
        Arccosine of the time average of the cosine of the course.
    elevation_deg, azimuth_deg : float
        Place of the representative state, of the averaged cosines.
    problem_course_deg : float
        Representative course of the problem.
    resolved_power_W, representative_power_W : float
        Mean power of the figure, and power of the representative state at the problem's course.
    resolved_weightless_power_W, representative_weightless_power_W : float
        The same without weight of kite and tether, at the same place.
    """

    mass_kg: float
    course_deg: float | None
    note: str
    gravity_course_deg: float | None
    gravity_note: str
    mean_course_deg: float
    elevation_deg: float
    azimuth_deg: float
    problem_course_deg: float
    resolved_power_W: float
    representative_power_W: float
    resolved_weightless_power_W: float
    representative_weightless_power_W: float

    @property
    def power_ratio(self) -> float:
        """Mean power of the figure over that of the representative state at the problem's course."""
        return self.resolved_power_W / self.representative_power_W

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and the power ratio, for the summary."""
        return {**asdict(self), "power_ratio": self.power_ratio}


def matching_path(
    values: ParameterValues,
    kind: str,
    tether_length_m: float,
    winch: Winch,
    *,
    centre_elevation_deg: float | None = None,
    amplitude_deg: float | None = None,
    elevation_amplitude_deg: float | None = None,
) -> FlightPath:
    """Return the path of a kind whose averaged cosines are those of the problem's representative place.

    Parameters
    ----------
    values
        The numbers of the problem.
    kind
        One of `kiteocp.studies.crosswind.path.PATHS`.
    tether_length_m, winch
        How it is flown: the averages are over time.
    centre_elevation_deg, amplitude_deg, elevation_amplitude_deg
        What is given stays; the amplitude is the azimuth amplitude of an eight and the radius of a circle.

    Raises
    ------
    InputError
        The place has no azimuth to take a size from, or the path leaves the sky.
    UnflyableError
        The path cannot be flown.
    """
    azimuth = abs(values["operation.traction.azimuth_deg"])
    elevation = values["operation.traction.elevation_deg"]
    if amplitude_deg is None and azimuth == 0.0:
        raise InputError(
            "operation.traction.azimuth_deg is 0, which leaves the size of the path open; give its azimuth amplitude",
            key="operation.traction.azimuth_deg",
        )
    # Of an angle that swings as a sine the mean square is half that of its amplitude.
    amplitude = math.sqrt(2.0) * azimuth if amplitude_deg is None else amplitude_deg
    centre = elevation if centre_elevation_deg is None else centre_elevation_deg
    for _ in range(_MOST_MATCHES):
        path = make_path(kind, centre, amplitude, elevation_amplitude_deg)
        if centre_elevation_deg is not None and amplitude_deg is not None:
            return path
        found_elevation, found_azimuth = _averaged_place(fly_path(values, path, tether_length_m, winch))
        miss = 0.0 if centre_elevation_deg is not None else elevation - found_elevation
        growth = 1.0 if amplitude_deg is not None else azimuth / found_azimuth
        if abs(miss) < _CLOSE_DEG and abs(growth - 1.0) * amplitude < _CLOSE_DEG:
            return path
        centre, amplitude = centre + miss, amplitude * growth
    raise InputError(
        f"no {kind} has averaged cosines of {elevation:g} deg elevation and {azimuth:g} deg azimuth; "
        "give its amplitudes and its centre"
    )


def compare(
    values: ParameterValues,
    flown: FlownPath,
    winch: Winch,
    weightless_power_W: float | None = None,
) -> RepresentativeCourse:
    """Compare a flown path with the representative state of its averaged cosines.

    Parameters
    ----------
    values
        The numbers of the problem that the path was flown with.
    flown
        The path.
    winch
        What the winch holds, in both.
    weightless_power_W
        Mean power of the same path without weight, where it is known already.
    """
    light = weightless(values)
    if weightless_power_W is None:
        weightless_power_W = weightless_power(values, flown.path, flown.tether_length_m, winch)
    averages = flown.averages()
    elevation, azimuth = _averaged_place(flown)
    # The side of the wind window and the sense of the course are those of the problem.
    azimuth = math.copysign(azimuth, values["operation.traction.azimuth_deg"])
    problem_course = values["operation.traction.course_deg"]
    sense = -1.0 if math.sin(math.radians(problem_course)) < 0.0 else 1.0
    courses = sense * np.linspace(0.0, 180.0, _COURSES)

    def power(course_deg: FloatArray, numbers: ParameterValues = values) -> FloatArray:
        return representative_states(numbers, flown.tether_length_m, elevation, azimuth, course_deg, winch)["power"]

    powers = power(courses)
    at_problem = float(power(np.array([problem_course]))[0])
    light_power = float(power(np.array([problem_course]), light)[0])
    resolved = averages["mean_power_W"]
    nearest = averages["mean_course_deg"]
    course, note = _matching_course(power, courses, powers, resolved, nearest)
    same_loss = resolved / weightless_power_W * light_power
    if math.isfinite(same_loss):
        gravity_course, gravity_note = _matching_course(power, courses, powers, same_loss, nearest)
    else:
        gravity_course, gravity_note = None, "without weight there is no such figure or no such state"
    return RepresentativeCourse(
        mass_kg=values["kite.mass_kg"],
        course_deg=course,
        note=note,
        gravity_course_deg=gravity_course,
        gravity_note=gravity_note,
        mean_course_deg=nearest,
        elevation_deg=elevation,
        azimuth_deg=azimuth,
        problem_course_deg=problem_course,
        resolved_power_W=resolved,
        representative_power_W=at_problem,
        resolved_weightless_power_W=weightless_power_W,
        representative_weightless_power_W=light_power,
    )


def weightless_power(values: ParameterValues, path: FlightPath, tether_length_m: float, winch: Winch) -> float:
    """Return the mean power (W) of a path without weight of kite and tether; not a number where it has none."""
    try:
        return fly_path(weightless(values), path, tether_length_m, winch).averages()["mean_power_W"]
    except UnflyableError:
        return math.nan


def representative_states(
    values: ParameterValues,
    tether_length_m: float,
    elevation_deg: float,
    azimuth_deg: float,
    course_deg: FloatArray,
    winch: Winch,
) -> dict[str, FloatArray]:
    """Return the states of the powered kite at one place on several courses (deg), shape (n,) each."""
    ones = np.ones_like(course_deg)
    lift, drag = values["kite.powered.lift_coefficient"], values.kite_drag_coefficient("powered")
    rows = [tether_length_m * ones, elevation_deg * ones, azimuth_deg * ones, course_deg, lift * ones, drag * ones]
    return solve_places(values, np.array(rows), winch)


def _averaged_place(flown: FlownPath) -> tuple[float, float]:
    """Return elevation and azimuth of the averaged cosines (eq:averagepositions), deg."""
    averages = flown.averages()
    elevation = np.rad2deg(np.arccos(averages["mean_cosine_elevation"]))
    return float(elevation), float(np.rad2deg(np.arccos(averages["mean_cosine_azimuth"])))


def _matching_course(
    power: Callable[[FloatArray], FloatArray], courses: FloatArray, powers: FloatArray, target: float, nearest: float
) -> tuple[float | None, str]:
    """Return the course between 0 and 180 deg at which the power is `target`, and what there is to say about it."""
    flown = np.isfinite(powers)
    if not flown.any():
        return None, "the representative state exists on no course"
    low, high = float(np.min(powers[flown])), float(np.max(powers[flown]))
    if high - low <= _FLAT * max(abs(low), abs(high)):
        return None, "the power of the representative state does not depend on the course: nothing has weight"
    misses = powers - target
    roots = [
        float(brentq(lambda course: float(power(np.array([course]))[0]) - target, left, right, xtol=1e-9))
        for left, right, a, b in zip(courses[:-1], courses[1:], misses[:-1], misses[1:], strict=True)
        if np.isfinite(a) and np.isfinite(b) and (a == 0.0 or a * b < 0.0)
    ]
    if not roots:
        side = "more" if target > high else "less"
        return None, (
            f"on no course: the figure has {side} power ({target:.0f} W) than the representative state on any "
            f"({low:.0f} to {high:.0f} W)"
        )
    roots.sort(key=lambda course: abs(abs(course) - nearest))
    others = ", ".join(f"{abs(course):.1f}" for course in roots[1:])
    note = f"on {others} deg too; the nearest to the mean course is given" if others else ""
    return roots[0] % 360.0, note
