"""Aerodynamics from a flight: wind, coefficients of every sample, averages by phase, and the fit."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, get_args

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from kiteocp.errors import CycleError, InputError, check_word
from kiteocp.execution import one_at_a_time
from kiteocp.problem import Problem
from kiteocp.recording import FlightData
from kiteocp.studies.estimation.bias import RoundTrip, round_trip
from kiteocp.studies.estimation.estimates import Estimation
from kiteocp.studies.estimation.fit import WIND, CoefficientFit, fit_coefficients, fitted_wind
from kiteocp.studies.estimation.inversion import Inversion, invert
from kiteocp.studies.estimation.phases import phase_estimates
from kiteocp.studies.estimation.unknowns import WindUnknowns, with_unknowns
from kiteocp.studies.estimation.wind import (
    FEWEST_SAMPLES,
    WindEstimate,
    wind_from_airspeed,
    wind_from_ground,
    wind_from_heights,
    wind_of_problem,
    winds_by_cycle,
)

FloatArray = NDArray[np.float64]

WindSource = Literal["measured", "airspeed", "ground", "fit", "problem"]
WIND_SOURCES: tuple[WindSource, ...] = get_args(WindSource)

#: Beyond these median resultant coefficients (of the projected area) there is no kite: flight and problem do not belong
#: together, or a unit is wrong.
CREDIBLE = (0.03, 1.6)


@one_at_a_time
def estimate(
    flight: FlightData,
    problem: Problem,
    *,
    wind: WindSource | None = None,
    cycles: Collection[int] | None = None,
    calibrate: bool = True,
    ground_height_m: float | None = None,
    unknowns: WindUnknowns | None = None,
) -> Estimation:
    """Estimate coefficients and wind from a flight.

    Parameters
    ----------
    flight
        What was measured.
    problem
        Area, masses, tether, air and the shape of the wind profile; its coefficients are not used.
    wind
        Where the wind at the kite comes from: ``measured`` at height (`wind_from_heights`), ``airspeed``
        (`wind_from_airspeed`), ``ground`` (`wind_from_ground`), ``fit`` (the equilibrium itself) or ``problem``; the
        first of measured, airspeed, ground and problem that the flight has where left out.
    cycles
        Numbers of the cycles to use; all where left out.
    calibrate, ground_height_m
        As of `wind_from_airspeed` and `wind_from_ground`.
    unknowns
        What the data do not tell of the wind; its intervals carry it. The defaults of `WindUnknowns` where left out.

    Raises
    ------
    InputError
        There is no such cycle, too little data, or flight and problem do not belong together.
    """
    if wind is not None:
        check_word("wind", wind, get_args(WindSource))
    chosen = _chosen(flight, cycles).flying()
    if not len(chosen):
        raise InputError("has no sample of a phase with the kite in the air; check the column map", file=flight.name)
    warnings = list(flight.warnings)
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

    def regauged(factor: float) -> WindEstimate:
        gauged = replace(
            chosen, apparent_wind_speed_m_s=chosen.apparent_wind_speed_m_s / (factor * (start.airspeed_gain or 1.0))
        )
        return wind_from_airspeed(gauged, problem, calibrate=False)

    found = with_unknowns(found, chosen, problem, unknowns or WindUnknowns(), regauged, ground_height_m)
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
    measured = flight.wind_at_height
    if measured is not None and np.count_nonzero(np.isfinite(measured.speed_m_s)) >= FEWEST_SAMPLES:
        return "measured"
    if np.count_nonzero(np.isfinite(flight.apparent_wind_speed_m_s)) >= FEWEST_SAMPLES:
        return "airspeed"
    return "ground" if np.count_nonzero(np.isfinite(flight.ground_wind_speed_m_s)) >= FEWEST_SAMPLES else "problem"


def _wind(
    flight: FlightData, problem: Problem, source: WindSource, calibrate: bool, height_m: float | None
) -> WindEstimate:
    if source == "measured":
        return wind_from_heights(flight, problem)
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
    if source == "fit" or not fit.wind_identified or found.total_standard_error is None:
        return []
    factor = fit.fit.parameter(WIND[0])
    error = float(np.hypot(found.total_standard_error / found.scale, factor["standard_error"]))
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
    if not wind.total_standard_error:
        return None
    stronger = replace(wind, scale=wind.scale + wind.total_standard_error).applied(problem)
    found = fit_coefficients(flight, stronger, invert(flight, stronger))
    return {name: found.fit.value(name) - fit.fit.value(name) for name in fit.fit.names if name in found.fit.names}


def _interval(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}"
