"""A flown cycle beside the model's: what each law predicts of each phase, how sure it is, and whether that agrees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace

from kiteocp.errors import CycleError
from kiteocp.physics.parameters import ParameterValues
from kiteocp.recording.data import FlightData
from kiteocp.studies.prediction.cycle_wind import (
    OWN_WIND,
    CycleWind,
    covariance_of_cycle,
    shifted,
    values_of_cycle,
    wind_of_cycle,
)
from kiteocp.studies.prediction.kite import EstimatedKite, own_coefficients
from kiteocp.studies.prediction.measured import MeasuredCycle, measured_cycle
from kiteocp.studies.prediction.predictions import LAWS, CycleComparison, PhaseComparison, Prediction
from kiteocp.studies.prediction.prescribed import FlownLaw, fly_law
from kiteocp.studies.prediction.replay import FlownWinchLaw, Path, Replay, matching_wind, path_of, replay

#: What each law predicts (the rest of a phase it is given), with the measured quantity beside it.
PREDICTED: Mapping[str, tuple[str, ...]] = {
    "constant_force": ("duration_s", "mean_force_N", "mean_power_W", "reeled_length_m", "elevation_end_deg"),
    "force_schedule": ("mean_power_W", "reeled_length_m", "mean_kite_speed_m_s"),
    "speed_schedule": ("mean_force_N", "mean_power_W"),
    "winch_law": ("mean_force_N", "mean_power_W", "reeled_length_m"),
}

#: What the law of constant force is given in a phase, so that it is no prediction there.
GIVEN: Mapping[str, tuple[str, ...]] = {
    "retraction": ("mean_force_N", "reeled_length_m"),
    "transition": ("elevation_end_deg",),
    "traction": ("mean_force_N", "reeled_length_m", "elevation_end_deg"),
    "turn": ("mean_force_N", "elevation_end_deg"),
}

#: Relative step of the wind for the elasticities.
WIND_STEP = 0.005

#: Steps of the parameters for the first-order propagation, in their standard errors.
STEP_SIGMAS = 0.5


def compare_cycle(flight: FlightData, kite: EstimatedKite, number: int) -> CycleComparison:
    """Fly a measured cycle again by every law.

    Parameters
    ----------
    flight
        The whole flight, in its own frame.
    kite
        Coefficients, from these or other cycles.
    number
        The cycle.
    """
    wind = wind_of_cycle(flight, kite, number)
    turned = wind.estimate.turned(flight)
    cycle = measured_cycle(turned, number)
    values = values_of_cycle(kite, wind)
    paths = _paths(turned, cycle, kite)
    names, covariance = covariance_of_cycle(kite, wind)
    errors = np.sqrt(np.diag(covariance))

    def numbers(at: ParameterValues, turn_deg: float = 0.0) -> tuple[dict[str, float], dict[str, Any]]:
        if turn_deg == 0.0:
            return _predicted(cycle, paths, at, kite.winch_law)
        more = replace(turned, azimuth_deg=turned.azimuth_deg - turn_deg)
        other = measured_cycle(more, number)
        return _predicted(other, _paths(more, other, kite), at, kite.winch_law)

    centre, series = numbers(values)
    jacobian = {}
    for name, error in zip(names, errors, strict=True):
        if error > 0:
            step = STEP_SIGMAS * float(error)
            up, down = (numbers(*shifted(values, name, sign * step, wind))[0] for sign in (1.0, -1.0))
            jacobian[name] = {key: _slope(up.get(key), centre[key], down.get(key), step) for key in centre}

    def error_of(key: str) -> float:
        slopes = np.array([jacobian[name][key] if name in jacobian else 0.0 for name in names])
        return float(np.sqrt(np.maximum(slopes @ covariance @ slopes, 0.0)))

    phases = {name: _phase_comparison(name, cycle, paths[name], centre, series, error_of) for name in cycle.phases}
    elasticity = _elasticities(values, wind, numbers)
    match = matching_wind(paths["traction"], values)
    own = own_coefficients(flight, kite, wind.estimate, number)
    return CycleComparison(cycle, wind, phases, _powers(cycle, centre, error_of), elasticity, match, own)


def _paths(flight: FlightData, cycle: MeasuredCycle, kite: EstimatedKite) -> dict[str, Path]:
    return {name: path_of(flight, cycle.number, name, kite.setting) for name in cycle.phases}


def _elasticities(
    values: ParameterValues, wind: CycleWind, numbers: Callable[[ParameterValues, float], tuple[dict[str, float], Any]]
) -> dict[str, float]:
    """Return by ``law.phase`` the relative change of the mean power per relative change of the wind."""
    step = WIND_STEP * wind.estimate.scale
    up, down = (numbers(*shifted(values, OWN_WIND, sign * step, wind))[0] for sign in (1.0, -1.0))
    ending = ".mean_power_W"
    return {
        key.removesuffix(ending): (up[key] - down[key]) / (WIND_STEP * (abs(up[key]) + abs(down[key])))
        for key in up
        if key.endswith(ending) and key in down
    }


def _slope(up: float | None, centre: float, down: float | None, step: float) -> float:
    """Return a difference quotient, one-sided where the model cannot fly one side."""
    if up is not None and down is not None:
        return (up - down) / (2 * step)
    if up is not None:
        return (up - centre) / step
    return float("nan") if down is None else (centre - down) / step


def _predicted(
    cycle: MeasuredCycle, paths: Mapping[str, Path], values: ParameterValues, winch: FlownWinchLaw | None
) -> tuple[dict[str, float], dict[str, Any]]:
    """Return every predicted number by ``law.phase.quantity``, and the time series behind by ``law.phase``."""
    found: dict[str, float] = {}
    series: dict[str, Any] = {}
    energies = dict.fromkeys(LAWS, 0.0)
    times = dict.fromkeys(LAWS, 0.0)
    for name, phase in cycle.phases.items():
        try:
            flown = fly_law(phase, cycle, values)
        except CycleError as error:
            series[f"constant_force.{name}"] = str(error)
            energies["constant_force"] = np.nan
        else:
            series[f"constant_force.{name}"] = flown
            summary = flown.summary()
            found |= {f"constant_force.{name}.{key}": value for key, value in summary.items()}
            energies["constant_force"] += summary["mean_power_W"] * summary["duration_s"]
            times["constant_force"] += summary["duration_s"]
        again = replay(paths[name], values, winch)
        series[f"replay.{name}"] = again
        summary = again.summary(phase.duration_s)
        found |= {f"force_schedule.{name}.{key[6:]}": value for key, value in summary.items() if key[:6] == "force."}
        found |= {f"speed_schedule.{name}.{key[6:]}": value for key, value in summary.items() if key[:6] == "speed."}
        found |= {f"winch_law.{name}.{key[6:]}": value for key, value in summary.items() if key[:6] == "winch."}
        for law in ("force_schedule", "speed_schedule"):
            energies[law] += found[f"{law}.{name}.mean_power_W"] * phase.duration_s
            times[law] += phase.duration_s
    for law in LAWS:
        if times[law] > 0 and np.isfinite(energies[law]):
            found[f"{law}.cycle.mean_power_W"] = energies[law] / times[law]
    return found, series


def _phase_comparison(
    name: str,
    cycle: MeasuredCycle,
    path: Path,
    centre: Mapping[str, float],
    series: Mapping[str, Any],
    error_of: Callable[[str], float],
) -> PhaseComparison:
    phase = cycle.phases[name]
    predictions: dict[str, dict[str, Prediction]] = {}
    for law, quantities in PREDICTED.items():
        predictions[law] = {}
        for quantity in quantities:
            key = f"{law}.{name}.{quantity}"
            if key not in centre or (law == "constant_force" and quantity in GIVEN[name]):
                continue
            # Along the path: the same samples on both sides.
            same = centre.get(f"{law}.{name}.{_measured_name(quantity)}")
            measured = getattr(phase, quantity) if same is None else same
            predictions[law][quantity] = Prediction(float(measured), centre[key], error_of(key))
    law = series[f"constant_force.{name}"]
    replayed: Replay = series[f"replay.{name}"]
    return PhaseComparison(
        measured=phase,
        predictions=predictions,
        unflown={} if isinstance(law, FlownLaw) else {"constant_force": str(law)},
        without_equilibrium={law: int(centre[f"{law}.{name}.without"]) for law in ("force_schedule", "speed_schedule")},
        law=law if isinstance(law, FlownLaw) else None,
        replayed=replayed,
    )


def _measured_name(quantity: str) -> str:
    """Name under which a replay gives the measured mean of the samples it could fly: ``mean_power_measured_W``."""
    for unit in ("_m_s", "_N", "_W", "_m", "_s", "_deg"):
        if quantity.endswith(unit):
            return f"{quantity.removesuffix(unit)}_measured{unit}"
    return quantity


def _powers(
    cycle: MeasuredCycle, centre: Mapping[str, float], error_of: Callable[[str], float]
) -> dict[str, Prediction]:
    """Return the mean power of the cycle by each law that flies all of it."""
    keys = {law: f"{law}.cycle.mean_power_W" for law in LAWS}
    return {
        law: Prediction(cycle.mean_power_W, centre[key], error_of(key)) for law, key in keys.items() if key in centre
    }
