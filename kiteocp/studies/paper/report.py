"""The validation as one self-contained HTML page: no file, font or script from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean

from kiteocp._version import __version__
from kiteocp.physics.parameters import parameter_values
from kiteocp.report.html import Picture, bullets, figures, page, paragraph, section, table
from kiteocp.studies.paper.paper import PaperValidation
from kiteocp.studies.paper.published import CASES, NOMINAL_KEYS, half_units, printed_inputs
from kiteocp.studies.paper.rounding import RETRACTION_FORCE
from kiteocp.studies.paper.statements import SHOWN, name_of, text_of
from kiteocp.studies.paper.tables import EXPLANATIONS, Comparison, Row

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


def report_html(study: PaperValidation, pictures: Sequence[Picture] = ()) -> str:
    """Return the report.

    Parameters
    ----------
    study
        What was computed.
    pictures
        The figures, in their order; without them the report says that it has none.
    """
    version = __version__
    said = study.statements()
    body = [
        paragraph(_INTRODUCTION),
        paragraph(f"Paper: {_SOURCE}. Computed by kiteocp {version}.", "small"),
        section("In short", bullets(said.pop("In short")) + _overview(study)),
        *(section(f"{CASES[case].capitalize()}: the phases", _case_tables(study, case)) for case in CASES),
        section("How the band of rounding is computed", paragraph(_BAND) + _inputs(study)),
        *(section(topic, bullets(sentences)) for topic, sentences in said.items()),
        section("The conclusions of the paper, one by one", _claims(study)),
        section("Convergence of the finite-difference scheme", _convergence(study)),
        section("Consistency of the published numbers", _consistency(study)),
        figures(pictures),
    ]
    return page(TITLE, body)


def _overview(study: PaperValidation) -> str:
    head = ["case", "force held at", *EXPLANATIONS, "off the published simulation", "off the experiment", "cycle power"]
    rows = []
    for found in study.comparisons:
        if not found.gravity and found.reference != study.reference:
            continue  # without weight the references are the same
        published = found.published_rows
        counts = [str(sum(row.explained == kind for row in published)) for kind in EXPLANATIONS]
        power = found.row("cycle.mean_power_W")
        texts = [text_of(power.quantity, value, unit=False) for value in _three(power)]
        rows.append(
            [
                f"{CASES[found.case]}, gravity {'included' if found.gravity else 'excluded'}",
                found.reference if found.gravity else "either",
                *counts,
                _mean_percent(abs(row.deviation_percent) for row in published),
                _mean_percent(abs(row.experiment_percent) for row in published),
                f"{texts[0]} kW ({texts[1]} published, {texts[2]} measured)",
            ]
        )
    note = (
        "The first four columns count how many of the eight published numbers rounding explains: "
        + "; ".join(f"{kind}: {words}" for kind, words in EXPLANATIONS.items())
        + ". The next two are means of the magnitudes."
    )
    return table(head, rows, numeric_from=2) + paragraph(note, "small")


def _case_tables(study: PaperValidation, case: str) -> str:
    parts = []
    for reference in (study.reference, *({found.reference for found in study.comparisons} - {study.reference})):
        for gravity in (False, True):
            found = study.comparison(case, reference, gravity=gravity)
            if not gravity and reference != study.reference:
                continue
            parts.append(f"<h3>Gravity {'included' if gravity else 'excluded'}, {_held(found)}</h3>" + _rows(found))
    return "".join(parts)


def _held(found: Comparison) -> str:
    return f"force held at the {found.reference}" if found.gravity else "force held at either end"


def _rows(found: Comparison) -> str:
    head = [
        "",
        "here",
        "with the paper's time step",
        "published",
        "here off published",
        "band of rounding",
        "explained by rounding",
        "experiment",
        "here off experiment",
        "published off experiment",
    ]
    rows, classes = [], []
    for row in found.rows:
        unit = SHOWN[row.quantity.partition(".")[2]][0]
        here, published, measured = (text_of(row.quantity, value, unit=False) for value in _three(row))
        low, high = (text_of(row.quantity, value, unit=False) for value in (row.band.low, row.band.high))
        label = f"{name_of(row.quantity)} ({unit})"
        if row.quantity == RETRACTION_FORCE:
            label = "retraction energy per metre (N)"
        rows.append(
            [
                label,
                here,
                text_of(row.quantity, row.stepped, unit=False),
                published,
                f"{row.deviation_percent:+.1f} %",
                f"{low} to {high}",
                row.explained,
                measured,
                f"{row.experiment_percent:+.0f} %",
                f"{row.published_experiment_percent:+.0f} %",
            ]
        )
        classes.append(row.explained.replace(" ", "-"))
    return table(head, rows, numeric_from=1, classes=classes)


def _inputs(study: PaperValidation) -> str:
    head = ["input", *(f"{title}: {word}" for title in CASES.values() for word in ("printed", "used", "half unit"))]
    printed = {case: printed_inputs(case) for case in CASES}
    halves = {case: half_units(case, nominal=True) for case in CASES}
    values = {
        case: parameter_values(study.comparison(case, study.reference, gravity=True).result.problem) for case in CASES
    }
    rows = []
    for key in next(iter(printed.values())):
        cells = []
        for case in CASES:
            text, scale = printed[case][key].text, printed[case][key].scale
            cells += [
                text if scale == 1 else f"{text} (in {scale:g} of the unit)",
                f"{values[case][key]:g}",
                f"{halves[case][key]:.2g}",
            ]
        rows.append([key + (" (nominal)" if key in NOMINAL_KEYS else ""), *cells])
    return table(head, rows, numeric_from=1)


def _claims(study: PaperValidation) -> str:
    head = ["case", "conclusion"]
    for reference in study.claims:
        head += [f"holds with the force held at the {reference}", "numbers"]
    rows, classes = [], []
    for claims in zip(*study.claims.values(), strict=True):
        cells = [CASES[claims[0].case], claims[0].text]
        for claim in claims:
            cells += ["yes" if claim.holds else "no", claim.numbers]
        rows.append(cells)
        classes.append("likely" if all(claim.holds for claim in claims) else "no")
    return table(head, rows, classes=classes)


def _convergence(study: PaperValidation) -> str:
    curves = study.convergence.curves
    head = ["nondimensional time step", *(f"{name} (steps)" for name in curves)]
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
    note = "Mean harvesting factor over that of the smallest time step."
    return paragraph(note, "small") + table(head, rows, numeric_from=1)


def _consistency(study: PaperValidation) -> str:
    checks = [
        [CASES[check.case], check.what, f"{check.computed:.4g}", check.printed.text, "yes" if check.agrees else "no"]
        for check in study.printed_checks
    ]
    columns = [
        [
            CASES[check.case],
            check.column,
            f"{1e-3 * check.energy_J:.0f}",
            f"{1e-3 * check.energy_of_phases_J:.0f}",
            f"{1e-3 * check.rounding_J:.0f}",
            f"{check.duration_s:g}",
            f"{check.duration_of_phases_s:g}",
            "yes" if check.agrees else "no",
        ]
        for check in study.table_checks
    ]
    head = ["case", "column", "cycle (kJ)", "phases (kJ)", "rounding (kJ)", "cycle (s)", "phases (s)", "agree"]
    return table(["case", "printed result of the inputs", "here", "printed", "agrees"], checks, numeric_from=2) + table(
        head, columns, numeric_from=2
    )


def _three(row: Row) -> tuple[float, float, float]:
    return row.simulated, row.published.value, row.experiment.value


def _mean_percent(numbers: Iterable[float]) -> str:
    return f"{fmean(numbers):.0f} %"
