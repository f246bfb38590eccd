"""The prescribed cycle for many problems of one structure at once, in some ten microseconds each.

Nearly all of them go through one CasADi function of fixed steps (`kiteocp.cycle.fast.cycle_function`). Those whose
error estimate is too large, or whose transition is out of the ordinary, go through its finer mesh, and what remains
through the adaptive integrator, which also says why a cycle cannot be flown.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from typing import Any, NoReturn

import msgspec
import numpy as np
import numpy.typing as npt

from kiteocp.cycle.fast.cycle_function import COARSE, FINE, OUTPUT_NAMES, QUANTITIES, FixedSteps, cycle_function
from kiteocp.cycle.phases import PHASES, require_three_phases
from kiteocp.cycle.simulation import LONGEST_PHASE, fly
from kiteocp.errors import CycleError, InputError, shortened
from kiteocp.execution import one_at_a_time
from kiteocp.numerics.vectorised import VectorisedFunction
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.problem import Problem
from kiteocp.problem.catalogue import catalogue
from kiteocp.problem.checking import BOUNDS, checked_number, failing
from kiteocp.problem.consistency import check_consistency

#: Largest error estimate of the steps that is accepted: of 4000 random cycles none was then off by more than 5e-5.
ERROR_ESTIMATE = 5e-4

#: How a cycle was computed.
ROUTES = ("coarse", "fine", "adaptive")


class BatchResult(msgspec.Struct, frozen=True):
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
        They are checked as those of a problem file are, one by one and against each other; defaults that follow from
        other keys do not follow them.
    gravity
        False leaves out all weights; of given parameter values it must stay True, as they have their own gravity.

    Returns
    -------
    BatchResult

    Raises
    ------
    InputError
        A key is no number of the problem, its values are not n finite numbers, or one of the n problems would not be
        valid; the message names the key and the first index.
    """
    if isinstance(problem, Problem):
        values = parameter_values(problem, gravity=gravity)
    elif gravity:
        values = problem
    else:
        raise InputError(
            "gravity=False needs a problem, not parameter values; set environment.gravity_m_s2 to 0 in them."
        )
    require_three_phases(values.structure, "simulate_batch")
    table = _table(values, parameters)
    count = table.shape[1]
    results = np.full((len(OUTPUT_NAMES), count), np.nan)
    route = np.full(count, ROUTES[-1])
    left = np.arange(count)
    for name, mesh in zip(ROUTES[:-1], (COARSE, FINE), strict=True):
        if left.size:
            found = _vectorised(values.structure, mesh)(table[:, left])
            # One that takes longer than it may is refused, in words, by the adaptive integrator.
            longest = table[values.structure.keys.index(LONGEST_PHASE), left]
            durations = found[[OUTPUT_NAMES.index(f"{phase}_duration_s") for phase in PHASES]]
            done = _trustworthy(found) & np.all(durations <= longest, axis=0)
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
            if key in (known.path for known in catalogue().walk() if known.nullable):
                raise InputError(f"{key} is null in the problem; give it a number there first.", file="parameters")
            near = difflib.get_close_matches(key, values.structure.keys, 1)
            hint = f"did you mean {near[0]}?" if near else "give a key path of the problem file, as kite.mass_kg."
            raise InputError(f"{key} is no number of the problem; {hint}", file="parameters")
        try:
            column = np.atleast_1d(np.asarray(given, dtype=float))
        except (TypeError, ValueError):
            shown = shortened(repr(given), 60)
            raise InputError(f"{key} is {shown}; give a list of numbers.", file="parameters") from None
        if column.ndim != 1 or column.size == 0 or not np.all(np.isfinite(column)):
            raise InputError(
                f"{key} must be a list of finite numbers, not of shape {column.shape} with "
                f"{np.count_nonzero(~np.isfinite(column))} that are none.",
                file="parameters",
            )
        _check_bounds(key, column)
        columns[key] = column
    count = max((column.size for column in columns.values()), default=1)
    table = np.repeat(values.vector[:, None], count, axis=1)
    for key, column in columns.items():
        if column.size not in (1, count):
            raise InputError(
                f"{key} has {column.size} values, but others have {count}; give as many.", file="parameters"
            )
        table[values.structure.keys.index(key)] = column
    _check_together(values.structure, table, columns)
    return table


def _check_bounds(key: str, column: np.ndarray) -> None:
    """Check the values of one key against its bounds in the problem file."""
    path = key.partition("[")[0]
    declared = next(known for known in catalogue().walk() if known.path == path)
    for name, bound in declared.bounds.items():
        _, holds = BOUNDS[name]
        wrong = np.flatnonzero(~holds(column, bound))
        if wrong.size:
            index = f"[{wrong[0]}]" if column.size > 1 else ""
            checked_number(float(column[wrong[0]]), failing("parameters", {}), declared, f"{key}{index}")


def _check_together(structure: Structure, table: np.ndarray, given: Collection[str]) -> None:
    """Check the keys against each other, once for each different set of the numbers that take part in that."""
    if not given:
        return
    # The numbers of kite, tether and air have no partner that could contradict them.
    together = ("operation.", "limits.", "environment.wind.")
    varied = [row for row, key in enumerate(structure.keys) if key in given and key.startswith(together)]
    _, firsts = np.unique(table[varied], axis=1, return_index=True) if varied else (None, np.zeros(1, dtype=int))
    nested = _nested(structure)
    fail = failing("parameters", {})
    for sample in np.sort(firsts):
        content = nested(table[:, sample])

        def fail_here(path: str, message: str, sample: int = int(sample)) -> NoReturn:
            fail(path, message if table.shape[1] == 1 else f"problem [{sample}]: {message}")

        check_consistency(content, content, fail_here)


def _nested(structure: Structure) -> Callable[[np.ndarray], dict[str, Any]]:
    """Return the function from a parameter vector to the blocks of a problem file, limits that are absent as None."""
    absent = {key.path: None for key in catalogue().walk() if key.nullable and key.path}
    lists = {key.partition("[")[0] for key in structure.keys if key.endswith("]")}

    def nest(vector: np.ndarray) -> dict[str, Any]:
        leaves: dict[str, Any] = {**absent, **dict(structure.choices), **{path: [] for path in lists}}
        for key, value in zip(structure.keys, vector.tolist(), strict=True):
            if key.endswith("]"):
                leaves[key.partition("[")[0]].append(value)
            else:
                leaves[key] = value
        content: dict[str, Any] = {"uncertainty": {}}
        for path, leaf in leaves.items():
            *above, name = path.split(".")
            block = content
            for part in above:
                block = block.setdefault(part, {})
            block[name] = leaf
        return content

    return nest


@lru_cache(maxsize=8)
def _vectorised(structure: Structure, mesh: FixedSteps) -> VectorisedFunction:
    return VectorisedFunction(cycle_function(structure, mesh))


def _trustworthy(results: np.ndarray) -> np.ndarray:
    """Which cycles are flown and accurate; comparisons with what is not a number are false."""
    rows = dict(zip(OUTPUT_NAMES, results, strict=True))
    trusted: np.ndarray = (rows["error_estimate"] < ERROR_ESTIMATE) & (rows["branches_in_order"] == 1)
    for name in PHASES:
        trusted &= (rows[f"{name}_duration_s"] > 0) & np.isfinite(rows[f"{name}_mean_power_W"])
    return trusted
