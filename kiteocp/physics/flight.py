"""One flight state in numbers, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, get_args

import msgspec
import numpy as np

from kiteocp.errors import InputError, NoEquilibriumError, check_word
from kiteocp.execution import one_at_a_time
from kiteocp.physics.equilibrium import OUTPUTS, EquilibriumFunctions, equilibrium_functions
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem

#: Names of the outputs with their units, as they reach a user.
OUTPUT_UNITS: Mapping[str, str] = {
    "height": "m",
    "wind_speed": "m_s",
    "wind_along_tether": "m_s",
    "wind_across_course": "m_s",
    "air_density": "kg_m3",
    "reeling_speed": "m_s",
    "tangential_speed": "m_s",
    "kite_speed": "m_s",
    "apparent_wind_speed": "m_s",
    "radial_apparent_wind_speed": "m_s",
    "aerodynamic_force": "N",
    "radial_ground_force": "N",
    "tether_force_kite": "N",
    "tether_force_ground": "N",
    "power": "W",
    "electrical_power": "W",
    "sag": "N",
    "weight_across": "N",
    "inflow_angle": "rad",
}

#: Points at which the residual is scanned for its sign before the rootfinder starts.
SCAN_POINTS = 200


class OperatingPoint(msgspec.Struct, frozen=True):
    """A place, a course and a setting of the kite, in the units of the problem file.

    Attributes
    ----------
    tether_length_m, elevation_deg, azimuth_deg, course_deg
        Position and course (180 deg is straight up).
    lift_coefficient, drag_coefficient
        Of the kite without the tether.
    """

    tether_length_m: float
    elevation_deg: float
    azimuth_deg: float
    course_deg: float
    lift_coefficient: float
    drag_coefficient: float

    def vector(self) -> np.ndarray:
        """Return the arguments in the order of `POSITION_ARGUMENTS`."""
        return np.array(
            [
                self.tether_length_m,
                self.elevation_deg,
                self.azimuth_deg,
                self.course_deg,
                self.lift_coefficient,
                self.drag_coefficient,
            ]
        )


#: Which coefficients of the kite apply.
Setting = Literal["powered", "depowered"]


@one_at_a_time
def flight_state(
    problem: Problem,
    *,
    tether_length_m: float,
    elevation_deg: float,
    azimuth_deg: float = 0.0,
    course_deg: float = 180.0,
    setting: Setting = "powered",
    reeling_speed_m_s: float | None = None,
    reeling_factor: float | None = None,
    tether_force_kite_N: float | None = None,
    tether_force_ground_N: float | None = None,
    gravity: bool = True,
) -> dict[str, float]:
    """Quasi-steady flight state at a place, by the implicit equilibrium (eq:F_a_projection).

    Parameters
    ----------
    problem
        Environment, kite and tether.
    tether_length_m, elevation_deg, azimuth_deg, course_deg
        Place and course; 0 deg is straight down, 90 deg towards positive azimuth, 180 deg straight up.
    setting
        Which coefficients of the kite apply.
    reeling_speed_m_s, reeling_factor, tether_force_kite_N, tether_force_ground_N
        What the winch holds; exactly one of them.
    gravity
        False leaves out all weights.

    Returns
    -------
    dict
        Named quantities with their unit in the name (`OUTPUT_UNITS`; factors have none).

    Raises
    ------
    InputError
        None or several of the four controls given, or the setting is neither word.
    NoEquilibriumError
        No quasi-steady state exists; the message says which state and why.
    """
    check_word("setting", setting, get_args(Setting))
    controls = {
        "reeling_speed": reeling_speed_m_s,
        "reeling_factor": reeling_factor,
        "tether_force_kite": tether_force_kite_N,
        "tether_force_ground": tether_force_ground_N,
    }
    given = {name: value for name, value in controls.items() if value is not None}
    if len(given) != 1:
        raise InputError(
            "flight_state takes exactly one of reeling_speed_m_s, reeling_factor, tether_force_kite_N and "
            f"tether_force_ground_N; {len(given)} were given."
        )
    kite = problem.kite.powered if setting == "powered" else problem.kite.depowered
    place = OperatingPoint(
        tether_length_m,
        elevation_deg,
        azimuth_deg,
        course_deg,
        kite.lift_coefficient,
        kite.kite_drag_coefficient,
    )
    [(control, value)] = given.items()
    state = solve_state(parameter_values(problem, gravity=gravity), place, control, value)
    return {_named(name): state[name] for name in OUTPUTS}


def _named(quantity: str) -> str:
    """Name of a quantity with its unit, factors have none."""
    unit = OUTPUT_UNITS.get(quantity)
    return f"{quantity}_{unit}" if unit else quantity


def solve_state(values: ParameterValues, place: OperatingPoint, control: str, value: float) -> dict[str, float]:
    """Solve one state; `flight_state` without the problem file around it.

    Raises
    ------
    NoEquilibriumError
        With ``reason`` one of ``force_below_sag``, ``slack``, ``reeling_too_fast``, ``crosswind``, ``too_heavy``,
        ``falling``.
    """
    functions = equilibrium_functions(values.structure, control)
    arguments = np.concatenate([values.vector, place.vector(), [value]])
    facts = {**msgspec.structs.asdict(place), _named(control): value}
    limit_low, limit_high = _domain(functions, arguments, control, place, facts)
    angles, residuals = _scan(functions, arguments, limit_low, limit_high)
    falls = _falls(residuals)
    if not falls.size:
        # Two roots close together may lie between two points of the scan: look again around its largest value.
        peak = int(np.argmax(np.where(np.isfinite(residuals), residuals, -np.inf)))
        near = angles[max(peak - 1, 0)], angles[min(peak + 1, SCAN_POINTS - 1)]
        fine_angles, fine_residuals = _scan(functions, arguments, *near)
        falls = _falls(fine_residuals)
        if not falls.size:
            raise _no_root(residuals[np.isfinite(residuals)], place, facts)
        angles, residuals = fine_angles, fine_residuals
    last = falls[-1]
    low, high = angles[last], angles[last + 1]
    share = residuals[last] / (residuals[last] - residuals[last + 1])
    root = float(functions.solve(low + share * (high - low), arguments))
    if not low <= root <= high:
        root = _bisect(lambda angle: float(functions.residual(angle, arguments)), low, high)
    named = functions.state(angle=root, arguments=arguments)
    state = {name: float(named[name]) for name in OUTPUTS}
    if state["radial_ground_force"] < 0:
        raise _slack(place, facts, f"at a reeling speed of {state['reeling_speed']:.3g} m/s")
    return state


def _scan(
    functions: EquilibriumFunctions, arguments: np.ndarray, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the residual at angles evenly spaced between two."""
    angles = np.linspace(low, high, SCAN_POINTS)
    return angles, np.asarray(functions.residual.map(SCAN_POINTS)(angles[None, :], arguments)).ravel()


