"""One table: columns with their units, and rows of numbers; as text for a terminal, as HTML and as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Iterable, Sequence
from html import escape

import msgspec

Cell = float | str | None

#: Between two columns of a terminal.
_GAP = "  "


class Column(msgspec.Struct, frozen=True):
    """What a column holds and how its numbers are written.

    Attributes
    ----------
    title
        What a person reads above it.
    unit
        Of what is shown; empty where there is none.
    factor
        From the number to what is shown: 1e-3 for W shown in kW.
    digits
        Format of a number (`format`), as ``.1f``; ``z`` takes the minus from a zero (``z.2f``).
    missing
        What is shown where there is no number.
    left
        Set to the left, as words are.
    once
        A text that the row above has too is not repeated.
    group
        Of neighbouring columns: shown above them.
    key
        Name in a CSV file, the unit in it; the column is left out there where this is empty.
    shown
        Whether a person sees it.
    detail
        Only for the page: too much for a terminal.
    """

    title: str = ""
    unit: str = ""
    factor: float = 1.0
    digits: str = "g"
    missing: str = ""
    left: bool = False
    once: bool = False
    group: str = ""
    key: str = ""
    shown: bool = True
    detail: bool = False

    def text(self, cell: Cell) -> str:
        """Return a cell as a person reads it; a text as it stands."""
        if isinstance(cell, str):
            return cell
        if cell is None or not math.isfinite(cell):
            return self.missing
        return format(self.factor * cell, self.digits)

    @property
    def heading(self) -> str:
        """Title and unit in one."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


class Table(msgspec.Struct, frozen=True):
    """Rows under columns.

    Attributes
    ----------
    columns
        What each holds.
    rows
        A cell for each column: a number in the unit of its key, or a text.
    rules
        Rows before which the terminal draws a line; 0 is the line below the headings.
    classes
        Class of each row in HTML, none where left out.
    detail
        Only for the page: too much for a terminal.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    rules: Collection[int] = ()
    classes: Sequence[str] = ()
    detail: bool = False

    def texts(self) -> list[list[str]]:
        """Return the cells of every row as a person reads them."""
        return [[c.text(cell) for c, cell in zip(self.columns, row, strict=True)] for row in self.rows]

    def text(self) -> str:
        """Return the lines for a terminal: units in a row of their own, columns without any text left out."""
        rows = self.texts()
        shown = [
            ["" if c.once and above is not None and row[i] == above[i] else row[i] for i, c in enumerate(self.columns)]
            for row, above in zip(rows, [None, *rows], strict=False)
        ]
        head = [[column.title for column in self.columns]]
        if any(column.unit for column in self.columns):
            head.append([column.unit for column in self.columns])
        kept = [
            i
            for i, column in enumerate(self.columns)
            if column.shown and not column.detail and any(row[i] for row in (*head, *shown))
        ]
        columns = [self.columns[i] for i in kept]
        head, shown = ([[row[i] for i in kept] for row in part] for part in (head, shown))
        widths = [max((len(row[i]) for row in (*head, *shown)), default=0) for i in range(len(columns))]
        for places, name in _groups(columns):
            # A group that is wider than its columns widens the last of them.
            room = sum(widths[i] for i in places) + len(_GAP) * (len(places) - 1)
            widths[places[-1]] += max(0, len(name) + 2 - room) if name else 0
        lines = [_line(columns, row, widths) for row in head]
        body = [_line(columns, row, widths) for row in shown]
        rule = "-" * max(map(len, [*lines, *body]), default=0)
        if any(column.group for column in columns):
            lines.insert(0, _group_line(columns, widths))
        for index, line in enumerate(body):
            lines += [rule, line] if index in self.rules else [line]
        return "\n".join(lines)

    def html(self) -> str:
        """Return the element ``table``."""
        kept = [i for i, column in enumerate(self.columns) if column.shown]
        columns = [self.columns[i] for i in kept]
        head = "".join(f"<th{_kind(c)}>{escape(c.heading)}</th>" for c in columns)
        groups = ""
        if any(column.group for column in columns):
            spans = "".join(f'<th colspan="{len(places)}">{escape(name)}</th>' for places, name in _groups(columns))
            groups = f"<tr>{spans}</tr>"
        lines = []
        for row, name in zip(self.texts(), self.classes or [""] * len(self.rows), strict=True):
            cells = (f"<td{_kind(self.columns[i])}>{escape(row[i])}</td>" for i in kept)
            lines.append(f"<tr{class_of(name)}>{''.join(cells)}</tr>")
        return (
            f'<div class="wide"><table><thead>{groups}<tr>{head}</tr></thead>'
            f"<tbody>{''.join(lines)}</tbody></table></div>"
        )

    def csv(self) -> bytes:
        """Return the columns that have a key as CSV: numbers that read back exactly, empty where not finite."""
        kept = [i for i, column in enumerate(self.columns) if column.key]
        return csv_bytes([self.columns[i].key for i in kept], ([row[i] for i in kept] for row in self.rows))


def csv_bytes(names: Sequence[str], rows: Iterable[Sequence[Cell]]) -> bytes:
    """Return a CSV file: numbers that read back exactly, an empty cell where one is missing or not finite."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([_exact(cell) for cell in row] for row in rows)
    return stream.getvalue().encode()


def _exact(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    return repr(float(cell)) if cell is not None and math.isfinite(cell) else ""


def _line(columns: Sequence[Column], row: Sequence[str], widths: Sequence[int]) -> str:
    cells = (
        text.ljust(width) if column.left else text.rjust(width)
        for column, text, width in zip(columns, row, widths, strict=True)
    )
    return _GAP.join(cells).rstrip()


def _groups(columns: Sequence[Column]) -> list[tuple[list[int], str]]:
    """Return the places of neighbouring columns of one group, with its name."""
    found: list[tuple[list[int], str]] = []
    for index, column in enumerate(columns):
        if found and found[-1][1] == column.group:
            found[-1][0].append(index)
        else:
            found.append(([index], column.group))
    return found


def _group_line(columns: Sequence[Column], widths: Sequence[int]) -> str:
    parts = []
    for places, name in _groups(columns):
        room = sum(widths[i] for i in places) + len(_GAP) * (len(places) - 1)
        parts.append(f" {name} ".center(room, "-") if name else " " * room)
    return _GAP.join(parts).rstrip()


def _kind(column: Column) -> str:
    return class_of("" if column.left else "number")


def class_of(name: str) -> str:
    """Return the attribute for a class of `kiteocp.report.style`, nothing for none."""
    return f' class="{name}"' if name else ""
