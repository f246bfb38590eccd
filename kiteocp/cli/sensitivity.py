"""Differentiate the optimal mean power with respect to every number of a problem file, and say how far that holds."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.output import complain
from kiteocp.cli.parser import add_calculation
from kiteocp.cli.progress import Progress, positive_integer
from kiteocp.cli.run import asked_of, conclude, failed_result, load, place_of, save, saved_if_interrupted
from kiteocp.errors import CycleError, InputError, SolveError
from kiteocp.execution import uninterrupted

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.result import Result
    from kiteocp.studies.sensitivity.sobol import GlobalStudy
    from kiteocp.studies.sensitivity.variation import Variation

NAME = "sensitivity"
HELP = "say what the optimal power is worth in every number and limit of a problem"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem, and what to find out beside the derivatives."""
    add_calculation(parser)
    parser.add_argument(
        "--no-intervals",
        dest="intervals",
        action="store_false",
        help="derivatives only: do not follow the optimum to where its active limits change",
    )
    parser.add_argument(
        "--vary",
        metavar="KEY=FROM:TO:N|V,V",
        help="also re-solve along one key at N values, as tether.diameter_m=0.003:0.008:11, or at those of a list, as "
        "tether.diameter_m=0.003,0.004",
    )
    parser.add_argument(
        "--global",
        dest="wide",
        action="store_true",
        help="also propagate the uncertainties of the file: distribution, Sobol indices, value of re-optimising",
    )
    parser.add_argument(
        "--samples", type=positive_integer, metavar="N", help="optima that --global solves at most (default 2000)"
    )
    parser.add_argument(
        "--jobs", type=positive_integer, metavar="N", help="processes of --global (default: one for each core)"
    )
    parser.add_argument(
        "--simulate",
        dest="forward",
        action="store_true",
        help="also differentiate the prescribed cycle, as simulated: mean powers and durations of its phases",
    )


def run(arguments: argparse.Namespace) -> int:
    """Differentiate, vary where asked to, save, print and draw."""
    for name in ("samples", "jobs"):
        if getattr(arguments, name) is not None and not arguments.wide:
            raise InputError(f"--{name} {getattr(arguments, name)}: only --global takes it; add --global")
    problem = load(arguments.problem, arguments.overrides)
    options = {
        "intervals": None if arguments.intervals else False,
        "vary": arguments.vary,
        "global": arguments.wide or None,
        "samples": arguments.samples,
        "simulate": arguments.forward or None,
    }
    asked = asked_of(arguments, NAME, problem, options)
    variation = _variation(problem, arguments)
    wide = _global_options(problem, arguments) if arguments.wide else None
    place = place_of(arguments, asked)
    directory = place.directory
    study = _Study()
    try:
        with saved_if_interrupted(asked, place, study.interrupted):
            unflown = study.compute(problem, arguments, variation, wide)
    except KeyboardInterrupt:
        study.save_tables(directory)
        raise
    written = save(study.result, asked, place) + study.save_tables(directory)
    status = conclude(arguments, study.result, place, written, _report)
    if status == 0 and unflown is not None:
        complain(f"{problem.name}: {unflown}; the rest is saved in {directory}")
        return 1
    return status


def _variation(problem: Problem, arguments: argparse.Namespace) -> tuple[str, list[float]] | None:
    """Return key and values of ``--vary``, checked before anything is solved."""
    if arguments.vary is None:
        return None
    # Imported once the problem is known to be good: a mistake in it is answered without waiting for CasADi.
    from kiteocp.studies.sensitivity.variation import parse_variation, varied_problems  # noqa: PLC0415

    asked = parse_variation(arguments.vary)
    varied_problems(problem, *asked)
    return asked


