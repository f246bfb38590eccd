"""The optimal pumping cycle as an optimal control problem of three phases.

States are tether length and elevation, the control is the radial tether force at the ground, and the inflow angle of
the equilibrium is an algebraic variable whose residual must vanish at every collocation point. All numbers of the
problem file are parameters: the program is built once for a structure and solved for any numbers.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from kiteocp.cycle.phases import PHASE_CHANGES, PHASES, RETRACTION, TRACTION, TRANSITION, PhaseKind
from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.declaration import (
    Link,
    OptimalControlProblem,
    PathConstraint,
    Phase,
    Point,
    PointExpressions,
    RateLimit,
    Residual,
    Static,
    Variable,
)
from kiteocp.ocp.limits import SCALES, PathLimit, bounds_of, path_limits
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.transcription import transcribe
from kiteocp.physics import kinematics
from kiteocp.physics.equilibrium import inflow_angle_at_force, outputs_of
from kiteocp.physics.kinematics import Course, radians
from kiteocp.physics.model import Model, Position
from kiteocp.physics.parameters import Parameters, Structure, parameters_of
from kiteocp.problem import Problem

#: Bounds of the inflow angle. Near 0 the kite stands still in the air, near pi/2 the tether is slack: the steady states
#: end there (a kinematic ratio of 0.03 and 200).
INFLOW_ANGLE = (0.03, float(np.arctan(200.0)))

#: Least square of the apparent wind along the course over that of the wind, where the tangential speed has two roots.
DISCRIMINANT_MIN = 1e-3

#: Shortest retraction and transition, s; below, a phase has no meaning.
SHORTEST = {"retraction": 0.5, "transition": 0.2}
LONGEST_S = 3600.0

#: Rounding of the electrical power at zero, where generator and motor meet, W.
POWER_ROUNDING_W = 10.0


@dataclass(frozen=True)
class Formulation:
    """What beside the structure of the problem shapes the program: the choices of its ``optimisation`` block.

    Attributes
    ----------
    objective
        ``mechanical`` or ``electrical`` mean power.
    traction_elevation
        ``constant``, ``linear``, ``course-coupled`` or ``free``.
    power_setting
        ``fixed``, ``traction`` or ``all``.
    speed_jumps
        ``free``, or ``limited`` to what the winch can do in the phase-change time.
    equilibrium
        ``implicit``: the inflow angle is a variable and its residual a constraint; ``explicit``: the closed form of the
        force-controlled state takes their place, fewer variables for the same optimum.
    intervals
        Mesh intervals of retraction, transition and traction.
    degree
        Collocation points per interval.
    interval_fractions
        Shares of the intervals in each of these phases, where they are not equal.
    """

    objective: str
    traction_elevation: str
    power_setting: str
    speed_jumps: str
    equilibrium: str
    intervals: tuple[int, int, int]
    degree: int
    interval_fractions: tuple[tuple[float, ...], ...] | None = None

    @classmethod
    def of(cls, problem: Problem) -> Formulation:
        """Formulation that a problem file asks for."""
        given, mesh = problem.optimisation, problem.optimisation.mesh
        intervals = (mesh.retraction_intervals, mesh.transition_intervals, mesh.traction_intervals)
        return cls(
            given.objective,
            given.traction_elevation,
            given.power_setting,
            given.speed_jumps,
            given.equilibrium,
            intervals,
            mesh.degree,
        )

    @property
    def points(self) -> int:
        """Collocation points of the whole mesh."""
        return sum(self.intervals) * self.degree

    def plain(self) -> Formulation:
        """Return the formulation of least freedom: constant elevation, fixed power setting."""
        return replace(self, traction_elevation="constant", power_setting="fixed")

    def refined(self) -> Formulation:
        """Return the same on a mesh of half the intervals' length."""
        if self.interval_fractions is not None:
            return self.on_mesh({name: mesh.refined() for name, mesh in self.mesh.items()})
        first, second, third = self.intervals
        return replace(self, intervals=(2 * first, 2 * second, 2 * third))

    def on_mesh(self, mesh: Mapping[str, PhaseMesh]) -> Formulation:
        """Return the same on any mesh, of intervals of any length."""
        first, second, third = (mesh[name].interval_fractions for name in PHASES)
        return replace(self, intervals=(len(first), len(second), len(third)), interval_fractions=(first, second, third))

    @property
    def mesh(self) -> dict[str, PhaseMesh]:
        """Mesh of each phase."""
        if self.interval_fractions is not None:
            return {
                name: PhaseMesh(self.degree, fractions)
                for name, fractions in zip(PHASES, self.interval_fractions, strict=True)
            }
        return {
            name: PhaseMesh.uniform(intervals=count, degree=self.degree)
            for name, count in zip(PHASES, self.intervals, strict=True)
        }

    def schedules_power_setting(self, kind: PhaseKind) -> bool:
        """Whether the kite's power setting is a control of the phase."""
        return self.power_setting != "fixed" and (
            kind is TRACTION or (kind is RETRACTION and self.power_setting == "all")
        )


