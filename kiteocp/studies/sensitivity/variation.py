"""The optimum along one key of the problem file: certified re-solves beside the tangent at the problem's own value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from kiteocp.cycle.phases import PHASES
from kiteocp.errors import InputError, SolveError
from kiteocp.execution import one_at_a_time
from kiteocp.optimum.cycle import active_limits
from kiteocp.optimum.neighbours import Family
from kiteocp.optimum.refine import Optimum, certified, optimise
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.problem.catalogue import limit_keys
from kiteocp.report.document import Heading, Part
from kiteocp.report.table import Column, Table
from kiteocp.result import Result

VARIATION_FILE = "variation.csv"

#: Values that one key takes at most.
MOST_VALUES = 1000

#: Of two optima at one value the cold one is taken to be another where its power is larger by this share.
ANOTHER_OPTIMUM = 1e-4


class Variation(msgspec.Struct, frozen=True):
    """A key and the optimum at several of its values.

    Attributes
    ----------
    key
        Key path.
    points
        For each value, ascending: ``value``, ``status``, ``mean_power_W`` (None where there is no cycle), ``tangent_W``
        (None where the problem's own value has no optimum), ``active_limits`` (by phase, with share of its time).
    """

    key: str
    points: tuple[dict[str, Any], ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the variation as plain values for the summary."""
        return {"key": self.key, "points": list(self.points)}

    def table(self) -> Table:
        """Return the points: for a person the limits active for longest, in CSV each that a phase may have.

        The cells of these are shares of the time of the phase, 0 where the limit is not active.
        """
        names = [(phase, name) for phase in PHASES for name in self.limits]
        columns = [
            Column("value", digits=".6g", key=self.key),
            Column("power", "W", digits=".1f", missing="-", key="mean_power_W"),
            Column("tangent", "W", digits=".1f", missing="-", key="tangent_W"),
            Column("status", left=True, key="status"),
            Column("limits active for longest", left=True),
            *(Column(key=f"{phase}:{name}", shown=False) for phase, name in names),
        ]
        rows = []
        for point in self.points:
            head = (point["value"], point["mean_power_W"], point["tangent_W"], point["status"])
            held = [
                f"{entry['limit'].removeprefix('limits.')} ({phase})"
                for phase, entries in point["active_limits"].items()
                for entry in entries[:1]
            ]
            rows.append((*head, "; ".join(held), *(share_of(point, phase, name) for phase, name in names)))
        return Table(columns, rows)

    def parts(self) -> list[Part]:
        """Return what a person reads."""
        return [Heading(f"along {self.key}:"), self.table()]

    @property
    def limits(self) -> list[str]:
        """Return the keys of all limits that are numbers, and of any other that is active at some point."""
        declared = limit_keys()
        met = [
            entry["limit"] for point in self.points for entries in point["active_limits"].values() for entry in entries
        ]
        return list(dict.fromkeys([*declared, *sorted(met)]))


def share_of(point: dict[str, Any], phase: str, limit: str) -> float:
    """Return the share of the time of a phase for which a limit is active at a point of a variation."""
    entries = point["active_limits"].get(phase, [])
    return next((float(entry["share"]) for entry in entries if entry["limit"] == limit), 0.0)


def parse_variation(text: str) -> tuple[str, list[float]]:
    """Split ``key=from:to:count`` or ``key=value,value``.

    Returns
    -------
    tuple of str and list of float
        Key path and the values, ascending.

    Raises
    ------
    InputError
        If it is not of this form.
    """
    key, _, numbers = text.partition("=")
    try:
        if ":" in numbers:
            first, last, count = numbers.split(":")
            steps = int(count) if len(count) <= len(str(MOST_VALUES)) else 0
            values = np.linspace(float(first), float(last), steps) if 2 <= steps <= MOST_VALUES else np.array([])
        else:
            values = np.array([float(part) for part in numbers.split(",")])
    except ValueError:
        values = np.array([])
    values = np.unique(values)
    if not (2 <= values.size <= MOST_VALUES and np.isfinite(values).all() and key.strip()):
        raise InputError(
            f"--vary {text}: expected key=from:to:count or key=value,value with 2 to {MOST_VALUES} different values, "
            "such as tether.diameter_m=0.003:0.008:11 or tether.diameter_m=0.003,0.004"
        )
    return key.strip(), values.tolist()


def varied_problems(problem: Problem, key: str, values: Sequence[float]) -> list[Problem]:
    """Return the problem with each of the values.

    Raises
    ------
    InputError
        The key does not exist or is not a number, or a value makes the problem wrong.
    """
    problems = [problem.with_values({key: value}) for value in values]
    if key not in parameter_values(problems[0]).structure.keys:
        raise InputError(f"--vary {key}: is not a number that the optimum depends on; give one such as kite.mass_kg")
    return problems


@one_at_a_time
def vary(
    problem: Problem,
    key: str,
    values: Sequence[float],
    around: Result | None = None,
    progress: Callable[[Variation, int], None] | None = None,
) -> Variation:
    """Re-solve a problem along one key, each value warm from its neighbour, and certify every optimum.

    Parameters
    ----------
    problem
        The problem.
    key
        Key path of a number.
    values
        Ascending.
    around
        The sensitivities of the problem itself, whose tangent is laid beside the curve; None leaves it out.
    progress
        Called after each value with the variation so far and the number of values.

    Returns
    -------
    Variation

    Raises
    ------
    InputError
        As `varied_problems`.
    """
    problems = varied_problems(problem, key, values)
    tangents: list[float | None] = [None] * len(values)
    rows = [row for row in around.details["sensitivities"] if row["key"] == key] if around is not None else []
    if around is not None and rows:
        power, slope, own = around.details["optimal_mean_power_W"], rows[0]["derivative"], rows[0]["value"]
        tangents = [power + slope * (value - own) for value in values]
    points: dict[int, dict[str, Any]] = {}

    def kept(index: int, found: Optimum | str) -> Optimum | str:
        points[index] = _point(values[index], found, tangents[index])
        if progress is not None:
            progress(Variation(key, tuple(points[place] for place in sorted(points))), len(values))
        return found

    # The ends are solved cold: a better optimum there than the warm chain finds means that the chain must be cold too.
    last = len(problems) - 1
    cold = kept(last, _cold(problems[last]))
    reached = kept(0, _cold(problems[0]))
    family: Family | None = None
    for index in range(1, last + 1):
        # The first that has an optimum is where the others come from.
        if family is None and isinstance(reached, Optimum):
            family = Family.of(reached)
        reached = _warm(problems[index], reached, family)
        if index < last:
            kept(index, reached)
    if isinstance(cold, Optimum) and (isinstance(reached, str) or _better(cold, reached)):
        for index in range(1, last):
            kept(index, _cold(problems[index]))
    else:
        kept(last, reached)
    return Variation(key, tuple(points[place] for place in sorted(points)))


def _better(one: Optimum, other: Optimum) -> bool:
    return one.mean_power_W - other.mean_power_W > ANOTHER_OPTIMUM * abs(one.mean_power_W)


def _cold(problem: Problem) -> Optimum | str:
    """Return the optimum from all starts, on a finer mesh where that of the file does not pass; or the status."""
    try:
        found = optimise(problem, certificate="quick", explained=False)
        return found if found.certificate.passed else optimise(problem, certificate="full", explained=False)
    except SolveError as error:
        return "infeasible" if error.explanation else "failed"


def _warm(problem: Problem, neighbour: Optimum | str, family: Family | None) -> Optimum | str:
    """Return the optimum from a neighbour's, certified; from all starts where that does not pass."""
    values = parameter_values(problem)
    if family is None or isinstance(neighbour, str) or values.structure != family.structure:
        return _cold(problem)
    start = neighbour.solution if neighbour.formulation == family.formulation else None
    attempts = family.attempts(values, start)
    if not attempts:
        return _cold(problem)
    found = certified(problem, attempts, "quick", family.formulation)
    return found if found.certificate.passed else _cold(problem)


def _point(value: float, found: Optimum | str, tangent: float | None) -> dict[str, Any]:
    if isinstance(found, str):
        return {"value": value, "status": found, "mean_power_W": None, "tangent_W": tangent, "active_limits": {}}
    return {
        "value": value,
        "status": found.certificate.status,
        "mean_power_W": found.mean_power_W,
        "tangent_W": tangent,
        "active_limits": active_limits(found.cycle),
    }
