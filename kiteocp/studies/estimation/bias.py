"""How far the paper's formulas are from the truth for one kite: measured on flights whose truth is known."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from kiteocp.cycle import simulate
from kiteocp.cycle.phases import PHASES
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.studies.estimation.fit import SETTING_OF_PHASE
from kiteocp.studies.estimation.inversion import invert
from kiteocp.studies.estimation.synthetic import flight_of_result

#: Coefficients that the round trip compares, relative to those the flight was made with.
COMPARED = ("lift_coefficient", "kite_drag_coefficient", "kite_lift_to_drag")


class RoundTrip(msgspec.Struct, frozen=True):
    """Relative errors of estimates from a flight without errors of measurement.

    Attributes
    ----------
    paper
        By phase and coefficient of `COMPARED`, the mean over the phase by the paper's formulas over the truth, less 1.
    exact
        The largest relative error of the exact inversion, over all samples: rounding.
    """

    paper: dict[str, dict[str, float]]
    exact: float

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {"paper_relative_bias": self.paper, "exact_largest_relative_error": self.exact}


def round_trip(problem: Problem) -> RoundTrip:
    """Fly the prescribed cycle of a problem, and estimate from it what is known.

    Raises
    ------
    CycleError
        The prescribed cycle cannot be flown.
    """
    flight = flight_of_result(simulate(problem))
    inversion, values = invert(flight, problem), parameter_values(problem)
    paper: dict[str, dict[str, float]] = {}
    largest = 0.0
    for phase in PHASES:
        setting = SETTING_OF_PHASE[phase]
        lift, drag = values[f"kite.{setting}.lift_coefficient"], values.kite_drag_coefficient(setting)
        inside, paper[phase] = flight.phase == phase, {}
        for name, truth in zip(COMPARED, (lift, drag, lift / drag), strict=True):
            found = inversion.quantities[f"paper.{name}"][inside]
            finite = found[np.isfinite(found)]
            paper[phase][name] = float(np.mean(finite)) / truth - 1.0 if finite.size else np.nan
            exact = inversion.quantities[f"exact.{name}"][inside]
            largest = max(largest, float(np.max(np.abs(exact / truth - 1.0))))
    return RoundTrip(paper, largest)