@lru_cache(maxsize=16)
def cycle_program(structure: Structure, formulation: Formulation) -> NonlinearProgram:
    """Build (once) the nonlinear program of the optimal cycle."""
    return transcribe(cycle_problem(structure, formulation), formulation.mesh)


def cycle_problem(structure: Structure, formulation: Formulation) -> OptimalControlProblem:
    """Declare the optimal control problem: phases, links between them, and the mean power to be maximised."""
    builder = _Builder(parameters_of(structure), formulation)
    retraction, transition = builder.plane_phase(RETRACTION), builder.plane_phase(TRANSITION)
    traction, statics = builder.traction_phase()
    phases = [retraction, transition, traction]
    links = [
        Link(
            f"tether length at the end of the {before.name}",
            after.start["tether_length"] - before.end["tether_length"],
            scale=SCALES["tether_length"],
        )
        for before, after in itertools.pairwise([*phases, retraction])
    ]
    links += [
        Link("elevation at the end of the retraction", transition.start["elevation"] - retraction.end["elevation"]),
        Link("elevation at the end of the transition", transition.end["elevation"] - builder.traction_start),
        Link("elevation at the end of the traction", retraction.start["elevation"] - builder.traction_end),
    ]
    p = builder.parameters
    if "limits.stroke_min_m" in p:
        stroke = traction.end["tether_length"] - traction.start["tether_length"]
        links.append(Link("limits.stroke_min_m", stroke, p["limits.stroke_min_m"], np.inf, scale=100.0))
    if formulation.speed_jumps == "limited":
        allowed = p["limits.reeling_acceleration_max_m_s2"] * p["limits.phase_change_time_s"]
        links += [
            Link(
                f"speed jump after the {before.name}",
                after.first["reeling_speed"] - before.end["reeling_speed"],
                -allowed,
                allowed,
                scale=SCALES["reeling_speed"],
            )
            for before, after in itertools.pairwise([*phases, retraction])
        ]
    energy = sum(phase.integral["objective_power"] for phase in phases)
    time = sum(phase.duration for phase in phases) + PHASE_CHANGES * p["limits.phase_change_time_s"]
    return OptimalControlProblem(
        phases, objective=-energy / time / SCALES["power"], links=links, statics=statics, parameters=p.vector
    )


#: Limits that most optima keep by themselves, by phase; the solver looks at them only after a first solution.
DEFERRED: dict[str, tuple[str, ...]] = {
    "retraction": ("tether_force_kite", "power", "height"),
    "transition": ("power", "height"),
    "traction": ("tether_force_ground", "height", "forward flight"),
}


def deferred_rows(program: NonlinearProgram) -> list[int]:
    """Return the rows that a first solution may leave out: rate limits and those of `DEFERRED`."""
    rows = list(program.find_rows(kind="rate"))
    for phase, names in DEFERRED.items():
        for name in names:
            rows += list(program.find_rows(phase=phase, kind="path", name=name))
    return sorted(int(row) for row in rows)


