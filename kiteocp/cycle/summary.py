"""The numbers every cycle is summarised in, simulated or optimal: phases, cycle, channels, warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.cycle.phases import KINDS, PHASE_CHANGES, PhaseName, pauses_after
from kiteocp.physics.aerodynamics import harvesting_factor
from kiteocp.physics.equilibrium import OUTPUTS
from kiteocp.physics.flight import OUTPUT_UNITS
from kiteocp.physics.kinematics import Course, elevation_rate
from kiteocp.physics.machine import electrical, energy_moved
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameters_of
from kiteocp.physics.tether import relative_gravitational_force, tether_mass
from kiteocp.physics.wind import profile_of

#: Outputs of a flight state that every time series carries.
CHANNELS = (
    "height",
    "reeling_speed",
    "kite_speed",
    "wind_speed",
    "apparent_wind_speed",
    "kinematic_ratio",
    "tether_force_kite",
    "tether_force_ground",
    "power",
    "electrical_power",
    "tangential_speed",
    "reeling_factor",
    "inflow_angle",
)

#: Tether weight over tether force beyond which the sag is no longer small (eq:rel_gravitational_Force).
SAG_LIMIT = 0.3


class PhaseRecord(msgspec.Struct, frozen=True, dict=True):
    """One flown phase.

    Attributes
    ----------
    name
        The phase.
    time_s, tether_length_m, elevation_rad
        Samples over the phase, shape (n,), time from the start of the phase.
    outputs
        Quantities of `OUTPUTS` at the samples, shape (len(OUTPUTS), n).
    energy_J, electrical_energy_J
        Energy delivered over the phase, at the drum and behind generator and motor.
    steered
        What steers the kite where the phase does not prescribe it: ``power_setting``, ``course`` (rad) and
        ``elevation_rate`` (rad/s) at the samples, shape (n,).
    """

    name: PhaseName
    time_s: np.ndarray
    tether_length_m: np.ndarray
    elevation_rad: np.ndarray
    outputs: np.ndarray
    energy_J: float
    electrical_energy_J: float
    steered: Mapping[str, np.ndarray] = msgspec.field(default_factory=dict)

    def output(self, name: str) -> np.ndarray:
        """Return one quantity of `OUTPUTS` at the samples, shape (n,)."""
        row: np.ndarray = self.outputs[OUTPUTS.index(name)]
        return row

    def ends(self, name: str) -> tuple[float, float]:
        """Return the least and the greatest sample of one quantity of `OUTPUTS`; not a number where one is not."""
        least, greatest = self._ends
        return least[OUTPUTS.index(name)], greatest[OUTPUTS.index(name)]

    @cached_property
    def _ends(self) -> tuple[list[float], list[float]]:
        return self.outputs.min(axis=1).tolist(), self.outputs.max(axis=1).tolist()

    def rate(self, name: str) -> np.ndarray:
        """Return the difference quotients in time of one quantity of `OUTPUTS` between the samples, shape (n - 1,)."""
        return np.asarray(np.diff(self.output(name)) / np.diff(self.time_s), dtype=np.float64)

    @property
    def power_setting(self) -> np.ndarray:
        """Power setting at the samples, 0 depowered and 1 powered, shape (n,)."""
        prescribed = float(KINDS[self.name].setting == "powered")
        return self.steered.get("power_setting", np.full(self.time_s.size, prescribed))

    def course_rad(self, values: ParameterValues) -> np.ndarray:
        """Course at the samples, 0 straight down and pi straight up, in the traction the mean one, shape (n,)."""
        return self.steered.get("course", np.full(self.time_s.size, self._prescribed_course_rad(values)))

    def elevation_rate_rad_s(self, values: ParameterValues) -> np.ndarray:
        """Rate of the (mean) elevation at the samples, shape (n,)."""
        if "elevation_rate" in self.steered:
            return self.steered["elevation_rate"]
        # The mean course of the file keeps the elevation of the traction.
        level = 0.0 if KINDS[self.name].course else np.cos(self._prescribed_course_rad(values))
        drift = Course(np.cos(self.course_rad(values)) - level, 0.0)
        rate = elevation_rate(self.output("tangential_speed"), drift, self.tether_length_m)
        return np.asarray(rate, dtype=np.float64) + 0.0

    def _prescribed_course_rad(self, values: ParameterValues) -> float:
        flown = KINDS[self.name].course
        if flown is None:
            return float(np.radians(values["operation.traction.course_deg"]))
        return float(np.arctan2(flown.sine, flown.cosine))

    @property
    def duration_s(self) -> float:
        """Duration of the phase."""
        return float(self.time_s[-1])


def electrical_energy_J(values: ParameterValues, states: np.ndarray, power_W: np.ndarray) -> float:
    """Return the electrical energy of a flown phase from its mechanical one.

    Parameters
    ----------
    values
        The efficiencies.
    states
        Time, tether length, elevation and mechanical energy at the steps of an integrator, shape (n, 4).
    power_W
        Mechanical power there, shape (n,).
    """
    moved = energy_moved(states[:, 0], power_W, states[:, 3])
    efficiencies = values["machine.generator_efficiency"], values["machine.motor_efficiency"]
    return float(electrical(float(states[-1, 3]), moved, *efficiencies))


def phase_summaries(records: Sequence[PhaseRecord], values: ParameterValues) -> dict[str, dict[str, float]]:
    """Return duration, power, energy, end points and mean power setting and course of each phase."""
    return {
        record.name: {
            "duration_s": record.duration_s,
            "mean_power_W": record.energy_J / record.duration_s,
            "mean_electrical_power_W": record.electrical_energy_J / record.duration_s,
            "energy_J": record.energy_J,
            "electrical_energy_J": record.electrical_energy_J,
            "tether_length_start_m": float(record.tether_length_m[0]),
            "tether_length_end_m": float(record.tether_length_m[-1]),
            "elevation_start_deg": float(np.degrees(record.elevation_rad[0])),
            "elevation_end_deg": float(np.degrees(record.elevation_rad[-1])),
            "mean_power_setting": _mean(record, record.power_setting),
            "mean_course_deg": _mean(record, np.degrees(record.course_rad(values))),
        }
        for record in records
    }


def _mean(record: PhaseRecord, samples: np.ndarray) -> float:
    """Mean over the time of a phase; exactly the value of what is constant."""
    return float(samples[0] + np.trapezoid(samples - samples[0], record.time_s) / record.duration_s)


def cycle_summary(
    values: ParameterValues,
    phases: Mapping[str, Mapping[str, float]],
    *,
    traction_altitude_m: float,
    phase_change_time_s: float = 0.0,
) -> dict[str, float]:
    """Return duration, mean powers (eq:pc_P_general), harvesting factor (eq:meanharvestfact) and mean altitude."""
    pauses = PHASE_CHANGES * phase_change_time_s
    duration = sum(phase["duration_s"] for phase in phases.values()) + pauses
    energy, electrical = (sum(phase[key] for phase in phases.values()) for key in ("energy_J", "electrical_energy_J"))
    wind, density = (float(v) for v in air_function(values.structure)(traction_altitude_m, values.vector))
    power = energy / duration
    return {
        "duration_s": duration,
        "mean_power_W": power,
        "mean_electrical_power_W": electrical / duration,
        "energy_J": energy,
        "electrical_energy_J": electrical,
        "mean_harvesting_factor": float(harvesting_factor(power, density, wind, values["kite.projected_area_m2"])),
        "mean_traction_altitude_m": traction_altitude_m,
        "wind_speed_at_mean_traction_altitude_m_s": wind,
        "phase_change_time_total_s": pauses,
    }


@lru_cache(maxsize=32)
def air_function(structure: Structure) -> ca.Function:
    """Build (once) ``(height, p) -> wind speed, air density``."""
    parameters = parameters_of(structure)
    model, height = Model(parameters), ca.SX.sym("height")
    return ca.Function("air", [height, parameters.vector], [model.wind_speed(height), model.air_density(height)])


def channels_of(records: Sequence[PhaseRecord], values: ParameterValues, pause_s: float = 0.0) -> dict[str, Any]:
    """Join the phases to time series with the names of the output contract.

    Parameters
    ----------
    records
        The phases in order.
    values
        Parameters, for the azimuth of the traction.
    pause_s
        Time of each phase change, which passes without motion or energy.
    """
    pauses = pauses_after([record.name for record in records], pause_s)
    starts = np.cumsum([0.0, *(record.duration_s + pause for record, pause in zip(records, pauses, strict=True))])
    traction_azimuth = values["operation.traction.azimuth_deg"]
    joined: dict[str, Any] = {
        "time_s": [record.time_s + start for record, start in zip(records, starts[:-1], strict=True)],
        "phase": [np.full(record.time_s.size, record.name) for record in records],
        "tether_length_m": [record.tether_length_m for record in records],
        "elevation_deg": [np.degrees(record.elevation_rad) for record in records],
        "azimuth_deg": [
            np.full(record.time_s.size, 0.0 if KINDS[record.name].course else traction_azimuth) for record in records
        ],
    }
    for name in CHANNELS:
        unit = OUTPUT_UNITS.get(name)
        joined[f"{name}_{unit}" if unit else name] = [record.output(name) for record in records]
    for record in records:
        for name, samples in steering(record, values).items():
            joined.setdefault(name, []).append(samples)
    return {name: np.concatenate(parts) for name, parts in joined.items()}


def steering(record: PhaseRecord, values: ParameterValues) -> dict[str, np.ndarray]:
    """Return what the kite's controller is given, by the names of the time series and the set points, shape (n,)."""
    return {
        "power_setting": record.power_setting,
        "course_deg": np.degrees(record.course_rad(values)),
        "elevation_rate_deg_s": np.degrees(record.elevation_rate_rad_s(values)),
    }


def validity_warnings(records: Sequence[PhaseRecord], values: ParameterValues) -> list[str]:
    """Name what of a flown cycle lies outside the validity of the model, one sentence each."""
    warnings = []
    highest = max(float(record.output("height").max()) for record in records)
    lowest = min(float(record.output("height").min()) for record in records)
    remark = profile_of(values.structure).remark(values, lowest, highest)
    if remark is not None:
        warnings.append(remark)
    if lowest < 0:
        warnings.append(f"the flight path goes below the ground ({lowest:.0f} m)")
    for record in records:
        mass = tether_mass(record.tether_length_m, values["tether.diameter_m"], values["tether.density_kg_m3"])
        weight = mass * values["environment.gravity_m_s2"]
        gamma = float(np.max(relative_gravitational_force(weight, record.output("tether_force_kite"))))
        if gamma > SAG_LIMIT:
            warnings.append(
                f"in the {record.name} the tether weighs up to {100 * gamma:.0f} % of its tension: it sags, and the "
                "model's straight tether is a rough picture"
            )
    return warnings
