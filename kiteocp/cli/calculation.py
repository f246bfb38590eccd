"""What the verbs share that compute a result from one problem: load, compute, save, print, draw."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.output import complain, say
from kiteocp.errors import CycleError, InfeasibleError, NoEquilibriumError, SolveError

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.result import Result


def load(name_or_path: str, overrides: list[str]) -> Problem:
    """Return the problem with the ``--set`` overrides, the last of one key counting."""
    from kiteocp.problem import load_problem, parse_override  # noqa: PLC0415  (keeps --help fast)

    return load_problem(name_or_path, dict(parse_override(text) for text in overrides))


def output_directory(output: str | None, problem: Problem, verb: str) -> Path:
    """Return where a verb writes: ``-o``, or ``results/<problem>/<verb>`` under the working directory."""
    return Path(output) if output is not None else Path("results") / problem.name / verb


def calculate(arguments: argparse.Namespace, verb: str, compute: Callable[[Problem], Result]) -> int:
    """Run one calculation and return the exit status.

    A calculation that cannot succeed for this problem still leaves a ``summary.json``, with its status and message.

    Parameters
    ----------
    arguments : argparse.Namespace
        With what `kiteocp.cli.parser.add_calculation` adds.
    verb : str
        Name of the verb, for the output directory and the summary.
    compute : callable
        From the problem to the result.

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
    directory = output_directory(arguments.output, problem, verb)
    try:
        result = compute(problem)
    except (CycleError, NoEquilibriumError, SolveError) as error:
        result = failed_result(verb, problem, error)
    # The numbers first: a picture that cannot be drawn must not cost them.
    return conclude(arguments, result, directory, result.save(directory))


def conclude(
    arguments: argparse.Namespace,
    result: Result,
    directory: Path,
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
    directory : pathlib.Path
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
    say(json.dumps(result.summary(), indent=2, ensure_ascii=False) if arguments.json else report(shown))
    try:
        # A calculation that failed holds no numbers, and so nothing to draw.
        if arguments.plot and (result.channels or "sensitivities" in result.details):
            from kiteocp.plots import draw  # noqa: PLC0415  (matplotlib only where a picture is wanted)

            written = written + draw(result, directory, arguments.formats or ("png",))
    finally:
        if not arguments.json:
            say("written: " + ", ".join(str(path) for path in written))
    if not result.succeeded:
        message = result.details.get("message") or "the calculation did not succeed"
        complain(f"{result.problem.name}: {result.status}: {message}; what was reached is saved in {directory}")
        return 1
    return 0


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
