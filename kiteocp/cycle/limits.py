"""The limits of the cycle: the bound of each in the units of the model, and how near a flown phase comes to it.

The rows of `kiteocp.problem.limits` say what is bounded; here is the one evaluator of them. The optimal control problem
takes its bounds from it, and certificates, active limits, winch laws and the warnings of `simulate` their distances.
Every bound that can shape an optimum is a row, and so a key of the problem file: those of the machine and those within
which the model has a steady state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import msgspec
import numpy as np

from kiteocp.cycle.phases import PhaseName, phases_of
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.physics.equilibrium import OUTPUTS
from kiteocp.physics.flight import OUTPUT_UNITS
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure
from kiteocp.problem.catalogue import limit_keys
from kiteocp.problem.limits import LimitRow

Side = Literal["lower", "upper", "both"]


class Measure(msgspec.Struct, frozen=True):
    """How the number in the file becomes the bound of a quantity in SI units, symbolic or numeric, and back."""

    to_quantity: Callable[[Any], Any]
    to_file: Callable[[Any], Any]


#: By the word of the row; angles are in degrees in the file.
MEASURES: Mapping[str, Measure] = {
    "same": Measure(lambda number: number, lambda value: value),
    "opposite": Measure(lambda number: -number, lambda value: -value),
    "degrees": Measure(lambda number: number * (np.pi / 180), lambda value: value * (180 / np.pi)),
    "tangent": Measure(ca.atan, np.tan),
}

#: Typical sizes by unit, by which the optimal control problem scales its variables and rows.
_UNIT_SCALES: Mapping[str, float] = {"N": 1000.0, "W": 1e4, "m_s": 10.0, "m": 100.0, "s": 10.0}

#: The same by quantity: all outputs of a flight state, and places, controls and wholes.
SCALES: Mapping[str, float] = {
    **{name: _UNIT_SCALES.get(OUTPUT_UNITS.get(name, ""), 1.0) for name in OUTPUTS},
    "tether_length": 100.0,
    "elevation": 1.0,
    "elevation_rate": 0.01,
    "course": 1.0,
    "power_setting": 1.0,
    "duration": 10.0,
    "stroke": 100.0,
}


class Limit(msgspec.Struct, frozen=True):
    """A limit that holds in some phases: at every instant, or for the phase as a whole.

    Attributes
    ----------
    key
        Key path in the problem file.
    quantity
        The bounded quantity, a place, an output of a flight state or a control; of a whole phase ``duration`` or
        ``stroke``.
    row
        What was declared of it.
    """

    key: str
    quantity: str
    row: LimitRow

    @property
    def phases(self) -> tuple[PhaseName, ...]:
        """Where it holds."""
        return self.row.phases  # type: ignore[return-value]

    @property
    def whole(self) -> bool:
        """Whether it holds for the phase as a whole."""
        return self.row.whole

    @property
    def rate(self) -> bool:
        """Whether it bounds the rate of the quantity in time."""
        return self.row.rate

    @property
    def side(self) -> Side:
        """Whether it is a lower or an upper bound of the quantity, or an upper one of its magnitude."""
        if self.row.measure == "magnitude":
            return "both"
        return "lower" if ("_min_" in f"{self.key}_") != (self.row.measure == "opposite") else "upper"

    @property
    def measure(self) -> Measure:
        """From the number in the file to the bound."""
        if self.row.unit.startswith("deg"):
            return MEASURES["degrees"]
        return MEASURES["same" if self.row.measure == "magnitude" else self.row.measure]

    def bound(self, values: Parameters | ParameterValues) -> Any:
        """Bound of the quantity (of its rate) in SI units, symbolic or numeric."""
        return self.measure.to_quantity(values[self.key])

    def bounds(self, values: Parameters | ParameterValues) -> tuple[Any, Any]:
        """Lower and upper bound that it gives the quantity, infinite where it gives none."""
        bound = self.bound(values)
        lower = {"lower": bound, "both": -bound, "upper": -np.inf}[self.side]
        return lower, bound if self.side != "lower" else np.inf

    def samples(self, record: PhaseRecord) -> np.ndarray | None:
        """Return the bounded quantity over a record in SI units: shape (n,), of a whole phase (1,), of a rate (n - 1,).

        None where the limit does not hold in that phase, or the phase has no such quantity.
        """
        if record.name not in self.phases:
            return None
        if self.rate:
            return record.rate(self.quantity)
        found = quantity_of(record, self.quantity)
        return None if found is None else np.atleast_1d(found)

    def size(self, values: ParameterValues) -> float:
        """Size that gaps to the limit are relative to: the bound, or a hundredth of the quantity's scale if larger."""
        bound = abs(float(self.bound(values)))
        return bound if self.rate else max(bound, 0.01 * SCALES[self.quantity])

    def margin(self, record: PhaseRecord, values: ParameterValues) -> float | None:
        """Return the smallest of `distances`, minus infinity where one is not a number."""
        return self.margins([record], values)[0]

    def margins(self, records: Sequence[PhaseRecord], values: ParameterValues) -> list[float | None]:
        """Return `margin` of each record."""
        bound, size = float(self.bound(values)), self.size(values)
        found: list[float | None] = []
        for record in records:
            ends = self._ends(record) if record.name in self.phases else None
            if ends is None:
                found.append(None)
                continue
            least, greatest = ends
            if self.side == "lower":
                gap = least - bound
            else:
                gap = bound - (max(abs(least), abs(greatest)) if self.side == "both" else greatest)
            found.append(gap / size if math.isfinite(least) and math.isfinite(greatest) else -math.inf)
        return found

    def _ends(self, record: PhaseRecord) -> tuple[float, float] | None:
        """Return the least and the greatest of `samples`; the many quantities of a record share their computation."""
        if not self.rate and self.quantity in OUTPUTS:
            return record.ends(self.quantity)
        samples = self.samples(record)
        return None if samples is None else (float(np.min(samples)), float(np.max(samples)))

    def distances(self, record: PhaseRecord, values: ParameterValues) -> np.ndarray | None:
        """Return the distance of each of `samples` to the limit over `size`, negative where it is exceeded."""
        samples = self.samples(record)
        return None if samples is None else self._gaps(samples, float(self.bound(values))) / self.size(values)

    def share(self, record: PhaseRecord, values: ParameterValues, within: float) -> float | None:
        """Return the share of the time of a record during which the quantity is this near to the limit, over `size`.

        Zero where it is near at single instants only, None where it never is.
        """
        samples = self.samples(record)
        if samples is None:
            return None
        near = np.abs(self._gaps(samples, float(self.bound(values)))) <= within * self.size(values)
        if not near.any():
            return None
        if self.whole:
            return 1.0
        if self.rate:
            return float(np.sum(np.diff(record.time_s)[near]) / record.duration_s)
        return min(float(np.trapezoid(near.astype(float), record.time_s) / record.duration_s), 1.0)

    def reached(self, record: PhaseRecord) -> float | None:
        """Return the sample that comes nearest to the limit or exceeds it most, in the unit of the file."""
        samples = self.samples(record)
        if samples is None:
            return None
        worst = samples[np.argmin(self._gaps(samples, 0.0))]
        return float(self.measure.to_file(abs(worst) if self.side == "both" else worst))

    def _gaps(self, samples: np.ndarray, bound: float) -> np.ndarray:
        if self.side == "lower":
            return samples - bound
        return bound - (np.abs(samples) if self.side == "both" else samples)


