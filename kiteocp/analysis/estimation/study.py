"""Aerodynamics from a flight: wind, coefficients of every sample, averages by phase, and the fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kiteocp.analysis.estimation.bias import RoundTrip, round_trip
from kiteocp.analysis.estimation.fit import WIND, CoefficientFit, fit_coefficients, fitted_wind
from kiteocp.analysis.estimation.inversion import COEFFICIENTS, Inversion, invert
from kiteocp.analysis.estimation.phases import WAYS, PhaseEstimate, phase_estimates
from kiteocp.analysis.estimation.wind import (
    FEWEST_SAMPLES,
    WindEstimate,
    wind_from_airspeed,
    wind_from_ground,
    wind_of_problem,
    winds_by_cycle,
)
from kiteocp.analysis.flights import FlightData
from kiteocp.errors import CycleError, InputError
from kiteocp.problem import Problem
from kiteocp.result import Result

FloatArray = NDArray[np.float64]

WindSource = Literal["airspeed", "ground", "fit", "problem"]
WIND_SOURCES: tuple[WindSource, ...] = ("airspeed", "ground", "fit", "problem")

#: Beyond these median resultant coefficients (of the projected area) there is no kite: flight and problem do not belong
#: together, or a unit is wrong.
CREDIBLE = (0.03, 1.6)


@dataclass(frozen=True)
class Estimation:
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


_DERIVED = (
    "wind_speed_m_s",
    "apparent_wind_speed_m_s",
    "radial_apparent_wind_speed_m_s",
    "aerodynamic_force_N",
    "tether_force_kite_N",
)


def estimate(
    flight: FlightData,
    problem: Problem,
    *,
    wind: WindSource | None = None,
    cycles: Collection[int] | None = None,
    calibrate: bool = True,
    ground_height_m: float | None = None,
) -> Estimation:
    """Estimate coefficients and wind from a flight.

    Parameters
    ----------
    flight
        What was measured.
    problem
        Area, masses, tether, air and the shape of the wind profile; its coefficients are not used.
    wind
        Where the wind at the kite comes from: ``airspeed`` (`wind_from_airspeed`), ``ground`` (`wind_from_ground`),
        ``fit`` (the equilibrium itself) or ``problem``; the first of airspeed, ground and problem that the flight has
        where left out.
    cycles
        Numbers of the cycles to use; all where left out.
    calibrate, ground_height_m
        As of `wind_from_airspeed` and `wind_from_ground`.

    Raises
    ------
    InputError
        There is no such cycle, too little data, or flight and problem do not belong together.
    """
    chosen = _chosen(flight, cycles)
    warnings: list[str] = []
    source = wind or _available(chosen)
    start = _wind(chosen, problem, _available(chosen) if source == "fit" else source, calibrate, ground_height_m)
    turned, blown = start.turned(chosen), start.applied(problem)
    inversion = invert(turned, blown)
    _check_credible(inversion, turned, problem)
    fit_with_wind = fit_coefficients(turned, blown, inversion, fit_wind=True)
    found = start
    if source == "fit":
        found = fitted_wind(fit_with_wind, start, problem)
        if fit_with_wind.wind_identified:
            turned, blown = found.turned(chosen), found.applied(problem)
            inversion = invert(turned, blown)
        else:
            found = start
            warnings.append(
                "the equilibrium does not tell the wind from the coefficients (the factor on the wind is "
                f"{_interval(fit_with_wind.fit.interval(WIND[0]))}); the wind is that of the {start.source}"
            )
    fit = fit_coefficients(turned, blown, inversion)
    for setting in ("powered", "depowered"):
        if setting not in fit.samples:
            warnings.append(f"the flight has too few {setting} samples; those coefficients stay as in the problem")
    estimated = blown.with_values(fit.changes())
    trip = _round_trip(estimated, problem)
    if trip is None:
        warnings.append("no cycle of this kite can be flown as prescribed: the bias of the paper's formulas is unknown")
    warnings += _disagreements(found, fit_with_wind, start, source)
    return Estimation(
        flight=turned,
        problem=problem,
        estimated=estimated,
        wind=found,
        winds=winds_by_cycle(chosen, problem, found) if found.source == "airspeed" else {},
        inversion=inversion,
        phases=phase_estimates(turned, inversion),
        fit=fit,
        fit_with_wind=fit_with_wind,
        round_trip=trip,
        wind_effect=_wind_effect(turned, problem, found, fit),
        warnings=tuple(warnings),
    )


def _chosen(flight: FlightData, cycles: Collection[int] | None) -> FlightData:
    if cycles is None:
        return flight
    known = flight.cycles()
    if absent := sorted(set(cycles) - set(known)):
        raise InputError(
            f"has no cycle {absent[0]}; it has {', '.join(map(str, known)) or 'no numbered cycles'}", file=flight.name
        )
    return flight.select(cycles)


def _available(flight: FlightData) -> WindSource:
    if np.count_nonzero(np.isfinite(flight.apparent_wind_speed_m_s)) >= FEWEST_SAMPLES:
        return "airspeed"
    return "ground" if np.count_nonzero(np.isfinite(flight.ground_wind_speed_m_s)) >= FEWEST_SAMPLES else "problem"


def _wind(
    flight: FlightData, problem: Problem, source: WindSource, calibrate: bool, height_m: float | None
) -> WindEstimate:
    if source == "airspeed":
        return wind_from_airspeed(flight, problem, calibrate=calibrate)
    return wind_from_ground(flight, problem, height_m=height_m) if source == "ground" else wind_of_problem(problem)


def _check_credible(inversion: Inversion, flight: FlightData, problem: Problem) -> None:
    """Refuse a flight that cannot be one of this kite."""
    if not np.any(np.isin(flight.phase, ["traction", "transition", "retraction"])):
        raise InputError(
            "has no sample of a retraction, transition or traction; check the phase labels of the column map",
            file=flight.name,
        )
    resultant = inversion.quantities["exact.resultant_coefficient"]
    finite = resultant[np.isfinite(resultant)]
    if finite.size < FEWEST_SAMPLES:
        raise InputError(
            f"gives {finite.size} samples with an answer for {problem.name}; check the wind, the units of the column "
            "map and the problem",
            file=flight.name,
        )
    typical = float(np.median(finite))
    if not CREDIBLE[0] < typical < CREDIBLE[1]:
        raise InputError(
            f"gives a median C_R of {typical:.3g} for {problem.name}; check kite.projected_area_m2, the wind and the "
            "unit of the tether force",
            file=flight.name,
        )


def _round_trip(estimated: Problem, problem: Problem) -> RoundTrip | None:
    """Fly the estimated kite as prescribed, or the given one where that cannot be flown."""
    for candidate in (estimated, problem):
        try:
            return round_trip(candidate)
        except CycleError:
            continue
    return None


def _disagreements(found: WindEstimate, fit: CoefficientFit, start: WindEstimate, source: WindSource) -> list[str]:
    """Say where the wind used and the wind of the equilibrium contradict each other."""
    if source == "fit" or not fit.wind_identified or found.scale_standard_error is None:
        return []
    factor = fit.fit.parameter(WIND[0])
    error = float(np.hypot(found.scale_standard_error / found.scale, factor["standard_error"]))
    if abs(factor["value"] - 1.0) <= 1.96 * error:
        return []
    return [
        f"by the equilibrium the wind is {factor['value']:.2f} times that of the {found.source} "
        f"({_interval(fit.fit.interval(WIND[0]))}), more than both errors explain; compare --wind fit"
    ]


def _wind_effect(
    flight: FlightData, problem: Problem, wind: WindEstimate, fit: CoefficientFit
) -> dict[str, float] | None:
    """Fit again in a wind stronger by its standard error; `flight` is already in the frame of the wind."""
    if not wind.scale_standard_error:
        return None
    stronger = replace(wind, scale=wind.scale + wind.scale_standard_error).applied(problem)
    found = fit_coefficients(flight, stronger, invert(flight, stronger))
    return {name: found.fit.value(name) - fit.fit.value(name) for name in fit.fit.names if name in found.fit.names}


def _interval(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}"
