"""The phases of the optimal cycle: variables, dynamics, equilibrium and limits of each."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import casadi as ca

from kiteocp.cycle.limits import SCALES, bounds_of, is_infinite, limited_outputs, limits_of
from kiteocp.cycle.motion import motion
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
from kiteocp.physics.equilibrium import inflow_angle_at_force, outputs_of
from kiteocp.physics.model import FlightState, LocalConditions, Model, Position

if TYPE_CHECKING:
    from kiteocp.optimum.program import Formulation

#: Shortest duration of a phase that the program knows, s: one that vanishes lasts so long.
SHORTEST_S = 1e-3

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
        if name == "duration":
            # Rates are differences over time: a phase of no time has none.
            lower = ca.fmax(lower, SHORTEST_S)
        if name == "elevation" and phase is not TRACTION:
            # No limit of its own: the lowest height, which is not below the ground, implies it.
            lower = 0.0
        return Variable(name, lower, upper, SCALES[name], continuous=name in CONTINUOUS)

    def plane_phase(self, kind: PhaseKind) -> Phase:
        """Retraction, transition or turn: straight up or down in the plane of the wind."""

        def model(point: Point) -> PointExpressions:
            return self.expressions(kind, point, point["elevation"])

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
            elevation = fixed["elevation"] if mode == "constant" else point["elevation"]
            rate = fixed.get("elevation_rate", point.values.get("elevation_rate"))
            return self.expressions(TRACTION, point, elevation, rate)

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

    def expressions(
        self, kind: PhaseKind, point: Point, elevation: Any, elevation_rate: Any = None
    ) -> PointExpressions:
        """Dynamics, equilibrium and limits at a point."""
        moved = motion(
            self.model,
            kind,
            point["tether_length"],
            elevation,
            partial(self.equilibrium, point),
            power_setting=point.values.get("power_setting"),
            course=point.values.get("course"),
            elevation_rate=elevation_rate,
        )
        state = moved.flight
        # What is a variable is not an output as well: every name has one meaning.
        outputs = {name: value for name, value in outputs_of(state).items() if name not in point.values}
        derivatives = {"tether_length": state.reeling_speed}
        if "elevation" in point.values:
            derivatives["elevation"] = moved.elevation_rate
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

    def equilibrium(self, point: Point, model: Model, position: Position, around: LocalConditions) -> FlightState:
        """State at the force of a point, its inflow angle an unknown of the program or in closed form."""
        force = point["radial_ground_force"]
        if self.implicit:
            return model.state_at_force(position, around, force, point["inflow_angle"])
        angle = inflow_angle_at_force(model, position, around, force).inflow_angle
        return model.state_at_force(position, around, force, angle)
