"""The one way of every verb that computes: load, compute, save, print, draw."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiteocp.cli.drawing import drawing_apart
from kiteocp.cli.output import complain, say
from kiteocp.cli.place import Asked, Place, choose_place
from kiteocp.cli.progress import Progress
from kiteocp.errors import CycleError, InputError, NoEquilibriumError, SolveError
from kiteocp.execution import uninterrupted
from kiteocp.verbs import PICTURE_FORMATS

if TYPE_CHECKING:
    from kiteocp.plots.pictures import Contents
    from kiteocp.problem import Problem
    from kiteocp.result import Result
    from kiteocp.studies.protocol import Study

#: The page of a study that has one.
PAGE_FILE = "report.html"

#: Pictures that are named one by one; of more their number is told.
NAMED = 4


def load(name_or_path: str, overrides: list[str]) -> Problem:
    """Return the problem with the ``--set`` overrides, the last of one key counting."""
    from kiteocp.problem import load_problem, parse_override  # noqa: PLC0415  (keeps --help fast)

    return load_problem(name_or_path, dict(parse_override(text) for text in overrides))


def asked_of(
    arguments: argparse.Namespace, verb: str, problem: Problem, options: Mapping[str, Any], *spare_words: str
) -> Asked:
    """Return what the arguments ask, with the options that shape the result and are not at their defaults."""
    as_it_stands: Problem | None = problem
    if arguments.overrides:
        name = getattr(arguments, "system", None) or arguments.problem
        try:
            as_it_stands = load(name, [])
        except InputError:  # what was set mends it
            as_it_stands = None
    given = {name: value for name, value in options.items() if value is not None}
    return Asked(verb, problem, as_it_stands, given, spare_words)


def calculate(
    arguments: argparse.Namespace, verb: str, compute: Callable[[Problem], Study], options: Mapping[str, Any]
) -> int:
    """Load the problem, run one calculation, and return the exit status.

    Parameters
    ----------
    arguments : argparse.Namespace
        With what `kiteocp.cli.parser.add_calculation` adds.
    verb : str
        Name of the verb, for the output directory and the summary.
    compute : callable
        From the problem to the study.
    options : mapping
        Options of the verb that shape the result; None where one is at its default.

    Raises
    ------
    InputError
        If the problem is wrong or the directory cannot be written to.
    """
    problem = load(arguments.problem, arguments.overrides)
    with drawing_apart(verb, formats_of(arguments)) as contents:
        asked = asked_of(arguments, verb, problem, options)
        return run_study(arguments, asked, place_of(arguments, asked), lambda: compute(problem), contents=contents)


def formats_of(arguments: argparse.Namespace, default: tuple[str, ...] = ("png",)) -> Sequence[str]:
    """Return the formats of the pictures; none with ``--no-plot``."""
    return (arguments.formats or default) if arguments.plot else ()


def place_of(arguments: argparse.Namespace, asked: Asked) -> Place:
    """Return where a verb writes: ``-o``, or ``results/<problem>/<verb>`` under the working directory."""
    return choose_place(arguments.output, asked, Path("results") / asked.problem.name, asked.verb)


def run_study(
    arguments: argparse.Namespace,
    asked: Asked | None,
    place: Place,
    compute: Callable[[], Study],
    *,
    reached: Callable[[], Study | None] = lambda: None,
    formats: tuple[str, ...] = ("png",),
    contents: Contents | None = None,
) -> int:
    """Compute a study, save, print and draw it, and return the exit status.

    A calculation that cannot succeed for this problem still leaves a ``summary.json``, with its status and message, and
    so does one that is interrupted where there is no earlier result.

    Parameters
    ----------
    arguments
        With what `kiteocp.cli.parser.add_output` adds.
    asked
        What is asked; None for a study whose input is always the same.
    place
        Where it goes.
    compute
        Returns the study.
    reached
        Returns what was reached when `compute` is interrupted, None where that is nothing.
    formats
        Of the pictures, where none is asked for.
    contents
        What draws, of `kiteocp.cli.drawing`; without it this process does.

    Returns
    -------
    int
        0, or 1 where the status of the result is not one of success.

    Raises
    ------
    InputError
        If a file or standard output cannot be written.
    """
    with _saved_if_interrupted(asked, place, reached):
        try:
            study = compute()
        except (CycleError, NoEquilibriumError, SolveError) as error:
            if asked is None:
                raise
            from kiteocp.studies.protocol import ResultStudy, failed_result  # noqa: PLC0415

            study = ResultStudy(failed_result(asked.verb, asked.problem, error))
    # The numbers first: a picture that cannot be drawn must not cost them.
    result, directory = study.result(), place.directory
    written = _save(result, study, asked, place)
    try:
        document = study.document()
        say(json.dumps(result.summary(), indent=2, ensure_ascii=False) if arguments.json else document.text())
        try:
            pictures = []
            suffixes = formats_of(arguments, formats)
            if suffixes and study.figures():
                from kiteocp.plots.pictures import draw_study, drawn  # noqa: PLC0415  (only where it is wanted)

                with Progress("pictures drawn") as progress:
                    pictures = draw_study(study, directory, suffixes, written, progress, contents or drawn)
            if document.page:
                from kiteocp.writing import write_atomically  # noqa: PLC0415

                write_atomically({directory / PAGE_FILE: document.html(pictures).encode()})
                written.insert(1, directory / PAGE_FILE)
        finally:
            _tell_written(arguments, place, written, apart=document.page)
    except KeyboardInterrupt as error:
        raise type(error)(f"the numbers are saved in {directory}") from None
    if not result.succeeded:
        message = result.details.get("message") or "the calculation did not succeed"
        complain(f"{result.problem.name}: {result.status}: {message}; what was reached is saved in {directory}")
        return 1
    return 0


def _save(result: Result, study: Study, asked: Asked | None, place: Place) -> list[Path]:
    """Save the result of a study with the options it was asked for, and its files; return what was written."""
    if asked is not None and asked.options:
        result.details["options"] = dict(asked.options)
    return result.save(place.directory, study.files())


@contextlib.contextmanager
def _saved_if_interrupted(asked: Asked | None, place: Place, reached: Callable[[], Study | None]) -> Iterator[None]:
    """Save what was reached if the block is interrupted, and say where it is.

    Where that is nothing, an earlier result is kept.

    Raises
    ------
    KeyboardInterrupt
        With one sentence that says what was saved.
    """
    try:
        yield
    except KeyboardInterrupt as error:
        with uninterrupted():
            study = reached()
            if study is None and place.replaced is not None:
                raise type(error)(f"nothing was reached; the earlier result in {place.directory} is kept") from None
            if asked is None:
                raise type(error)("nothing was reached, and nothing written") from None
            what = f"what was reached is saved in {place.directory}"
            if study is None:
                from kiteocp.studies.protocol import ResultStudy, interrupted_result  # noqa: PLC0415

                study = ResultStudy(interrupted_result(asked.verb, asked.problem))
                what = f"nothing was reached yet, as the summary in {place.directory} says"
            _save(study.result(), study, asked, place)
            raise type(error)(what) from None


def _tell_written(arguments: argparse.Namespace, place: Place, files: list[Path], *, apart: bool) -> None:
    """Say what was written, apart from what is above or not, and which earlier result is gone (not into JSON)."""
    if not arguments.json:
        pictures = [path for path in files if path.suffix.removeprefix(".") in PICTURE_FORMATS]
        stems = dict.fromkeys(path.stem for path in pictures)
        told, also = files, ""
        if len(stems) > NAMED:
            told = [path for path in files if path not in pictures]
            suffixes = ", ".join(dict.fromkeys(path.suffix.removeprefix(".") for path in pictures))
            also = f", and {len(stems)} pictures beside them as {suffixes}"
        say(("\n" if apart else "") + f"written: {', '.join(map(str, told))}{also}")
    if place.replaced is not None:
        (complain if arguments.json else say)(place.replaced)


def digest_of(flight: Path) -> str:
    """Return the digest of a recording, empty where it cannot be read: reading it says why."""
    import hashlib  # noqa: PLC0415  (loads OpenSSL, which few verbs need)

    # Unlike `Path.is_file`, this asks of any text.
    if not os.path.isfile(flight):
        return ""
    try:
        with flight.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""
