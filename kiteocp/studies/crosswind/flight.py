"""A closed path flown by the quasi-steady model: states along it, the time they take, and their time averages.

At every point the course is the path's tangent, and the equilibrium of forces on that course gives the path speed
and, with the winch holding a force or a speed, the other of the two. The tether length is that of the figure's middle.
"""

from __future__ import annotations

import msgspec
import numpy as np

from kiteocp.errors import NoEquilibriumError
from kiteocp.ocp.collocation import FloatArray
from kiteocp.physics.equilibrium import OUTPUTS, equilibrium_functions
from kiteocp.physics.flight import OperatingPoint, solve_state
from kiteocp.physics.parameters import ParameterValues
from kiteocp.studies.crosswind.path import FlightPath, antiderivative

#: A residual below this is an equilibrium: the rootfinder stops at 1e-14, rounding leaves a few units more.
_SOLVED = 1e-10


class UnflyableError(NoEquilibriumError):
    """A path that the kite cannot fly: where on it, and why."""

    def __str__(self) -> str:
        """Return one sentence with the place and the cause."""
        return f"the path cannot be flown: {self.cause}"


class Winch(msgspec.Struct, frozen=True):
    """What the winch holds along a path.

    Attributes
    ----------
    control : str
        ``tether_force_kite`` or ``tether_force_ground`` (N), or ``reeling_speed`` (m/s).
    value : float
        The force or the speed.
    """

    control: str
    value: float


class FlownPath(msgspec.Struct, frozen=True):
    """A path with the states along it.

    Attributes
    ----------
    path : FlightPath
        The path.
    tether_length_m : float
        Length at which it is flown.
    states : dict of str to numpy.ndarray, shape (n,)
        The outputs of the model (`kiteocp.physics.equilibrium.OUTPUTS`, SI units) at the points of the path.
    time_s : numpy.ndarray, shape (n,)
        Time at the points.
    period_s : float
        Time of one figure.
    """

    path: FlightPath
    tether_length_m: float
    states: dict[str, FloatArray]
    time_s: FloatArray
    period_s: float

    def mean(self, values: FloatArray) -> float:
        """Return the time average of values given at the points."""
        return float(np.sum(values * self._shares()))

    def averages(self) -> dict[str, float]:
        """Return the time averages over one figure, by name with unit."""
        states = self.states
        cosine = self.mean(np.cos(self.path.course_rad))
        return {
            "mean_power_W": self.mean(states["power"]),
            "mean_reeling_speed_m_s": self.mean(states["reeling_speed"]),
            "mean_tether_force_kite_N": self.mean(states["tether_force_kite"]),
            "mean_tether_force_ground_N": self.mean(states["tether_force_ground"]),
            "mean_kite_speed_m_s": self.mean(states["kite_speed"]),
            "mean_path_speed_m_s": self.mean(states["tangential_speed"]),
            "mean_wind_speed_m_s": self.mean(states["wind_speed"]),
            "mean_kinematic_ratio": self.mean(states["kinematic_ratio"]),
            "mean_cosine_azimuth": self.mean(np.cos(self.path.azimuth_rad)),
            "mean_cosine_elevation": self.mean(np.cos(self.path.elevation_rad)),
            "mean_cosine_course": cosine,
            "mean_course_deg": float(np.rad2deg(np.arccos(cosine))),
        }

    def halving_error(self) -> float:
        """Return the relative change of the mean power when every second point is left out."""
        coarse = self._shares()[::2]
        power = float(np.sum(self.states["power"][::2] * coarse) / np.sum(coarse))
        mean = self.mean(self.states["power"])
        return abs(power / mean - 1.0) if mean else abs(power)

    def turning_radius_m(self) -> float:
        """Return the smallest turning radius in the tangential plane."""
        return self.tether_length_m / float(np.max(np.abs(self.path.curvature)))

    def turn_rate_deg_s(self) -> float:
        """Return the largest turn rate along the path."""
        rate = self.path.curvature * self.states["tangential_speed"] / self.tether_length_m
        return float(np.rad2deg(np.max(np.abs(rate))))

    def _shares(self) -> FloatArray:
        share = self.path.length_rad / self.states["tangential_speed"]
        return share / np.sum(share)


def places_on(path: FlightPath, tether_length_m: float, lift: float, kite_drag: float) -> FloatArray:
    """Return the arguments of the equilibrium at the points of a path, shape (6, n), see `POSITION_ARGUMENTS`."""
    ones = np.ones_like(path.azimuth_rad)
    degrees = (np.rad2deg(angle) for angle in (path.elevation_rad, path.azimuth_rad, path.course_rad))
    return np.array([tether_length_m * ones, *degrees, lift * ones, kite_drag * ones])


