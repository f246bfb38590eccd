"""What the verbs share that compute a result from one problem: load, compute, save, print, draw."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiteocp.cli.output import complain, say
from kiteocp.cli.place import Asked, Place, choose_place
from kiteocp.errors import CycleError, InfeasibleError, InputError, NoEquilibriumError, SolveError
from kiteocp.execution import uninterrupted

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.result import Result


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


def place_of(arguments: argparse.Namespace, asked: Asked) -> Place:
    """Return where a verb writes: ``-o``, or ``results/<problem>/<verb>`` under the working directory."""
    return choose_place(arguments.output, asked, Path("results") / asked.problem.name, asked.verb)


def calculate(
    arguments: argparse.Namespace, verb: str, compute: Callable[[Problem], Result], options: Mapping[str, Any]
) -> int:
    """Run one calculation and return the exit status.

    A calculation that cannot succeed for this problem still leaves a ``summary.json``, with its status and message, and
    so does one that is interrupted where there is no earlier result.

    Parameters
    ----------
    arguments : argparse.Namespace
        With what `kiteocp.cli.parser.add_calculation` adds.
    verb : str
        Name of the verb, for the output directory and the summary.
    compute : callable
        From the problem to the result.
    options : mapping
        Options of the verb that shape the result; None where one is at its default.

    Returns
    -------
    int
        0, or 1 where the status of the result is not one of success.

    Raises
    ------
    InputError
        If the problem is wrong or the directory cannot be written to.
    """
    problem = load(arguments.problem, arguments.overrides)
    asked = asked_of(arguments, verb, problem, options)
    place = place_of(arguments, asked)
    with saved_if_interrupted(asked, place):
        try:
            result = compute(problem)
        except (CycleError, NoEquilibriumError, SolveError) as error:
            result = failed_result(verb, problem, error)
    # The numbers first: a picture that cannot be drawn must not cost them.
    return conclude(arguments, result, place, save(result, asked, place))


def save(result: Result, asked: Asked, place: Place) -> list[Path]:
    """Save a result with the options it was asked for, and return the files."""
    if asked.options:
        result.details["options"] = dict(asked.options)
    return result.save(place.directory)


@contextlib.contextmanager
def saved_if_interrupted(
    asked: Asked, place: Place, reached: Callable[[], Result | None] = lambda: None
) -> Iterator[None]:
    """Save what was reached if the block is interrupted, and say where it is.

    Parameters
    ----------
    asked, place
        What was asked, and where it goes.
    reached : callable
        Returns what was reached, None where that is nothing: then an earlier result is kept.

    Raises
    ------
    KeyboardInterrupt
        With one sentence that says what was saved.
    """
    try:
        yield
    except KeyboardInterrupt as error:
        with uninterrupted():
            result = reached()
            if result is None and place.replaced is not None:
                raise type(error)(f"nothing was reached; the earlier result in {place.directory} is kept") from None
            what = f"what was reached is saved in {place.directory}"
            if result is None:
                result = interrupted_result(asked)
                what = f"nothing was reached yet, as the summary in {place.directory} says"
            save(result, asked, place)
            raise type(error)(what) from None


def interrupted_result(asked: Asked) -> Result:
    """Return a result without numbers that says that the calculation was interrupted."""
    from kiteocp.result import Result  # noqa: PLC0415  (keeps --help fast)

    return Result(
        verb=asked.verb,
        problem=asked.problem,
        status="interrupted",
        details={"message": "interrupted before there was a result"},
    )


def conclude(
    arguments: argparse.Namespace,
    result: Result,
    place: Place,
    written: list[Path],
    report: Callable[[Result], str] = str,
) -> int:
    """Print a saved result, draw it where asked to, say what was written, and return the exit status.

    Parameters
    ----------
    arguments : argparse.Namespace
        With what `kiteocp.cli.parser.add_calculation` adds.
    result : Result
        What was computed.
    place : Place
        Where it was saved and its pictures go.
    written : list of pathlib.Path
        The files written so far.
    report : callable
        From the result to the text that is printed without ``--json``.

    Returns
    -------
    int
        0, or 1 where the status of the result is not one of success.

    Raises
    ------
    InputError
        If a picture or standard output cannot be written.
    """
    # What went wrong goes to standard error, below, and is not said twice.
    details = {key: value for key, value in result.details.items() if result.succeeded or key != "message"}
    shown = replace(result, details=details)
    directory = place.directory
    try:
        say(json.dumps(result.summary(), indent=2, ensure_ascii=False) if arguments.json else report(shown))
        try:
            # A calculation that failed holds no numbers, and so nothing to draw.
            if arguments.plot and (result.channels or "sensitivities" in result.details):
                from kiteocp.plots import draw  # noqa: PLC0415  (matplotlib only where a picture is wanted)

                written = written + draw(result, directory, arguments.formats or ("png",))
        finally:
            tell_written(arguments, place, ", ".join(str(path) for path in written))
    except KeyboardInterrupt as error:
        raise type(error)(f"the numbers are saved in {directory}") from None
    if not result.succeeded:
        message = result.details.get("message") or "the calculation did not succeed"
        complain(f"{result.problem.name}: {result.status}: {message}; what was reached is saved in {directory}")
        return 1
    return 0


def tell_written(arguments: argparse.Namespace, place: Place, files: str, *, apart: bool = False) -> None:
    """Say what was written, apart from what is above it or not, and which earlier result is gone (not into JSON)."""
    if not arguments.json:
        say(("\n" if apart else "") + f"written: {files}")
    if place.replaced is not None:
        (complain if arguments.json else say)(place.replaced)


def failed_result(verb: str, problem: Problem, error: CycleError | NoEquilibriumError | SolveError) -> Result:
    """Return a result without numbers that says why there are none."""
    from kiteocp.result import Result  # noqa: PLC0415  (keeps --help fast)

    return Result(
        verb=verb,
        problem=problem,
        # No cycle exists where a state of it has no equilibrium; a solver that found none proves nothing.
        status="failed" if isinstance(error, SolveError) and not isinstance(error, InfeasibleError) else "infeasible",
        warnings=tuple(problem.warnings()),
        details={"message": str(error), "facts": error.facts, "explanation": dict(error.explanation)},
    )


def digest_of(flight: Path) -> str:
    """Return the digest of a recording, empty where it cannot be read: reading it says why."""
    # Unlike `Path.is_file`, this asks of any text.
    if not os.path.isfile(flight):
        return ""
    try:
        with flight.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""
