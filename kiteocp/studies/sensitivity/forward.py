"""Sensitivity of the prescribed cycle to every number of the problem file, and the band that their rounding explains.

The flown cycle is differentiated along its steps (`kiteocp.cycle.fast.tangent`); numbers that follow from a key by
default are carried along.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from kiteocp.cycle.fast.tangent import QUANTITIES, cycle_and_tangent
from kiteocp.cycle.phases import PHASES, require_three_phases
from kiteocp.errors import InputError
from kiteocp.execution import one_at_a_time
from kiteocp.ocp.collocation import FloatArray
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.problem.catalogue import catalogue
from kiteocp.report.document import Lines, Part
from kiteocp.report.table import Cell, Column, Table
from kiteocp.studies.sensitivity.derivatives import key_directions

#: The closed form of the kite at rest has no derivative at weight zero, but just beside it (m/s2).
SMALL_GRAVITY_M_S2 = 1e-9

#: Change of a quantity per change of a key, both relative, that is rounding of the arithmetic and no influence.
ROUNDING = 1e-12


class ForwardSensitivity(msgspec.Struct, frozen=True):
    """The prescribed cycle and its derivatives.

    Attributes
    ----------
    keys, values
        Key paths of the numbers of the problem, and the numbers, shape (keys,).
    units
        Unit of each key.
    quantities
        Durations, energies and mean powers by the names of `QUANTITIES`.
    jacobian
        Derivative of each quantity per unit of each key, shape (quantities, keys).
    """

    keys: tuple[str, ...]
    values: FloatArray
    units: tuple[str, ...]
    quantities: Mapping[str, float]
    jacobian: FloatArray

    def derivative(self, quantity: str, key: str) -> float:
        """Return the derivative of a quantity of `QUANTITIES` per unit of a key."""
        return float(self.jacobian[QUANTITIES.index(quantity), self.keys.index(key)])

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary.

        ``forward_cycle`` holds the quantities by phase and of the cycle, ``forward_sensitivities`` one row for each
        key: ``derivative`` (W per unit of the key) and ``elasticity`` are those of the mean power of the cycle, the
        objects named after the phases and ``cycle`` the derivatives of all quantities.
        """
        power = self.quantities["cycle.mean_power_W"]
        rows = []
        for column, (key, value, unit) in enumerate(zip(self.keys, self.values, self.units, strict=True)):
            parts = _by_part(self.jacobian[:, column])
            derivative = parts["cycle"]["mean_power_W"]
            elasticity = derivative * float(value) / power if power else None
            row = {"key": key, "value": float(value), "unit": unit, "derivative": derivative, "elasticity": elasticity}
            rows.append({**row, **parts})
        return {"forward_cycle": _by_part(np.array(list(self.quantities.values()))), "forward_sensitivities": rows}


@one_at_a_time
def forward_sensitivity(problem: Problem, *, gravity: bool = True) -> ForwardSensitivity:
    """Differentiate the prescribed cycle of a problem with respect to each of its numbers.

    A key means what ``--set`` of it does: numbers that follow from it by default are carried along.

    Parameters
    ----------
    problem
        The problem; its ``operation`` block prescribes the cycle.
    gravity
        False leaves out all weights; the key of gravity then has no influence.

    Raises
    ------
    CycleError
        The cycle cannot be flown, as `kiteocp.simulate`.
    InputError
        The cycle has a turn.
    """
    values = parameter_values(problem, gravity=gravity)
    require_three_phases(values.structure, "the derivative of the prescribed cycle")
    keys = values.structure.keys
    directions = key_directions(problem)
    if not gravity:
        directions[:, keys.index("environment.gravity_m_s2")] = 0.0
    numbers, jacobian = cycle_and_tangent(values, directions)
    if gravity and values["environment.gravity_m_s2"] == 0.0:
        column = keys.index("environment.gravity_m_s2")
        beside = values.replaced({"environment.gravity_m_s2": SMALL_GRAVITY_M_S2})
        jacobian[:, [column]] = cycle_and_tangent(beside, directions[:, [column]])[1]
    sizes = np.where(values.vector == 0.0, 1.0, np.abs(values.vector))
    jacobian[np.abs(jacobian * sizes) <= ROUNDING * np.abs(numbers)[:, None]] = 0.0
    known = {key.path: key.unit or "1" for key in catalogue().walk()}
    return ForwardSensitivity(
        keys=keys,
        values=values.vector,
        units=tuple(known[key.partition("[")[0]] for key in keys),
        quantities=dict(zip(QUANTITIES, numbers, strict=True)),
        jacobian=jacobian,
    )


