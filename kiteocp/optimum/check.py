"""One claim of a certificate and how it came out."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

#: ``quick`` judges a solution on its own mesh; ``full`` has also solved a refinement of the mesh and compared; ``none``
#: has only recomputed the first-order conditions and the objective, and certifies nothing.
Level = Literal["quick", "full", "none"]


class Check(msgspec.Struct, frozen=True):
    """One claim and how it came out.

    Attributes
    ----------
    name
        What was checked.
    passed
        Whether it holds; None for what informs only.
    value, tolerance
        The measured number and what it may be at most; None where there is no number.
    text
        One line that says what was found.
    """

    name: str
    passed: bool | None
    value: float | None
    tolerance: float | None
    text: str

    def to_dict(self) -> dict[str, Any]:
        """Return the check as plain values for the summary."""
        return msgspec.structs.asdict(self)
