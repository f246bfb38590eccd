"""What some cycles of a flight tell of kite and wind, and the wind of the others: where a prediction starts from."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import asdict, replace

from kiteocp.errors import InputError
from kiteocp.problem import Problem
from kiteocp.recording.cleaning import FloatArray
from kiteocp.recording.data import FlightData
from kiteocp.recording.power_setting import FULLY_POWERED
from kiteocp.studies.estimation.fit import CoefficientFit, fit_coefficients
from kiteocp.studies.estimation.inversion import invert
from kiteocp.studies.estimation.wind import WindEstimate, wind_from_airspeed, wind_from_heights, wind_of_problem
from kiteocp.studies.prediction.replay import FlownWinchLaw, winch_law
from kiteocp.studies.prediction.sensor import airspeed_factor

#: Steps for the slope of one estimate over another: relative, and of a direction.
SLOPE_STEP, DIRECTION_STEP_DEG = 0.01, 1.0

#: The parameters of a prediction beside the coefficients: factor on the wind of the problem, and its direction.
WIND, DIRECTION = "wind_scale", "wind_direction_offset_deg"


class EstimatedKite(msgspec.Struct, frozen=True):
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
        Key paths of the coefficients, `WIND` and `DIRECTION`, and the covariance of their errors, shape (k, k).
    airspeed_factor, airspeed_factor_error
        What the airspeed sensor has to be multiplied by to agree with wind and velocity, and its standard error; None
        without a sensor.
    wind_by_forces
        Factor on the wind by the equilibrium of forces alone, and its standard error, as a check; None where the forces
        do not tell it.
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
    wind_by_forces: tuple[float, float] | None
    setting: tuple[float, float]
    winch_law: FlownWinchLaw | None
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
            "wind_scale_by_forces": None if self.wind_by_forces is None else self.wind_by_forces[0],
            "wind_scale_by_forces_standard_error": None if self.wind_by_forces is None else self.wind_by_forces[1],
            "winch_law": None if self.winch_law is None else asdict(self.winch_law),
            "power_setting_depowered": self.setting[0],
            "power_setting_powered": self.setting[1],
        }


def estimate_kite(flight: FlightData, problem: Problem, cycles: Collection[int]) -> EstimatedKite:
    """Estimate coefficients and wind on some cycles of a flight.

    The wind is that measured at height, where it was; else it comes from the airspeed, whose sensor is gauged along
    with it. Neither knows the forces, so that they can be held against it. Without both, wind and coefficients come
    from one fit of the equilibrium. The coefficients depend on the wind; their covariance counts its errors too.

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
    chosen = _fitting(flight.select(cycles))
    warnings = []
    by_forces = fit_coefficients(chosen, problem, invert(chosen, problem), fit_wind=True)
    wind = _independent_wind(flight.select(cycles), problem)
    if wind is not None:
        fit = _fit(chosen, problem, wind)
        names, covariance = _given_wind_covariance(chosen, problem, wind, fit)
    elif by_forces.wind_identified:
        fit, wind = by_forces, _fitted_wind(by_forces, problem)
        names, covariance = _joint_covariance(fit)
    else:
        wind = wind_of_problem(problem)
        fit = _fit(chosen, problem, wind)
        names, covariance = _given_wind_covariance(chosen, problem, wind, fit)
        warnings.append("neither airspeed nor forces tell the wind of the flight; it is that of the problem")
    # Coefficients of a setting that was not flown stay those of the problem.
    for setting in ("powered", "depowered"):
        if setting not in fit.samples:
            warnings.append(
                f"the estimation cycles have too few {setting} samples; the problem's coefficients are kept"
            )
    base = problem.with_values(fit.changes())
    estimated = wind.applied(base)
    factor, error = airspeed_factor(wind.turned(flight.select(cycles)), estimated)
    check = by_forces.fit.parameter(WIND) if by_forces.wind_identified else None
    return EstimatedKite(
        problem=estimated,
        base=base,
        fit=fit,
        wind=wind,
        names=names,
        covariance=covariance,
        airspeed_factor=factor,
        airspeed_factor_error=error,
        wind_by_forces=None if check is None else (check["value"], check["standard_error"]),
        setting=_settings(flight.select(cycles)),
        winch_law=winch_law(flight.select(cycles)),
        cycles=tuple(sorted(cycles)),
        warnings=tuple(warnings),
    )


