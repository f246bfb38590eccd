"""Tables and documents: the same numbers as terminal text, page and CSV."""

from __future__ import annotations

import csv
import io
import math

import pytest

from kiteocp.report.document import WIDTH, Bullets, Document, Figure, Heading, Lines, Paragraph, Picture
from kiteocp.report.table import Column, Table

POWERS = Table(
    (
        Column(left=True, once=True),
        Column("power", "kW", 1e-3, "z.2f", missing="-", key="mean_power_W", group="here"),
        Column("off", "%", digits="+.1f", group="here", detail=True),
        Column("remark", left=True, key="remark"),
        Column(key="share", shown=False),
    ),
    (
        ("traction", 20630.0, 1.0, "a < b", 1 / 3),
        ("traction", -1e-9, math.nan, "", 0.25),
        ("cycle", None, -2.0, "", math.inf),
    ),
    rules=(0, 2),
    classes=("likely", "", ""),
)


def test_a_table_as_text() -> None:
    assert POWERS.text().splitlines() == [
        "           here",
        "           power  remark",
        "              kW",
        "------------------------",
        "traction   20.63  a < b",
        "            0.00",
        "------------------------",
        "cycle          -",
    ]


def test_a_column_as_wide_as_the_name_of_its_group() -> None:
    table = Table([Column("a", left=True), Column("b", group="a long name"), Column("c")], [("x", 1.0, 2.0)])
    # With a blank on either side of it, as between dashes.
    assert table.text().splitlines() == ["    a long name", "a              b  c", "x              1  2"]


def test_a_table_as_html_says_nothing_that_only_the_csv_has() -> None:
    html = POWERS.html()
    assert '<tr><th colspan="1"></th><th colspan="2">here</th><th colspan="1"></th></tr>' in html
    assert '<th class="number">power (kW)</th>' in html
    assert '<tr class="likely"><td>traction</td><td class="number">20.63</td><td class="number">+1.0</td>' in html
    assert "a &lt; b" in html
    assert html.count("</th>") == 3 + 4
    assert html.count("</td>") == 3 * 4
    assert "0.25" not in html


def test_a_table_as_csv_reads_back_exactly() -> None:
    rows = list(csv.DictReader(io.StringIO(POWERS.csv().decode())))
    assert [row["share"] for row in rows] == [repr(1 / 3), "0.25", ""]
    assert [row["mean_power_W"] for row in rows] == ["20630.0", "-1e-09", ""]
    assert list(rows[0]) == ["mean_power_W", "remark", "share"]


def test_a_row_of_another_length_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="shorter"):
        Table([Column("a"), Column("b")], [(1.0,)]).text()


DOCUMENT = Document(
    "one & all",
    [
        Lines(["status"], joined=True),
        Heading("findings"),
        Bullets(["word " * 40]),
        Heading("all of it", detail=True),
        Paragraph("only on the page", small=True, detail=True),
        POWERS,
        Lines([], joined=True),
        Lines(["  first", "second"]),
    ],
    page=True,
)


def test_a_document_as_text() -> None:
    blocks = DOCUMENT.text().split("\n\n")
    assert blocks[0] == "one & all\nstatus"
    heading, *bullet = blocks[1].splitlines()
    assert heading == "findings"
    assert [line[:2] for line in bullet] == ["- ", "  "]
    assert max(map(len, bullet)) <= WIDTH
    assert blocks[2] == POWERS.text()
    assert blocks[3] == "  first\nsecond"
    assert len(blocks) == 4


def test_a_document_as_a_page() -> None:
    picture = Picture(Figure("side_view", "Seen from the <side>."), "image/png", b"pixels")
    html = DOCUMENT.html([picture])
    assert "<title>one &amp; all</title>" in html
    assert '<p class="small">only on the page</p>' in html
    assert "Figure 1. Seen from the &lt;side&gt;." in html
    assert 'alt="side view" src="data:image/png;base64,cGl4ZWxz"' in html
    assert "Drawn without pictures" in DOCUMENT.html()
