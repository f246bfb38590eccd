"""What an earlier calculation left in a directory: whose result it is, and which files belong to it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from kiteocp.verbs import verb_named

SUMMARY_FILE = "summary.json"


class Earlier(msgspec.Struct, frozen=True):
    """The summary of a result in a directory.

    Attributes
    ----------
    verb
        What made it; empty where the summary is not one of kiteocp.
    summary
        Its contents; empty where it cannot be read.
    """

    verb: str
    summary: dict[str, Any]

    @property
    def of_kiteocp(self) -> bool:
        """Whether kiteocp wrote it."""
        verb = verb_named(self.verb)
        return verb is not None and bool(verb.files)


def earlier_result(directory: Path) -> Earlier | None:
    """Return whose result a directory holds; None where it holds no summary."""
    path = directory / SUMMARY_FILE
    if not path.exists():
        return None
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return Earlier("", {})
    if not isinstance(summary, dict) or "schema_version" not in summary:
        return Earlier("", {})
    return Earlier(str(summary.get("verb", "")), summary)


def files_of(verb: str, directory: Path) -> list[Path]:
    """Return the files in a directory that have names a verb writes, the summary not among them."""
    known = verb_named(verb)
    return sorted(
        {path for pattern in (known.patterns if known else ()) for path in directory.glob(pattern) if path.is_file()}
    )


def stale_files(directory: Path, written: Iterable[Path] = ()) -> list[Path]:
    """Return the files of the earlier result in a directory, without those to be written anew.

    Beside a new summary they would be taken for part of it. Files that no result accounts for are not among them.
    """
    earlier = earlier_result(directory)
    if earlier is None:
        return []
    new = set(written)
    return [path for path in files_of(earlier.verb, directory) if path not in new]