class _Builder:
    """The phases of one problem, which share parameters and limits."""

    def __init__(self, parameters: Parameters, formulation: Formulation) -> None:
        self.parameters = parameters
        self.model = Model(parameters)
        self.formulation = formulation
        self.implicit = formulation.equilibrium == "implicit"
        self.limits: list[PathLimit] = path_limits(parameters.structure)
        self.traction_start: Any = None
        self.traction_end: Any = None

    def variable(self, name: str, phase: PhaseKind, quantity: str | None = None) -> Variable:
        """Return a state with the limits of its quantity; an elevation is at least zero."""
        quantity = quantity or name
        lower, upper = bounds_of(self.limits, self.parameters, phase.name, quantity)
        if quantity == "elevation" and phase is not TRACTION:
            lower = 0.0
        return Variable(name, lower, upper, SCALES[quantity])

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

        return self.phase(
            kind, model, [self.variable("elevation", kind)], Variable("duration", SHORTEST[kind.name], LONGEST_S, 10.0)
        )

    def traction_phase(self) -> tuple[Phase, list[Static]]:
        """Crosswind flight at a mean state, its elevation constant, linear in time, free, or tied to the course."""
        mode, p = self.formulation.traction_elevation, self.parameters
        duration = Variable("duration", p["limits.traction_duration_min_s"], LONGEST_S, 10.0)
        rate_max = radians(p["limits.traction_elevation_rate_max_deg_s"])
        states, controls, statics = [], [], []
        elevation_variable = self.variable("elevation", TRACTION)
        if mode == "constant":
            statics = [Static("elevation", elevation_variable.lower, elevation_variable.upper)]
        else:
            states = [elevation_variable]
        if mode == "linear":
            statics = [Static("elevation_rate", scale=0.01)]
        elif mode == "free":
            controls = [Variable("elevation_rate", -rate_max, rate_max, 0.01)]
        elif mode == "course-coupled":
            controls = [Variable("course", 0.0, np.pi)]
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

        phase = self.phase(TRACTION, model, states, duration, controls)
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
        duration: Variable,
        controls: list[Variable] | None = None,
    ) -> Phase:
        """Declare what all phases share: tether length, force, inflow angle, and the acceleration of the winch."""
        acceleration = self.parameters["limits.reeling_acceleration_max_m_s2"]
        controls = [Variable("radial_ground_force", 0.0, np.inf, SCALES["radial_ground_force"]), *(controls or [])]
        if self.formulation.schedules_power_setting(kind):
            controls.append(Variable("power_setting", 0.0, 1.0))
        return Phase(
            kind.name,
            duration=duration,
            states=[self.variable("tether_length", kind), *states],
            algebraics=[Variable("inflow_angle", *INFLOW_ANGLE)] if self.implicit else [],
            controls=controls,
            model=model,
            rate_limits=[
                RateLimit("limits.reeling_acceleration_max_m_s2", "reeling_speed", -acceleration, acceleration)
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
        outputs["objective_power"] = self.objective_power(state.power)
        derivatives = {"tether_length": state.reeling_speed}
        if "elevation" in point.values:
            derivatives["elevation"] = elevation_rate(state.tangential_speed)
        constraints = []
        for quantity in ("tether_force_kite", "tether_force_ground", "reeling_speed", "power", "height"):
            lower, upper = bounds_of(self.limits, self.parameters, kind.name, quantity)
            if not (_infinite(lower) and _infinite(upper)):
                constraints.append(PathConstraint(quantity, outputs[quantity], lower, upper, SCALES[quantity]))
        if kind.course is None:
            forward = (around.wind.along_course - state.tangential_speed) / around.wind_speed
            constraints.append(PathConstraint("forward flight", forward**2, DISCRIMINANT_MIN, np.inf))
        if not self.implicit:
            constraints.append(PathConstraint("inflow angle", inflow_angle, *INFLOW_ANGLE))
        residuals = [Residual("equilibrium", state.residual)] if self.implicit else []
        return PointExpressions(derivatives, residuals, constraints, outputs)

    def objective_power(self, power: Any) -> Any:
        """Power that the objective integrates: mechanical, or electrical behind generator and motor."""
        if self.formulation.objective == "mechanical":
            return power
        p = self.parameters
        generator, motor = p["machine.generator_efficiency"], 1 / p["machine.motor_efficiency"]
        rounded = ca.sqrt(power**2 + POWER_ROUNDING_W**2) - POWER_ROUNDING_W
        return 0.5 * (generator + motor) * power - 0.5 * (motor - generator) * rounded


def _infinite(bound: Any) -> bool:
    return isinstance(bound, float) and not np.isfinite(bound)
