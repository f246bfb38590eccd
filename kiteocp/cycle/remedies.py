"""What would make a prescribed cycle fly that cannot be flown: each number of its operation, or the wind, alone."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import asdict

from kiteocp.cycle.laws import PHASE_ENDS, flown_in_order, phase_functions
from kiteocp.cycle.phases import PHASES, PhaseName, phases_of
from kiteocp.cycle.simulation import LONGEST_PHASE, STATE_SCALES, fly
from kiteocp.errors import CycleError
from kiteocp.execution import one_at_a_time
from kiteocp.numerics.integrator import IntegrationError, Integrator
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.physics.wind import WIND, in_wind, value_of, wind_text
from kiteocp.problem import Problem
from kiteocp.report.words import listed, rounded

#: Values tried between the given one and the end of a range, closest together near the given one.
SCANNED = 12

#: The value where the cycle begins to fly is located to this share of itself.
ACCURACY = 1e-3

#: The search needs no more than to know whether a cycle completes: error of a step, and steps of a phase. A phase that
#: completes takes some 20.
ROUGH_TOLERANCE, ROUGH_STEPS = 1e-6, 200

#: Range of the wind speed and of the forces as factors.
WIND_RANGE, FORCE_RANGE = (0.1, 10.0), (0.02, 20.0)

#: Words for the numbers of the operation.
PHRASES = {
    "operation.traction.tether_force_N": "a traction force of {} N",
    "operation.retraction.tether_force_N": "a retraction force of {} N",
    "operation.traction.elevation_deg": "a traction elevation of {} deg",
    "operation.tether_length_min_m": "a shortest tether of {} m",
    "operation.tether_length_max_m": "a longest tether of {} m",
    "operation.turn.tether_force_N": "a turn force of {} N",
    "operation.turn.elevation_deg": "a turn up to {} deg of elevation",
}


class Remedy(msgspec.Struct, frozen=True):
    """One number that, changed alone, makes the prescribed cycle fly.

    Attributes
    ----------
    key
        Key path in the problem file, ``environment.wind`` for the wind speed (of a table all its speeds).
    value, needed
        The number in the file and the nearest one found at which the cycle flies; of a table its largest speed.
    relative_change
        From one to the other.
    """

    key: str
    value: float
    needed: float
    relative_change: float


class UnflownCycle(msgspec.Struct, frozen=True):
    """Why a prescribed cycle cannot be flown, and what would make it fly.

    Attributes
    ----------
    sentence
        For an operator.
    remedies
        The smallest relative change first; empty if none of them alone helps.
    """

    sentence: str
    remedies: tuple[Remedy, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for the summary."""
        return {"sentence": self.sentence, "remedies": [asdict(remedy) for remedy in self.remedies]}


@one_at_a_time
def explain_simulation(problem: Problem, error: CycleError, *, gravity: bool = True) -> UnflownCycle:
    """Find for each number of the prescribed cycle, and the wind, the nearest value at which the cycle flies.

    Parameters
    ----------
    problem
        The problem whose simulation failed.
    error
        How it failed.
    gravity
        As in the simulation.
    """
    values = parameter_values(problem, gravity=gravity)
    remedies = []
    for key, (low, high) in _ranges(values).items():
        value = value_of(values, key)
        found = [needed for end in (low, high) if (needed := _nearest_flying(values, key, value, end)) is not None]
        if found:
            needed = min(found, key=lambda number: abs(number - value))
            remedies.append(Remedy(key, value, needed, needed / value - 1))
    remedies.sort(key=lambda remedy: abs(remedy.relative_change))
    if not remedies:
        return UnflownCycle(f"{error}; no number of operation and no wind alone was found that makes it fly", ())
    needs = listed([_need(values, remedy) for remedy in remedies], "or", always_comma=True)
    return UnflownCycle(f"{error}; it would fly with {needs}", tuple(remedies))


def _ranges(values: ParameterValues) -> dict[str, tuple[float, float]]:
    """Sensible values of each number: those that a problem file may hold beside the others as they are."""
    traction, retraction = "operation.traction.tether_force_N", "operation.retraction.tether_force_N"
    shortest, longest = "operation.tether_length_min_m", "operation.tether_length_max_m"
    wind = value_of(values, WIND)
    turn, top, low = "operation.turn.tether_force_N", "operation.turn.elevation_deg", "operation.traction.elevation_deg"
    of_turn = {
        turn: (FORCE_RANGE[0] * values[turn], FORCE_RANGE[1] * values[turn]),
        top: (1.01 * values[low], max(85.0, 1.01 * values[top])),
    }
    return {
        WIND: (WIND_RANGE[0] * wind, WIND_RANGE[1] * wind),
        traction: (1.001 * values[retraction], FORCE_RANGE[1] * values[traction]),
        retraction: (FORCE_RANGE[0] * values[retraction], 0.999 * values[traction]),
        "operation.traction.elevation_deg": (5.0, 85.0),
        shortest: (0.1 * values[shortest], 0.99 * values[longest]),
        longest: (1.01 * values[shortest], 4.0 * values[longest]),
        **(of_turn if phases_of(values.structure) != PHASES else {}),
    }


def _nearest_flying(values: ParameterValues, key: str, value: float, end: float) -> float | None:
    """Nearest value towards an end of the range at which the cycle flies; what flies is not always an interval."""
    failing = value
    shares = np.linspace(0.0, 1.0, SCANNED + 1)[1:] ** 2
    for flying in value * (end / value) ** shares:
        if _flies(_changed(values, key, float(flying))):
            break
        failing = float(flying)
    else:
        return None
    while abs(flying - failing) > ACCURACY * flying:
        middle = math.sqrt(failing * flying)
        if _flies(_changed(values, key, middle)):
            flying = middle
        else:
            failing = middle
    return float(flying) if _confirmed(_changed(values, key, float(flying))) else None


def _changed(values: ParameterValues, key: str, number: float) -> ParameterValues:
    if key != WIND:
        return values.replaced({key: number})
    return in_wind(values, number / value_of(values, WIND))


def _confirmed(values: ParameterValues) -> bool:
    try:
        fly(values)
    except CycleError:
        return False
    return True


def _flies(values: ParameterValues) -> bool:
    """Fly the prescribed cycle as `kiteocp.cycle.simulation.fly`, but roughly, and give up soon.

    A state that ceases to exist is approached in ever smaller steps; to know it to nine digits takes a second.
    """

    def run(name: PhaseName, start: np.ndarray, end: float) -> np.ndarray:
        return _rough_integrators(values.structure)[name].run(start, values.vector, end, values[LONGEST_PHASE])

    try:
        flown_in_order(values, run)
    except IntegrationError:
        return False
    return True


@lru_cache(maxsize=16)
def _rough_integrators(structure: Structure) -> dict[PhaseName, Integrator]:
    return {
        name: Integrator(
            phase_functions(structure, name).rates,
            end.component,
            end.monotone,
            STATE_SCALES,
            tolerance=ROUGH_TOLERANCE,
            max_steps=ROUGH_STEPS,
        )
        for name, end in ((name, PHASE_ENDS[name]) for name in phases_of(structure))
    }


def _need(values: ParameterValues, remedy: Remedy) -> str:
    if remedy.key == WIND:
        return wind_text(values, remedy.needed / remedy.value)
    return PHRASES[remedy.key].format(rounded(remedy.needed, up=remedy.needed > remedy.value))
