"""How a phase moves: position, local conditions, equilibrium and rates put together, once for all who need them.

Programs, laws, schedules, winch laws and replays differ in what they know of a state - a force, a speed, an unknown of
the solver - and so hand in the equilibrium as a function; where the kite is, what it meets and how its elevation
changes is the same for all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from kiteocp.cycle.phases import PhaseKind
from kiteocp.physics import kinematics
from kiteocp.physics.equilibrium import explicit_state
from kiteocp.physics.kinematics import Course
from kiteocp.physics.model import FlightState, LocalConditions, Model, Position

#: From model, position and local conditions to the flight state.
Equilibrium = Callable[[Model, Position, LocalConditions], FlightState]


class Motion(msgspec.Struct, frozen=True):
    """A flight state and where it leads.

    Attributes
    ----------
    flight
        The state.
    elevation_rate
        Rate of the (mean) elevation, rad/s; the tether length changes with ``flight.reeling_speed``.
    """

    flight: FlightState
    elevation_rate: Any


def motion(
    model: Model,
    kind: PhaseKind,
    tether_length: Any,
    elevation: Any,
    equilibrium: Equilibrium,
    *,
    power_setting: Any = None,
    course: Any = None,
    azimuth: Any = None,
    elevation_rate: Any = None,
) -> Motion:
    """Return the motion of a phase at a place.

    Parameters
    ----------
    model, kind
        The model and the phase.
    tether_length, elevation
        Where the kite is, m and rad.
    equilibrium
        What solves the state there, as `at_force`.
    power_setting
        0 depowered to 1 powered; that of the phase where left out.
    course
        Mean course of crosswind flight, rad; that of the file, at which the manoeuvre is closed and keeps its
        elevation, where left out. Any other makes the manoeuvre climb or sink by the component that is left.
    azimuth
        Azimuth of crosswind flight, rad; that of the file where left out.
    elevation_rate
        Rate of the mean elevation of crosswind flight, rad/s, where it is steered itself; zero where left out.
    """
    position = nominal = kind.position(model, tether_length, elevation)
    if course is not None or azimuth is not None:
        heading = nominal.course if course is None else Course.of_angle(course)
        position = Position(tether_length, elevation, nominal.azimuth if azimuth is None else azimuth, heading)
    setting = kind.setting if power_setting is None else power_setting
    around = model.conditions(position, model.coefficients(setting))
    flight = equilibrium(model, position, around)
    if kind.course is not None:
        drift = kind.course
    elif course is not None:
        drift = Course(position.course.cosine - nominal.course.cosine, 0.0)
    else:
        return Motion(flight, 0.0 if elevation_rate is None else elevation_rate)
    return Motion(flight, kinematics.elevation_rate(flight.tangential_speed, drift, tether_length))


def at_force(force: Callable[[Model, LocalConditions], Any]) -> Equilibrium:
    """Return the closed form at a radial ground force (N), a function of model and local conditions."""
    return lambda model, position, around: explicit_state(model, position, around, force(model, around))


def at_ground_force(tether_force: Any) -> Equilibrium:
    """Return the closed form at a tether force that is measured at the ground, N."""
    return at_force(lambda model, around: model.radial_ground_force(around, tether_force, "ground"))
