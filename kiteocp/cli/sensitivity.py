"""Differentiate the optimal mean power with respect to every number of a problem file, and say how far that holds."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from kiteocp.cli.drawing import drawing_apart
from kiteocp.cli.output import complain
from kiteocp.cli.parser import add_calculation
from kiteocp.cli.progress import Progress, positive_integer
from kiteocp.cli.run import asked_of, formats_of, load, place_of, run_study
from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.problem import Problem

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
    asked = asked_of(arguments, "sensitivity", problem, options)
    with drawing_apart("sensitivity", formats_of(arguments)) as contents:
        from kiteocp.studies.sensitivity.study import SensitivityStudy  # noqa: PLC0415

        along = _variation(problem, arguments)
        wide = _global_options(problem, arguments) if arguments.wide else None
        study = SensitivityStudy()
        status = run_study(
            arguments,
            asked,
            place := place_of(arguments, asked),
            lambda: study.compute(
                problem, Progress, intervals=arguments.intervals, along=along, wide=wide, forward=arguments.forward
            ),
            reached=study.interrupted,
            contents=contents,
        )
    if status == 0 and study.unflown is not None:
        complain(f"{problem.name}: {study.unflown}; the rest is saved in {place.directory}")
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


def _global_options(problem: Problem, arguments: argparse.Namespace) -> dict[str, int]:
    """Return the numbers of samples and jobs, checked before anything is solved."""
    from kiteocp.studies.sensitivity.sobol import SAMPLES, base_samples  # noqa: PLC0415

    options = {"samples": arguments.samples or SAMPLES, "jobs": arguments.jobs or os.cpu_count() or 1}
    base_samples(problem, options["samples"])
    return options
