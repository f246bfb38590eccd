"""The table of equations leads from each label of the paper that the code names to where it is."""

from __future__ import annotations

import re
from pathlib import Path

import kiteocp

PACKAGE = Path(kiteocp.__file__).parent
TABLE = PACKAGE.parent / "docs" / "equations.md"

LABEL = re.compile(r"eq:[A-Za-z_0-9]+")


def places_in_the_code() -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        for label in LABEL.findall(path.read_text(encoding="utf-8")):
            found.setdefault(label, set()).add(path.relative_to(PACKAGE).as_posix())
    return found


def test_the_table_names_every_label_and_every_file() -> None:
    rows = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("| `eq:")]
    told = {row.split("`")[1]: set(re.findall(r"`([\w/]+\.py)`", row)) for row in rows}
    assert told == places_in_the_code()


def test_every_equation_is_written_out() -> None:
    rows = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("| `eq:")]
    assert all("$`" in row for row in rows), [row for row in rows if "$`" not in row]
