"""The columns of a recording as they are in its file."""

from __future__ import annotations

import csv
from pathlib import Path

from kiteocp.errors import InputError
from kiteocp.problem.files import check_readable_kind


def read_table(path: Path, label: str) -> dict[str, list[str]]:
    """Return the columns of a CSV file as texts."""
    check_readable_kind(path, label)
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            sample = stream.readline()
            stream.seek(0)
            separator = max(",;\t", key=sample.count)
            rows = list(csv.reader(stream, delimiter=separator))
    except FileNotFoundError:
        raise InputError("there is no such file; check the path of the flight", file=label) from None
    except IsADirectoryError:
        raise InputError("is a directory; name the CSV file in it", file=label) from None
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text; export the flight as CSV", file=label) from None
    except csv.Error as error:
        raise InputError(f"is not CSV ({error}); export the flight again", file=label) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read ({reason}); check the path and its permissions", file=label) from None
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    if len(rows) < 2:
        raise InputError("holds no samples; a flight has a row of column names and a row for each sample", file=label)
    header = [cell.strip() for cell in rows[0]]
    body = [row + [""] * (len(header) - len(row)) for row in rows[1:]]
    return {column: [row[index].strip() for row in body] for index, column in enumerate(header)}