@one_at_a_time
def rounding_band(
    problem: Problem, half_units: Mapping[str, float], *, gravity: bool = True
) -> dict[str, tuple[float, float]]:
    """Return how far the rounding of given inputs may move the prescribed cycle, to first order.

    Parameters
    ----------
    problem
        The problem.
    half_units
        By key path the half unit of the last digit given, in the unit of the key: 0.05 for 9.9 m/s.
    gravity
        As `forward_sensitivity`.

    Returns
    -------
    dict of str to tuple of float
        By the names of `QUANTITIES` the worst case (all roundings against the quantity) and the root of the sum of
        squares of all contributions. Rounding errors being uniform, the latter over the root of 3 is the standard
        deviation.

    Raises
    ------
    InputError
        A key is no number of the problem, or its half unit is not a finite number of at least 0.
    CycleError
        As `forward_sensitivity`.
    """
    keys = parameter_values(problem).structure.keys
    for key, half in half_units.items():
        if key not in keys:
            raise InputError(f"{key} is no number of the problem; give a key path such as kite.mass_kg.", key=key)
        if not (math.isfinite(half) and half >= 0):
            raise InputError(f"the half unit of {key} is {half}; give a finite number of at least 0.", key=key)
    study = forward_sensitivity(problem, gravity=gravity)
    halves = np.array([half_units.get(key, 0.0) for key in keys])
    shares = np.abs(study.jacobian * halves)
    worst, root = shares.sum(axis=1), np.sqrt((shares**2).sum(axis=1))
    return {name: (float(a), float(b)) for name, a, b in zip(QUANTITIES, worst, root, strict=True)}


def forward_parts(details: Mapping[str, Any]) -> list[Part]:
    """Return what `ForwardSensitivity.to_dict` says, by falling influence on the mean power of the cycle."""
    cycle, rows = details["forward_cycle"], details["forward_sensitivities"]
    shown = [(part, name) for name in ("mean_power_W", "duration_s") for part in PHASES]
    heads = [f"{letter} {part}" for letter in ("P", "T") for part in ("retr.", "trans.", "tract.")]
    columns = [Column("key", left=True), Column("W per unit", digits=".4g"), Column("% per %", digits="+z.3f")]
    columns += [Column(head, digits="+z.3f", missing="nan") for head in heads]
    silent: list[str] = []
    lines: list[list[Cell]] = []
    for row in sorted(rows, key=lambda row: -abs(row["elasticity"] or 0.0)):
        if not any(slope for part in (*PHASES, "cycle") for slope in row[part].values()):
            silent.append(row["key"])
            continue
        shares = [
            row[part][name] * row["value"] / cycle[part][name] + 0.0 if cycle[part][name] else math.nan
            for part, name in shown
        ]
        lines.append([row["key"], row["derivative"], row["elasticity"], *shares])
    whole = cycle["cycle"]
    return [
        Lines([f"prescribed cycle: mean power {whole['mean_power_W']:.1f} W in {whole['duration_s']:.1f} s"]),
        Table(columns, lines),
        Lines([f"without influence: {', '.join(silent)}", "P, T: mean power and duration of each phase, % per %"]),
    ]


def _by_part(numbers: FloatArray) -> dict[str, dict[str, float]]:
    """Return numbers in the order of `QUANTITIES` by phase, or ``cycle``, and quantity."""
    parts: dict[str, dict[str, float]] = {}
    for quantity, number in zip(QUANTITIES, numbers, strict=True):
        part, _, name = quantity.partition(".")
        parts.setdefault(part, {})[name] = float(number)
    return parts
