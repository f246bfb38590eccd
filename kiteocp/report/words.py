"""Numbers and lists as a sentence writes them."""

from __future__ import annotations

import math
from collections.abc import Sequence


def rounded(number: float, *, up: bool) -> str:
    """Round to three digits, to the side on which the number still does what it is to do."""
    if number == 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(abs(number))) - 2)
    # What is a round number but for the last bits stays one.
    ratio = number / unit
    steps = math.ceil(ratio - 1e-6) if up else math.floor(ratio + 1e-6)
    return f"{steps * unit:.10g}"


def listed(items: Sequence[str], word: str, *, always_comma: bool = False) -> str:
    """Join items as a sentence does."""
    if len(items) < 2:
        return "".join(items)
    comma = "," if always_comma or len(items) > 2 else ""
    return f"{', '.join(items[:-1])}{comma} {word} {items[-1]}"
