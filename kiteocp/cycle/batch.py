"""The prescribed cycle for many problems of one structure at once, in some ten microseconds each.

Nearly all of them go through one CasADi function of fixed steps (`kiteocp.cycle.cycle_function`). Those whose error
estimate is too large, or whose transition is out of the ordinary, go through its finer mesh, and what remains through
the adaptive integrator, which also says why a cycle cannot be flown.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from kiteocp.cycle.cycle_function import COARSE, FINE, OUTPUT_NAMES, QUANTITIES, Mesh, cycle_function
from kiteocp.cycle.phases import PHASES
from kiteocp.cycle.simulation import fly
from kiteocp.cycle.vectorised import VectorisedFunction
from kiteocp.errors import CycleError, InputError
from kiteocp.execution import one_at_a_time
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.problem import Problem

#: Largest error estimate of the steps that is accepted: of 4000 random cycles none was then off by more than 5e-5.
ERROR_ESTIMATE = 5e-4

#: How a cycle was computed.
ROUTES = ("coarse", "fine", "adaptive")


@dataclass(frozen=True)
class BatchResult:
    """The cycles of a batch of n problems; all arrays of shape (n,), not numbers where a cycle cannot be flown.

    Attributes
    ----------
    phases
        ``phases["traction"]["mean_power_W"]``: ``duration_s``, ``energy_J`` and ``mean_power_W`` of each phase.
    cycle
        The same of the whole cycle, without pauses at the phase changes.
    reason
        Empty where the cycle was flown, else the reason of the `CycleError` of `simulate`.
    failed_phase
        Empty where the cycle was flown, else the phase that could not be.
    route
        How each was computed: ``coarse`` or ``fine`` steps, or the ``adaptive`` integrator.
    """

    phases: Mapping[str, Mapping[str, np.ndarray]]
    cycle: Mapping[str, np.ndarray]
    reason: np.ndarray
    failed_phase: np.ndarray
    route: np.ndarray

    @property
    def flown(self) -> np.ndarray:
        """Where the cycle was flown, shape (n,)."""
        where: np.ndarray = self.reason == ""
        return where


@one_at_a_time
def simulate_batch(
    problem: Problem | ParameterValues,
    parameters: Mapping[str, npt.ArrayLike],
    *,
    gravity: bool = True,
) -> BatchResult:
    """Simulate the prescribed cycles of many problems that differ in numbers only.

    Phase durations and energies agree with `simulate` to 1e-4.

    Parameters
    ----------
    problem
        The problem whose numbers hold where no others are given, or its parameter values.
    parameters
        By key path in the problem file (``kite.mass_kg``) n values each, in the units of the file, or one for all.
        They are not checked as those of a problem file are.
    gravity
        False leaves out all weights; of given parameter values it must stay True, as they have their own gravity.

    Returns
    -------
    BatchResult

    Raises
    ------
    InputError
        A key is no number of the problem, or its values are not n finite numbers.
    """
    if isinstance(problem, Problem):
        values = parameter_values(problem, gravity=gravity)
    elif gravity:
        values = problem
    else:
        raise InputError(
            "gravity=False needs a problem, not parameter values; set environment.gravity_m_s2 to 0 in them."
        )
    table = _table(values, parameters)
    count = table.shape[1]
    results = np.full((len(OUTPUT_NAMES), count), np.nan)
    route = np.full(count, ROUTES[-1])
    left = np.arange(count)
    for name, mesh in zip(ROUTES[:-1], (COARSE, FINE), strict=True):
        if left.size:
            found = _vectorised(values.structure, mesh)(table[:, left])
            done = _trustworthy(found)
            results[:, left[done]], route[left[done]] = found[:, done], name
            left = left[~done]
    reason, failed_phase = np.full(count, "", dtype=object), np.full(count, "", dtype=object)
    for index in left:
        try:
            flown = fly(ParameterValues(values.structure, table[:, index].copy()))
        except CycleError as error:
            reason[index], failed_phase[index] = error.reason, error.phase
            continue
        parts = [(phase.duration_s, phase.energy_J) for phase in flown]
        parts.append((sum(time for time, _ in parts), sum(energy for _, energy in parts)))
        numbers = [number for time, energy in parts for number in (time, energy, energy / time)]
        results[: len(numbers), index] = numbers
    summaries = {
        part: {quantity: results[OUTPUT_NAMES.index(f"{part}_{quantity}")] for quantity in QUANTITIES}
        for part in (*PHASES, "cycle")
    }
    cycle = summaries.pop("cycle")
    return BatchResult(summaries, cycle, reason.astype(str), failed_phase.astype(str), route)


def _table(values: ParameterValues, parameters: Mapping[str, npt.ArrayLike]) -> np.ndarray:
    """Return the parameter vectors of all problems, shape (number of parameters, n)."""
    columns: dict[str, np.ndarray] = {}
    for key, given in parameters.items():
        if key not in values:
            near = difflib.get_close_matches(key, values.structure.keys, 1)
            hint = f"did you mean {near[0]}?" if near else "give a key path of the problem file, as kite.mass_kg."
            raise InputError(f"{key} is no number of the problem; {hint}", file="parameters")
        try:
            column = np.atleast_1d(np.asarray(given, dtype=float))
        except (TypeError, ValueError):
            raise InputError(f"{key} is {given!r}; give a list of numbers.", file="parameters") from None
        if column.ndim != 1 or column.size == 0 or not np.all(np.isfinite(column)):
            raise InputError(
                f"{key} must be a list of finite numbers, not of shape {column.shape} with "
                f"{np.count_nonzero(~np.isfinite(column))} that are none.",
                file="parameters",
            )
        columns[key] = column
    count = max((column.size for column in columns.values()), default=1)
    table = np.repeat(values.vector[:, None], count, axis=1)
    for key, column in columns.items():
        if column.size not in (1, count):
            raise InputError(
                f"{key} has {column.size} values, but others have {count}; give as many.", file="parameters"
            )
        table[values.structure.keys.index(key)] = column
    return table


@lru_cache(maxsize=8)
def _vectorised(structure: Structure, mesh: Mesh) -> VectorisedFunction:
    return VectorisedFunction(cycle_function(structure, mesh))


def _trustworthy(results: np.ndarray) -> np.ndarray:
    """Which cycles are flown and accurate; comparisons with what is not a number are false."""
    rows = dict(zip(OUTPUT_NAMES, results, strict=True))
    trusted: np.ndarray = (rows["error_estimate"] < ERROR_ESTIMATE) & (rows["branches_in_order"] == 1)
    for name in PHASES:
        trusted &= (rows[f"{name}_duration_s"] > 0) & np.isfinite(rows[f"{name}_mean_power_W"])
    return trusted
