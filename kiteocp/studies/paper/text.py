"""The validation as text for a terminal: one table for each case, one for the force held at the ground, sentences."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from kiteocp.studies.paper.paper import PaperValidation
from kiteocp.studies.paper.published import CASES
from kiteocp.studies.paper.statements import SHOWN, name_of, text_of
from kiteocp.studies.paper.tables import Comparison, Row

WIDTH = 118

#: Marks of what rounding explains, in the narrow column of a table.
MARKS = {"likely": "=", "at worst": "~", "nominal sizes": "?", "no": "!"}
_LEGEND = (
    "band: what rounding of the measured inputs explains, computed at its two worst corners. Published number: "
    "= within twice its standard deviation; ~ within the band; ? only if tether diameter and mast height were rounded "
    "too; ! outside. Positive deviations are larger numbers, so less power taken in the retraction."
)
#: Topics of the sentences that are printed; the report has all of them.
_TOPICS = (
    "In short",
    "What the rounding of the inputs explains",
    "What lies outside",
    "Beside the experiment",
    "The finite-difference scheme",
)
#: Widths of a block: here, published, deviation, band, mark.
_WIDTHS = (7, 10, 9, 16, 2)


def format_validation(study: PaperValidation) -> str:
    """Return tables and sentences."""
    parts = []
    for case, title in CASES.items():
        without, included = (study.comparison(case, study.reference, gravity=gravity) for gravity in (False, True))
        description = included.result.problem.description
        parts.append(
            f"{title}: {description}; tether force held at the {study.reference}\n\n"
            + _format_blocks({"gravity excluded": without, "gravity included": included}, experiment=True)
        )
    (other,) = {found.reference for found in study.comparisons} - {study.reference}
    blocks = {title: study.comparison(case, other, gravity=True) for case, title in CASES.items()}
    parts.append(f"gravity included, tether force held at the {other}\n\n{_format_blocks(blocks, experiment=False)}")
    parts.append(_wrapped(_LEGEND, ""))
    said = study.statements()
    for topic in _TOPICS:
        parts.append("\n".join([topic.lower(), *(_wrapped(sentence, "- ") for sentence in said[topic])]))
    return "\n\n".join(parts)


def _format_blocks(blocks: dict[str, Comparison], *, experiment: bool) -> str:
    """Return a table of the published quantities, one group of columns for each comparison."""
    heads = [f" {title} ".center(sum(_WIDTHS) + 1, "-") for title in blocks]
    columns = ["here", "published", "off", "band", ""]
    under = ["".join(text.rjust(width) for text, width in zip(columns, _WIDTHS, strict=True)) + " " for _ in blocks]
    tail = ["experiment      off"] if experiment else []
    width = 26
    lines = ["  ".join([" " * width, *heads]), "  ".join([" " * width, *under, *tail]).rstrip()]
    quantities = [row.quantity for row in next(iter(blocks.values())).published_rows]
    for quantity in quantities:
        rows = [comparison.row(quantity) for comparison in blocks.values()]
        unit = SHOWN[quantity.partition(".")[2]][0]
        cells = [_block(row) for row in rows]
        if experiment:
            measured = text_of(quantity, rows[-1].experiment.value, unit=False)
            cells.append(f"{measured:>10}{rows[-1].experiment_percent:>+7.0f} %")
        lines.append("  ".join([f"{name_of(quantity)} ({unit})".ljust(width), *cells]))
    return "\n".join(lines)


def _block(row: Row) -> str:
    ends = sorted((text_of(row.quantity, end, unit=False) for end in (row.band.low, row.band.high)), key=float)
    texts: Sequence[str] = (
        text_of(row.quantity, row.simulated, unit=False),
        text_of(row.quantity, row.published.value, unit=False),
        f"{row.deviation_percent:+.1f} %",
        " .. ".join(ends),
        MARKS[row.explained],
    )
    return "".join(text.rjust(width) for text, width in zip(texts, _WIDTHS, strict=True)) + " "


def _wrapped(text: str, bullet: str) -> str:
    return textwrap.fill(text, WIDTH, initial_indent=bullet, subsequent_indent=" " * len(bullet))
