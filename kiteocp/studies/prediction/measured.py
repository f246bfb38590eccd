"""What the phases of a flown cycle were like: durations, means and the state that represents each of them."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from kiteocp.recording.cleaning import FloatArray
from kiteocp.recording.data import FLIGHT_PHASES, FlightData

#: A phase with fewer usable samples than this is not there.
FEWEST_SAMPLES = 8


class MeasuredPhase(msgspec.Struct, frozen=True):
    """One phase of one flown cycle.

    Attributes
    ----------
    name
        One of `FLIGHT_PHASES`.
    duration_s
        From the first sample to the next phase.
    mean_force_N, mean_power_W, mean_reeling_speed_m_s, mean_kite_speed_m_s
        Means over time; force at the ground, power as force times reeling speed, speed of the kite across the tether.
    reeled_length_m
        Length reeled out, negative reeling in.
    tether_length_start_m, tether_length_end_m
        Straight tether lengths as the model knows them (`model_lengths`).
    elevation_start_deg, elevation_end_deg
        At the first and at the last sample; of transition and turn, which end at an elevation, at the one after it.
    elevation_deg, azimuth_deg, course_deg
        The representative state: means of the cosines (eq:averagepositions), and of the cosine of the course.
    height_m
        Mean height.
    samples
        Samples with a force and a reeling speed.
    """

    name: str
    duration_s: float
    mean_force_N: float
    mean_power_W: float
    mean_reeling_speed_m_s: float
    mean_kite_speed_m_s: float
    reeled_length_m: float
    tether_length_start_m: float
    tether_length_end_m: float
    elevation_start_deg: float
    elevation_end_deg: float
    elevation_deg: float
    azimuth_deg: float
    course_deg: float
    height_m: float
    samples: int

    @property
    def energy_J(self) -> float:
        """Mechanical energy delivered."""
        return self.mean_power_W * self.duration_s

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {key: value for key, value in asdict(self).items() if key != "name"} | {"energy_J": self.energy_J}


class MeasuredCycle(msgspec.Struct, frozen=True):
    """One flown cycle, its phases by name."""

    number: int
    phases: dict[str, MeasuredPhase]

    @property
    def complete(self) -> bool:
        """Whether it holds every phase that the model knows."""
        return {"retraction", "transition", "traction"} <= self.phases.keys()

    @property
    def duration_s(self) -> float:
        """Sum of the durations."""
        return sum(phase.duration_s for phase in self.phases.values())

    @property
    def mean_power_W(self) -> float:
        """Energy of all phases over their duration."""
        return sum(phase.energy_J for phase in self.phases.values()) / self.duration_s

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        phases = {name: phase.to_dict() for name, phase in self.phases.items()}
        return {"duration_s": self.duration_s, "mean_power_W": self.mean_power_W, "phases": phases}


def measured_cycle(flight: FlightData, number: int) -> MeasuredCycle:
    """Summarise one cycle of a flight (in the frame of its wind)."""
    cycle = flight.select([number])
    step = float(np.median(np.diff(flight.time_s)))
    length = model_lengths(flight)[flight.cycle == number]
    phases = {}
    for name in FLIGHT_PHASES:
        among = cycle.phase == name
        phase = cycle.where(among)
        usable = np.isfinite(phase.tether_force_ground_N) & np.isfinite(phase.reeling_speed_m_s)
        if np.count_nonzero(usable & np.isfinite(phase.elevation_deg)) >= FEWEST_SAMPLES:
            # Where a phase ends at an elevation it ends between two samples.
            after = _elevation_after(cycle, among, step) if name in ("transition", "turn") else float("nan")
            phases[name] = _phase(name, phase, length[among], step, after)
    return MeasuredCycle(number, phases)


def _elevation_after(cycle: FlightData, among: NDArray[np.bool_], step: float) -> float:
    """Return the elevation of the sample right after a phase, nan where none follows at once."""
    last = int(np.flatnonzero(among)[-1])
    follows = last + 1 < len(cycle) and cycle.time_s[last + 1] - cycle.time_s[last] < 2.0 * step
    return float(cycle.elevation_deg[last + 1]) if follows else float("nan")


def _phase(name: str, phase: FlightData, length: FloatArray, step: float, elevation_after: float) -> MeasuredPhase:
    time = phase.time_s
    duration = float(time[-1] - time[0]) + step

    def mean(values: FloatArray) -> float:
        return time_mean(time, values)

    def angle(values_deg: FloatArray) -> float:
        return float(np.degrees(np.arccos(np.clip(mean(np.cos(np.radians(values_deg))), -1.0, 1.0))))

    speed = mean(phase.reeling_speed_m_s)
    elevation = phase.elevation_deg[np.isfinite(phase.elevation_deg)]
    return MeasuredPhase(
        name=name,
        duration_s=duration,
        mean_force_N=mean(phase.tether_force_ground_N),
        mean_power_W=mean(phase.tether_force_ground_N * phase.reeling_speed_m_s),
        mean_reeling_speed_m_s=speed,
        mean_kite_speed_m_s=mean(np.hypot(phase.polar_speed_m_s, phase.azimuthal_speed_m_s)),
        reeled_length_m=speed * duration,
        tether_length_start_m=float(length[0]),
        tether_length_end_m=float(length[0]) + speed * duration,
        elevation_start_deg=float(elevation[0]),
        elevation_end_deg=elevation_after if np.isfinite(elevation_after) else float(elevation[-1]),
        elevation_deg=angle(phase.elevation_deg),
        azimuth_deg=angle(phase.azimuth_deg),
        course_deg=angle(phase.course_deg),
        height_m=mean(phase.height_m),
        samples=int(np.count_nonzero(np.isfinite(phase.tether_force_ground_N * phase.reeling_speed_m_s))),
    )


def time_mean(time_s: FloatArray, values: FloatArray) -> float:
    """Return the mean over time; missing values are bridged by straight lines, nan where there is none at all."""
    known = np.isfinite(values)
    if np.count_nonzero(known) < 2:
        return float(values[known][0]) if known.any() else float("nan")
    time, kept = time_s[known], values[known]
    return float(np.trapezoid(kept, time) / (time[-1] - time[0]))


def model_lengths(flight: FlightData) -> FloatArray:
    """Return the straight tether length as the model knows it, without missing values, shape (n,).

    The reeled-out length, which the drum counts finely, shifted by its median difference to the measured distance,
    which has the drift of a satellite receiver in it. Without a length it is the distance.
    """
    length = flight.tether_length_m
    if np.isfinite(length).any():
        offset = np.nanmedian(flight.distance_m - length)
        length = length + (offset if np.isfinite(offset) else 0.0)
    else:
        length = flight.distance_m
    known = np.isfinite(length)
    return np.interp(flight.time_s, flight.time_s[known], length[known])
