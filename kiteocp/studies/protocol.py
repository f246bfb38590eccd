"""What every study gives, whatever it computes: numbers, words, files and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import msgspec
from msgspec.structs import replace

from kiteocp.errors import CycleError, InfeasibleError, NoEquilibriumError, SolveError
from kiteocp.problem import Problem
from kiteocp.report.document import Document, Figure
from kiteocp.result import Result
from kiteocp.verbs import verb_named


class Study(Protocol):
    """The answer of a verb. The command line saves, prints and draws any; `kiteocp.plots` knows how figures look."""

    def result(self) -> Result:
        """Return the numbers, of the output contract."""

    def document(self) -> Document:
        """Return what a person reads; why a calculation failed is not in it, as that is said apart."""

    def files(self) -> Mapping[str, bytes]:
        """Return what is written beside ``summary.json`` and the time series, by name: tables as CSV, problem files."""

    def figures(self) -> Sequence[Figure]:
        """Return the figures that there are to draw."""


class ResultStudy(msgspec.Struct, frozen=True):
    """A study whose numbers are all in its result.

    Attributes
    ----------
    found
        The result.
    words
        From a result to its document.
    written
        Files beside it.
    """

    found: Result
    words: Callable[[Result], Document] = Result.document
    written: Mapping[str, bytes] = msgspec.field(default_factory=dict)

    def result(self) -> Result:
        """Return the numbers."""
        return self.found

    def document(self) -> Document:
        """Return the words, without why it failed."""
        if self.found.succeeded:
            return self.words(self.found)
        told = {key: value for key, value in self.found.details.items() if key != "message"}
        return self.words(replace(self.found, details=told))

    def files(self) -> Mapping[str, bytes]:
        """Return the files beside the result."""
        return self.written

    def figures(self) -> Sequence[Figure]:
        """Return those for which the result holds what they need; one that failed has no numbers to draw."""
        return figures_of(self.found)


def figures_of(result: Result) -> list[Figure]:
    """Return the figures that a result can be drawn as."""
    verb = verb_named(result.verb)
    return [
        Figure(stem)
        for stem, key in (verb.pictures if verb else {}).items()
        if (len(result.channels) > 0 if key is None else key in result.details)
    ]


def failed_result(verb: str, problem: Problem, error: CycleError | NoEquilibriumError | SolveError) -> Result:
    """Return a result without numbers that says why there are none."""
    # No cycle exists where a state of it has no equilibrium; a solver that found none proves nothing.
    failed = isinstance(error, SolveError) and not isinstance(error, InfeasibleError)
    details = {"message": str(error), "facts": error.facts, "explanation": dict(error.explanation)}
    return Result(
        verb, problem, "failed" if failed else "infeasible", warnings=tuple(problem.warnings()), details=details
    )


def interrupted_result(verb: str, problem: Problem) -> Result:
    """Return a result without numbers that says that the calculation was interrupted."""
    return Result(verb, problem, "interrupted", details={"message": "interrupted before there was a result"})
