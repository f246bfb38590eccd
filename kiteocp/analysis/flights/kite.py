"""What some cycles of a flight tell of kite and wind, and the wind of the others: where a prediction starts from."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from kiteocp.analysis.estimation.averages import average
from kiteocp.analysis.estimation.fit import CoefficientFit, fit_coefficients
from kiteocp.analysis.estimation.inversion import invert
from kiteocp.analysis.estimation.wind import WindEstimate, wind_from_airspeed, wind_of_problem
from kiteocp.analysis.flights.cleaning import FloatArray
from kiteocp.analysis.flights.data import FlightData
from kiteocp.analysis.flights.replay import WinchLaw, winch_law
from kiteocp.errors import InputError
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem

#: On its way to the powered setting the kite tells of neither: below this setting a transition is left out.
FULLY_POWERED = 0.95

#: Samples with an airspeed below which it says nothing about the wind.
FEWEST_AIRSPEEDS = 50

#: Relative step for the slope of one estimate over another.
SLOPE_STEP = 0.01

#: The parameters of a prediction: coefficients, the factor on the wind of the problem, and the part of the wind of the
#: cycle that its own airspeed got wrong.
WIND, OWN_WIND = "wind_scale", "wind_scale_of_cycle"


@dataclass(frozen=True)
class EstimatedKite:
    """Kite and wind as some cycles showed them.

    Attributes
    ----------
    problem
        The problem as given, with the estimated coefficients and the wind of the estimation cycles.
    base
        The same with the wind of the problem as given, which `wind.scale` is a factor on.
    fit
        Coefficients with their covariance.
    wind
        Wind of the estimation cycles.
    names, covariance
        Key paths of the coefficients and `WIND`, and the covariance of their errors, shape (k, k).
    airspeed_factor, airspeed_factor_error
        What the airspeed sensor has to be multiplied by to agree with the equilibrium, and its standard error; None
        without a sensor.
    setting
        Measured power settings of the depowered and of the powered coefficients.
    winch_law
        Reeling speed over force in their tractions; None where the winch followed no such law.
    cycles
        The estimation cycles.
    warnings
        What to know about the estimate, one sentence each.
    """

    problem: Problem
    base: Problem
    fit: CoefficientFit
    wind: WindEstimate
    names: tuple[str, ...]
    covariance: FloatArray
    airspeed_factor: float | None
    airspeed_factor_error: float | None
    setting: tuple[float, float]
    winch_law: WinchLaw | None
    cycles: tuple[int, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        fitted = self.fit.to_dict()
        return {
            "cycles": list(self.cycles),
            "wind": self.wind.to_dict(),
            "coefficients": fitted["settings"],
            "airspeed_factor": self.airspeed_factor,
            "airspeed_factor_standard_error": self.airspeed_factor_error,
            "winch_law": None if self.winch_law is None else asdict(self.winch_law),
            "power_setting_depowered": self.setting[0],
            "power_setting_powered": self.setting[1],
        }


@dataclass(frozen=True)
class CycleWind:
    """Wind of one cycle.

    Attributes
    ----------
    estimate
        Factor on the wind of the problem, and direction.
    own_error
        Standard error of the factor from this cycle's airspeed alone; 0 where the wind is that of other cycles.
    slope
        Change of the factor per change of the factor of the estimation cycles, which the sensor was gauged with.
    """

    estimate: WindEstimate
    own_error: float
    slope: float


def estimate_kite(flight: FlightData, problem: Problem, cycles: Collection[int]) -> EstimatedKite:
    """Estimate coefficients and wind on some cycles of a flight.

    Wind and coefficients come from one fit of the equilibrium. The wind that the airspeed sensor shows is not used for
    it: the sensor is gauged by the fit instead, so that it can tell the wind of other cycles.

    Parameters
    ----------
    flight
        The whole flight.
    problem
        Mass, area, tether and the shape of the wind profile.
    cycles
        The cycles to use.

    Raises
    ------
    InputError
        They hold too few usable samples.
    """
    chosen = flight.select(cycles)
    chosen = chosen.where(~((chosen.phase == "transition") & (chosen.power_setting < FULLY_POWERED)))
    warnings = []
    fit = fit_coefficients(chosen, problem, invert(chosen, problem), fit_wind=True)
    # Coefficients of a setting that was not flown stay those of the problem.
    for setting in ("powered", "depowered"):
        if setting not in fit.samples:
            warnings.append(
                f"the estimation cycles have too few {setting} samples; the problem's coefficients are kept"
            )
    if fit.wind_identified:
        wind = _fitted_wind(fit, problem)
    else:
        wind = _other_wind(chosen, problem)
        warnings.append(
            f"the equilibrium does not tell the wind from the coefficients; the wind is that of the {wind.source}"
        )
        chosen, base = wind.turned(chosen), wind.applied(problem)
        fit = fit_coefficients(chosen, base, invert(chosen, base))
    base = problem.with_values(fit.changes())
    names, covariance = _covariance(fit, wind)
    estimated = wind.applied(base)
    factor, error = _airspeed_factor(wind.turned(flight.select(cycles)), estimated)
    return EstimatedKite(
        problem=estimated,
        base=base,
        fit=fit,
        wind=wind,
        names=names,
        covariance=covariance,
        airspeed_factor=factor,
        airspeed_factor_error=error,
        setting=_settings(flight.select(cycles)),
        winch_law=winch_law(flight.select(cycles)),
        cycles=tuple(sorted(cycles)),
        warnings=tuple(warnings),
    )


def wind_of_cycle(flight: FlightData, kite: EstimatedKite, cycle: int) -> CycleWind:
    """Estimate the wind of a cycle from its airspeed, gauged on the estimation cycles; theirs where it has none."""
    chosen = flight.select([cycle])
    usable = np.isfinite(chosen.apparent_wind_speed_m_s) & np.isfinite(chosen.polar_speed_m_s)
    if kite.airspeed_factor is None or np.count_nonzero(usable) < FEWEST_AIRSPEEDS:
        return CycleWind(kite.wind, 0.0, 1.0)

    def found(factor: float) -> WindEstimate:
        gauged = replace(chosen, apparent_wind_speed_m_s=factor * chosen.apparent_wind_speed_m_s)
        return wind_from_airspeed(gauged, kite.base, calibrate=False)

    estimate = found(kite.airspeed_factor)
    # A stronger wind on the estimation cycles gauges the sensor higher, and that shows a stronger wind here.
    slope_of_wind = (found(kite.airspeed_factor * (1 + SLOPE_STEP)).scale - estimate.scale) / (
        kite.airspeed_factor * SLOPE_STEP
    )
    turned = kite.wind.turned(flight.select(kite.cycles))
    stronger = replace(kite.wind, scale=kite.wind.scale * (1 + SLOPE_STEP)).applied(kite.base)
    factor = _airspeed_factor(turned, stronger)[0]
    slope_of_factor = ((factor or kite.airspeed_factor) - kite.airspeed_factor) / (kite.wind.scale * SLOPE_STEP)
    gauge = slope_of_wind * (kite.airspeed_factor_error or 0.0)
    own = float(np.hypot(estimate.scale_standard_error or 0.0, gauge))
    return CycleWind(estimate, own, slope_of_wind * slope_of_factor)


def covariance_of_cycle(kite: EstimatedKite, wind: CycleWind) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and covariance of everything that a prediction of a cycle depends on, its own wind last."""
    size = len(kite.names)
    covariance = np.zeros((size + 1, size + 1))
    covariance[:size, :size] = kite.covariance
    covariance[size, size] = wind.own_error**2
    return (*kite.names, OWN_WIND), covariance


