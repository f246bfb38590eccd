"""What the validation says: tables of each case and sentences, with all that is behind them on the page."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean
from typing import TYPE_CHECKING

from kiteocp._version import __version__
from kiteocp.physics.parameters import parameter_values
from kiteocp.report.document import Bullets, Document, Heading, Paragraph, Part
from kiteocp.report.table import Cell, Column, Table
from kiteocp.studies.paper.published import CASES, NOMINAL_KEYS, half_units, printed_inputs
from kiteocp.studies.paper.rounding import RETRACTION_FORCE
from kiteocp.studies.paper.statements import SHOWN, name_of, text_of
from kiteocp.studies.paper.tables import EXPLANATIONS, Comparison, Row

if TYPE_CHECKING:
    from kiteocp.studies.paper.paper import PaperValidation

TITLE = "Validation of the quasi-steady model against its publication"

_SOURCE = (
    "R. van der Vlugt, A. Bley, M. Noom, R. Schmehl: Quasi-steady model of a pumping kite power system. Renewable "
    "Energy 131, 83-99, 2019, doi:10.1016/j.renene.2018.07.023"
)
_INTRODUCTION = (
    "This page computes the results section of the paper anew, from the paper's equations and its published inputs, "
    "and sets it beside the paper's own simulation and its experiment. No constant is fitted to a table: the published "
    "results enter only as what is compared with. Positive deviations are larger numbers; in the retraction, where the "
    "power is negative, that is less power taken."
)
_BAND = (
    "The paper prints rounded inputs, so that nobody else can compute with the authors' own. The band of a number is "
    "where it may lie if every input is moved by up to half a unit of its last printed digit. The model is "
    "differentiated with respect to each input along the flown cycle; the signs of the derivatives give the two "
    "corners of the rounded inputs at which the number is smallest and largest, and both are flown again. The "
    "published number is rounded itself, which widens the band by half a unit of its last digit. It is called likely "
    "to be explained if it lies within the band and within twice the standard deviation that independent, uniform "
    "rounding errors have: the root of the sum of squares over the root of three. Tether diameter and mast height are "
    "sizes by name, a 4 mm tether and a mast of 6 m, rather than rounded measurements; they are held here, and "
    "counted apart as if they were rounded to a whole millimetre and metre."
)

#: Marks of what rounding explains, for the narrow column of a table.
MARKS = {"likely": "=", "at worst": "~", "nominal sizes": "?", "no": "!"}
_LEGEND = (
    "band: what rounding of the measured inputs explains, computed at its two worst corners. Published number: "
    "= within twice its standard deviation; ~ within the band; ? only if tether diameter and mast height were rounded "
    "too; ! outside. Positive deviations are larger numbers, so less power taken in the retraction."
)
#: Topics whose sentences stand on the page only.
_DETAILS = {"Where the tether force is held", "The conclusions of the paper", "The published numbers themselves"}

_IN_SHORT = "In short"


def paper_document(study: PaperValidation) -> Document:
    """Return tables and sentences; the page has all of them."""
    said = study.statements()
    return Document(
        TITLE,
        [
            Paragraph(_INTRODUCTION, detail=True),
            Paragraph(f"Paper: {_SOURCE}. Computed by kiteocp {__version__}.", small=True, detail=True),
            *_topic(_IN_SHORT, said.pop(_IN_SHORT)),
            *_overview(study),
            *(part for case in CASES for part in _case(study, case)),
            Paragraph(_LEGEND, small=True),
            Heading("How the band of rounding is computed", detail=True),
            Paragraph(_BAND, detail=True),
            _inputs(study),
            *(part for topic, sentences in said.items() for part in _topic(topic, sentences)),
            Heading("The conclusions of the paper, one by one", detail=True),
            _claims(study),
            Heading("Convergence of the finite-difference scheme", detail=True),
            Paragraph("Mean harvesting factor over that of the smallest time step.", small=True, detail=True),
            _convergence(study),
            Heading("Consistency of the published numbers", detail=True),
            *_consistency(study),
        ],
        page=True,
    )


def _topic(title: str, sentences: list[str]) -> tuple[Heading, Bullets]:
    detail = title in _DETAILS
    return Heading(title, detail=detail), Bullets(sentences, detail=detail)


def _overview(study: PaperValidation) -> Iterator[Part]:
    columns = [
        Column("case", left=True),
        Column("force held at", left=True),
        *map(Column, EXPLANATIONS),
        Column("off the published simulation", unit="%", digits=".0f"),
        Column("off the experiment", unit="%", digits=".0f"),
        Column("cycle power"),
    ]
    rows: list[list[Cell]] = []
    for found in study.comparisons:
        if not found.gravity and found.reference != study.reference:
            continue  # without weight the references are the same
        published = found.published_rows
        here, paper, measured = _texts(found.row("cycle.mean_power_W"))
        rows.append(
            [
                f"{CASES[found.case]}, gravity {'included' if found.gravity else 'excluded'}",
                found.reference if found.gravity else "either",
                *(sum(row.explained == kind for row in published) for kind in EXPLANATIONS),
                fmean(abs(row.deviation_percent) for row in published),
                fmean(abs(row.experiment_percent) for row in published),
                f"{here} kW ({paper} published, {measured} measured)",
            ]
        )
    yield Table(columns, rows, detail=True)
    yield Paragraph(
        "The first four columns count how many of the eight published numbers rounding explains: "
        + "; ".join(f"{kind}: {words}" for kind, words in EXPLANATIONS.items())
        + ". The next two are means of the magnitudes.",
        small=True,
        detail=True,
    )


def _case(study: PaperValidation, case: str) -> Iterator[Part]:
    yield Heading(f"{CASES[case].capitalize()}: the phases")
    yield Paragraph(f"{study.comparison(case, study.reference, gravity=True).result.problem.description}.")
    (other,) = {found.reference for found in study.comparisons} - {study.reference}
    for reference, gravity in ((study.reference, False), (study.reference, True), (other, True)):
        # Without weight the references are the same.
        held = f"included, force held at the {reference}" if gravity else "excluded, force held at either end"
        yield Heading(f"{CASES[case].capitalize()}, gravity {held}", level=3)
        yield _phases(study.comparison(case, reference, gravity=gravity))


def _phases(found: Comparison) -> Table:
    """Return what is computed here beside what is published and measured."""
    published, measured = "published simulation", "experiment"
    columns = [
        Column(left=True),
        Column("here"),
        Column("with the paper's time step", detail=True),
        Column("published", group=published),
        Column("here off", "%", digits="+.1f", group=published),
        Column("band of rounding", group=published),
        Column(left=True, group=published),
        Column("explained by rounding", left=True, group=published, detail=True),
        Column("measured", group=measured),
        Column("here off", "%", digits="+.0f", group=measured),
        Column("published off", "%", digits="+.0f", group=measured, detail=True),
    ]
    rows: list[list[Cell]] = []
    for row in found.rows:
        name = "retraction energy per metre" if row.quantity == RETRACTION_FORCE else name_of(row.quantity)
        here, paper, experiment = _texts(row)
        low, high = (text_of(row.quantity, value, unit=False) for value in (row.band.low, row.band.high))
        rows.append(
            [
                f"{name} ({SHOWN[row.quantity.partition('.')[2]][0]})",
                here,
                text_of(row.quantity, row.stepped, unit=False),
                paper,
                row.deviation_percent,
                f"{low} to {high}",
                MARKS[row.explained],
                row.explained,
                experiment,
                row.experiment_percent,
                row.published_experiment_percent,
            ]
        )
    return Table(columns, rows, classes=[row.explained.replace(" ", "-") for row in found.rows])


def _inputs(study: PaperValidation) -> Table:
    columns = [Column("input", left=True)]
    for title in CASES.values():
        columns += [
            Column("printed", group=title),
            Column("used", group=title),
            Column("half unit", digits=".2g", group=title),
        ]
    printed = {case: printed_inputs(case) for case in CASES}
    halves = {case: half_units(case, nominal=True) for case in CASES}
    values = {
        case: parameter_values(study.comparison(case, study.reference, gravity=True).result.problem) for case in CASES
    }
    rows: list[list[Cell]] = []
    for key in next(iter(printed.values())):
        rows.append([key + (" (nominal)" if key in NOMINAL_KEYS else "")])
        for case in CASES:
            text, scale = printed[case][key].text, printed[case][key].scale
            rows[-1] += [
                text if scale == 1 else f"{text} (in {scale:g} of the unit)",
                float(values[case][key]),
                halves[case][key],
            ]
    return Table(columns, rows, detail=True)


def _claims(study: PaperValidation) -> Table:
    columns = [Column("case", left=True), Column("conclusion", left=True)]
    for reference in study.claims:
        group = f"with the force held at the {reference}"
        columns += [Column("holds", left=True, group=group), Column("numbers", left=True, group=group)]
    rows: list[list[Cell]] = []
    classes = []
    for claims in zip(*study.claims.values(), strict=True):
        rows.append([CASES[claims[0].case], claims[0].text])
        for claim in claims:
            rows[-1] += [_yes(claim.holds), claim.numbers]
        classes.append("likely" if all(claim.holds for claim in claims) else "no")
    return Table(columns, rows, classes=classes, detail=True)


def _convergence(study: PaperValidation) -> Table:
    curves = study.convergence.curves
    columns = [Column("nondimensional time step", left=True), *(Column(f"{name} (steps)") for name in curves)]
    first = next(iter(curves.values()))
    rows = [
        [
            f"{step:.3g}",
            *(
                f"{curve.ratios[index]:.5f} ({curve.steps[index]:.0f})" if curve.steps[index] > 0 else "failed"
                for curve in curves.values()
            ),
        ]
        for index, step in enumerate(first.time_steps)
    ]
    rows.append(["Richardson's limit", *(f"{curve.limit_ratio:.7f}" for curve in curves.values())])
    rows.append(["adaptive integrator", *(f"{curve.accurate_ratio:.7f}" for curve in curves.values())])
    begins = [study.convergence.band_time_steps[name] for name in curves]
    rows.append(["within 3 % below", *(f"{begin:.4f}" for begin in begins)])
    return Table(columns, rows, detail=True)


def _consistency(study: PaperValidation) -> Iterator[Table]:
    columns = [
        Column("case", left=True),
        Column("printed result of the inputs", left=True),
        Column("here", digits=".4g"),
        Column("printed"),
        Column("agrees"),
    ]
    rows: list[list[Cell]] = [
        [CASES[check.case], check.what, check.computed, check.printed.text, _yes(check.agrees)]
        for check in study.printed_checks
    ]
    yield Table(columns, rows, detail=True)
    columns = [
        Column("case", left=True),
        Column("column", left=True),
        Column("cycle", "kJ", 1e-3, ".0f"),
        Column("phases", "kJ", 1e-3, ".0f"),
        Column("rounding", "kJ", 1e-3, ".0f"),
        Column("cycle", "s"),
        Column("phases", "s"),
        Column("agree"),
    ]
    rows = [
        [
            CASES[check.case],
            check.column,
            check.energy_J,
            check.energy_of_phases_J,
            check.rounding_J,
            check.duration_s,
            check.duration_of_phases_s,
            _yes(check.agrees),
        ]
        for check in study.table_checks
    ]
    yield Table(columns, rows, detail=True)


def _texts(row: Row) -> tuple[str, str, str]:
    """Return a number as computed here, as published and as measured."""
    here, published, measured = (
        text_of(row.quantity, value, unit=False) for value in (row.simulated, row.published.value, row.experiment.value)
    )
    return here, published, measured


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"
