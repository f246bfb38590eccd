"""The paper's laws with a flown cycle's own boundary conditions: every phase from where it began to where it ended.

Retraction, turn and traction hold their mean force at the ground, the transition rests between two forces. The turn
from reel-out to reel-in has no phase in the model: the winch still reels out under the force of the traction while the
kite climbs. It is flown as a phase of its own, powered and straight up; in a closed cycle it belongs to the traction.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import msgspec
import numpy as np

from kiteocp.cycle.laws import STATE, phase_functions
from kiteocp.cycle.motion import at_ground_force, motion
from kiteocp.cycle.phases import TURN
from kiteocp.cycle.simulation import LONGEST_PHASE, STATE_SCALES
from kiteocp.errors import CycleError
from kiteocp.numerics.integrator import IntegrationError, Integrator
from kiteocp.physics.equilibrium import OUTPUTS, outputs_of
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameters_of
from kiteocp.studies.prediction.measured import MeasuredCycle, MeasuredPhase

#: Where the state of the model is known by these names.
LENGTH, ELEVATION = STATE.index("tether_length_m"), STATE.index("elevation_rad")

#: Parts of an integrator's step between samples.
PARTS = 8


class FlownLaw(msgspec.Struct, frozen=True):
    """A phase flown by its law.

    Attributes
    ----------
    time_s, tether_length_m, elevation_deg, reeling_speed_m_s, force_N
        Samples over the phase, shape (n,); the force at the ground.
    """

    time_s: np.ndarray
    tether_length_m: np.ndarray
    elevation_deg: np.ndarray
    reeling_speed_m_s: np.ndarray
    force_N: np.ndarray

    def summary(self) -> dict[str, float]:
        """Return duration, mean force, power and speed, reeled length and the elevation reached."""
        duration = float(self.time_s[-1])
        power = float(np.trapezoid(self.force_N * self.reeling_speed_m_s, self.time_s)) / duration
        return {
            "duration_s": duration,
            "mean_force_N": float(np.trapezoid(self.force_N, self.time_s)) / duration,
            "mean_power_W": power,
            "mean_reeling_speed_m_s": float(self.tether_length_m[-1] - self.tether_length_m[0]) / duration,
            "reeled_length_m": float(self.tether_length_m[-1] - self.tether_length_m[0]),
            "elevation_end_deg": float(self.elevation_deg[-1]),
        }


def operation_of(cycle: MeasuredCycle) -> dict[str, float | str]:
    """Return the ``operation`` keys of a problem that prescribe a flown cycle: lengths, mean forces, mean state.

    The longest tether is that at the end of reel-out (the turn included), the shortest that at the end of reel-in.
    """
    traction, retraction = cycle.phases["traction"], cycle.phases["retraction"]
    lengths = [length for p in cycle.phases.values() for length in (p.tether_length_start_m, p.tether_length_end_m)]
    return {
        "operation.force_reference": "ground",
        "operation.tether_length_min_m": min(lengths),
        "operation.tether_length_max_m": max(lengths),
        "operation.traction.elevation_deg": traction.elevation_deg,
        "operation.traction.azimuth_deg": traction.azimuth_deg,
        "operation.traction.course_deg": traction.course_deg,
        "operation.traction.tether_force_N": traction.mean_force_N,
        "operation.retraction.tether_force_N": retraction.mean_force_N,
    }


def fly_law(phase: MeasuredPhase, cycle: MeasuredCycle, values: ParameterValues) -> FlownLaw:
    """Fly a phase by the paper's law from where it began: its mean force, to where it ended.

    Retraction and traction end at the measured tether length; the turn and the transition at the elevation measured at
    their ends.

    Parameters
    ----------
    phase, cycle
        What was flown.
    values
        Numbers of the problem; its operation is replaced by that of the cycle.

    Raises
    ------
    CycleError
        The model cannot fly it, with the reason.
    """
    numbers = {key: value for key, value in operation_of(cycle).items() if not isinstance(value, str)}
    if phase.name == "turn":
        numbers["operation.traction.tether_force_N"] = phase.mean_force_N
    values = values.replaced(numbers)
    start = np.array([0.0, phase.tether_length_start_m, np.radians(phase.elevation_start_deg), 0.0])
    by_length = phase.name in ("retraction", "traction")
    if phase.name == "traction":
        start[ELEVATION] = np.radians(phase.elevation_deg)
    end = phase.tether_length_end_m if by_length else float(np.radians(phase.elevation_end_deg))
    downwards = {"retraction": True, "transition": True, "traction": False, "turn": False}[phase.name]
    begin = start[LENGTH if by_length else ELEVATION]
    if (end >= begin) if downwards else (end <= begin):
        raise CycleError(phase.name, "before it begins: it was flown the other way round", reason="domain")
    integrator = _integrator(values.structure, phase.name)
    try:
        states = integrator.run(start, values.vector, end, values[LONGEST_PHASE])
    except IntegrationError as error:
        at = f"after {error.state[0]:.3g} s at {error.state[1]:.4g} m and {np.degrees(error.state[2]):.3g} deg"
        why = "it does not end" if error.reason == "too_long" else "the next state has no equilibrium"
        raise CycleError(phase.name, f"{at}: {why}", reason=error.reason) from None
    states = integrator.refined(states, values.vector, PARTS)
    outputs = np.asarray(_outputs(values.structure, phase.name).map(len(states))(states.T, values.vector))
    return FlownLaw(
        time_s=states[:, 0],
        tether_length_m=states[:, LENGTH],
        elevation_deg=np.degrees(states[:, ELEVATION]),
        reeling_speed_m_s=outputs[OUTPUTS.index("reeling_speed")],
        force_N=outputs[OUTPUTS.index("tether_force_ground")],
    )


@lru_cache(maxsize=32)
def _integrator(structure: Structure, name: str) -> Integrator:
    rates, _ = _functions(structure, name)
    target = LENGTH if name in ("retraction", "traction") else ELEVATION
    # The transition's law has kinks; retraction and traction may come to rest, where their length stands still.
    return Integrator(
        rates, target, name in ("transition", "traction", "turn"), STATE_SCALES, order=5 if name == "transition" else 8
    )


def _outputs(structure: Structure, name: str) -> ca.Function:
    return _functions(structure, name)[1]


@lru_cache(maxsize=32)
def _functions(structure: Structure, name: str) -> tuple[ca.Function, ca.Function]:
    """Build (once) ``(state, p) -> rates`` and ``-> outputs``: the turn's here, the others are the cycle's own."""
    if name != "turn":
        functions = phase_functions(structure, name)
        return functions.rates, functions.outputs
    parameters, state = parameters_of(structure), ca.SX.sym("state", len(STATE))
    held = at_ground_force(parameters["operation.traction.tether_force_N"])
    moved = motion(Model(parameters), TURN, state[LENGTH], state[ELEVATION], held)
    flight = moved.flight
    rates = ca.vertcat(1.0, flight.reeling_speed, moved.elevation_rate, flight.power)
    outputs = outputs_of(flight)
    arguments = [state, parameters.vector]
    return (
        ca.Function("rates", arguments, [ca.densify(rates)]),
        ca.Function("outputs", arguments, [ca.densify(ca.vertcat(*(outputs[key] for key in OUTPUTS)))]),
    )
