"""Saving a result to a directory and loading it again: whole files or none."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from kiteocp.errors import InputError
from kiteocp.execution import uninterrupted
from kiteocp.problem import Problem, problem_from_dict
from kiteocp.problem.files import check_readable_kind
from kiteocp.result.channels import TIME_SERIES_CHANNELS
from kiteocp.result.container import HEAD_KEYS, OUTCOME_KEYS, SCHEMA_VERSION, Result
from kiteocp.result.earlier import SUMMARY_FILE, stale_files

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


def save_result(result: Result, directory: Path) -> list[Path]:
    """Write a result into a directory; see `Result.save`."""
    summary = json.dumps(result.summary(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    contents = {directory / SUMMARY_FILE: summary.encode()}
    if result.channels:
        contents[directory / TIME_SERIES_FILE] = format_time_series(result.channels)
    if result.prescribed is not None and result.prescribed.channels:
        contents[directory / PRESCRIBED_FILE] = format_time_series(result.prescribed.channels)
    write_atomically(contents, remove=stale_files(directory, contents))
    return list(contents)


def format_time_series(channels: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Return channels as CSV, the contract's columns first; numbers read back exactly, an empty cell is not finite."""
    names = [name for name in TIME_SERIES_CHANNELS if name in channels]
    names += [name for name in channels if name not in names]
    columns = [
        [value if isinstance(value, str) else repr(value) if math.isfinite(value) else "" for value in column]
        for column in (channels[name].tolist() for name in names)
    ]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*columns, strict=True))
    return stream.getvalue().encode()


def load_result(directory: str | Path) -> Result:
    """Load what `Result.save` wrote.

    Parameters
    ----------
    directory : str or pathlib.Path
        Directory with a ``summary.json``.

    Returns
    -------
    Result
        The same numbers; a null of the summary comes back as None in `cycle` and is left out of `phases`.

    Raises
    ------
    InputError
        If there is no readable result, or one of another schema version.

    """
    directory = Path(directory)
    path = directory / SUMMARY_FILE
    check_readable_kind(path)
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{directory}: holds no {SUMMARY_FILE}; name a directory that kiteocp simulate or solve wrote"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({error}); run the calculation again") from None
    version = summary.get("schema_version") if isinstance(summary, dict) else None
    if version != SCHEMA_VERSION:
        raise InputError(f"{path}: schema_version is {version!r}, not {SCHEMA_VERSION}; run the calculation again")
    if "validation" in summary:
        raise InputError(f"{path}: holds two problems, no single result; read the JSON, or report.html beside it")
    try:
        problem = problem_from_dict(summary["input"], str(path), sha256=summary["input_sha256"])
        prescribed = summary.get("prescribed")
        return _build(
            summary,
            str(summary["verb"]),
            problem,
            _read_time_series(directory / TIME_SERIES_FILE),
            prescribed
            and _build(prescribed, "simulate", problem, _read_time_series(directory / PRESCRIBED_FILE), None),
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{directory}: is not a complete result ({error}); run the calculation again") from None


def _build(
    summary: dict[str, Any],
    verb: str,
    problem: Problem,
    channels: dict[str, npt.NDArray[Any]],
    prescribed: Result | None,
) -> Result:
    for part, numbers in (*summary["phases"].items(), ("cycle", summary["cycle"])):
        for key, value in numbers.items():
            if not isinstance(value, int | float | None):
                raise ValueError(f"{key} of {part} is no number")
    if channels and min(column.size for column in channels.values()) < 2:
        raise ValueError("its time series has fewer than two rows")
    phases = {
        name: {key: value for key, value in phase.items() if value is not None}
        for name, phase in summary["phases"].items()
    }
    return Result(
        verb=verb,
        problem=problem,
        status=summary["status"],
        warnings=tuple(summary["warnings"]),
        phases={name: phase for name, phase in phases.items() if phase},
        cycle=dict(summary["cycle"]),
        channels=channels,
        details={key: value for key, value in summary.items() if key not in OUTCOME_KEYS | HEAD_KEYS},
        prescribed=prescribed,
    )


def _read_time_series(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read a time series; no file is no channels (a calculation that failed has none)."""
    check_readable_kind(path)
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            header, *rows = csv.reader(stream)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None
    except ValueError:
        raise InputError(f"{path}: is not a time series; run the calculation again") from None
    if any(len(row) != len(header) for row in rows):
        raise InputError(f"{path}: has rows of unequal length; run the calculation again")
    channels: dict[str, npt.NDArray[Any]] = {}
    for index, name in enumerate(header):
        try:
            column = [row[index] for row in rows]
            channels[name] = np.array(
                column if name == "phase" else [float(cell) if cell else math.nan for cell in column]
            )
        except ValueError as error:
            raise InputError(f"{path}: column {name} is damaged ({error}); run the calculation again") from None
    return channels
