"""Saving a result to a directory: whole files or none."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from kiteocp.errors import InputError
from kiteocp.execution import uninterrupted
from kiteocp.report.table import csv_bytes
from kiteocp.result.channels import TIME_SERIES_CHANNELS
from kiteocp.result.earlier import SUMMARY_FILE, stale_files

if TYPE_CHECKING:
    from kiteocp.result.container import Result

TIME_SERIES_FILE = "timeseries.csv"
PRESCRIBED_FILE = "timeseries_prescribed.csv"


def write_atomically(contents: Mapping[Path, bytes], remove: Iterable[Path] = ()) -> None:
    """Write several files so that each is there whole or not at all.

    All of them are first written under temporary names beside their targets; only when every byte is on disk are
    they renamed, so that a full disk leaves what was there.

    Parameters
    ----------
    contents : mapping of pathlib.Path to bytes
        Target to content; directories are made where they do not exist.
    remove : iterable of pathlib.Path
        Files to take away once all bytes are on disk; one that cannot be removed is left.

    Raises
    ------
    InputError
        If a directory or file cannot be written, in one sentence with its path and the reason.

    """
    temporary: dict[Path, str] = {}
    target = Path()
    try:
        for target, content in contents.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
            temporary[target] = name
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            # mkstemp makes private files; give them the permissions any other new file would have.
            os.chmod(name, 0o666 & ~_umask())
        for target in contents:
            if target.is_dir():
                raise IsADirectoryError(0, "a directory has this name")
        # A signal between two renames would leave new files beside old ones.
        with uninterrupted():
            for path in remove:
                with contextlib.suppress(OSError):
                    path.unlink(missing_ok=True)
            for target in contents:
                os.replace(temporary[target], target)
                del temporary[target]
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{target}: cannot be written ({reason}); choose a place that can be written to") from error
    finally:
        for name in temporary.values():
            with contextlib.suppress(OSError):
                os.unlink(name)


def check_writable(directory: Path) -> None:
    """Make sure that files can be written into a directory, which need not exist; nothing is left behind.

    Raises
    ------
    InputError
        They cannot, in one sentence with the path and the reason.
    """
    made: list[Path] = []
    try:
        missing = [path for path in (directory, *directory.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir()
            made.append(path)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{directory}: cannot be written ({reason}); choose a place that can be written to") from None
    finally:
        for path in reversed(made):
            with contextlib.suppress(OSError):
                path.rmdir()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


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
