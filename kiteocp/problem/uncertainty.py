"""The ``uncertainty`` block of the problem file: how far the numbers of the file may be off."""

import math
from typing import Annotated

from msgspec import UNSET, Struct, UnsetType

from kiteocp.problem.fields import quantity

#: The ways to state an uncertainty; each entry gives exactly one.
WAYS = ("standard_deviation", "relative_standard_deviation", "range")


class Uncertainty(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far one number may be off: exactly one of three ways to say it."""

    standard_deviation: (
        Annotated[float, quantity("", "standard deviation, in the unit of the key", gt=0)] | UnsetType
    ) = UNSET
    relative_standard_deviation: (
        Annotated[float, quantity("1", "standard deviation over the value, 0.05 for 5 %", gt=0)] | UnsetType
    ) = UNSET
    range: (
        Annotated[
            tuple[Annotated[float, quantity("", "an end of the range")], ...],
            quantity("", "lowest and highest value, all between equally likely", min_length=2),
        ]
        | UnsetType
    ) = UNSET

    def bounds(self, value: float) -> tuple[float, float]:
        """Return the ends of the range, or the value one standard deviation lower and higher, in the unit of the key.

        Parameters
        ----------
        value : float
            The value in the problem file.
        """
        if not isinstance(self.range, UnsetType):
            return self.range[0], self.range[1]
        spread = self.deviation(value)
        return value - spread, value + spread

    def deviation(self, value: float) -> float:
        """Return the standard deviation in the unit of the key; of a range that of the uniform distribution."""
        if not isinstance(self.range, UnsetType):
            return (self.range[1] - self.range[0]) / math.sqrt(12.0)
        if not isinstance(self.relative_standard_deviation, UnsetType):
            return abs(self.relative_standard_deviation * value)
        return float(self.standard_deviation)  # type: ignore[arg-type]  # exactly one of the three is given
