"""Pieces of a self-contained HTML page: paragraphs, lists, tables, figures, and a style that also prints."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

#: System fonts and few colours; what a colour says stands in the table as a word too.
STYLE = """
body { font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color: #222; max-width: 68rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; line-height: 1.25; }
h2 { font-size: 1.25rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc; padding-bottom: .2rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
p.small, p.caption { font-size: .875rem; color: #444; }
li { margin: .3rem 0; }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .8125rem; margin: .5rem 0 1rem; }
th, td { padding: .25rem .6rem; text-align: left; border-bottom: 1px solid #e3e3e3; vertical-align: top; }
th { border-bottom: 1px solid #777; font-weight: 600; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.likely td { background: #eaf5f0; }
tr.at-worst td { background: #f6f8e8; }
tr.nominal-sizes td { background: #fdf3e0; }
tr.no td { background: #fbe9e2; }
figure { margin: 1.2rem 0 1.8rem; text-align: center; }
figure img { max-width: 100%; height: auto; }
p.caption { text-align: left; margin: .3rem auto; max-width: 48rem; }
@media print {
  body { font-size: 10pt; max-width: none; margin: 0; }
  table { font-size: 8pt; }
  tr, figure { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  td { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""


@dataclass(frozen=True)
class Picture:
    """A figure of the report: file stem, caption, media type and content."""

    stem: str
    caption: str
    media_type: str
    content: bytes


def page(title: str, body: Sequence[str]) -> str:
    """Return a page whose heading is its title."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{escape(title)}</h1>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def figures(pictures: Sequence[Picture]) -> str:
    """Return the section of the figures, numbered, or the sentence that there are none."""
    drawn = "".join(_figure(number, picture) for number, picture in enumerate(pictures, start=1))
    return section("Figures", drawn or paragraph("Drawn without pictures (--no-plot)."))


def _figure(number: int, picture: Picture) -> str:
    data = base64.b64encode(picture.content).decode("ascii")
    caption = paragraph(f"Figure {number}. {picture.caption}", "caption")
    # An image of its own, so that the names inside one drawing do not meet those of another.
    source = f"data:{picture.media_type};base64,{data}"
    return f'<figure id="{picture.stem}"><img alt="{picture.stem.replace("_", " ")}" src="{source}">{caption}</figure>'


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of plain text, of a class of `STYLE` where one is given."""
    return f"<p{_class(kind)}>{escape(text)}</p>"


def bullets(sentences: Sequence[str]) -> str:
    """Return a list of plain sentences."""
    return "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "</ul>"


def section(title: str, content: str) -> str:
    """Return HTML under a heading."""
    return f"<section><h2>{escape(title)}</h2>{content}</section>"


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, numeric_from: int | None = None, classes: Sequence[str] = ()
) -> str:
    """Return a table of plain texts.

    Parameters
    ----------
    head, rows
        Texts of the heading and of the cells.
    numeric_from
        First column that is set to the right.
    classes
        Class of each row, none where left out.
    """
    kinds = ["number" if numeric_from is not None and index >= numeric_from else "" for index in range(len(head))]
    names = classes or [""] * len(rows)
    lines = [_row("th", head, kinds, "")]
    lines += [_row("td", row, kinds, name) for row, name in zip(rows, names, strict=True)]
    return f'<div class="wide"><table><thead>{lines[0]}</thead><tbody>{"".join(lines[1:])}</tbody></table></div>'


def _row(tag: str, texts: Sequence[str], kinds: Sequence[str], name: str) -> str:
    cells = "".join(f"<{tag}{_class(kind)}>{escape(text)}</{tag}>" for text, kind in zip(texts, kinds, strict=True))
    return f"<tr{_class(name)}>{cells}</tr>"


def _class(name: str) -> str:
    return f' class="{name}"' if name else ""
