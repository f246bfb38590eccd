"""Limits in conflict, and the sentence that says so to an operator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import asdict

from kiteocp.cycle.phases import KINDS
from kiteocp.ocp.trajectory import Trajectory
from kiteocp.physics.parameters import ParameterValues
from kiteocp.physics.wind import wind_text
from kiteocp.problem.catalogue import limit_keys
from kiteocp.problem.limits import LimitRow
from kiteocp.report.words import listed, rounded

#: Limits and alternatives that the sentence names; the conflict lists them all.
NAMED, ALTERNATIVES = 4, 3


class Conflict(msgspec.Struct, frozen=True):
    """One limit of a smallest set that cannot hold together.

    Attributes
    ----------
    key
        Key path in the problem file.
    value
        Its number in the file.
    needed
        The number at which a cycle exists with everything else as it is; None where this limit alone cannot do it.
    relative_change
        Of the number, negative for a lower one.
    phase
        Where it bites most; None where that is no phase.
    elevation_deg, tether_length_m
        Least and greatest there.
    """

    key: str
    value: float
    needed: float | None
    relative_change: float | None
    phase: str | None = None
    elevation_deg: tuple[float, float] | None = None
    tether_length_m: tuple[float, float] | None = None

    @property
    def alone(self) -> bool:
        """Whether moving this limit alone makes a cycle possible."""
        return self.needed is not None


class Infeasibility(msgspec.Struct, frozen=True):
    """Why no cycle was found.

    Attributes
    ----------
    sentence
        For an operator.
    conflict
        A smallest set of limits that cannot hold together: without any one of them the others could. Those that can
        repair it alone first, the smallest relative change first. Empty where no limit is to blame.
    wind_factor
        Nearest factor of the wind speed at which a cycle exists with all limits as they are; None if none was found.
    wind_needed_m_s
        The reference wind speed then, of a table its largest speed.
    relaxation
        The smallest joint relaxation found: limits and their numbers; empty if no relaxation of limits helps.
    elastic_sum
        Sum of the relative slacks at the joint elastic optimum.
    starts
        From how many starts that was reached.
    start
        The cycle at the elastic optimum, if that vanishes: a start from which to try again, on any mesh.
    """

    sentence: str
    conflict: tuple[Conflict, ...]
    wind_factor: float | None = None
    wind_needed_m_s: float | None = None
    relaxation: Mapping[str, float] = msgspec.field(default_factory=dict)
    elastic_sum: float | None = None
    starts: int = 0
    start: Trajectory | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for the summary."""
        return {
            "sentence": self.sentence,
            "conflict": [asdict(conflict) | {"alone": conflict.alone} for conflict in self.conflict],
            "wind_factor": self.wind_factor,
            "wind_needed_m_s": self.wind_needed_m_s,
            "relaxation": dict(self.relaxation),
            "elastic_sum": self.elastic_sum,
            "starts": self.starts,
        }


def sentence_of(
    values: ParameterValues,
    conflict: Sequence[Conflict],
    wind_factor: float | None,
    relaxation: Mapping[str, float],
) -> str:
    """Compose the sentence: what cannot be held, where, and the alternatives, the smallest relative change first."""
    if conflict:
        cannot = [_row(c.key).cannot.format(f"{c.value:.4g}") for c in conflict[:NAMED]]
        if len(conflict) > NAMED:
            cannot.append(f"keep {len(conflict) - NAMED} more of its limits")
        what = f"the kite cannot {listed(cannot, 'and')}{_place(conflict)}"
    else:
        what = "no relaxation of the limits gives a cycle"
    alternatives = [
        (abs(c.relative_change), need_of(c.key, c.value, c.needed))
        for c in conflict
        if c.needed is not None and c.relative_change is not None
    ]
    if wind_factor is not None:
        alternatives.append((abs(wind_factor - 1), wind_text(values, wind_factor)))
    needs = [text for _, text in sorted(alternatives)[:ALTERNATIVES]]
    if relaxation and not any(c.alone for c in conflict):
        together = listed([need_of(key, values[key], needed) for key, needed in relaxation.items()], "and")
        needs.append(f"{together} together")
    if not needs:
        remedy = "no relaxation found"
    elif conflict:
        remedy = f"smallest relaxation found: {listed(needs, 'or', always_comma=True)}"
    else:
        remedy = f"it takes {listed(needs, 'or', always_comma=True)}"
    return f"no cycle found: with {wind_text(values, 1.0)} {what}; {remedy}"


def need_of(key: str, value: float, needed: float) -> str:
    """Name the value a limit would need, rounded to the side that loosens it."""
    return _row(key).needs.format(rounded(needed, up=needed > value))


def _row(key: str) -> LimitRow:
    row = limit_keys()[key].limit
    assert row is not None
    return row


def _place(conflict: Sequence[Conflict]) -> str:
    """Say where the conflict bites: there where its first limit does that has a place."""
    for entry in conflict:
        # A limit of the elevation says itself where it bites.
        if entry.phase is not None and entry.elevation_deg is not None and "elevation" not in entry.key:
            low, high = entry.elevation_deg
            at = f"{low:.0f} deg" if high - low < 1 else f"{low:.0f} to {high:.0f} deg"
            return f" {KINDS[entry.phase].words} at {at} of elevation"  # type: ignore[index]
    return ""
