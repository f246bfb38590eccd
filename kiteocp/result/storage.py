"""Saving a result to a directory: whole files or none."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from kiteocp.report.table import csv_bytes
from kiteocp.result.channels import TIME_SERIES_CHANNELS
from kiteocp.result.earlier import SUMMARY_FILE, stale_files
from kiteocp.writing import write_atomically

if TYPE_CHECKING:
    from kiteocp.result.container import Result

TIME_SERIES_FILE = "timeseries.csv"
PRESCRIBED_FILE = "timeseries_prescribed.csv"


def save_result(result: Result, directory: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write a result into a directory; see `Result.save`."""
    summary = json.dumps(result.summary(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    contents = {directory / SUMMARY_FILE: summary.encode()}
    if result.channels:
        contents[directory / TIME_SERIES_FILE] = format_time_series(result.channels)
    if result.prescribed is not None and result.prescribed.channels:
        contents[directory / PRESCRIBED_FILE] = format_time_series(result.prescribed.channels)
    contents |= {directory / name: content for name, content in files.items()}
    write_atomically(contents, remove=stale_files(directory, contents))
    return list(contents)


def format_time_series(channels: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Return channels as CSV, the contract's columns first; numbers read back exactly, an empty cell is not finite."""
    names = [name for name in TIME_SERIES_CHANNELS if name in channels]
    names += [name for name in channels if name not in names]
    return csv_bytes(names, zip(*(channels[name].tolist() for name in names), strict=True))
