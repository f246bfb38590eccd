"""What a comparison of a flown cycle with the model holds: predictions beside what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from kiteocp.studies.estimation.fit import CoefficientFit
from kiteocp.studies.prediction.cycle_wind import CycleWind
from kiteocp.studies.prediction.measured import MeasuredCycle, MeasuredPhase
from kiteocp.studies.prediction.prescribed import FlownLaw
from kiteocp.studies.prediction.replay import Replay

#: Laws by which a phase is flown again.
LAWS = ("constant_force", "force_schedule", "speed_schedule", "winch_law")

#: Half the width of a 95 % band, in standard errors.
BAND_SIGMAS = 1.96

#: A band whose half is this share of the prediction says nothing.
WIDE = 0.5

#: A prediction within this share of the measured value is close.
CLOSE = 0.1


class Prediction(msgspec.Struct, frozen=True):
    """One predicted quantity of a phase beside the measured one.

    Attributes
    ----------
    measured, predicted
        In the unit of the quantity.
    standard_error
        Of the prediction, from the errors of coefficients and wind to first order.
    verdict
        ``close`` within `CLOSE` of the measured value; ``within`` further off, but within the 95 % band of the
        prediction; ``differs`` outside it; ``unknown`` inside a band half as wide as the prediction itself or wider,
        or without a band.
    """

    measured: float
    predicted: float
    standard_error: float

    @property
    def deviation(self) -> float:
        """Relative deviation of the prediction; nan where nothing was measured."""
        return (self.predicted - self.measured) / abs(self.measured) if self.measured else float("nan")

    @property
    def verdict(self) -> str:
        """Whether both agree."""
        off = abs(self.predicted - self.measured)
        if off <= CLOSE * abs(self.measured):
            return "close"
        half = BAND_SIGMAS * self.standard_error
        if off > half:
            return "differs"
        return "within" if half < WIDE * abs(self.predicted) else "unknown"

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {
            "measured": self.measured,
            "predicted": self.predicted,
            "standard_error": self.standard_error,
            "deviation": self.deviation,
            "verdict": self.verdict,
        }


class PhaseComparison(msgspec.Struct, frozen=True):
    """A phase by every law.

    Attributes
    ----------
    measured
        What was flown.
    predictions
        By law and quantity.
    unflown
        By law, why the model cannot fly the phase.
    without_equilibrium
        By law, samples of the path that have none.
    law, replayed
        The time series behind: by constant force (None if it cannot be flown), and along the path.
    """

    measured: MeasuredPhase
    predictions: Mapping[str, Mapping[str, Prediction]]
    unflown: Mapping[str, str]
    without_equilibrium: Mapping[str, int]
    law: FlownLaw | None
    replayed: Replay

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        laws = {
            law: {quantity: found.to_dict() for quantity, found in self.predictions.get(law, {}).items()}
            | ({"message": self.unflown[law]} if law in self.unflown else {})
            for law in LAWS
        }
        return {
            "measured": self.measured.to_dict(),
            **laws,
            "samples": int(self.replayed.path.time_s.size),
            "samples_without_equilibrium": dict(self.without_equilibrium),
        }


class CycleComparison(msgspec.Struct, frozen=True):
    """A cycle by every law.

    Attributes
    ----------
    measured
        What was flown.
    wind
        The wind it was flown again in.
    phases
        By name.
    power
        Mean power of the whole cycle, by law (the law of constant force only where it can fly every phase).
    wind_elasticity
        By ``law.phase``: relative change of the predicted mean power per relative change of the wind.
    matching_wind
        Factor on this wind with which the flown force makes the path of the traction reel out as far as measured; None
        where no wind does.
    own
        Coefficients that this cycle by itself asks for in its wind; None where it is too short.
    """

    measured: MeasuredCycle
    wind: CycleWind
    phases: Mapping[str, PhaseComparison]
    power: Mapping[str, Prediction]
    wind_elasticity: Mapping[str, float]
    matching_wind: float | None
    own: CoefficientFit | None

    @property
    def matching_sigmas(self) -> float:
        """How many standard errors of the wind the matching one is off; infinite where the wind has none."""
        if self.matching_wind is None:
            return float("nan")
        error = float(np.sqrt(self.wind.covariance[0, 0])) / self.wind.estimate.scale
        return abs(self.matching_wind - 1.0) / error if error > 0 else float("inf")

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {
            "cycle": self.measured.number,
            "duration_s": self.measured.duration_s,
            "mean_power_W": self.measured.mean_power_W,
            "wind": self.wind.estimate.to_dict() | {"own_standard_error": float(np.sqrt(self.wind.covariance[0, 0]))},
            "own_coefficients": None if self.own is None else self.own.to_dict()["settings"],
            "matching_wind_factor": self.matching_wind,
            "wind_elasticity_of_power": dict(self.wind_elasticity),
            "predicted_mean_power": {law: found.to_dict() for law, found in self.power.items()},
            "phases": {name: phase.to_dict() for name, phase in self.phases.items()},
        }
