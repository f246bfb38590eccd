"""Loading a saved result: the same numbers, or one sentence on what is wrong with the files."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from kiteocp.errors import InputError
from kiteocp.problem import Problem, problem_from_dict
from kiteocp.problem.files import check_readable_kind
from kiteocp.result.container import Result
from kiteocp.result.contract import HEAD_KEYS, OUTCOME_KEYS, SCHEMA_VERSION
from kiteocp.result.earlier import SUMMARY_FILE
from kiteocp.result.storage import PRESCRIBED_FILE, TIME_SERIES_FILE


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