def own_coefficients(flight: FlightData, kite: EstimatedKite, wind: WindEstimate, cycle: int) -> CoefficientFit | None:
    """Fit the coefficients to a single cycle in its wind, to hold against those of the estimation cycles."""
    try:
        return _fit(_fitting(flight.select([cycle])), kite.base, wind)
    except InputError:
        return None


def _fitting(flight: FlightData) -> FlightData:
    """Return the samples whose power setting is that of their phase."""
    return flight.where(~((flight.phase == "transition") & (flight.power_setting < FULLY_POWERED)))


def _fit(chosen: FlightData, problem: Problem, wind: WindEstimate) -> CoefficientFit:
    """Fit the coefficients in a given wind."""
    turned, applied = wind.turned(chosen), wind.applied(problem)
    return fit_coefficients(turned, applied, invert(turned, applied))


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


def _independent_wind(flight: FlightData, problem: Problem) -> WindEstimate | None:
    """Return the wind measured at height, or by the airspeed, its sensor gauged along with it; None without both."""
    try:
        if flight.wind_at_height is not None:
            return wind_from_heights(flight, problem)
        return wind_from_airspeed(flight, problem)
    except InputError:
        return None


def _coefficients(fit: CoefficientFit) -> tuple[list[str], FloatArray, FloatArray]:
    """Return key paths, values and covariance of the coefficients alone."""
    kept = [name for name in fit.fit.names if name not in (WIND, DIRECTION)]
    index = [fit.fit.names.index(name) for name in kept]
    errors = fit.fit.standard_errors[index]
    covariance = fit.fit.correlation[np.ix_(index, index)] * np.outer(errors, errors)
    return [f"kite.{name}" for name in kept], fit.fit.values[index], covariance


def _joint_covariance(fit: CoefficientFit) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and covariance where the wind was fitted along with the coefficients."""
    names = tuple(name if name in (WIND, DIRECTION) else f"kite.{name}" for name in fit.fit.names)
    return names, fit.fit.correlation * np.outer(fit.fit.standard_errors, fit.fit.standard_errors)


def _given_wind_covariance(
    chosen: FlightData, problem: Problem, wind: WindEstimate, fit: CoefficientFit
) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and covariance where the coefficients were fitted in a wind known with errors of its own."""
    names, values, covariance = _coefficients(fit)
    scale_error, angle_error = wind.scale_standard_error or 0.0, wind.direction_standard_error_deg or 0.0
    together = (wind.correlation or 0.0) * scale_error * angle_error
    of_wind = np.array([[scale_error**2, together], [together, angle_error**2]])
    steps = (SLOPE_STEP * wind.scale, DIRECTION_STEP_DEG)
    others = (
        replace(wind, scale=wind.scale + steps[0]),
        replace(wind, direction_offset_deg=wind.direction_offset_deg + steps[1]),
    )
    slopes = np.zeros((len(names), 2))
    if of_wind.any():
        for column, (other, step) in enumerate(zip(others, steps, strict=True)):
            slopes[:, column] = (_coefficients(_fit(chosen, problem, other))[1] - values) / step
    cross = slopes @ of_wind
    return (*names, WIND, DIRECTION), np.block([[covariance + cross @ slopes.T, cross], [cross.T, of_wind]])


def _settings(flight: FlightData) -> tuple[float, float]:
    """Return the mean power settings of retraction and traction, nan where none is measured."""
    means = []
    for phase in ("retraction", "traction"):
        setting = flight.power_setting[flight.phase == phase]
        means.append(float(np.nanmean(setting)) if np.isfinite(setting).any() else float("nan"))
    return means[0], means[1]
