"""The limits that a flight kept to, for an optimum on equal terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kiteocp.cycle.limits import limits_of
from kiteocp.cycle.phases import PHASE_CHANGES
from kiteocp.cycle.simulation import fly, record_of
from kiteocp.errors import CycleError, NoEquilibriumError
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.recording.cleaning import FloatArray
from kiteocp.recording.data import FlightData
from kiteocp.studies.prediction.measured import MeasuredCycle, model_lengths

#: A mean state holds no peak of a figure of eight: force and elevation of the traction are averaged over so many s.
WINDOW_S = 15.0

#: Quantiles that stand for the largest and the smallest value flown.
HIGH, LOW = 0.99, 0.01

#: Room beyond what the prescribed cycle reaches, so that it is inside.
WIDER, ROOM_DEG = 1e-3, 0.05


def flown_limits(flight: FlightData) -> dict[str, float]:
    """Return the ``limits`` keys that a flight kept to, by robust quantiles over all its cycles.

    The largest force is that of a mean state, whose peaks are higher: averaged over `WINDOW_S`, about a figure of
    eight; and so is the lowest elevation of the traction. All others are quantiles of the samples. A winch that reels
    in fast can reel out as fast, though the controller of this flight did not.
    """
    length, speed, force = model_lengths(flight), flight.reeling_speed_m_s, flight.tether_force_ground_N
    power = force * speed
    traction, retraction = flight.phase == "traction", flight.phase == "retraction"

    def windowed(values: FloatArray) -> FloatArray:
        parts = [
            _rolling_mean(flight.time_s[mask], values[mask])
            for mask in (traction & (flight.cycle == cycle) for cycle in flight.cycles())
        ]
        return np.concatenate([part for part in parts if part.size] or [values[traction]])

    def high(values: FloatArray) -> float:
        return float(np.nanquantile(values, HIGH))

    def low(values: FloatArray) -> float:
        return float(np.nanquantile(values, LOW))

    within = np.isfinite(length) & (flight.phase != "")
    return {
        "limits.tether_force_min_N": low(force[retraction]),
        "limits.tether_force_max_N": high(windowed(force)),
        "limits.reel_in_speed_max_m_s": high(np.abs(speed)),
        "limits.reel_out_speed_max_m_s": high(np.abs(speed)),
        "limits.generator_power_max_W": high(power),
        "limits.motor_power_max_W": high(-power),
        "limits.height_min_m": low(flight.height_m),
        "limits.height_max_m": high(flight.height_m),
        "limits.tether_length_min_m": float(np.min(length[within])),
        "limits.tether_length_max_m": float(np.max(length[within])),
        "limits.traction_elevation_min_deg": low(windowed(flight.elevation_deg)) - ROOM_DEG,
        "limits.traction_elevation_max_deg": high(flight.elevation_deg[traction]) + ROOM_DEG,
        "limits.elevation_max_deg": high(flight.elevation_deg),
    }


def _rolling_mean(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return means over windows of `WINDOW_S` (or the whole, where it is shorter), missing values left out."""
    known = np.isfinite(values)
    time, kept = time_s[known], values[known]
    if kept.size == 0:
        return kept
    ends = np.searchsorted(time, time + WINDOW_S, side="right")
    full = time + WINDOW_S <= time[-1] + 1e-9
    sums = np.concatenate([[0.0], np.cumsum(kept)])
    if not full.any():
        return np.array([kept.mean()])
    starts = np.flatnonzero(full)
    means: FloatArray = (sums[ends[starts]] - sums[starts]) / (ends[starts] - starts)
    return means


def widened(
    problem: Problem, limits: Mapping[str, float], cycles: Sequence[MeasuredCycle]
) -> tuple[Problem, dict[str, float]]:
    """Return a problem whose limits hold the cycle that it prescribes, and those limits.

    The time by which the flown cycles lasted longer is the time of manoeuvres that the model does not have. The
    optimum needs it too: it becomes the time of the phase changes.
    """
    wide = dict(limits)
    values = parameter_values(problem)
    try:
        flown = fly(values)
    except (CycleError, NoEquilibriumError):
        return problem, wide
    for limit in limits_of(values.structure):
        if limit.key not in wide or limit.key.startswith("limits.traction_elevation"):
            continue
        for record in (record_of(values, phase) for phase in flown):
            reached = limit.reached(record)
            side = -1 if "_min_" in limit.key else 1
            if reached is not None and side * reached > side * wide[limit.key]:
                wide[limit.key] = reached * (1.0 + side * WIDER)
    lost = float(np.mean([c.duration_s for c in cycles])) - sum(phase.duration_s for phase in flown)
    wide["limits.phase_change_time_s"] = max(lost, 0.0) / PHASE_CHANGES
    elevation = problem.operation.traction.elevation_deg
    wide["limits.traction_elevation_min_deg"] = min(wide["limits.traction_elevation_min_deg"], elevation - ROOM_DEG)
    wide["limits.traction_elevation_max_deg"] = max(wide["limits.traction_elevation_max_deg"], elevation + ROOM_DEG)
    return problem.with_values(wide), wide
