"""A flight as measured: positions, velocities, forces and wind in the conventions of the model."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

#: Phases in the order of a cycle. "turn" is the way from reel-out to reel-in; the model has no phase for it.
FLIGHT_PHASES = ("retraction", "transition", "traction", "turn")

#: Below this height above the ground station a kite does not fly: it lies, or is carried.
GROUND_HEIGHT_M = 2.0


class MeasuredWind(msgspec.Struct, frozen=True, eq=False):
    """Wind measured at several heights beside a flight, as by a lidar; nan stands for a missing value.

    Attributes
    ----------
    heights_m : float array
        Heights above the ground station, ascending, shape (m,).
    speed_m_s : float array
        At each sample of the flight, shape (n, m).
    direction_deg : float array
        Where it comes from, clockwise from north, shape (n, m).
    """

    heights_m: NDArray[np.float64]
    speed_m_s: NDArray[np.float64]
    direction_deg: NDArray[np.float64]

    def where(self, keep: NDArray[np.bool_]) -> MeasuredWind:
        """Return the samples that a mask (n,) keeps."""
        return MeasuredWind(self.heights_m, self.speed_m_s[keep], self.direction_deg[keep])


class FlightData(msgspec.Struct, frozen=True, eq=False):
    """Samples of a flight, in order of time; every array has the same length n, nan stands for a missing value.

    Attributes
    ----------
    time_s : float array
        From the start of the recording.
    cycle : int array
        Number of the pumping cycle; -1 where the sample belongs to none.
    phase : str array
        One of `FLIGHT_PHASES`, or empty.
    distance_m : float array
        Straight distance from the ground station to the kite.
    tether_length_m : float array
        Length reeled out; may be missing throughout.
    elevation_deg, azimuth_deg : float array
        Position of the kite in the wind reference frame (azimuth: the model's phi).
    height_m : float array
        Above the ground station.
    course_deg : float array
        0 straight down, 90 towards +phi, 180 straight up.
    radial_speed_m_s, polar_speed_m_s, azimuthal_speed_m_s : float array
        Velocity of the kite: outwards, towards +theta (downwards), towards +phi.
    reeling_speed_m_s : float array
        Of the tether at the ground, positive reeling out.
    tether_force_ground_N : float array
        At the ground station.
    ground_wind_speed_m_s, ground_wind_direction_deg : float array
        Measured at the ground; the direction the wind comes from, clockwise from north.
    apparent_wind_speed_m_s : float array
        Measured at the kite; may be missing throughout.
    angle_of_attack_deg : float array
        Measured at the kite; may be missing throughout.
    power_setting : float array
        0 depowered to 1 powered; may be missing throughout.
    name : str
        What the flight is called in tables and pictures.
    downwind_bearing_deg : float
        Bearing of phi = 0, clockwise from north.
    counts : mapping of str to int
        Samples (or single values) rejected or repaired in reading, by reason.
    wind_at_height : MeasuredWind or None
        Measured at several heights; None where it was not.
    notes, warnings : tuple of str
        What reading found out for itself, and what of the recording contradicts itself; one sentence each.
    """

    time_s: NDArray[np.float64]
    cycle: NDArray[np.int64]
    phase: NDArray[np.str_]
    distance_m: NDArray[np.float64]
    tether_length_m: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    azimuth_deg: NDArray[np.float64]
    height_m: NDArray[np.float64]
    course_deg: NDArray[np.float64]
    radial_speed_m_s: NDArray[np.float64]
    polar_speed_m_s: NDArray[np.float64]
    azimuthal_speed_m_s: NDArray[np.float64]
    reeling_speed_m_s: NDArray[np.float64]
    tether_force_ground_N: NDArray[np.float64]
    ground_wind_speed_m_s: NDArray[np.float64]
    ground_wind_direction_deg: NDArray[np.float64]
    apparent_wind_speed_m_s: NDArray[np.float64]
    angle_of_attack_deg: NDArray[np.float64]
    power_setting: NDArray[np.float64]
    name: str = "flight"
    downwind_bearing_deg: float = 0.0
    counts: Mapping[str, int] = msgspec.field(default_factory=dict)
    wind_at_height: MeasuredWind | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        lengths = {name: np.shape(values) for name, values in self.arrays().items()}
        if len(set(lengths.values())) != 1 or len(next(iter(lengths.values()))) != 1:
            raise ValueError(f"the arrays of a flight need one common length, not {lengths}")

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time_s)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return every array by its name, in the order of declaration."""
        return {name: getattr(self, name) for name in self.__struct_fields__ if name not in _SCALARS}

    def cycles(self) -> tuple[int, ...]:
        """Return the numbers of the cycles, in ascending order, without the samples that belong to none."""
        return tuple(int(number) for number in np.unique(self.cycle) if number >= 0)

    def select(self, cycles: Collection[int] | None = None, phase: str | Collection[str] | None = None) -> FlightData:
        """Return the samples of the given cycles and phase (or phases), in order; None means all."""
        keep = np.ones(len(self), dtype=bool)
        if cycles is not None:
            keep &= np.isin(self.cycle, list(cycles))
        if phase is not None:
            keep &= np.isin(self.phase, [phase] if isinstance(phase, str) else list(phase))
        return self.where(keep)

    def flying(self) -> FlightData:
        """Return the samples that belong to a phase, with the kite off the ground; the others are counted."""
        ground = np.abs(self.height_m) < GROUND_HEIGHT_M
        keep = (self.phase != "") & ~ground
        if keep.all():
            return self
        counts = dict(self.counts)
        if ground.any():
            counts["rows_on_ground"] = counts.get("rows_on_ground", 0) + int(ground.sum())
        # In reading, samples without a phase were counted already.
        if without := int(np.count_nonzero(self.phase == "")):
            counts["rows_without_phase"] = max(without, counts.get("rows_without_phase", 0))
        return replace(self.where(keep), counts=counts)

    def where(self, keep: NDArray[np.bool_]) -> FlightData:
        """Return the samples that a mask (n,) keeps."""
        kept: dict[str, Any] = {name: values[keep] for name, values in self.arrays().items()}
        if self.wind_at_height is not None:
            kept["wind_at_height"] = self.wind_at_height.where(keep)
        return replace(self, **kept)


_SCALARS = ("name", "downwind_bearing_deg", "counts", "wind_at_height", "notes", "warnings")