def _falls(residuals: np.ndarray) -> np.ndarray:
    """Return the points after which the residual changes from plus to minus.

    Below the root the drag's share of the force is too small for the angle, above it too large: the last such change is
    the branch that the massless kite flies on.
    """
    finite = np.isfinite(residuals)
    return np.flatnonzero((residuals[:-1] >= 0) & (residuals[1:] < 0) & finite[:-1] & finite[1:])


def _bisect(residual: Callable[[float], float], low: float, high: float) -> float:
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if residual(middle) >= 0 else (low, middle)
    return 0.5 * (low + high)


def _domain(
    functions: EquilibriumFunctions, arguments: np.ndarray, control: str, place: OperatingPoint, facts: dict[str, Any]
) -> tuple[float, float]:
    """Bounds of the inflow angle within which all roots of the state are real."""
    probe = {name: float(v) for name, v in functions.state(angle=0.5, arguments=arguments).items()}
    wind_radial, crosswind = probe["wind_along_tether"], abs(probe["wind_across_course"])
    if control in ("reeling_speed", "reeling_factor"):
        radial = wind_radial - probe["reeling_speed"]
        if radial <= 0:
            raise NoEquilibriumError(
                f"{_where(place)}: the kite reels out at {probe['reeling_speed']:.3g} m/s, "
                f"but the wind blows only at {wind_radial:.3g} m/s along the tether",
                facts={**facts, "reeling_speed_m_s": probe["reeling_speed"], "wind_along_tether_m_s": wind_radial},
                reason="reeling_too_fast",
            )
        # The force must at least carry the weight across the tether: a lower bound on the apparent wind speed.
        base = float(functions.state(angle=0.0, arguments=arguments)["aerodynamic_force"])
        low = np.arctan(crosswind / radial)
        if base < probe["weight_across"]:
            low = max(low, np.arccos(np.sqrt(base / probe["weight_across"])))
        return low + 1e-9, np.pi / 2 - 1e-9
    force = arguments[-1]
    if control != "radial_ground_force" and force < probe["sag"]:
        raise NoEquilibriumError(
            f"{_where(place)}: a tether force of {force:.4g} N is less than the sag of the tether "
            f"alone asks for ({probe['sag']:.4g} N)",
            facts={**facts, "sag_N": probe["sag"]},
            reason="force_below_sag",
        )
    if probe["radial_ground_force"] < 0:
        raise _slack(place, facts, f"with {force:.4g} N")
    if crosswind >= probe["apparent_wind_speed"]:
        raise NoEquilibriumError(
            f"{_where(place)}: the wind across the course ({crosswind:.3g} m/s) is stronger than "
            f"the apparent wind that the force allows ({probe['apparent_wind_speed']:.3g} m/s)",
            facts={**facts, "crosswind_m_s": crosswind, "apparent_wind_speed_m_s": probe["apparent_wind_speed"]},
            reason="crosswind",
        )
    return float(np.arcsin(crosswind / probe["apparent_wind_speed"])) + 1e-9, np.pi / 2 - 1e-9


def _slack(place: OperatingPoint, facts: dict[str, Any], condition: str) -> NoEquilibriumError:
    return NoEquilibriumError(
        f"{_where(place)}: {condition} the tether is slack at the ground", facts=facts, reason="slack"
    )


def _no_root(residuals: np.ndarray, place: OperatingPoint, facts: dict[str, Any]) -> NoEquilibriumError:
    if residuals.size and residuals[-1] > 0:
        return NoEquilibriumError(
            f"{_where(place)}: gravity pulls the kite down faster than the air can carry it "
            "(its kinematic ratio tends to infinity)",
            facts=facts,
            reason="falling",
        )
    return NoEquilibriumError(
        f"{_where(place)}: the kite is too heavy for the lift it has on this course "
        "(its kinematic ratio tends to zero)",
        facts=facts,
        reason="too_heavy",
    )


def _where(place: OperatingPoint) -> str:
    return (
        f"at {place.tether_length_m:.4g} m of tether, {place.elevation_deg:.3g} deg elevation, "
        f"{place.azimuth_deg:.3g} deg azimuth, course {place.course_deg:.4g} deg"
    )
