"""One document: headings, sentences and tables, as text for a terminal and as a page of its own."""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Sequence
from html import escape

import msgspec

from kiteocp._version import __version__
from kiteocp.report.style import STYLE
from kiteocp.report.table import Table, class_of

#: Columns of a terminal that sentences fill.
WIDTH = 118


class Heading(msgspec.Struct, frozen=True):
    """What follows is about this; level 2 is a section of the page, 3 a part of one."""

    text: str
    level: int = 2
    detail: bool = False


class Paragraph(msgspec.Struct, frozen=True):
    """A sentence or several; in small type where it is a note."""

    words: str
    small: bool = False
    detail: bool = False


class Bullets(msgspec.Struct, frozen=True):
    """A list of sentences."""

    items: Sequence[str]
    detail: bool = False


class Lines(msgspec.Struct, frozen=True):
    """Lines that stand as they are, however long; `joined` to what is above without an empty line."""

    items: Sequence[str]
    joined: bool = False
    detail: bool = False


Part = Heading | Paragraph | Bullets | Lines | Table


class Figure(msgspec.Struct, frozen=True):
    """A figure that a study has: what its file is called, without suffix, and what it shows."""

    stem: str
    caption: str = ""


class Picture(msgspec.Struct, frozen=True):
    """A figure as drawn: media type and content."""

    figure: Figure
    media_type: str
    content: bytes


class Document(msgspec.Struct, frozen=True):
    """What a study says, in order.

    Attributes
    ----------
    title
        Of the page, and the first line of the text.
    parts
        Those with `detail` stand on the page only.
    page
        Whether the study also has a page, ``report.html``.
    """

    title: str
    parts: Sequence[Part]
    page: bool = False

    def text(self) -> str:
        """Return the document for a terminal, without a newline at the end."""
        blocks = [self.title]
        # A line is joined to the title where it says so, and to a heading always.
        above: Part | None = None
        for part in self.parts:
            if part.detail or not (written := _text(part)):
                continue
            if isinstance(above, Heading) or (isinstance(part, Lines) and part.joined):
                blocks[-1] += f"\n{written}"
            else:
                blocks.append(written)
            above = part
        return "\n\n".join(blocks)

    def html(self, pictures: Sequence[Picture] = ()) -> str:
        """Return the document as one self-contained page: no file, font or script from elsewhere.

        Parameters
        ----------
        pictures
            The figures, in their order; without them the page says that it has none.
        """
        drawn = "".join(_figure(number, picture) for number, picture in enumerate(pictures, start=1))
        body = [f"<h1>{escape(self.title)}</h1>", *map(_html, self.parts), "<h2>Figures</h2>"]
        body.append(drawn or "<p>Drawn without pictures (--no-plot).</p>")
        body.append(f'<p class="small">kiteocp {escape(__version__)}</p>')
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escape(self.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
            + "\n".join(body)
            + "\n</body>\n</html>\n"
        )


def _text(part: Part) -> str:
    match part:
        case Heading():
            return part.text
        case Paragraph():
            return textwrap.fill(part.words, WIDTH)
        case Bullets():
            return "\n".join(
                textwrap.fill(item, WIDTH, initial_indent="- ", subsequent_indent="  ") for item in part.items
            )
        case Lines():
            return "\n".join(part.items)
        case Table():
            return part.text()


def _html(part: Part) -> str:
    match part:
        case Heading():
            return f"<h{part.level}>{escape(part.text)}</h{part.level}>"
        case Paragraph():
            return f"<p{class_of('small' if part.small else '')}>{escape(part.words)}</p>"
        case Bullets():
            return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in part.items)}</ul>"
        case Lines():
            return f"<p>{'<br>'.join(map(escape, part.items))}</p>"
        case Table():
            return part.html()


def _figure(number: int, picture: Picture) -> str:
    data, stem = base64.b64encode(picture.content).decode("ascii"), picture.figure.stem
    # An image of its own, so that the names inside one drawing do not meet those of another.
    source = f"data:{picture.media_type};base64,{data}"
    caption = f'<p class="caption">{escape(f"Figure {number}. {picture.figure.caption}")}</p>'
    return f'<figure id="{stem}"><img alt="{stem.replace("_", " ")}" src="{source}">{caption}</figure>'
