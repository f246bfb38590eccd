"""From a recording (CSV) to a `FlightData`: units, frames and senses of the column map, and the faults counted."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from kiteocp.errors import InputError, printable
from kiteocp.problem.files import user_path
from kiteocp.recording import cleaning
from kiteocp.recording.blocks import FACTORS, Azimuth, CartesianPosition
from kiteocp.recording.cleaning import FloatArray, circular_median_deg, wrapped
from kiteocp.recording.columns import ColumnMap
from kiteocp.recording.contradictions import contradictions, recorded_course_disagrees
from kiteocp.recording.csv_table import read_table
from kiteocp.recording.data import FlightData, MeasuredWind
from kiteocp.recording.frames import cartesian, model_course, spherical_velocity
from kiteocp.recording.map_choice import map_for
from kiteocp.recording.motion import derivative
from kiteocp.recording.power_setting import check_levels, levels, setting_of
from kiteocp.recording.samples import Samples

Texts = np.ndarray[Any, np.dtype[np.str_]]


def load_flight(
    path: str | os.PathLike[str], columns: ColumnMap | str | os.PathLike[str] | None = None, *, name: str | None = None
) -> FlightData:
    """Read a recording.

    Parameters
    ----------
    path : str or path-like
        A CSV file with a header row.
    columns : ColumnMap, str or path-like, optional
        The column map, by its shipped name or its path; where left out, the shipped one whose necessary columns are all
        there. An optional quantity of a map that is not in the recording is left out; ``warnings`` says so, except of a
        shipped map.
    name : str, optional
        What the flight is called; the stem of the file where left out.

    Returns
    -------
    FlightData
        In order of time. ``counts`` says what was wrong with the recording: rows dropped (``rows_...``), values set to
        missing or repaired (``values_...``), each by reason, and ``gaps``. ``warnings`` says which columns contradict
        each other under the map.

    Raises
    ------
    InputError
        The file is missing, unreadable or empty, lacks a column, or holds no sample of a phase.
    """
    table = read_table(user_path(path), str(path))
    layout, warnings = map_for(table, columns, str(path))
    samples = Samples(table, layout, str(path))
    samples.warnings += warnings
    # The name goes into comments, tables and JSON; that of a file may hold what these cannot.
    return _Reader(samples).flight(printable(name or Path(path).stem))


class _Reader:
    """One recording on its way into the conventions of the model."""

    def __init__(self, samples: Samples) -> None:
        self.samples, self.layout, self.label = samples, samples.layout, samples.label
        self.counts = samples.counts

    def flight(self, name: str) -> FlightData:
        """Return the flight."""
        layout, samples = self.layout, self.samples
        samples.drop_ground(self._height())
        phase = self._phases()
        length = samples.cleaned(layout.tether_length, "tether_length_m")
        reeling = samples.cleaned(layout.reeling_speed, "reeling_speed_m_s")
        force = samples.cleaned(layout.tether_force, "tether_force_ground_N")
        distance, elevation, azimuth, bearing0 = self._position(phase)
        off = cleaning.off_tether(distance, length)
        self.counts["values_position_off_tether"] += int(off.sum())
        for values in (distance, elevation, azimuth):
            values[off] = np.nan
        radial, polar, azimuthal = self._velocity(distance, elevation, azimuth, bearing0)
        direction, turned = cleaning.turn_directions(self._wind_direction(), bearing0)
        self.counts["values_wind_direction_turned"] += turned
        flight = FlightData(
            time_s=samples.time_s,
            cycle=self._cycles(phase),
            phase=phase,
            distance_m=distance,
            tether_length_m=length,
            elevation_deg=elevation,
            azimuth_deg=azimuth,
            height_m=distance * np.sin(np.radians(elevation)),
            course_deg=np.degrees(np.arctan2(azimuthal, polar)) % 360.0,
            radial_speed_m_s=radial,
            polar_speed_m_s=polar,
            azimuthal_speed_m_s=azimuthal,
            reeling_speed_m_s=reeling,
            tether_force_ground_N=force,
            ground_wind_speed_m_s=samples.cleaned(layout.ground_wind_speed, "ground_wind_speed_m_s"),
            ground_wind_direction_deg=direction,
            apparent_wind_speed_m_s=samples.cleaned(layout.apparent_wind_speed, "apparent_wind_speed_m_s"),
            angle_of_attack_deg=samples.cleaned(layout.angle_of_attack, "angle_of_attack_deg"),
            power_setting=self._power_setting(phase),
            name=name,
            downwind_bearing_deg=bearing0,
            wind_at_height=self._wind_at_height(),
        )
        self._check(flight)
        course, power = self._recorded_course(), self._recorded_power()
        self.counts["values_course_disagrees"] += recorded_course_disagrees(flight, course)
        flight = replace(flight, counts=dict(self.counts))
        warnings, notes = contradictions(flight, layout, self._recorded_bearing(), course, power)
        samples.warnings += warnings
        samples.notes += notes
        counts = {reason: count for reason, count in sorted(self.counts.items()) if count}
        return replace(flight, counts=counts, notes=tuple(samples.notes), warnings=tuple(samples.warnings))

    def _height(self) -> FloatArray:
        """Return the height as recorded, m."""
        position, samples = self.layout.position, self.samples
        if isinstance(position, CartesianPosition):
            return samples.column(position.up.column, position.up.unit, count_missing=False)
        distance = samples.column(position.distance.column, position.distance.unit, count_missing=False)
        elevation = samples.column(position.elevation.column, position.elevation.unit, count_missing=False)
        return distance * np.sin(np.radians(elevation))

    def _phases(self) -> Texts:
        block = self.layout.phase
        texts = self.samples.texts(block.column)
        phase = np.array([block.labels.get(text, "") for text in texts], dtype="U10")
        self.counts["rows_without_phase"] += int((phase == "").sum())
        if not np.any(phase != ""):
            found = ", ".join(sorted(set(texts))[:5])
            raise InputError(
                f"column {block.column} holds none of the labels {', '.join(block.labels)} of the map "
                f"{self.layout.name}, but {found}; correct phase.labels",
                file=self.label,
                key="phase.labels",
            )
        return phase

    def _cycles(self, phase: Texts) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Return the number of the cycle; where the recording has none, a new one begins with each traction."""
        if self.layout.cycle is not None:
            numbers = self.samples.numbers(self.layout.cycle.column)[self.samples.rows]
            return np.where(np.isfinite(numbers), numbers, -1.0).astype(np.int64)
        named = np.where(phase == "", np.roll(phase, 1), phase)
        begins = (named[1:] == "traction") & (named[:-1] != "traction")
        return np.cumsum(np.r_[False, begins]).astype(np.int64)

    def _position(self, phase: Texts) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Return distance (m), elevation, azimuth (deg) and the bearing of zero azimuth (deg)."""
        position, samples = self.layout.position, self.samples
        recorded = position.azimuth
        if isinstance(position, CartesianPosition):
            parts = (position.east, position.north, position.up)
            east, north, up = (samples.clean(samples.column(p.column, p.unit), "cartesian_m") for p in parts)
            across = np.hypot(east, north)
            distance = np.hypot(across, up)
            elevation = np.degrees(np.arctan2(up, across))
            bearing = np.degrees(np.arctan2(east, north))
        else:
            distance = samples.column(position.distance.column, position.distance.unit)
            elevation = samples.column(position.elevation.column, position.elevation.unit)
            if position.azimuth.zero_bearing_deg is None:
                raise InputError(
                    "position.azimuth.zero_bearing_deg is missing; give the bearing of zero azimuth in deg",
                    file=f"column map {self.layout.name}",
                    key="position.azimuth.zero_bearing_deg",
                )
            bearing = position.azimuth.zero_bearing_deg + self._clockwise(position.azimuth)
        samples.clean(distance, "distance_m", frozen=False)
        samples.clean(elevation, "elevation_deg", frozen=False)
        bearing0 = self.layout.downwind_bearing_deg
        if bearing0 is None and recorded is not None:
            zero = recorded.zero_bearing_deg
            bearing0 = circular_median_deg(bearing - self._clockwise(recorded)) if zero is None else zero
        elif bearing0 is None:
            bearing0 = circular_median_deg(bearing[phase == "traction"])
        # The model's azimuth is counter-clockwise as seen from above.
        return distance, elevation, wrapped(bearing0 - bearing), bearing0 % 360.0

    def _clockwise(self, azimuth: Azimuth) -> FloatArray:
        sign = 1.0 if azimuth.sense == "clockwise" else -1.0
        return sign * self.samples.column(azimuth.column, azimuth.unit)

    def _recorded_bearing(self) -> FloatArray | None:
        """Return the recorded azimuth as a bearing from its own zero (deg); None where it is not recorded."""
        azimuth = self.layout.position.azimuth
        return None if azimuth is None else self._clockwise(azimuth)

    def _velocity(
        self, distance: FloatArray, elevation: FloatArray, azimuth: FloatArray, bearing0: float
    ) -> tuple[FloatArray, ...]:
        """Return the radial, polar and azimuthal velocity of the kite (m/s)."""
        block, samples = self.layout.velocity, self.samples
        if block is None:
            east, north, up = cartesian(distance, elevation, bearing0 - azimuth)
            moved = [samples.clean(derivative(samples.time_s, part), "speed_m_s") for part in (north, east, up)]
            samples.notes.append("the velocity of the kite is the derivative of its position")
            return spherical_velocity((moved[0], moved[1], moved[2]), elevation, azimuth, bearing0)
        first, second, third = (samples.clean(samples.column(c, block.unit), "speed_m_s") for c in block.columns)
        if block.frame == "spherical":
            return first, second, third
        north, east, up = (first, second, -third) if block.frame == "NED" else (second, first, third)
        return spherical_velocity((north, east, up), elevation, azimuth, bearing0)

    def _recorded_course(self) -> FloatArray | None:
        """Return the course of its own column in the model's sense (deg).

        That of the velocity is used, because forces follow from it too; a course recorded on its own may lag behind.
        """
        block = self.layout.course
        return None if block is None else model_course(block, self.samples.column(block.column, block.unit))

    def _recorded_power(self) -> FloatArray | None:
        """Return the recorded mechanical power, W; what is used is force times reeling speed."""
        block = self.layout.mechanical_power
        if block is None:
            return None
        return block.sign * self.samples.column(block.column, block.unit, count_missing=False)

    def _wind_direction(self) -> FloatArray:
        block = self.layout.ground_wind_direction
        if block is None:
            return np.full(self.samples.rows.size, np.nan)
        direction = self.samples.column(block.column, block.unit)
        return (direction + (180.0 if block.of == "to" else 0.0)) % 360.0

    def _wind_at_height(self) -> MeasuredWind | None:
        block, samples = self.layout.wind_at_height, self.samples
        if block is None:
            return None
        heights = np.array(block.heights) * FACTORS[block.unit]
        lists = [block.speed.columns] + ([] if block.direction is None else [block.direction.columns])
        if any(len(columns) != heights.size for columns in lists) or heights.size < 2 or np.any(np.diff(heights) <= 0):
            raise InputError(
                f"wind_at_height.heights has {heights.size} heights for {' and '.join(str(len(c)) for c in lists)} "
                "columns; give two or more ascending heights and one column for each",
                file=f"column map {self.layout.name}",
                key="wind_at_height.heights",
            )
        speed = samples.stacked(block.speed.columns, block.speed.unit, "ground_wind_speed_m_s")
        if block.direction is None:
            return MeasuredWind(heights, speed, np.full(speed.shape, np.nan))
        direction = samples.stacked(block.direction.columns, block.direction.unit)
        return MeasuredWind(heights, speed, (direction + (180.0 if block.direction.of == "to" else 0.0)) % 360.0)

    def _power_setting(self, phase: Texts) -> FloatArray:
        block, samples = self.layout.power_setting, self.samples
        unknown = np.full(samples.rows.size, np.nan)
        if block is None:
            return unknown
        if block.powered is not None and block.powered == block.depowered:
            raise InputError(
                f"power_setting.powered and power_setting.depowered are both {block.powered:g}; give the two ends",
                file=f"column map {self.layout.name}",
                key="power_setting.powered",
            )
        values = samples.numbers(block.column)[samples.rows]
        self.counts["values_missing"] += int(np.isnan(values).sum())
        found = levels(block, values, phase)
        if found is None:
            samples.notes.append(
                f"column {block.column} does not tell the powered from the depowered kite; it was not used"
            )
            return unknown
        if block.powered is None or block.depowered is None:
            samples.notes.append(
                f"by column {block.column} the kite is powered at {found[0]:.4g} and depowered at {found[1]:.4g}, as "
                "found from the flight"
            )
        setting = setting_of(values, found)
        check_levels(block, setting, values, phase, self.layout.name)
        return setting

    def _check(self, flight: FlightData) -> None:
        """Refuse a flight of which a necessary quantity is missing throughout."""
        needed = ("distance_m", "elevation_deg", "azimuth_deg", "polar_speed_m_s", "tether_force_ground_N")
        for quantity in (*needed, "reeling_speed_m_s"):
            if not np.isfinite(getattr(flight, quantity)).any():
                raise InputError(
                    f"holds no usable value of {quantity}; check its column and unit in the column map "
                    f"{self.layout.name}",
                    file=self.label,
                    key=quantity,
                )
