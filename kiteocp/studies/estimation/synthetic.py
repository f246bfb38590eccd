"""A flight as it would have been measured, made from a simulated cycle: the known answer that estimation must find."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from kiteocp.cycle.motion import at_ground_force, motion
from kiteocp.cycle.phases import KINDS, PHASES, PhaseName, require_three_phases
from kiteocp.errors import InputError
from kiteocp.execution import one_at_a_time
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values, parameters_of
from kiteocp.physics.wind import ground_height
from kiteocp.recording import FlightData
from kiteocp.result import Result

FloatArray = NDArray[np.float64]

#: A spike is the value times this, of either sign.
SPIKE = 4.0

#: How long a frozen sensor repeats its value, s.
FROZEN_S = 3.0


class Noise(msgspec.Struct, frozen=True):
    """Errors of measurement: standard deviations, in the unit of what they are added to.

    Half of the variance is white, half correlated over `correlation_time_s` (a process of first order).

    Attributes
    ----------
    speed_m_s
        Of each component of the velocity.
    force_share
        Of the tether force, relative.
    angle_deg
        Of elevation and azimuth.
    distance_m
        Of the distance.
    airspeed_m_s
        Of the measured apparent wind speed.
    wind_share
        Of the wind speed at the ground, relative.
    correlation_time_s
        Of the correlated half.
    wrong_share
        Share of the samples with a wrong value: a spike, a frozen sensor or nothing, in the speed or the force.
    """

    speed_m_s: float = 0.0
    force_share: float = 0.0
    angle_deg: float = 0.0
    distance_m: float = 0.0
    airspeed_m_s: float = 0.0
    wind_share: float = 0.0
    correlation_time_s: float = 1.0
    wrong_share: float = 0.0


#: No errors at all.
NOISELESS = Noise()


@one_at_a_time
def flight_of_result(
    result: Result,
    *,
    sample_rate_Hz: float = 10.0,
    cycles: int = 1,
    noise: Noise = NOISELESS,
    gaps: tuple[tuple[float, float], ...] = (),
    seed: int = 0,
) -> FlightData:
    """Fly a simulated cycle again and measure it.

    The positions are interpolated; the state at each of them is the closed form of the equilibrium, so that without
    noise every sample is in equilibrium to machine precision.

    Parameters
    ----------
    result
        Of `kiteocp.simulate`.
    sample_rate_Hz
        Samples a second.
    cycles
        How often the cycle is flown.
    noise, gaps, seed
        Errors of measurement, stretches without samples (from, to, in s), and the seed of the random numbers.

    Raises
    ------
    InputError
        The result is not that of a simulation with gravity, it has a turn, or the sample rate or the number of cycles
        is not positive.
    """
    if result.verb != "simulate" or not result.channels or not result.details["simulation"]["gravity"]:
        raise InputError(f"a flight is made from a simulation with gravity, not from a result of {result.verb}")
    require_three_phases(parameter_values(result.problem).structure, "a synthetic flight")
    if not sample_rate_Hz > 0 or cycles < 1:
        raise InputError(f"sample_rate_Hz is {sample_rate_Hz} and cycles is {cycles}, but both must be positive")
    values = parameter_values(result.problem)
    time = np.concatenate([_times(result, sample_rate_Hz) + k * float(result["time_s"][-1]) for k in range(cycles)])
    once = _once(result, values, sample_rate_Hz)
    count = once["time_s"].size
    arrays: dict[str, Any] = {name: np.tile(column, cycles) for name, column in once.items()}
    arrays |= {"time_s": time, "cycle": np.repeat(np.arange(cycles), count)}
    missing = np.full(time.size, np.nan)
    flight = FlightData(
        **arrays,
        ground_wind_direction_deg=np.full(time.size, 270.0),
        angle_of_attack_deg=missing,
        name=f"{result.problem.name} (simulated)",
        downwind_bearing_deg=90.0,
    )
    measured = _measured(flight, noise, np.random.default_rng(seed))
    lost = np.zeros(time.size, dtype=bool)
    for start, end in gaps:
        lost |= (time >= start) & (time < end)
    return measured.where(~lost)


def _times(result: Result, rate: float) -> FloatArray:
    """Return the times of the samples: evenly from the start, without the very end, where the next cycle begins."""
    end = float(result["time_s"][-1])
    return np.arange(0.0, end - 1e-9, 1.0 / rate)


def _once(result: Result, values: ParameterValues, rate: float) -> dict[str, Any]:
    """Return the arrays of one cycle without errors."""
    time = _times(result, rate)
    phase_of = np.empty(time.size, dtype="<U10")
    columns = {name: np.empty(time.size) for name in _QUANTITIES}
    azimuth, course = np.zeros(time.size), np.zeros(time.size)
    for name in PHASES:
        knots = result.channel("time_s", name)
        inside = (time >= knots[0]) & ((time < knots[-1]) | (name == PHASES[-1]))
        phase_of[inside] = name
        inputs = [
            CubicSpline(knots, result.channel(channel, name))(time[inside])
            for channel in ("tether_length_m", "elevation_deg", "tether_force_ground_N")
        ]
        function = _state_function(values.structure, name)
        table = np.asarray(function.map(inputs[0].size)(np.stack(inputs), values.vector))
        for quantity, row in zip(_QUANTITIES, table, strict=True):
            columns[quantity][inside] = row
        azimuth[inside] = values["operation.traction.azimuth_deg"] if KINDS[name].course is None else 0.0
        course[inside] = {"retraction": 180.0, "transition": 0.0, "traction": values["operation.traction.course_deg"]}[
            name
        ]
    return {
        "time_s": time,
        "phase": phase_of,
        "distance_m": columns["distance_m"],
        "tether_length_m": columns["distance_m"],
        "elevation_deg": columns["elevation_deg"],
        "azimuth_deg": azimuth,
        "height_m": columns["height_m"],
        "course_deg": course,
        "radial_speed_m_s": columns["radial_speed_m_s"],
        "polar_speed_m_s": columns["tangential_speed_m_s"] * np.cos(np.radians(course)),
        "azimuthal_speed_m_s": columns["tangential_speed_m_s"] * np.sin(np.radians(course)),
        "reeling_speed_m_s": columns["radial_speed_m_s"],
        "tether_force_ground_N": columns["tether_force_ground_N"],
        "ground_wind_speed_m_s": columns["ground_wind_speed_m_s"],
        "apparent_wind_speed_m_s": columns["apparent_wind_speed_m_s"],
        "power_setting": np.where(phase_of == "retraction", 0.0, 1.0),
    }


_QUANTITIES = (
    "distance_m",
    "elevation_deg",
    "height_m",
    "radial_speed_m_s",
    "tangential_speed_m_s",
    "apparent_wind_speed_m_s",
    "tether_force_ground_N",
    "ground_wind_speed_m_s",
)


@lru_cache(maxsize=64)
def _state_function(structure: Structure, name: PhaseName) -> ca.Function:
    """Build (once) ``((length, elevation in deg, ground force), p) -> `_QUANTITIES`, stacked``."""
    parameters = parameters_of(structure)
    model, kind, inputs = Model(parameters), KINDS[name], ca.SX.sym("inputs", 3)
    length, elevation, tension = ca.vertsplit(inputs)
    state = motion(model, kind, length, elevation * (np.pi / 180), at_ground_force(tension)).flight
    outputs = (
        length,
        elevation,
        state.conditions.height,
        state.reeling_speed,
        state.tangential_speed,
        state.apparent_wind_speed,
        state.tether_force_ground,
        model.wind_speed(ground_height(parameters)),
    )
    return ca.Function("state", [inputs, parameters.vector], [ca.densify(ca.vertcat(*outputs))])


def _measured(flight: FlightData, noise: Noise, random: np.random.Generator) -> FlightData:
    """Add the errors of measurement."""
    step = float(np.median(np.diff(flight.time_s)))

    def error(size: float) -> FloatArray:
        white, slow = random.normal(size=(2, len(flight)))
        found: FloatArray = size * np.sqrt(0.5) * (white + _correlated(slow, step / noise.correlation_time_s))
        return found

    speeds = ("radial_speed_m_s", "polar_speed_m_s", "azimuthal_speed_m_s")
    changed: dict[str, Any] = {name: getattr(flight, name) + error(noise.speed_m_s) for name in speeds}
    changed["reeling_speed_m_s"] = flight.reeling_speed_m_s
    changed["tether_force_ground_N"] = flight.tether_force_ground_N * (1.0 + error(noise.force_share))
    changed["elevation_deg"] = flight.elevation_deg + error(noise.angle_deg)
    changed["azimuth_deg"] = flight.azimuth_deg + error(noise.angle_deg)
    changed["distance_m"] = flight.distance_m + error(noise.distance_m)
    changed["apparent_wind_speed_m_s"] = flight.apparent_wind_speed_m_s + error(noise.airspeed_m_s)
    changed["ground_wind_speed_m_s"] = flight.ground_wind_speed_m_s * (1.0 + error(noise.wind_share))
    _spoil(changed, noise.wrong_share, max(round(FROZEN_S / step), 1), random)
    polar, azimuthal = changed["polar_speed_m_s"], changed["azimuthal_speed_m_s"]
    changed["course_deg"] = np.degrees(np.arctan2(azimuthal, polar)) % 360.0
    return replace(flight, **changed)


def _correlated(white: FloatArray, decay: float) -> FloatArray:
    """Return a process of first order with unit variance from white noise; `decay` is the step over its time."""
    keep = float(np.exp(-decay))
    series: FloatArray = white * float(np.sqrt(1.0 - keep**2))
    series[0] = white[0]
    for i in range(1, series.size):
        series[i] += keep * series[i - 1]
    return series


def _spoil(columns: Mapping[str, FloatArray], share: float, frozen: int, random: np.random.Generator) -> None:
    """Make a share of the samples wrong, a third each: spikes, frozen stretches and missing values."""
    count = next(iter(columns.values())).size
    names = ("radial_speed_m_s", "polar_speed_m_s", "tether_force_ground_N")
    for name, third in zip(names, np.array_split(random.permutation(count)[: round(share * count)], 3), strict=True):
        column, kinds = columns[name], np.array_split(third, 3)
        column[kinds[0]] *= random.choice([-SPIKE, SPIKE], size=kinds[0].size)
        column[kinds[1]] = np.nan
        for start in kinds[2][: max(kinds[2].size // frozen, 1)] if kinds[2].size else ():
            column[start : start + frozen] = column[max(start - frozen, 0)]
