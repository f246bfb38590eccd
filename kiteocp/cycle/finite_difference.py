"""The paper's own integration: explicit steps of the kite's position vector (eq:retraction_trajectory)."""

from __future__ import annotations

import math

import numpy as np

from kiteocp.cycle.buffered import BufferedFunction
from kiteocp.cycle.integrator import IntegrationError
from kiteocp.cycle.laws import phase_functions
from kiteocp.cycle.phases import PhaseName
from kiteocp.cycle.summary import air_function
from kiteocp.physics.parameters import ParameterValues


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
        Tether length in m at which the phase ends; for the transition the elevation in rad.
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
    by_elevation = name == "transition"
    states = [start]
    time, length, elevation, energy = (float(v) for v in start)
    done = False
    while not done:
        _, radial, angular, power = rates(states[-1], values.vector)
        if not math.isfinite(radial + angular + power):
            raise IntegrationError(states[-1], "domain")
        across, step = length * float(angular), step_s
        radial = float(radial)
        turn = math.atan2(across * step, length + radial * step)
        reached = math.hypot(length + radial * step, across * step)
        if by_elevation and elevation + turn <= end:
            done, slope = True, math.tan(end - elevation)
            step = length * slope / (across - radial * slope)
        elif not by_elevation and (reached - end) * (length - end) <= 0 and reached != length:
            done, step = True, _time_to_length(length, end, radial, across)
        time, energy = time + step, energy + float(power) * step
        elevation += math.atan2(across * step, length + radial * step)
        length = math.hypot(length + radial * step, across * step)
        if time > max_time:
            raise IntegrationError(states[-1], "too_long")
        states.append(np.array([time, length, elevation, energy]))
    states[-1][2 if by_elevation else 1] = end
    return np.array(states)


def _time_to_length(length: float, end: float, radial: float, across: float) -> float:
    """Smallest time after which a straight path from ``length`` is ``end`` away from the ground station."""
    # (length + radial t)^2 + (across t)^2 = end^2
    a, b, c = radial**2 + across**2, length * radial, length**2 - end**2
    root = math.sqrt(b * b - a * c)
    return c / (-b + root) if c >= 0 else (-b + root) / a
