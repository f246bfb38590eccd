"""``kiteocp validate FLIGHT.csv``: a recorded flight against the model."""

from __future__ import annotations

import argparse
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.output import complain, say
from kiteocp.cli.parser import add_overrides
from kiteocp.cli.place import choose_place
from kiteocp.cli.progress import Progress
from kiteocp.cli.run import asked_of, digest_of, load, save, saved_if_interrupted, tell_written
from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.report.html import Picture
    from kiteocp.studies.prediction.study import FlightStudy

REPORT = "report.html"

#: What a page can show, by suffix.
MEDIA_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}

#: Options that only a flight takes, by their names in the arguments.
FLIGHT_OPTIONS = {"system": "--system", "columns": "--columns", "estimate_on": "--estimate-on", "overrides": "--set"}


def add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flight and what belongs to it."""
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


def check_no_flight(arguments: argparse.Namespace) -> None:
    """Refuse options of a flight where none is given."""
    for name, option in FLIGHT_OPTIONS.items():
        if getattr(arguments, name):
            raise InputError(
                f"{option} needs a flight; name its CSV file: kiteocp validate FLIGHT.csv --system PROBLEM"
            )


def validate_recording(arguments: argparse.Namespace) -> int:
    """Estimate, predict, optimise, save, print and draw."""
    if arguments.system is None:
        raise InputError("a flight needs the system that flew it; add --system, as --system v9-kite")
    cycles = _numbers(arguments.estimate_on)
    problem = load(arguments.system, arguments.overrides)
    from kiteocp.recording.reading import load_flight  # noqa: PLC0415  (keeps --help fast)

    flight = load_flight(arguments.flight, arguments.columns)
    from kiteocp.result import write_atomically  # noqa: PLC0415
    from kiteocp.studies.prediction.study import validate_flight  # noqa: PLC0415
    from kiteocp.studies.prediction.summary import format_study, result_of  # noqa: PLC0415

    recording = Path(arguments.flight)
    options = {
        "flight_sha256": digest_of(recording),
        "columns": arguments.columns,
        "estimate-on": cycles,
    }
    asked = asked_of(arguments, "validate", problem, options, problem.name)
    place = choose_place(arguments.output, asked, Path("results") / "validation", recording.stem)
    directory = place.directory
    with saved_if_interrupted(asked, place):
        with Progress("parts of the study done") as progress:
            study = validate_flight(flight, problem, estimate_on=cycles, progress=progress)
        result = result_of(study)
    # The numbers first: a picture that cannot be drawn must not cost them.
    written = save(result, asked, place)
    say(json.dumps(result.summary(), indent=2, ensure_ascii=False) if arguments.json else format_study(study))
    try:
        pictures: list[Picture] = []
        if arguments.plot:
            pictures = _draw(study, directory, arguments.formats or ["png"], written)
        from kiteocp.studies.prediction.report import report_html  # noqa: PLC0415

        write_atomically({directory / REPORT: report_html(study, pictures).encode()})
        written.insert(1, directory / REPORT)
    except KeyboardInterrupt as error:
        raise type(error)(f"the numbers are saved in {directory}") from None
    finally:
        tell_written(arguments, place, ", ".join(str(path) for path in written), apart=True)
    if study.optimum is None:
        complain(f"{problem.name}: {study.optimum_message}; the comparison is saved in {directory}")
        return 1
    return 0


def _numbers(text: str | None) -> list[int] | None:
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--estimate-on {text}: expected numbers of cycles, as 0,1") from None


def _draw(study: FlightStudy, directory: Path, formats: list[str], written: list[Path]) -> list[Picture]:
    """Draw and save every figure, add the files to ``written``, and return the figures for the report."""
    from kiteocp.plots.flights import caption, figures  # noqa: PLC0415  (matplotlib only where a picture is wanted)
    from kiteocp.plots.style import save_figure  # noqa: PLC0415
    from kiteocp.report.html import Picture  # noqa: PLC0415

    pictures = []
    with Progress("pictures drawn") as progress:
        drawings = figures(study)
        for done, (stem, draw) in enumerate(drawings.items(), start=1):
            figure = draw()
            paths = save_figure(figure, directory / stem, formats)
            written += paths
            # The first format that a browser shows; it does not show a PDF in a page.
            shown = next((path for path in paths if path.suffix in MEDIA_TYPES), None)
            if shown is not None:
                suffix, content = shown.suffix, shown.read_bytes()
            else:
                stream = io.BytesIO()
                figure.savefig(stream, format="svg", metadata={"Date": None})
                suffix, content = ".svg", stream.getvalue()
            pictures.append(Picture(stem, caption(stem), MEDIA_TYPES[suffix], content))
            progress(done, len(drawings))
    return pictures