def shifted(values: ParameterValues, name: str, change: float, wind: CycleWind) -> ParameterValues:
    """Return the numbers of a cycle's problem with one parameter of `covariance_of_cycle` changed."""
    if name not in (WIND, OWN_WIND):
        return values.replaced({name: values[name] + change})
    ratio = 1.0 + change * (wind.slope if name == WIND else 1.0) / wind.estimate.scale
    speeds = [key for key in values.structure.keys if key.startswith("environment.wind.") and "speed" in key]
    return values.replaced({key: values[key] * ratio for key in speeds})


def _fitted_wind(fit: CoefficientFit, problem: Problem) -> WindEstimate:
    scale, angle = (fit.fit.parameter(name) for name in ("wind_scale", "wind_direction_offset_deg"))
    reference = wind_of_problem(problem)
    return replace(
        reference,
        source="fit",
        scale=scale["value"],
        direction_offset_deg=angle["value"],
        scale_standard_error=scale["standard_error"],
        direction_standard_error_deg=angle["standard_error"],
        scale_interval=(scale["interval"][0], scale["interval"][1]),
        direction_interval_deg=(angle["interval"][0], angle["interval"][1]),
        samples=sum(fit.samples.values()),
        effective_samples=scale["effective_samples"],
        outliers=sum(fit.outliers.values()),
        reference_speed_m_s=scale["value"] * (reference.reference_speed_m_s or np.nan),
    )


