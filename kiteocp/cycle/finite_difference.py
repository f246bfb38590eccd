"""The paper's own integration: explicit steps of the kite's position vector (eq:retraction_trajectory)."""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np

from kiteocp.cycle.laws import ELEVATION, PHASE_ENDS, STATE, phase_functions
from kiteocp.cycle.phases import PhaseName
from kiteocp.cycle.summary import air_function
from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.numerics.integrator import IntegrationError
from kiteocp.physics.parameters import ParameterValues, Structure, parameters_of

#: Steps that are taken in one call; those beyond the end of a phase are thrown away.
BLOCK = 64


def characteristic_time(values: ParameterValues) -> float:
    """Characteristic time of the traction (eq:charsystemtime), s.

    The wind speed is that at the reference height; a table has none, so that the one at the mean traction altitude
    (eq:meantractionaltitude) takes its place.
    """
    shortest, longest = values["operation.tether_length_min_m"], values["operation.tether_length_max_m"]
    if "environment.wind.reference_speed_m_s" in values:
        return (longest - shortest) / values["environment.wind.reference_speed_m_s"]
    altitude = 0.5 * (shortest + longest) * math.sin(math.radians(values["operation.traction.elevation_deg"]))
    wind, _ = air_function(values.structure)(altitude, values.vector)
    return (longest - shortest) / float(wind)


def finite_difference_phase(
    values: ParameterValues, name: PhaseName, start: np.ndarray, end: float, step_s: float, max_time: float
) -> np.ndarray:
    """Step a phase in constant time steps, the last one shortened so that it ends exactly.

    The position vector moves straight over a step, with the velocity at its start; the energy is the power at the start
    times the step.

    Parameters
    ----------
    values, name
        The problem's numbers and the phase.
    start
        State (time, tether length, elevation in rad, energy), shape (4,).
    end
        Tether length in m at which the phase ends; for transition and turn the elevation in rad.
    step_s, max_time
        Time step and longest duration, s.

    Returns
    -------
    numpy.ndarray, shape (steps + 1, 4)

    Raises
    ------
    IntegrationError
        A state on the way does not exist, or the phase does not end.
    """
    rates = BufferedFunction(phase_functions(values.structure, name).rates)
    block = BufferedFunction(_block_of_steps(values.structure, name))
    steps, parameters = np.full(BLOCK, step_s), np.tile(values.vector, BLOCK)
    column = PHASE_ENDS[name].component
    by_elevation = column == ELEVATION
    parts, last = [start[None, :]], start
    done = False
    while not done:
        ahead = np.vstack([last, block(last, steps, parameters).reshape(BLOCK, len(STATE))])
        ordinary = ahead[1 : 1 + _ordinary_steps(ahead, column, end, max_time)]
        if len(ordinary):
            parts.append(ordinary)
            last = ordinary[-1]
        time, length, elevation, energy = (float(v) for v in last)
        _, radial, angular, power = (float(v) for v in rates(last, values.vector))
        if not math.isfinite(radial + angular + power):
            raise IntegrationError(last, "domain")
        across, step = length * angular, step_s
        turn = math.atan2(across * step, length + radial * step)
        reached = math.hypot(length + radial * step, across * step)
        if by_elevation and (elevation + turn - end) * (elevation - end) <= 0 and turn:
            done, slope = True, math.tan(end - elevation)
            step = length * slope / (across - radial * slope)
        elif not by_elevation and (reached - end) * (length - end) <= 0 and reached != length:
            done, step = True, _time_to_length(length, end, radial, across)
        time, energy = time + step, energy + power * step
        elevation += math.atan2(across * step, length + radial * step)
        length = math.hypot(length + radial * step, across * step)
        if time > max_time:
            raise IntegrationError(last, "too_long")
        last = np.array([time, length, elevation, energy])
        parts.append(last[None, :])
    states = np.concatenate(parts)
    states[-1, column] = end
    return states


@lru_cache(maxsize=32)
def _block_of_steps(structure: Structure, name: PhaseName) -> ca.Function:
    """Build (once) ``(state, steps, p for each step) -> states after 1 to BLOCK steps``, all of full length."""
    state, step, p = ca.SX.sym("state", len(STATE)), ca.SX.sym("step"), parameters_of(structure).vector
    time, length, elevation, energy = ca.vertsplit(state)
    _, radial, angular, power = ca.vertsplit(phase_functions(structure, name).rates(state, p))
    outwards, sideways = length + radial * step, length * angular * step
    after = ca.vertcat(
        time + step,
        ca.sqrt(outwards**2 + sideways**2),
        elevation + ca.atan2(sideways, outwards),
        energy + power * step,
    )
    return ca.Function("step", [state, step, p], [ca.cse(after)]).mapaccum(BLOCK)


def _ordinary_steps(ahead: np.ndarray, column: int, end: float, max_time: float) -> int:
    """Count the steps before the first that ends the phase, takes too long or leaves the domain."""
    before, after = ahead[:-1, column], ahead[1:, column]
    crossed = ((after - end) * (before - end) <= 0) & (after != before)
    special = crossed | (ahead[1:, 0] > max_time) | ~np.isfinite(ahead[1:]).all(axis=1)
    return int(np.argmax(special)) if special.any() else len(special)


def _time_to_length(length: float, end: float, radial: float, across: float) -> float:
    """Smallest time after which a straight path from ``length`` is ``end`` away from the ground station."""
    # (length + radial t)^2 + (across t)^2 = end^2
    a, b, c = radial**2 + across**2, length * radial, length**2 - end**2
    root = math.sqrt(b * b - a * c)
    return c / (-b + root) if c >= 0 else (-b + root) / a
