"""The set points of an optimal cycle as a controller takes them: over time, and over tether length."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from kiteocp.cycle.phases import pauses_after
from kiteocp.cycle.summary import PhaseRecord, steering
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.physics.parameters import ParameterValues

#: Columns of the set points that a phase change ramps from the end of one phase to the start of the next.
RAMPED = (
    "tether_force_kite_N",
    "tether_force_ground_N",
    "reeling_speed_m_s",
    "elevation_deg",
    "power_setting",
    "course_deg",
    "elevation_rate_deg_s",
)

#: Rows of a phase change, and of a branch over tether length.
CHANGE_SAMPLES = 11
LENGTH_SAMPLES = 41

#: A branch over tether length shorter than this (m) is a winch at rest, and is left out.
SHORTEST_BRANCH_M = 0.05

Table = Mapping[str, np.ndarray]


def setpoints_over_time(cycle: OptimalCycle) -> dict[str, np.ndarray]:
    """Return the set points of a cycle over time, its phase changes included.

    In a phase change the model lets nothing move; its rows (phase ``change``) hold the tether length and ramp the other
    set points evenly from the end of one phase to the start of the next.

    Returns
    -------
    dict of str to numpy.ndarray, shape (n,)
        ``time_s`` in the cycle, ``phase``, ``time_in_phase_s`` and the set points, the unit in each name.
    """
    pauses = pauses_after([record.name for record in cycle.records], cycle.values["limits.phase_change_time_s"])
    phases = [_setpoints(record, cycle.values) for record in cycle.records]
    parts: list[dict[str, np.ndarray]] = []
    start = 0.0
    for index, (record, phase, pause) in enumerate(zip(cycle.records, phases, pauses, strict=True)):
        parts.append(_part(record.name, start, phase))
        start += float(phase["time_in_phase_s"][-1])
        if pause > 0:
            parts.append(_part("change", start, _change(phase, phases[(index + 1) % len(phases)], pause)))
            start += pause
    return {column: np.concatenate([part[column] for part in parts]) for column in parts[0]}


def setpoints_over_length(cycle: OptimalCycle) -> dict[str, np.ndarray]:
    """Return the set points over an even grid of tether length.

    A phase in which the length turns has one branch for each stretch of one direction, numbered in the order flown, so
    that within a branch the set points are functions of the length. Stretches shorter than `SHORTEST_BRANCH_M`, a winch
    at rest, are left out.

    Returns
    -------
    dict of str to numpy.ndarray, shape (n,)
        ``phase``, ``branch`` (counted from 1), ``tether_length_m`` in the order flown, ``time_in_phase_s`` and the set
        points.
    """
    parts: list[dict[str, np.ndarray]] = []
    for record in cycle.records:
        phase = _setpoints(record, cycle.values)
        for number, branch in enumerate(branches(record.tether_length_m), start=1):
            length = record.tether_length_m[branch]
            grid = np.linspace(length[0], length[-1], LENGTH_SAMPLES)
            rising = slice(None) if length[-1] > length[0] else slice(None, None, -1)
            columns = {
                column: np.interp(grid, length[rising], samples[branch][rising]) for column, samples in phase.items()
            }
            columns["tether_length_m"] = grid
            labels = {"phase": np.full(LENGTH_SAMPLES, record.name), "branch": np.full(LENGTH_SAMPLES, number)}
            parts.append({**labels, **columns})
    return {column: np.concatenate([part[column] for part in parts]) for column in parts[0]}


def branches(length: np.ndarray) -> list[slice]:
    """Cut samples of tether length where it turns; stretches of less than `SHORTEST_BRANCH_M` are left out."""
    direction = np.sign(np.diff(length))
    turns = np.flatnonzero(direction[1:] != direction[:-1]) + 1
    borders = [0, *turns.tolist(), length.size - 1]
    pieces = [slice(start, end + 1) for start, end in itertools.pairwise(borders)]
    return [piece for piece in pieces if abs(length[piece][-1] - length[piece][0]) >= SHORTEST_BRANCH_M]


def _setpoints(record: PhaseRecord, values: ParameterValues) -> dict[str, np.ndarray]:
    return {
        "time_in_phase_s": record.time_s,
        "tether_length_m": record.tether_length_m,
        "tether_force_kite_N": record.output("tether_force_kite"),
        "tether_force_ground_N": record.output("tether_force_ground"),
        "reeling_speed_m_s": record.output("reeling_speed"),
        "elevation_deg": np.degrees(record.elevation_rad),
        **steering(record, values),
    }


def _change(before: Table, after: Table, pause: float) -> dict[str, np.ndarray]:
    ramp = {column: np.linspace(before[column][-1], after[column][0], CHANGE_SAMPLES) for column in RAMPED}
    length = np.full(CHANGE_SAMPLES, before["tether_length_m"][-1])
    return {"time_in_phase_s": np.linspace(0.0, pause, CHANGE_SAMPLES), "tether_length_m": length, **ramp}


def _part(name: str, start: float, columns: Table) -> dict[str, Any]:
    time = columns["time_in_phase_s"]
    return {"time_s": start + time, "phase": np.full(time.size, name), **columns}
