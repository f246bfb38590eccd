"""The gravity equilibrium (sections 2.6 and 2.7 of the paper): who solves the residual of a `FlightState`, and how.

The residual is the reference; `casadi.rootfinder` solves it for any azimuth and course, force or reeling speed given.
Two special cases have a form of their own, used where speed counts: with the force given the state is explicit
(`inflow_angle_at_force`), and straight down in the plane of the wind a reeling speed takes a few safe Newton steps
(`radial_ground_force_flying_down`). The paper's fixed-point iteration is a cross-check (`paper_iteration`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.physics.kinematics import Course, radians
from kiteocp.physics.model import Coefficients, FlightState, LocalConditions, Model, Position
from kiteocp.physics.parameters import Structure, parameters_of

#: Newton steps of `radial_ground_force_flying_down`: they converge monotonically and from there quadratically; six
#: leave less than 1e-12 where kite and tether weigh less than the aerodynamic force, eight wherever there is wind.
NEWTON_STEPS = 8

#: Arguments of the numeric functions below, in order, after the parameter vector.
POSITION_ARGUMENTS = ("tether_length_m", "elevation_deg", "azimuth_deg", "course_deg", "lift_coefficient", "kite_drag")


class ExplicitEquilibrium(msgspec.Struct, frozen=True):
    """Closed form of a force-controlled state: the inflow angle, and what must be positive for it to exist."""

    inflow_angle: Any
    crosswind_margin: Any
    drag_angle_margin: Any
    forward_margin: Any
    radial_margin: Any


def inflow_angle_at_force(
    model: Model, position: Position, around: LocalConditions, radial_ground_force: Any
) -> ExplicitEquilibrium:
    """Solve the equilibrium of a given radial ground force without iteration.

    With the force given, the aerodynamic force and so the magnitude of the apparent wind are known. Its direction u
    is a unit vector whose component across the course is the wind's, and whose angle to the force is that of the drag:
    a line cut with a sphere. Of the two points the one moving forward through the air is taken (the larger root of
    eq:lambda). Where one of the margins is not positive there is no equilibrium.
    """
    radial = radial_ground_force + around.weight_along
    across = around.weight_across
    force = ca.sqrt(radial**2 + across**2)
    speed = model.apparent_wind_speed_of_force(around, force)
    u_across = around.wind.across_course / speed
    # Force along the course, and what the angle to the drag leaves for the plane of tether and course.
    along = -across * position.course.cosine
    target = force * around.drag_coefficient / around.resultant_coefficient - across * position.course.sine * u_across
    in_plane = 1 - u_across**2
    magnitude_squared = radial**2 + along**2
    radicand = in_plane - target**2 / magnitude_squared
    swing = ca.sqrt(radicand / magnitude_squared)
    u_along = target * along / magnitude_squared - swing * radial
    u_radial = target * radial / magnitude_squared + swing * along
    return ExplicitEquilibrium(
        inflow_angle=ca.atan2(ca.sqrt(u_along**2 + u_across**2), u_radial),
        crosswind_margin=in_plane,
        drag_angle_margin=radicand,
        forward_margin=-u_along,
        radial_margin=u_radial,
    )


def explicit_state(model: Model, position: Position, around: LocalConditions, radial_ground_force: Any) -> FlightState:
    """Flight state of a given radial ground force by the closed form; not a number where there is none."""
    solution = inflow_angle_at_force(model, position, around, radial_ground_force)
    # 0/0 outside the domain: a kite that would fall back through the air must not pass for a state.
    exists = ca.logic_and(solution.forward_margin > 0, solution.radial_margin > 0)
    angle = solution.inflow_angle + ca.if_else(exists, 0.0, np.nan)
    return model.state_at_force(position, around, radial_ground_force, angle)


def radial_ground_force_flying_down(model: Model, around: LocalConditions, reeling_speed: Any) -> Any:
    """Radial ground force (N) of a kite flying straight down in the plane of the wind at a given reeling speed (m/s).

    Let delta be the angle of force and apparent wind, epsilon that of the force to the tether, W the weight across it
    and K the aerodynamic force of the radial wind alone. Then ``W cos(delta + epsilon)^2 = K sin(epsilon)``; in
    ``q = sqrt(sin(epsilon))`` the difference of the square roots is concave and falls, and Newton's method from the
    right is monotone. Minus infinity where the kite reels out faster than the wind blows along the tether.
    """
    delta = ca.atan2(around.lift_coefficient, around.drag_coefficient)
    radial_wind = ca.fmax(around.wind.radial - reeling_speed, 1e-9)
    root_weight = ca.sqrt(around.weight_across)
    root_force = ca.sqrt(model.aerodynamic_force(around, radial_wind))
    q = ca.fmin(ca.sqrt(ca.cos(delta)), root_weight * ca.cos(delta) / root_force)
    for _ in range(NEWTON_STEPS):
        epsilon = ca.asin(q**2)
        value = root_weight * ca.cos(delta + epsilon) - root_force * q
        slope = -root_weight * ca.sin(delta + epsilon) * 2 * q / ca.cos(epsilon) - root_force
        q = q - value / slope
    epsilon = ca.asin(q**2)
    force = (root_force / ca.cos(delta + epsilon)) ** 2
    radial = force * ca.cos(epsilon) - around.weight_along
    return ca.if_else(around.wind.radial > reeling_speed, radial, -np.inf)


def weight_share_flying_up(model: Model, around: LocalConditions, radial_wind: Any, share_of_angle: Any) -> Any:
    """Share of the weight across the tether that a kite flying straight up carries, its tether pulling at the ground.

    With delta the angle of force and apparent wind and epsilon that of the force to the tether, the apparent wind is
    at ``delta - epsilon`` to the tether: the force ``K / cos(delta - epsilon)^2`` follows, K being that of the radial
    wind alone, and ``sin(epsilon)`` of it is across the tether. The tether does not push, so epsilon is at most the
    angle of the weight to the tether. A state exists where the share is one for some epsilon; where it is less than
    one for all, there is none, whatever the force.

    Parameters
    ----------
    model, around
        The model, and its local conditions on a course straight up in the plane of the wind.
    radial_wind
        Wind along the tether less the reeling speed, m/s; at least zero.
    share_of_angle
        The angle epsilon as a share, 0 to 1, of the largest that it can have.
    """
    delta = ca.atan2(around.lift_coefficient, around.drag_coefficient)
    epsilon = share_of_angle * ca.fmin(delta, ca.atan2(around.weight_across, around.weight_along))
    force = model.aerodynamic_force(around, radial_wind) / ca.cos(delta - epsilon) ** 2
    return force * ca.sin(epsilon) / around.weight_across


def paper_iteration(
    model: Model, position: Position, around: LocalConditions, reeling_factor: Any, iterations: int = 200
) -> Any:
    """Kinematic ratio by the paper's fixed-point iteration (eq:kappa_iteration); a cross-check, not the solver."""
    target = around.lift_coefficient / around.drag_coefficient
    kappa = target
    for _ in range(iterations):
        state = model.state_at_reeling_speed(position, around, reeling_factor * around.wind_speed, ca.atan(kappa))
        # The residual is the cosine of eq:F_a_projection less that of the drag.
        cosine = state.residual + around.drag_coefficient / around.resultant_coefficient
        kappa = kappa * ca.sqrt(target / ca.sqrt(1 / cosine**2 - 1))
    return kappa


