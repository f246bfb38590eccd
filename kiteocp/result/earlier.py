"""What an earlier calculation left in a directory: whose result it is, and which files belong to it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SUMMARY_FILE = "summary.json"
PICTURE_FORMATS = ("png", "svg", "pdf")

#: Files that each verb writes beside its summary, and the stems of its pictures, as patterns.
_FILES: dict[str, tuple[str, ...]] = {
    "simulate": ("timeseries.csv",),
    "solve": ("timeseries.csv", "timeseries_prescribed.csv"),
    "sensitivity": ("variation.csv", "global.csv", "timeseries.csv", "timeseries_prescribed.csv"),
    "crosswind": ("timeseries.csv",),
    "estimate": ("estimated.yaml", "timeseries.csv"),
    "validate": ("report.html", "timeseries.csv", "timeseries_prescribed.csv"),
}
PICTURES: dict[str, tuple[str, ...]] = {
    "simulate": ("cycle",),
    "solve": ("cycle",),
    "sensitivity": ("sensitivity", "variation", "global"),
    "crosswind": ("crosswind",),
    "estimate": ("estimate",),
    "validate": (
        *("side_view", "angular_coordinates", "tether_length", "reeling_speed", "flight_speed", "wind_speed"),
        *("tether_force", "power", "convergence", "mass_isolines"),
        *("cycle_*", "side_view_*", "comparison", "optimum"),
    ),
}


@dataclass(frozen=True)
class Earlier:
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
        return self.verb in _FILES


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
    patterns = [*_FILES.get(verb, ())]
    patterns += [f"{stem}.{suffix}" for stem in PICTURES.get(verb, ()) for suffix in PICTURE_FORMATS]
    return sorted({path for pattern in patterns for path in directory.glob(pattern) if path.is_file()})


def stale_files(directory: Path, written: Iterable[Path] = ()) -> list[Path]:
    """Return the files of the earlier result in a directory, without those to be written anew.

    Beside a new summary they would be taken for part of it. Files that no result accounts for are not among them.
    """
    earlier = earlier_result(directory)
    if earlier is None:
        return []
    new = set(written)
    return [path for path in files_of(earlier.verb, directory) if path not in new]
