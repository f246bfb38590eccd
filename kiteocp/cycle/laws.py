"""The prescribed cycle of the forward simulation: what the winch holds in each phase, and how the kite then moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import msgspec
import numpy as np

from kiteocp.cycle.motion import Motion, motion
from kiteocp.cycle.phases import KINDS, PHASES, FlownPhase, PhaseKind, PhaseName, phases_of
from kiteocp.physics.equilibrium import (
    OUTPUTS,
    equilibrium_functions,
    explicit_state,
    outputs_of,
    radial_ground_force_flying_down,
)
from kiteocp.physics.kinematics import radians
from kiteocp.physics.model import Coefficients, FlightState, LocalConditions, Model, Position
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure, parameters_of

#: How the equilibrium of a state is found: in closed form, or by `casadi.rootfinder` on the residual.
Equilibrium = Literal["explicit", "rootfinder"]

#: Components of the state that is integrated.
STATE = ("time_s", "tether_length_m", "elevation_rad", "energy_J")
TIME, LENGTH, ELEVATION, ENERGY = range(len(STATE))


class PhaseEnd(msgspec.Struct, frozen=True):
    """What ends a phase of the prescribed cycle: a component of the state reaches a number of the file.

    Attributes
    ----------
    component
        Index in `STATE`.
    key
        Key path of the number.
    factor
        From the unit of the file to that of the state.
    monotone
        Whether the component moves towards its end throughout, so that it can be stepped in instead of the time.
    """

    component: int
    key: str
    factor: float
    monotone: bool

    def value(self, values: ParameterValues) -> float:
        """Value of the component at which the phase ends."""
        return values[self.key] * self.factor


#: Each phase ends at a tether length or an elevation; the powered kite flying down or up, the latter is monotone.
PHASE_ENDS: dict[PhaseName, PhaseEnd] = {
    "retraction": PhaseEnd(LENGTH, "operation.tether_length_min_m", 1.0, False),
    "transition": PhaseEnd(ELEVATION, "operation.traction.elevation_deg", math.pi / 180, True),
    "traction": PhaseEnd(LENGTH, "operation.tether_length_max_m", 1.0, True),
    "turn": PhaseEnd(ELEVATION, "operation.turn.elevation_deg", math.pi / 180, True),
}


def traction_end(values: ParameterValues) -> np.ndarray:
    """Return the state in which the traction of the prescribed cycle ends, shape (4,)."""
    longest, elevation = (PHASE_ENDS[name].value(values) for name in ("traction", "transition"))
    return np.array([0.0, longest, elevation, 0.0])


def next_start(states: np.ndarray) -> np.ndarray:
    """Return the state in which the phase after one with these states, shape (n, 4), starts."""
    return np.array([0.0, states[-1, LENGTH], states[-1, ELEVATION], 0.0])


def flown_in_order(
    values: ParameterValues, run: Callable[[PhaseName, np.ndarray, float], np.ndarray]
) -> list[FlownPhase]:
    """Fly the phases of the prescribed cycle, each from where the one before ends.

    Where the traction ends is known, so that a turn, the last phase, is flown first.

    Parameters
    ----------
    values
        The problem's numbers.
    run
        From the name of a phase, the state it starts in, shape (4,), and the value at which it ends (`PHASE_ENDS`), to
        its states, shape (n, 4).

    Returns
    -------
    list of FlownPhase
        In the order of the cycle.
    """
    names, start = phases_of(values.structure), traction_end(values)
    flown: dict[PhaseName, FlownPhase] = {}
    for name in (*names[len(PHASES) :], *PHASES):
        flown[name] = FlownPhase(name, run(name, start, PHASE_ENDS[name].value(values)))
        start = next_start(flown[name].states)
    return [flown[name] for name in names]


class PhaseFunctions(msgspec.Struct, frozen=True):
    """CasADi functions of one phase under the prescribed law.

    ``rates(state, p)`` are the time derivatives of `STATE`; ``outputs(state, p)`` the quantities of `OUTPUTS`, stacked.
    """

    rates: ca.Function
    outputs: ca.Function


def prescribed_motion(model: Model, kind: PhaseKind, tether_length: Any, elevation: Any, law: Equilibrium) -> Motion:
    """Motion under the prescribed law: constant force, or zero reeling between the two forces in the transition.

    In the transition a state that has no equilibrium at zero reeling speed counts as slack, so that the kite reels in.
    """
    p = model.parameters
    reference = model.structure.choice("operation.force_reference")

    def equilibrium(model: Model, position: Position, around: LocalConditions) -> FlightState:
        coefficients = model.coefficients(kind.setting)

        def radial(key: str) -> Any:
            return model.radial_ground_force(around, p[f"operation.{key}.tether_force_N"], reference)

        if kind.name == "transition":
            at_rest = _force_at_rest(model, position, around, coefficients, law)
            force = ca.fmin(ca.fmax(at_rest, radial("retraction")), radial("traction"))
        else:
            force = radial(kind.name)
        # A force too small to lift the tether leaves it slack at the ground, which is no state: 0/0 there.
        force = force + ca.if_else(force < 0, np.nan, 0.0)
        if law == "explicit":
            return explicit_state(model, position, around, force)
        angle = _solved(model, position, around, coefficients, "radial_ground_force", force)
        return model.state_at_force(position, around, force, angle)

    return motion(model, kind, tether_length, elevation, equilibrium)


def _force_at_rest(
    model: Model, position: Position, around: LocalConditions, coefficients: Coefficients, equilibrium: Equilibrium
) -> Any:
    if equilibrium == "explicit":
        return radial_ground_force_flying_down(model, around, 0.0)
    angle = _solved(model, position, around, coefficients, "reeling_speed", 0.0)
    force = model.state_at_reeling_speed(position, around, 0.0, angle).radial_ground_force
    return ca.if_else(around.wind.radial > 0, force, -1.0)


def _solved(
    model: Model, position: Position, around: LocalConditions, coefficients: Coefficients, control: str, value: Any
) -> Any:
    """Inflow angle by `casadi.rootfinder`, started at the angle of the massless kite (eq:triangle_similarity)."""
    degrees = 1 / radians(1.0)
    heading = ca.atan2(position.course.sine, position.course.cosine) * degrees
    arguments = ca.vertcat(
        model.parameters.vector,
        position.tether_length,
        position.elevation * degrees,
        position.azimuth * degrees,
        heading,
        coefficients.lift,
        coefficients.kite_drag,
        value,
    )
    guess = ca.atan2(around.lift_coefficient, around.drag_coefficient)
    return equilibrium_functions(model.structure, control).solve(guess, arguments)


@lru_cache(maxsize=64)
def phase_functions(structure: Structure, name: PhaseName, equilibrium: Equilibrium = "explicit") -> PhaseFunctions:
    """Build (once) the functions of a phase under the prescribed law."""
    kind = KINDS[name]
    explicit = equilibrium == "explicit"
    # A rootfinder cannot be part of an SX expression.
    symbol: Any = ca.SX if explicit else ca.MX
    parameters = parameters_of(structure) if explicit else Parameters(structure, ca.MX)
    state = symbol.sym("state", len(STATE))
    length, elevation = state[LENGTH], state[ELEVATION]
    moved = prescribed_motion(Model(parameters), kind, length, elevation, equilibrium)
    rates = ca.vertcat(1.0, moved.flight.reeling_speed, moved.elevation_rate, moved.flight.power)
    outputs = outputs_of(moved.flight)
    return PhaseFunctions(
        ca.Function("rates", [state, parameters.vector], [ca.densify(rates)]),
        ca.Function("outputs", [state, parameters.vector], [ca.densify(ca.vertcat(*(outputs[n] for n in OUTPUTS)))]),
    )