@lru_cache(maxsize=32)
def limits_of(structure: Structure) -> tuple[Limit, ...]:
    """Return all limits that a problem of this structure has, in the order of the file."""
    return tuple(
        Limit(path, quantity, key.limit)
        for path, key in limit_keys().items()
        if path in structure.keys and key.limit is not None and (quantity := _bounded(key.limit, structure)) is not None
        if set(key.limit.phases) & set(phases_of(structure))
    )


def _bounded(row: LimitRow, structure: Structure) -> str | None:
    return row.quantity if row.at is None else f"{row.quantity}_{structure.choice(row.at)}"


def path_limits(structure: Structure) -> list[Limit]:
    """Return the limits that a problem of this structure has at every instant."""
    return [limit for limit in limits_of(structure) if not limit.whole and not limit.rate]


def limited_outputs(structure: Structure, phase: PhaseName) -> list[str]:
    """Return the outputs of a flight state that are limited at every instant of a phase, each once."""
    found = (limit.quantity for limit in path_limits(structure) if phase in limit.phases)
    return [quantity for quantity in dict.fromkeys(found) if quantity in OUTPUTS]


def rarely_active(structure: Structure, phase: PhaseName) -> list[str]:
    """Return the quantities of a phase whose limits most optima keep by themselves (`LimitRow.rarely`)."""
    rare: dict[str, bool] = {}
    for limit in path_limits(structure):
        if phase in limit.phases:
            rare[limit.quantity] = rare.get(limit.quantity, True) and phase in limit.row.rarely
    return [quantity for quantity, always in rare.items() if always]


def bounds_of(
    limits: Sequence[Limit], values: Parameters | ParameterValues, phase: PhaseName, quantity: str
) -> tuple[Any, Any]:
    """Lower and upper bound of a quantity in a phase, the tightest of all its limits; infinite where there is none."""
    lower, upper = -np.inf, np.inf
    for limit in limits:
        if limit.quantity == quantity and phase in limit.phases and not limit.rate:
            below, above = limit.bounds(values)
            lower, upper = _tighter(lower, below, ca.fmax), _tighter(upper, above, ca.fmin)
    return lower, upper


def _tighter(known: Any, given: Any, choose: Callable[[Any, Any], Any]) -> Any:
    if is_infinite(known) or is_infinite(given):
        return given if is_infinite(known) else known
    return choose(known, given)


def is_infinite(bound: Any) -> bool:
    """Whether a bound, symbolic or numeric, is none."""
    return isinstance(bound, float) and not np.isfinite(bound)


def quantity_of(record: PhaseRecord, name: str) -> Any:
    """Return a limited quantity over a record in SI units, shape (n,), one number for ``duration`` and ``stroke``.

    None where the phase has no such quantity.
    """
    if name == "tether_length":
        return record.tether_length_m
    if name == "elevation":
        return record.elevation_rad
    if name == "duration":
        return record.duration_s
    if name == "stroke":
        return record.tether_length_m[-1] - record.tether_length_m[0]
    return record.output(name) if name in OUTPUTS else record.steered.get(name)
