"""The validation against the paper: tables, convergence, isolines and checks, computed together."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import asdict

from kiteocp.execution import one_at_a_time
from kiteocp.problem import Problem
from kiteocp.report.document import Document, Figure
from kiteocp.result import Result
from kiteocp.studies.paper.captions import CAPTIONS
from kiteocp.studies.paper.claims import Claim, check_claims
from kiteocp.studies.paper.consistency import (
    ErratumEffect,
    PrintedCheck,
    TableCheck,
    errata_effects,
    printed_checks,
    table_checks,
)
from kiteocp.studies.paper.convergence import Convergence, convergence_study
from kiteocp.studies.paper.isolines import GravityIsolines, mass_isolines
from kiteocp.studies.paper.published import CASES, half_units
from kiteocp.studies.paper.report import paper_document
from kiteocp.studies.paper.statements import statements
from kiteocp.studies.paper.tables import Comparison, compare

#: Where the tether force may be held.
REFERENCES = ("kite", "ground")

#: Parts of the work that progress counts.
_PARTS = 10


class PaperResult(Result, frozen=True, eq=False):
    """The numbers of the validation, which has two problems.

    Attributes
    ----------
    problems
        Both by name of the case; `problem` is the first.
    """

    problems: Mapping[str, Problem] = msgspec.field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Return the contents of ``summary.json``: the head of the contract for both problems."""
        digests = "".join(problem.sha256 for problem in self.problems.values())
        return {
            **super().summary(),
            "problem": ", ".join(self.problems),
            "input_sha256": hashlib.sha256(digests.encode()).hexdigest(),
            "input": {case: problem.to_dict() for case, problem in self.problems.items()},
        }


class PaperValidation(msgspec.Struct, frozen=True):
    """The paper's results section, computed anew.

    Attributes
    ----------
    comparisons
        The tables: both cases, with and without gravity, the force held at the kite and at the ground.
    reference
        Where the problem files hold the force.
    convergence, isolines
        The two studies.
    claims
        The paper's conclusions, by where the force is held.
    printed_checks, table_checks
        Whether the published numbers agree with each other.
    errata
        Contradictory inputs and what the other reading would change.
    """

    comparisons: tuple[Comparison, ...]
    reference: str
    convergence: Convergence
    isolines: GravityIsolines
    claims: dict[str, tuple[Claim, ...]]
    printed_checks: tuple[PrintedCheck, ...]
    table_checks: tuple[TableCheck, ...]
    errata: tuple[ErratumEffect, ...]

    def comparison(self, case: str, reference: str, *, gravity: bool) -> Comparison:
        """Return the table of a case."""
        return next(
            found
            for found in self.comparisons
            if (found.case, found.reference, found.gravity) == (case, reference, gravity)
        )

    def cycles(self) -> dict[str, dict[str, Result]]:
        """Return the simulated cycles by case and treatment of gravity, as the figures take them."""
        return {
            case: {
                f"gravity {word}": self.comparison(case, self.reference, gravity=gravity).result
                for word, gravity in (("included", True), ("excluded", False))
            }
            for case in CASES
        }

    def statements(self) -> dict[str, list[str]]:
        """Return what the study shows by topic, in sentences made from its numbers."""
        return statements(self)

    def result(self) -> PaperResult:
        """Return all numbers, with the head of the contract for both problems."""
        problems = {case: self.comparison(case, self.reference, gravity=True).result.problem for case in CASES}
        warnings = tuple(
            f"{found.case}, gravity {'included' if found.gravity else 'excluded'}: {warning}"
            for found in self.comparisons
            if found.reference == self.reference
            for warning in found.result.warnings
        )
        return PaperResult(
            "validate",
            next(iter(problems.values())),
            warnings=warnings,
            details={"validation": self._numbers()},
            problems=problems,
        )

    def document(self) -> Document:
        """Return the tables, and what the study shows in sentences."""
        return paper_document(self)

    def files(self) -> Mapping[str, bytes]:
        """Return what is written beside the numbers: nothing."""
        return {}

    def figures(self) -> Sequence[Figure]:
        """Return the figures of the results section."""
        return [Figure(stem, caption) for stem, caption in CAPTIONS.items()]

    def _numbers(self) -> dict[str, Any]:
        tables: dict[str, Any] = {}
        for found in self.comparisons:
            gravity = "gravity_included" if found.gravity else "gravity_excluded"
            rows = {row.quantity: row.to_dict() for row in found.rows}
            tables.setdefault(found.case, {}).setdefault(f"force_at_{found.reference}", {})[gravity] = rows
        # A tenth of the kinematic ratios and of the courses: a picture's grid is not for reading.
        ratios = courses = slice(None, None, 10)
        return {
            "tables": tables,
            "half_units": {
                case: {"measured_inputs": half_units(case), "all_inputs": half_units(case, nominal=True)}
                for case in CASES
            },
            "convergence": self.convergence.to_dict(),
            "mass_isolines": {
                "course_deg": self.isolines.course_deg[courses],
                "kinematic_ratio": self.isolines.kinematic_ratio[ratios],
                "mass_kg": self.isolines.mass_kg[ratios, courses],
            },
            "claims": {
                f"force_at_{reference}": [asdict(claim) for claim in claims]
                for reference, claims in self.claims.items()
            },
            "printed_checks": [check.to_dict() for check in self.printed_checks],
            "table_checks": [check.to_dict() for check in self.table_checks],
            "errata": [effect.to_dict() for effect in self.errata],
        }


@one_at_a_time
def validate_paper(progress: Callable[[int, int], None] | None = None) -> PaperValidation:
    """Compute the paper's results section from the two shipped problem files.

    Parameters
    ----------
    progress
        Called with the parts done and the number of parts.
    """

    def tell(done: int) -> None:
        if progress is not None:
            progress(done, _PARTS)

    comparisons: list[Comparison] = []
    for case in CASES:
        for reference in REFERENCES:
            tell(len(comparisons) // 2)
            comparisons += [compare(case, reference, gravity=gravity) for gravity in (False, True)]
    reference = str(comparisons[0].result.problem.operation.force_reference)
    cycles = {found.case: found.result for found in comparisons if found.gravity and found.reference == reference}

    def claims_at(held: str) -> tuple[Claim, ...]:
        tables = {(found.case, found.gravity): found for found in comparisons if found.reference == held}
        return check_claims(lambda case, gravity: tables[case, gravity])

    convergence = convergence_study(progress=lambda done, total: tell(len(comparisons) // 2 + done * 4 // total))
    tell(_PARTS - 2)
    isolines = mass_isolines()
    tell(_PARTS - 1)
    return PaperValidation(
        tuple(comparisons),
        reference,
        convergence,
        isolines,
        {held: claims_at(held) for held in REFERENCES},
        printed_checks(cycles),
        table_checks(),
        errata_effects(),
    )
