"""All that one run finds out about a problem: derivatives, and where asked for curve, samples, prescribed cycle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager

import msgspec
from msgspec.structs import replace

from kiteocp.errors import CycleError, SolveError
from kiteocp.problem import Problem
from kiteocp.report.document import Document, Figure, Part
from kiteocp.report.table import Table
from kiteocp.result import Result
from kiteocp.studies.protocol import ResultStudy, failed_result, figures_of
from kiteocp.studies.sensitivity.forward import forward_parts, forward_sensitivity
from kiteocp.studies.sensitivity.local import sensitivities
from kiteocp.studies.sensitivity.report import sensitivities_document
from kiteocp.studies.sensitivity.sobol import SAMPLES_FILE, GlobalStudy, global_sensitivity
from kiteocp.studies.sensitivity.sobol_report import global_parts
from kiteocp.studies.sensitivity.variation import VARIATION_FILE, Variation, vary

#: Makes what tells the progress of some work, in words.
Tell = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]


class SensitivityStudy(msgspec.Struct):
    """What is known so far, so that an interruption loses none of it.

    Attributes
    ----------
    found
        The derivatives; None before they are known.
    variation, samples
        The curve along a key, and the samples of the uncertainties.
    unflown
        Why the prescribed cycle has no derivatives, if they were asked for and there are none.
    """

    found: Result | None = None
    variation: Variation | None = None
    samples: GlobalStudy | None = None
    unflown: str | None = None

    def compute(
        self,
        problem: Problem,
        tell: Tell,
        *,
        intervals: bool = True,
        along: tuple[str, list[float]] | None = None,
        wide: Mapping[str, int] | None = None,
        forward: bool = False,
    ) -> SensitivityStudy:
        """Find out, and return itself.

        Parameters
        ----------
        problem
            The problem.
        tell
            For the progress.
        intervals
            As of `kiteocp.studies.sensitivity.local.sensitivities`.
        along
            Key and values of a curve.
        wide
            Numbers of ``samples`` and ``jobs`` to propagate the uncertainties with.
        forward
            Whether to differentiate the prescribed cycle too.

        Where there is no optimum, the result says why.
        """
        try:
            self.found = sensitivities(problem, intervals=intervals)
        except SolveError as error:
            self.found = failed_result("sensitivity", problem, error)
            along = wide = None
        if along is not None:
            with tell("values solved") as progress:

                def keep(done: Variation, total: int) -> None:
                    self.variation = done
                    progress(len(done.points), total)

                self.variation = vary(problem, *along, around=self.found, progress=keep)
        if wide is not None:

            def keep_samples(done: GlobalStudy) -> None:
                self.samples = done

            with tell("optima solved") as progress:
                self.samples = global_sensitivity(problem, progress=progress, keep=keep_samples, **wide)
            self.found.details["global"] = self.samples.summary
        if forward:
            try:
                self.found.details.update(forward_sensitivity(problem).to_dict())
            except CycleError as error:
                self.found.details.update(forward_cycle=None, forward_sensitivities=[], forward_message=str(error))
                self.unflown = f"the prescribed cycle cannot be flown: {error}"
        return self

    def interrupted(self) -> SensitivityStudy | None:
        """Return what was found when the run was interrupted; None where that is nothing."""
        if self.found is None:
            return None
        if self.samples is not None and "global" not in self.found.details:
            self.found.details["global_finished_samples"] = len(self.samples.samples)
        self.found.details["message"] = "interrupted; what was finished until then is here"
        return replace(self, found=replace(self.found, status="interrupted"))

    def result(self) -> Result:
        """Return the derivatives, with the curve."""
        assert self.found is not None
        if self.variation is not None:
            self.found.details["variation"] = self.variation.to_dict()
        return self.found

    def document(self) -> Document:
        """Return what a person reads; why there is no optimum is said apart."""
        result = self.result()
        first = ResultStudy(result, sensitivities_document).document()
        parts: list[Part] = list(first.parts)
        if self.variation is not None:
            parts += self.variation.parts()
        if "global" in result.details:
            parts += global_parts(result.details["global"])
        if result.details.get("forward_cycle"):
            parts += forward_parts(result.details)
        return replace(first, parts=parts)

    def files(self) -> dict[str, bytes]:
        """Return the curve and the samples as tables."""
        tables: dict[str, Table] = {}
        if self.variation is not None:
            tables[VARIATION_FILE] = self.variation.table()
        if self.samples is not None:
            tables[SAMPLES_FILE] = self.samples.table()
        return {name: table.csv() for name, table in tables.items()}

    def figures(self) -> list[Figure]:
        """Return the pictures of what was found."""
        return figures_of(self.result())