class EquilibriumFunctions(msgspec.Struct, frozen=True):
    """CasADi functions of one structure with a state's control (force or speed) given.

    ``residual(angle, p, position..., control)``, ``solve(guess, p, position..., control)`` with `casadi.rootfinder`,
    and ``state(angle, ...)`` with the outputs of `OUTPUTS`.
    """

    residual: ca.Function
    solve: ca.Function
    state: ca.Function


#: Outputs of `EquilibriumFunctions.state`, attributes of `FlightState` or of its local conditions.
OUTPUTS = (
    "height",
    "wind_speed",
    "wind_along_tether",
    "wind_across_course",
    "air_density",
    "reeling_speed",
    "tangential_speed",
    "kite_speed",
    "apparent_wind_speed",
    "radial_apparent_wind_speed",
    "kinematic_ratio",
    "reeling_factor",
    "tangential_speed_factor",
    "forward_airspeed_ratio",
    "aerodynamic_force",
    "radial_ground_force",
    "tether_force_kite",
    "tether_force_ground",
    "power",
    "electrical_power",
    "residual",
    "sag",
    "weight_across",
    "drag_coefficient",
    "resultant_coefficient",
    "inflow_angle",
)


def outputs_of(state: FlightState) -> dict[str, Any]:
    """Return the quantities of `OUTPUTS` by name."""
    return {name: getattr(state, name) if hasattr(state, name) else getattr(state.conditions, name) for name in OUTPUTS}


@lru_cache(maxsize=32)
def equilibrium_functions(structure: Structure, control: str) -> EquilibriumFunctions:
    """Build (once) the functions that solve the equilibrium by `casadi.rootfinder`.

    Parameters
    ----------
    structure
        Structure of the problem.
    control
        What is given: ``tether_force_kite``, ``tether_force_ground``, ``radial_ground_force`` (N),
        ``reeling_speed`` (m/s) or ``reeling_factor``.
    """
    parameters = parameters_of(structure)
    model = Model(parameters)
    angle, value = ca.SX.sym("inflow_angle"), ca.SX.sym(control)
    place = [ca.SX.sym(name) for name in POSITION_ARGUMENTS]
    length, elevation, azimuth, course, lift, kite_drag = place
    # A course of exactly 0 or 180 deg has a sine of exactly zero: the kite then stays in the plane of the wind.
    straight = ca.fmod(ca.fabs(course), 180) == 0
    heading = Course(ca.cos(radians(course)), ca.if_else(straight, 0.0, ca.sin(radians(course))))
    position = Position(length, radians(elevation), radians(azimuth), heading)
    around = model.conditions(position, Coefficients(lift, kite_drag))
    if control in ("reeling_speed", "reeling_factor"):
        speed = value * around.wind_speed if control == "reeling_factor" else value
        state = model.state_at_reeling_speed(position, around, speed, angle)
    else:
        radial = value
        if control != "radial_ground_force":
            radial = model.radial_ground_force(around, value, control.removeprefix("tether_force_"))
        state = model.state_at_force(position, around, radial, angle)
    arguments = ca.vertcat(parameters.vector, *place, value)
    residual = ca.Function("residual", [angle, arguments], [state.residual])
    solve = ca.rootfinder(
        "equilibrium",
        "newton",
        {"x": angle, "p": arguments, "g": state.residual},
        {
            "abstol": 1e-14,
            "max_iter": 50,
            "line_search": True,
            # A state without equilibrium is an answer: not a number, no exception and nothing on the terminal.
            "error_on_fail": False,
            "show_eval_warnings": False,
        },
    )
    outputs = outputs_of(state)
    values = ca.Function("state", [angle, arguments], list(outputs.values()), ["angle", "arguments"], list(outputs))
    return EquilibriumFunctions(residual, solve, values)
