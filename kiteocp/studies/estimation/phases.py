"""Coefficients of each phase of a flight: time averages over the samples that have an answer and are no outliers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.numerics.averages import Average, average
from kiteocp.numerics.robust import NORMAL
from kiteocp.recording import FLIGHT_PHASES, FlightData
from kiteocp.studies.estimation.inversion import COEFFICIENTS, Inversion

#: The two ways to the coefficients of a sample.
WAYS = ("paper", "exact")

#: A sample counts as an outlier of its phase where a coefficient is so many robust standard deviations off the median.
OUTLIER = 6.0
JUDGED_BY = ("lift_coefficient", "kite_drag_coefficient", "kite_lift_to_drag")


class PhaseEstimate(msgspec.Struct, frozen=True):
    """Coefficients of one phase by one way.

    Attributes
    ----------
    averages
        By name of `COEFFICIENTS` (the paper's also ``kinematic_ratio``), over the samples used.
    samples, used
        Of the phase, and of them with an answer that is no outlier.
    rejected
        The others by reason, ``outlier`` among them.
    """

    averages: Mapping[str, Average]
    samples: int
    used: int
    rejected: Mapping[str, int]

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {
            **{name: found.to_dict() for name, found in self.averages.items()},
            "samples": self.samples,
            "used": self.used,
            "rejected": dict(self.rejected),
        }


def phase_estimates(flight: FlightData, inversion: Inversion) -> dict[str, dict[str, PhaseEstimate]]:
    """Average the coefficients of a flight by phase and way."""
    return {
        phase: {way: _phase_estimate(flight, inversion, flight.phase == phase, way) for way in WAYS}
        for phase in FLIGHT_PHASES
        if np.any(flight.phase == phase)
    }


def _phase_estimate(flight: FlightData, inversion: Inversion, inside: NDArray[np.bool_], way: str) -> PhaseEstimate:
    quantities = {
        name: inversion.quantities[f"{way}.{name}"][inside]
        for name in (*COEFFICIENTS, "kinematic_ratio")
        if f"{way}.{name}" in inversion.quantities
    }
    answered = np.isfinite(quantities["lift_coefficient"])
    outlying = np.zeros_like(answered)
    for name in JUDGED_BY:
        values = quantities[name]
        if answered.any():
            median = np.median(values[answered])
            spread = NORMAL * np.median(np.abs(values[answered] - median))
            # The smallest spread is rounding, in a flight without errors.
            outlying |= answered & (np.abs(values - median) > OUTLIER * max(spread, 1e-6 * abs(median)))
    used = answered & ~outlying
    time = flight.time_s[inside]
    rejected = inversion.counts(way, inside)
    if outlying.any():
        rejected["outlier"] = int(outlying.sum())
    averages = {name: average(time, np.where(used, values, np.nan)) for name, values in quantities.items()}
    return PhaseEstimate(averages, int(inside.sum()), int(used.sum()), rejected)