def solve_places(values: ParameterValues, places: FloatArray, winch: Winch) -> dict[str, FloatArray]:
    """Solve the equilibrium at many places at once.

    Parameters
    ----------
    values
        The numbers of the problem.
    places
        Shape (6, n), rows as `POSITION_ARGUMENTS`.
    winch
        What is given.

    Returns
    -------
    dict of str to numpy.ndarray, shape (n,)
        The quantities of `OUTPUTS`; not a number where there is no equilibrium.
    """
    functions = equilibrium_functions(values.structure, winch.control)
    count = places.shape[1]
    arguments = np.vstack([np.tile(values.vector[:, None], count), places, np.full((1, count), winch.value)])
    # The massless kite without tether drag has this angle (eq:triangle_similarity).
    guess = np.arctan2(places[4], places[5])[None, :]
    angles = np.asarray(functions.solve.map(count)(guess, arguments))
    states = _outputs(values, winch, angles, arguments)
    beyond = np.asarray(functions.residual.map(count)(angles + 1e-6, arguments)).ravel()
    # The branch of the massless kite: beyond it the residual is negative. The rest is searched for one by one.
    good = (np.abs(states["residual"]) < _SOLVED) & (beyond < 0.0) & (states["radial_ground_force"] >= 0.0)
    good &= (angles.ravel() > 0.0) & (angles.ravel() < 0.5 * np.pi)
    for index in np.flatnonzero(~good):
        try:
            found = solve_state(values, OperatingPoint(*places[:, index].tolist()), winch.control, winch.value)
        except NoEquilibriumError:
            found = dict.fromkeys(OUTPUTS, np.nan)
        for name in OUTPUTS:
            states[name][index] = found[name]
    return states


def _outputs(values: ParameterValues, winch: Winch, angles: FloatArray, arguments: FloatArray) -> dict[str, FloatArray]:
    state = equilibrium_functions(values.structure, winch.control).state
    named = state.map(arguments.shape[1])(angle=angles, arguments=arguments)
    return {name: np.asarray(named[name]).ravel() for name in OUTPUTS}


def fly_path(values: ParameterValues, path: FlightPath, tether_length_m: float, winch: Winch) -> FlownPath:
    """Fly a closed path once with the powered kite.

    Parameters
    ----------
    values
        The numbers of the problem (`kiteocp.physics.parameters.parameter_values`).
    path
        The path.
    tether_length_m
        Length of the tether, held for one figure.
    winch
        What the winch holds.

    Raises
    ------
    UnflyableError
        Somewhere on the path there is no equilibrium, or the kite does not move forward; the message says where first.
    """
    lift, drag = values["kite.powered.lift_coefficient"], values.kite_drag_coefficient("powered")
    places = places_on(path, tether_length_m, lift, drag)
    states = solve_places(values, places, winch)
    speed = states["tangential_speed"]
    if not np.all(speed > 0.0):
        raise _unflyable(values, places, winch, speed)
    # d(time) / d(parameter), whose mean over the points makes the period.
    pace = tether_length_m * path.length_rad / speed * (len(speed) / (2.0 * np.pi))
    return FlownPath(path, tether_length_m, states, antiderivative(pace), float(np.mean(pace) * 2.0 * np.pi))


def weightless(values: ParameterValues) -> ParameterValues:
    """Return the numbers of the problem without weight of kite and tether."""
    return values.replaced({"environment.gravity_m_s2": 0.0})


def _unflyable(values: ParameterValues, places: FloatArray, winch: Winch, speed: FloatArray) -> UnflyableError:
    """Return the error of the first point without equilibrium or, where all have one, of the slowest."""
    missing = np.flatnonzero(~np.isfinite(speed))
    if missing.size:
        try:
            solve_state(values, OperatingPoint(*places[:, missing[0]].tolist()), winch.control, winch.value)
        except NoEquilibriumError as error:
            share = 100.0 * missing.size / speed.size
            return UnflyableError(
                f"no equilibrium of forces {error.cause} (so on {share:.0f} % of its points)",
                facts={**error.facts, "share_of_points": missing.size / speed.size},
                reason=error.reason,
            )
    slowest = int(np.nanargmin(speed))
    length, elevation, azimuth, course = places[:4, slowest].tolist()
    return UnflyableError(
        f"at {length:.4g} m of tether, {elevation:.3g} deg elevation, {azimuth:.3g} deg azimuth, "
        f"course {course % 360.0:.4g} deg the kite does not move forward: its path speed is {speed[slowest]:.3g} m/s",
        facts={
            "tether_length_m": length,
            "elevation_deg": elevation,
            "azimuth_deg": azimuth,
            "course_deg": course % 360.0,
            "path_speed_m_s": float(speed[slowest]),
        },
        reason="backwards",
    )
