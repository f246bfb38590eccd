"""Reproduce the results section of the paper beside its tables, or set a recorded flight against the model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.parser import add_output, add_overrides
from kiteocp.cli.place import choose_paper_place, choose_place
from kiteocp.cli.progress import Progress
from kiteocp.cli.run import asked_of, digest_of, load, run_study
from kiteocp.errors import InputError
from kiteocp.verbs import PICTURE_FORMATS

if TYPE_CHECKING:
    from kiteocp.studies.paper.paper import PaperValidation
    from kiteocp.studies.prediction.study import FlightStudy

HELP = "reproduce the paper's results beside its tables, or set a recorded flight against the model"

#: Where results go without ``-o``, below it a folder for each flight.
DIRECTORY = Path("results") / "validation"

#: Options that only a flight takes, by their names in the arguments.
FLIGHT_OPTIONS = {"system": "--system", "columns": "--columns", "estimate_on": "--estimate-on", "overrides": "--set"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flight, if any, where to write and what to draw."""
    parser.add_argument(
        "flight",
        metavar="FLIGHT.csv",
        nargs="?",
        help="a recorded flight to set against the model, with --system; the paper where left out",
    )
    parser.add_argument("--system", metavar="PROBLEM", help="the system that flew, as v9-kite")
    parser.add_argument(
        "--columns", metavar="MAP", help="column map of the flight: name of a shipped one, or path (default: what fits)"
    )
    parser.add_argument(
        "--estimate-on",
        dest="estimate_on",
        metavar="CYCLES",
        help="numbers of the cycles to estimate wind and aerodynamics on, as 0,1 (default: the first half)",
    )
    add_overrides(parser)
    add_output(parser, "results/validation, with a flight results/validation/<flight>", "all, of a flight png")


def run(arguments: argparse.Namespace) -> int:
    """Validate against the paper, or against a flight where one is given."""
    if arguments.flight is not None:
        return _run_flight(arguments)
    for name, option in FLIGHT_OPTIONS.items():
        if getattr(arguments, name):
            raise InputError(
                f"{option} needs a flight; name its CSV file: kiteocp validate FLIGHT.csv --system PROBLEM"
            )
    place = choose_paper_place(DIRECTORY if arguments.output is None else Path(arguments.output))
    return run_study(arguments, None, place, _paper, formats=PICTURE_FORMATS)


def _paper() -> PaperValidation:
    from kiteocp.studies.paper.paper import validate_paper  # noqa: PLC0415  (keeps --help fast)

    with Progress("parts of the validation done") as progress:
        return validate_paper(progress)


def _run_flight(arguments: argparse.Namespace) -> int:
    """Estimate on some cycles of a flight, predict the others, and find the optimum."""
    if arguments.system is None:
        raise InputError("a flight needs the system that flew it; add --system, as --system v9-kite")
    cycles = _numbers(arguments.estimate_on)
    problem = load(arguments.system, arguments.overrides)
    from kiteocp.recording.reading import load_flight  # noqa: PLC0415  (keeps --help fast)

    flight = load_flight(arguments.flight, arguments.columns)
    recording = Path(arguments.flight)
    options = {"flight_sha256": digest_of(recording), "columns": arguments.columns, "estimate-on": cycles}
    asked = asked_of(arguments, "validate", problem, options, problem.name)
    place = choose_place(arguments.output, asked, DIRECTORY, recording.stem)

    def compute() -> FlightStudy:
        from kiteocp.studies.prediction.study import validate_flight  # noqa: PLC0415

        with Progress("parts of the study done") as progress:
            return validate_flight(flight, problem, estimate_on=cycles, progress=progress)

    return run_study(arguments, asked, place, compute)


def _numbers(text: str | None) -> list[int] | None:
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--estimate-on {text}: expected numbers of cycles, as 0,1") from None