def _other_wind(flight: FlightData, problem: Problem) -> WindEstimate:
    """Return the wind by the airspeed as it is, or that of the problem."""
    try:
        return wind_from_airspeed(flight, problem)
    except InputError:
        return wind_of_problem(problem)


def _covariance(fit: CoefficientFit, wind: WindEstimate) -> tuple[tuple[str, ...], FloatArray]:
    """Return key paths of the coefficients and `WIND`, and their covariance."""
    kept = [name for name in fit.fit.names if name != "wind_direction_offset_deg"]
    index = [fit.fit.names.index(name) for name in kept]
    errors = fit.fit.standard_errors[index]
    covariance = fit.fit.correlation[np.ix_(index, index)] * np.outer(errors, errors)
    names = [name if name == WIND else f"kite.{name}" for name in kept]
    if WIND not in names:
        names.append(WIND)
        covariance = np.pad(covariance, ((0, 1), (0, 1)))
        covariance[-1, -1] = (wind.scale_standard_error or 0.0) ** 2
    return tuple(names), covariance


def _airspeed_factor(flight: FlightData, problem: Problem) -> tuple[float | None, float | None]:
    """Return the ratio of the apparent wind speed that follows from wind and velocity to the measured one."""
    ratio = invert(flight, problem).quantities["apparent_wind_speed_m_s"] / flight.apparent_wind_speed_m_s
    ratio = np.where(np.isfinite(ratio), ratio, np.nan)
    if np.count_nonzero(np.isfinite(ratio)) < FEWEST_AIRSPEEDS:
        return None, None
    middle = float(np.nanmedian(ratio))
    spread = 1.4826 * float(np.nanmedian(np.abs(ratio - middle)))
    kept = np.where(np.abs(ratio - middle) <= 3.0 * spread + 1e-12, ratio, np.nan)
    found = average(flight.time_s, kept)
    return found.mean, found.standard_error


def _settings(flight: FlightData) -> tuple[float, float]:
    """Return the mean power settings of retraction and traction, nan where none is measured."""
    means = []
    for phase in ("retraction", "traction"):
        setting = flight.power_setting[flight.phase == phase]
        means.append(float(np.nanmean(setting)) if np.isfinite(setting).any() else float("nan"))
    return means[0], means[1]


def values_of_cycle(kite: EstimatedKite, wind: CycleWind) -> ParameterValues:
    """Return the numbers of the problem in the wind of a cycle."""
    return parameter_values(wind.estimate.applied(kite.base))
