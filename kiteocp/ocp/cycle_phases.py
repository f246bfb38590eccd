"""The phases of the optimal cycle: variables, dynamics, equilibrium and limits of each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kiteocp.cycle.limits import SCALES, bounds_of, is_infinite, limited_outputs, limits_of
from kiteocp.cycle.phases import TRACTION, PhaseKind
from kiteocp.ocp.declaration import (
    PathConstraint,
    Phase,
    Point,
    PointExpressions,
    RateLimit,
    Residual,
    Static,
    Variable,
)
from kiteocp.physics import kinematics
from kiteocp.physics.equilibrium import inflow_angle_at_force, outputs_of
from kiteocp.physics.kinematics import Course
from kiteocp.physics.model import Model, Position

if TYPE_CHECKING:
    from kiteocp.ocp.formulation import Formulation

#: Algebraics and controls that the reeling speed depends on: where they jump inside a phase, the speed would.
CONTINUOUS = frozenset({"inflow_angle", "radial_ground_force", "power_setting", "course"})


class PhaseBuilder:
    """The phases of one problem, which share model, parameters and limits.

    Attributes
    ----------
    parameters
        Those of the model.
    traction_start, traction_end
        Elevation at both ends of the traction, once its phase is declared.
    """

    def __init__(self, model: Model, formulation: Formulation) -> None:
        self.parameters = model.parameters
        self.model = model
        self.formulation = formulation
        self.implicit = formulation.equilibrium == "implicit"
        self.limits = limits_of(model.parameters.structure)
        self.traction_start: Any = None
        self.traction_end: Any = None

    def variable(self, name: str, phase: PhaseKind) -> Variable:
        """Return a variable with the limits of its quantity."""
        lower, upper = bounds_of(self.limits, self.parameters, phase.name, name)
        if name == "elevation" and phase is not TRACTION:
            # No limit of its own: the lowest height, which is not below the ground, implies it.
            lower = 0.0
        return Variable(name, lower, upper, SCALES[name], continuous=name in CONTINUOUS)

    def plane_phase(self, kind: PhaseKind) -> Phase:
        """Retraction or transition: straight up or down in the plane of the wind."""

        def model(point: Point) -> PointExpressions:
            position = kind.position(self.model, point["tether_length"], point["elevation"])
            return self.expressions(
                kind,
                point,
                position,
                lambda speed: kinematics.elevation_rate(speed, position.course, point["tether_length"]),
            )

        return self.phase(kind, model, [self.variable("elevation", kind)])

    def traction_phase(self) -> tuple[Phase, list[Static]]:
        """Crosswind flight at a mean state, its elevation constant, linear in time, free, or tied to the course."""
        mode = self.formulation.traction_elevation
        states, controls, statics = [], [], []
        elevation_variable = self.variable("elevation", TRACTION)
        if mode == "constant":
            statics = [Static("elevation", elevation_variable.lower, elevation_variable.upper)]
        else:
            states = [elevation_variable]
        if mode == "linear":
            statics = [Static("elevation_rate", scale=SCALES["elevation_rate"])]
        elif mode == "free":
            controls = [self.variable("elevation_rate", TRACTION)]
        elif mode == "course-coupled":
            controls = [self.variable("course", TRACTION)]
        fixed = {static.name: static.symbol for static in statics}

        def model(point: Point) -> PointExpressions:
            length = point["tether_length"]
            elevation = fixed["elevation"] if mode == "constant" else point["elevation"]
            nominal = TRACTION.position(self.model, length, elevation)
            if mode != "course-coupled":
                rate = fixed.get("elevation_rate", point.values.get("elevation_rate"))
                return self.expressions(TRACTION, point, nominal, lambda _: rate)
            course = Course.of_angle(point["course"])
            # At the mean course of the file the manoeuvre is closed and keeps its elevation; any other makes it climb.
            drift = Course(course.cosine - nominal.course.cosine, 0.0)
            position = Position(length, elevation, nominal.azimuth, course)
            return self.expressions(
                TRACTION, point, position, lambda speed: kinematics.elevation_rate(speed, drift, length)
            )

        phase = self.phase(TRACTION, model, states, controls)
        if mode == "constant":
            self.traction_start = self.traction_end = fixed["elevation"]
        else:
            self.traction_start, self.traction_end = phase.start["elevation"], phase.end["elevation"]
        return phase, statics

    def phase(
        self,
        kind: PhaseKind,
        model: Any,
        states: list[Variable],
        controls: list[Variable] | None = None,
    ) -> Phase:
        """Declare what all phases share: tether length, force, inflow angle, and the acceleration of the winch."""
        controls = [self.variable("radial_ground_force", kind), *(controls or [])]
        if self.formulation.schedules_power_setting(kind):
            controls.append(self.variable("power_setting", kind))
        return Phase(
            kind.name,
            duration=self.variable("duration", kind),
            states=[self.variable("tether_length", kind), *states],
            algebraics=[self.variable("inflow_angle", kind)] if self.implicit else [],
            controls=controls,
            model=model,
            rate_limits=[
                RateLimit(limit.key, limit.quantity, *limit.bounds(self.parameters))
                for limit in self.limits
                if limit.rate and kind.name in limit.phases
            ],
        )

    def expressions(self, kind: PhaseKind, point: Point, position: Position, elevation_rate: Any) -> PointExpressions:
        """Dynamics, equilibrium and limits at a point."""
        setting = point["power_setting"] if self.formulation.schedules_power_setting(kind) else kind.setting
        around = self.model.surroundings(position, self.model.coefficients(setting))
        force = point["radial_ground_force"]
        if self.implicit:
            inflow_angle = point["inflow_angle"]
        else:
            inflow_angle = inflow_angle_at_force(self.model, position, around, force).inflow_angle
        state = self.model.state_at_force(position, around, force, inflow_angle)
        # What is a variable is not an output as well: every name has one meaning.
        outputs = {name: value for name, value in outputs_of(state).items() if name not in point.values}
        derivatives = {"tether_length": state.reeling_speed}
        if "elevation" in point.values:
            derivatives["elevation"] = elevation_rate(state.tangential_speed)
        constraints = []
        for quantity in limited_outputs(self.model.structure, kind.name):
            # A variable has its bounds already.
            if quantity in point.values:
                continue
            lower, upper = bounds_of(self.limits, self.parameters, kind.name, quantity)
            if not (is_infinite(lower) and is_infinite(upper)):
                constraints.append(PathConstraint(quantity, outputs[quantity], lower, upper, SCALES[quantity]))
        residuals = [Residual("equilibrium", state.residual)] if self.implicit else []
        return PointExpressions(derivatives, residuals, constraints, outputs)
