"""The output contract: version of the schema, statuses, the keys of a summary, and its plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

SCHEMA_VERSION = 1
STATUSES: tuple[str, ...] = ("ok", "certified", "not_certified", "infeasible", "failed", "interrupted")
SUCCESSFUL_STATUSES = frozenset({"ok", "certified"})
OUTCOME_KEYS = frozenset({"status", "warnings", "phases", "cycle"})
HEAD_KEYS = frozenset({"schema_version", "kiteocp_version", "versions", "verb", "problem"})
HEAD_KEYS |= {"input_sha256", "input", "prescribed"}


def to_plain(value: Any) -> Any:
    """Return `value` with NumPy types and tuples as plain ones and every number that is not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [to_plain(item) for item in value]
    return value
