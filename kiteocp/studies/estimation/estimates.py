"""What an estimation gives: the numbers of the summary, and the time series."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.problem import Problem
from kiteocp.recording import FlightData
from kiteocp.result import Result
from kiteocp.studies.estimation.bias import RoundTrip
from kiteocp.studies.estimation.fit import CoefficientFit
from kiteocp.studies.estimation.inversion import COEFFICIENTS, Inversion
from kiteocp.studies.estimation.phases import WAYS, PhaseEstimate
from kiteocp.studies.estimation.wind import WindEstimate

#: Quantities of the inversion that every time series carries.
_DERIVED = (
    "wind_speed_m_s",
    "apparent_wind_speed_m_s",
    "radial_apparent_wind_speed_m_s",
    "aerodynamic_force_N",
    "tether_force_kite_N",
)


class Estimation(msgspec.Struct, frozen=True):
    """What a flight tells of the kite and of the wind.

    Attributes
    ----------
    flight
        The cycles used, in the frame of the estimated wind.
    problem, estimated
        As given, and with the fitted coefficients and the wind.
    wind
        The wind used.
    winds
        Wind of each cycle where it comes from the airspeed, else none.
    inversion
        Coefficients of every sample.
    phases
        By phase and way.
    fit
        Coefficients by setting, at the wind used.
    fit_with_wind
        The same with the wind free: what the equilibrium alone says of it.
    round_trip
        The bias of the paper's formulas for this kite; None where no cycle of it can be flown.
    wind_effect
        By name of the coefficients of `fit`, their change where the wind is stronger by one standard error of its
        scale: an error beside those of the fit, which takes the wind as known. None where that error is unknown.
    warnings
        One sentence each.
    """

    flight: FlightData
    problem: Problem
    estimated: Problem
    wind: WindEstimate
    winds: Mapping[int, WindEstimate]
    inversion: Inversion
    phases: Mapping[str, Mapping[str, PhaseEstimate]]
    fit: CoefficientFit
    fit_with_wind: CoefficientFit
    round_trip: RoundTrip | None
    wind_effect: Mapping[str, float] | None
    warnings: tuple[str, ...]

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of a coefficient of `fit`, the error of the wind's scale included."""
        low, high = self.fit.fit.interval(name)
        effect = 0.0 if self.wind_effect is None else self.wind_effect.get(name, 0.0)
        half = float(np.hypot(0.5 * (high - low), 1.96 * effect))
        return 0.5 * (low + high) - half, 0.5 * (low + high) + half

    def to_dict(self) -> dict[str, Any]:
        """Return ``estimates`` of the summary."""
        fit = self.fit.to_dict()
        for setting, found in fit["settings"].items():
            for name in ("lift_coefficient", "drag_coefficient"):
                found[name]["interval_with_wind_error"] = list(self.interval(f"{setting}.{name}"))
            ratio = found["lift_to_drag"]
            half = 1.96 * float(np.hypot(ratio["standard_error"], self._ratio_effect(setting)))
            ratio["interval_with_wind_error"] = [ratio["value"] - half, ratio["value"] + half]
        return {
            "flight": self.flight.name,
            "cycles": list(self.flight.cycles()),
            "samples": len(self.flight),
            "repaired_or_dropped_in_reading": dict(self.flight.counts),
            "notes": list(self.flight.notes),
            "wind": self.wind.to_dict(),
            "wind_by_cycle": {str(cycle): wind.to_dict() for cycle, wind in self.winds.items()},
            "phases": {
                phase: {way: found.to_dict() for way, found in ways.items()} for phase, ways in self.phases.items()
            },
            "fit": fit,
            "wind_effect": None if self.wind_effect is None else dict(self.wind_effect),
            "fit_with_wind": self.fit_with_wind.to_dict(),
            "round_trip": None if self.round_trip is None else self.round_trip.to_dict(),
        }

    def _ratio_effect(self, setting: str) -> float:
        """Change of the lift-to-drag ratio by the standard error of the wind."""
        if self.wind_effect is None or f"{setting}.lift_coefficient" not in self.wind_effect:
            return 0.0
        lift, drag = self.fit.coefficients(setting)
        changes = (self.wind_effect[f"{setting}.{name}_coefficient"] for name in ("lift", "drag"))
        return (lift + next(changes)) / (drag + next(changes)) - lift / drag

    def result(self) -> Result:
        """Return the estimation as a result of the verb ``estimate``, to be saved and drawn."""
        return Result(
            verb="estimate",
            problem=self.problem,
            warnings=self.warnings,
            channels=self.channels(),
            details={"estimates": self.to_dict()},
        )

    def channels(self) -> dict[str, NDArray[Any]]:
        """Return the time series: what was measured, and what every sample says."""
        flight, found = self.flight, self.inversion.quantities
        kite_speed = np.sqrt(flight.radial_speed_m_s**2 + flight.polar_speed_m_s**2 + flight.azimuthal_speed_m_s**2)
        measured = {
            "time_s": flight.time_s,
            "phase": flight.phase,
            "cycle": flight.cycle.astype(float),
            "tether_length_m": flight.tether_length_m,
            "distance_m": flight.distance_m,
            "elevation_deg": flight.elevation_deg,
            "azimuth_deg": flight.azimuth_deg,
            "height_m": flight.height_m,
            "course_deg": flight.course_deg,
            "reeling_speed_m_s": flight.reeling_speed_m_s,
            "kite_speed_m_s": kite_speed,
            "tether_force_ground_N": flight.tether_force_ground_N,
            "power_W": flight.tether_force_ground_N * flight.reeling_speed_m_s,
            "measured_apparent_wind_speed_m_s": flight.apparent_wind_speed_m_s,
        }
        derived = {
            "kinematic_ratio": found["paper.kinematic_ratio"],
            **{name: found[name] for name in _DERIVED},
            **{f"{way}_{name}": found[f"{way}.{name}"] for way in WAYS for name in COEFFICIENTS},
        }
        return {**measured, **derived}
