"""How alike two records of one quantity are."""

from __future__ import annotations

import msgspec
import numpy as np

from kiteocp.recording.cleaning import FloatArray

#: Two records of one quantity agree where they correlate by this much at least and one is the other times a factor in
#: this range: noise and filters of real sensors stay inside (0.84 and more, and 0.95 to 1.05, in the two open data
#: sets), a wrong sign or unit does not (the unit of speed closest to m/s is the knot, 0.51; that of force closest to
#: kgf is daN, 0.98, which nothing tells).
CORRELATED, FACTORS_OF_AGREEMENT = 0.7, (0.75, 1.33)

#: Below this standard deviation (m/s, and W for powers) there is nothing to compare, nor with fewer samples.
MOVING_M_S, WORKING_W, FEWEST = 0.3, 50.0, 50


class Likeness(msgspec.Struct, frozen=True):
    """How one record of a quantity follows from another: correlation, and factor of the first on the second."""

    correlation: float
    factor: float
    told: bool

    @property
    def agrees(self) -> bool:
        """Whether they are the same quantity, or nothing can be told."""
        low, high = FACTORS_OF_AGREEMENT
        return not self.told or (self.correlation >= CORRELATED and low <= self.factor <= high)

    @property
    def words(self) -> str:
        """What is wrong between them."""
        if self.correlation <= -CORRELATED:
            return "has the opposite sign"
        if self.correlation >= CORRELATED:
            return f"is {self.factor:.3g} times as large"
        return f"goes another way (correlation {self.correlation:.2f})"


def likeness(recorded: FloatArray, expected: FloatArray, least: float = MOVING_M_S) -> Likeness:
    """Compare a recorded series with what it should be, shape (n,); nan entries are left out."""
    known = np.isfinite(recorded) & np.isfinite(expected)
    x, y = recorded[known], expected[known]
    if x.size < FEWEST or min(np.std(x), np.std(y)) < least:
        return Likeness(1.0, 1.0, told=False)
    correlation = float(np.corrcoef(x, y)[0, 1])
    # Of spreads, so that the noise of either side does not flatten the factor.
    return Likeness(correlation, float(np.std(x) / np.std(y)), told=True)
