"""Reproduce the results section of the paper beside its tables, or set a recorded flight against the model."""

from __future__ import annotations

import argparse
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.output import say
from kiteocp.cli.parser import PICTURE_FORMATS, add_output
from kiteocp.cli.place import choose_paper_place
from kiteocp.cli.progress import Progress
from kiteocp.cli.run import tell_written
from kiteocp.cli.validate_flight import add_flight_arguments, check_no_flight, validate_recording

if TYPE_CHECKING:
    from kiteocp.report.html import Picture
    from kiteocp.studies.paper.paper import PaperValidation

NAME = "validate"
HELP = "reproduce the paper's results beside its tables, or set a recorded flight against the model"

#: Files that a validation writes beside its pictures.
SUMMARY, REPORT = "summary.json", "report.html"

def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flight, if any, where to write and what to draw."""
    add_flight_arguments(parser)
    add_output(parser, "results/validation, with a flight results/validation/<flight>", "all, of a flight png")


def run(arguments: argparse.Namespace) -> int:
    """Validate against the paper, or against a flight where one is given."""
    if arguments.flight is not None:
        return validate_recording(arguments)
    check_no_flight(arguments)
    return _validate_paper(arguments)


def _validate_paper(arguments: argparse.Namespace) -> int:
    """Compute, save, print and draw the paper's results section, and write the report."""
    from kiteocp.result import write_atomically  # noqa: PLC0415
    from kiteocp.result.earlier import stale_files  # noqa: PLC0415
    from kiteocp.studies.paper.paper import validate_paper  # noqa: PLC0415  (keeps --help fast)
    from kiteocp.studies.paper.report import report_html  # noqa: PLC0415
    from kiteocp.studies.paper.text import format_validation  # noqa: PLC0415

    directory = Path(arguments.output) if arguments.output is not None else Path("results") / "validation"
    place = choose_paper_place(directory)
    try:
        with Progress("parts of the validation done") as progress:
            study = validate_paper(progress)
    except KeyboardInterrupt as error:
        raise type(error)("nothing was reached, and nothing written") from None
    # The numbers first: a picture that cannot be drawn must not cost them.
    summary = json.dumps(study.summary(), indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically({directory / SUMMARY: (summary + "\n").encode()}, remove=stale_files(directory))
    written = [directory / SUMMARY]
    say(summary if arguments.json else format_validation(study))
    try:
        pictures: list[Picture] = []
        if arguments.plot:
            pictures = _draw(study, directory, arguments.formats or PICTURE_FORMATS, written)
        write_atomically({directory / REPORT: report_html(study, pictures).encode()})
        written.insert(1, directory / REPORT)
    except KeyboardInterrupt as error:
        raise type(error)(f"the numbers are saved in {directory}") from None
    finally:
        tell_written(arguments, place, _written(written), apart=True)
    return 0


def _draw(
    study: PaperValidation, directory: Path, formats: tuple[str, ...] | list[str], written: list[Path]
) -> list[Picture]:
    """Draw and save every figure, add the files to ``written``, and return the figures for the report."""
    from kiteocp.plots.style import save_figure  # noqa: PLC0415  (matplotlib only where a picture is wanted)
    from kiteocp.plots.validation import CAPTIONS, figures  # noqa: PLC0415
    from kiteocp.report.html import Picture  # noqa: PLC0415

    pictures: list[Picture] = []
    with Progress("pictures drawn") as progress:
        for stem, figure in figures(study.cycles(), study.convergence, study.isolines).items():
            progress(len(pictures), len(CAPTIONS))
            paths = save_figure(figure, directory / stem, formats)
            written += paths
            by_suffix = {path.suffix: path for path in paths}
            # A drawing of lines where there is one, else the pixels; a report cannot show a PDF.
            suffix = next((suffix for suffix in (".svg", ".png") if suffix in by_suffix), None)
            if suffix is None:
                stream, suffix = io.BytesIO(), ".svg"
                figure.savefig(stream, format="svg", metadata={"Date": None})
                content = stream.getvalue()
            else:
                content = by_suffix[suffix].read_bytes()
            pictures.append(
                Picture(stem, CAPTIONS[stem], {".svg": "image/svg+xml", ".png": "image/png"}[suffix], content)
            )
    return pictures


def _written(paths: list[Path]) -> str:
    """Return what was written: the pictures counted, there being dozens."""
    pictures = [path for path in paths if path.suffix.removeprefix(".") in PICTURE_FORMATS]
    text = ", ".join(str(path) for path in paths if path not in pictures)
    if not pictures:
        return text
    suffixes = ", ".join(dict.fromkeys(path.suffix.removeprefix(".") for path in pictures))
    stems = {path.stem for path in pictures}
    return f"{text} (with all sentences and tables), and {len(stems)} pictures beside them as {suffixes}"
