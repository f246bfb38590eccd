"""To the winch: set points, phase switching and implementable laws of an optimal cycle, and what the laws lose."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np

from kiteocp.cycle.phases import PhaseName
from kiteocp.errors import SolveError, check_word
from kiteocp.execution import one_at_a_time
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.optimum.refine import Optimum, optimise
from kiteocp.physics.wind import problem_in_wind
from kiteocp.problem import Problem
from kiteocp.result.contract import to_plain
from kiteocp.result.storage import format_time_series
from kiteocp.studies.winch.evaluation import LawEvaluation, evaluate
from kiteocp.studies.winch.flight import Switching
from kiteocp.studies.winch.law import Kind, WinchLaw, fit_force_law, fit_length_law
from kiteocp.studies.winch.report import format_report
from kiteocp.studies.winch.setpoints import setpoints_over_length, setpoints_over_time
from kiteocp.writing import write_atomically

TIME_FILE, LENGTH_FILE = "setpoints_time.csv", "setpoints_length.csv"
LAWS_FILE, REPORT_FILE = "laws.json", "report.txt"

#: Winds in which the laws are flown, over that of the problem.
WIND_FACTORS = (1.0, 0.9, 1.1)


class WinchExport(msgspec.Struct, frozen=True):
    """What a controller takes from an optimal cycle.

    Attributes
    ----------
    problem
        What was optimised.
    certified
        Whether the optimum passed all its checks.
    setpoints_time, setpoints_length
        Tables of `kiteocp.studies.winch.setpoints`, by column.
    switching
        When phases end.
    laws
        For each kind (``force``, ``length``) the law of each phase; a length law is missing where the tether length
        is not monotone.
    evaluations
        Cycles under the laws of each kind in each wind of `WIND_FACTORS`.
    """

    problem: Problem
    certified: bool
    setpoints_time: Mapping[str, np.ndarray]
    setpoints_length: Mapping[str, np.ndarray]
    switching: Switching
    laws: Mapping[Kind, Mapping[PhaseName, WinchLaw]]
    evaluations: tuple[LawEvaluation, ...]

    def evaluation(self, kind: Kind = "force", wind_factor: float = 1.0) -> LawEvaluation:
        """Return the cycle under the laws of a kind in a wind.

        Raises
        ------
        InputError
            The kind is none.
        KeyError
            It was not flown.
        """
        check_word("kind", kind, get_args(Kind))
        for one in self.evaluations:
            if one.kind == kind and one.wind_factor == wind_factor:
                return one
        raise KeyError(f"no cycle under {kind} laws at {wind_factor:g} times the wind")

    @property
    def report(self) -> str:
        """What a person reads, several lines."""
        return format_report(self.problem, self.certified, self.switching, self.laws, self.evaluations)

    def to_dict(self) -> dict[str, Any]:
        """Return the contents of ``laws.json``: plain values, finite numbers or None."""
        ends = self.switching
        conditions: dict[PhaseName, dict[str, float]] = {
            "retraction": {
                "tether_length_at_most_m": ends.retraction_length_m,
                "or_elevation_at_least_deg": ends.elevation_max_deg,
            },
            "transition": {"elevation_at_most_deg": ends.transition_elevation_deg},
            "traction": {"tether_length_at_least_m": ends.traction_length_m},
        }
        if ends.turn_elevation_deg is not None:
            conditions["turn"] = {"elevation_at_least_deg": ends.turn_elevation_deg}
        plain: dict[str, Any] = to_plain(
            {
                "schema_version": 1,
                "problem": self.problem.name,
                "input_sha256": self.problem.sha256,
                "certified": self.certified,
                "phases": {
                    name: {
                        "ends_when": condition,
                        **{
                            f"{kind}_law": laws[name].to_dict() if name in laws else None
                            for kind, laws in self.laws.items()
                        },
                    }
                    for name, condition in conditions.items()
                },
                "evaluations": [one.to_dict() for one in self.evaluations],
            }
        )
        return plain

    def save(self, directory: str | Path) -> list[Path]:
        """Write set points, laws and report into a directory, whole or not at all.

        Raises
        ------
        InputError
            The directory cannot be written to.
        """
        directory = Path(directory)
        contents = {
            directory / TIME_FILE: format_time_series(self.setpoints_time),
            directory / LENGTH_FILE: format_time_series(self.setpoints_length),
            directory / LAWS_FILE: (json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n").encode(),
            directory / REPORT_FILE: (self.report + "\n").encode(),
        }
        write_atomically(contents)
        return list(contents)


@one_at_a_time
def export_schedule(problem: Problem, directory: str | Path) -> WinchExport:
    """Solve a problem and write what a winch controller takes; ``kiteocp solve --export`` in Python.

    Parameters
    ----------
    problem
        The problem.
    directory
        Where ``setpoints_time.csv``, ``setpoints_length.csv``, ``laws.json`` and ``report.txt`` go.

    Raises
    ------
    SolveError
        No optimal cycle was found.
    InputError
        The directory cannot be written to.
    """
    export = winch_export(optimise(problem))
    export.save(directory)
    return export


@one_at_a_time
def winch_export(optimum: Optimum) -> WinchExport:
    """Make set points and laws from an optimum and fly the laws in the wind of the problem and in others.

    The optima of the other winds are solved anew, with the quick certificate. The force laws are fitted to all of them,
    the one in the wind of the problem counting most; the length laws to that one alone.
    """
    cycle, problem = optimum.cycle, optimum.problem
    problems = {factor: problem if factor == 1.0 else problem_in_wind(problem, factor) for factor in WIND_FACTORS}
    optima = {factor: cycle if factor == 1.0 else _optimal_cycle(changed) for factor, changed in problems.items()}
    others = [other for factor, other in optima.items() if factor != 1.0 and other is not None]
    laws: dict[Kind, dict[PhaseName, WinchLaw]] = {"force": {}, "length": {}}
    for index, record in enumerate(cycle.records):
        laws["force"][record.name] = fit_force_law(record, [other.records[index] for other in others], cycle.values)
        if (law := fit_length_law(record)) is not None:
            laws["length"][record.name] = law
    evaluations = [
        evaluate(kind, of_kind, cycle, problems[factor], factor, optima[factor])
        for kind, of_kind in laws.items()
        if len(of_kind) == len(cycle.records)
        for factor in WIND_FACTORS
    ]
    return WinchExport(
        problem,
        optimum.certificate.passed,
        setpoints_over_time(cycle),
        setpoints_over_length(cycle),
        Switching.of(cycle),
        laws,
        tuple(evaluations),
    )


def _optimal_cycle(problem: Problem) -> OptimalCycle | None:
    try:
        return optimise(problem, certificate="quick").cycle
    except SolveError:
        return None