class _Study:
    """What a run of the verb has found so far, so that an interruption loses none of it."""

    def __init__(self) -> None:
        self._found: Result | None = None
        self._variation: Variation | None = None
        self._global: GlobalStudy | None = None

    @property
    def result(self) -> Result:
        """The sensitivities, which there are once `compute` has returned."""
        assert self._found is not None
        return self._found

    def compute(
        self,
        problem: Problem,
        arguments: argparse.Namespace,
        variation: tuple[str, list[float]] | None,
        wide: dict[str, int] | None,
    ) -> str | None:
        """Differentiate, vary and propagate; return why the prescribed cycle has no derivatives, if so."""
        from kiteocp.studies.sensitivity.local import sensitivities  # noqa: PLC0415
        from kiteocp.studies.sensitivity.variation import vary  # noqa: PLC0415

        try:
            self._found = sensitivities(problem, intervals=arguments.intervals)
        except SolveError as error:
            self._found = failed_result(NAME, problem, error)
        else:
            if variation is not None:
                with Progress("values solved") as progress:

                    def keep(done: Variation, total: int) -> None:
                        self._variation = done
                        progress(len(done.points), total)

                    self._variation = vary(problem, *variation, around=self._found, progress=keep)
                self._found.details["variation"] = self._variation.to_dict()
            if wide is not None:
                self._propagate(problem, wide)
        return _differentiate_forward(problem, self._found) if arguments.forward else None

    def _propagate(self, problem: Problem, wide: dict[str, int]) -> None:
        from kiteocp.studies.sensitivity.sobol import global_sensitivity  # noqa: PLC0415

        def keep(done: GlobalStudy) -> None:
            self._global = done

        with Progress("optima solved") as progress:
            self._global = global_sensitivity(problem, progress=progress, keep=keep, **wide)
        self.result.details["global"] = self._global.summary

    def interrupted(self) -> Result | None:
        """Return what was found when the run was interrupted; None where that is nothing."""
        if self._found is None:
            return None
        if self._variation is not None:
            self._found.details["variation"] = self._variation.to_dict()
        if self._global is not None and "global" not in self._found.details:
            self._found.details["global_finished_samples"] = len(self._global.samples)
        self._found.details["message"] = "interrupted; what was finished until then is here"
        return replace(self._found, status="interrupted")

    def save_tables(self, directory: Path) -> list[Path]:
        """Write the tables of what was found, and return the files."""
        with uninterrupted():
            return [table.save(directory) for table in (self._variation, self._global) if table is not None]


def _global_options(problem: Problem, arguments: argparse.Namespace) -> dict[str, int]:
    """Return the numbers of samples and jobs, checked before anything is solved."""
    from kiteocp.studies.sensitivity.sobol import SAMPLES, base_samples  # noqa: PLC0415

    options = {"samples": arguments.samples or SAMPLES, "jobs": arguments.jobs or os.cpu_count() or 1}
    base_samples(problem, options["samples"])
    return options


def _differentiate_forward(problem: Problem, result: Result) -> str | None:
    """Add the prescribed cycle and its derivatives to a result; return why there are none, if so."""
    from kiteocp.studies.sensitivity.forward import forward_sensitivity  # noqa: PLC0415

    try:
        result.details.update(forward_sensitivity(problem).to_dict())
    except CycleError as error:
        result.details.update({"forward_cycle": None, "forward_sensitivities": [], "forward_message": str(error)})
        return f"the prescribed cycle cannot be flown: {error}"
    return None


def _report(result: Result) -> str:
    from kiteocp.studies.sensitivity.forward import format_forward  # noqa: PLC0415
    from kiteocp.studies.sensitivity.report import format_sensitivities, format_variation  # noqa: PLC0415

    parts = [format_sensitivities(result)]
    if "variation" in result.details:
        parts.append(format_variation(result))
    if "global" in result.details:
        from kiteocp.studies.sensitivity.sobol_report import format_global  # noqa: PLC0415

        parts.append(format_global(result.details["global"]))
    if result.details.get("forward_cycle"):
        parts.append(format_forward(result.details))
    return "\n\n".join(parts)
