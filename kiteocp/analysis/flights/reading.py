"""From a recording (CSV) to a `FlightData`: units, frames and senses of the column map, and the faults counted."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from kiteocp.analysis.flights import cleaning
from kiteocp.analysis.flights.cleaning import FloatArray, circular_median_deg, wrapped
from kiteocp.analysis.flights.columns import (
    FACTORS,
    Azimuth,
    CartesianPosition,
    ColumnMap,
    load_columns,
    shipped_columns,
)
from kiteocp.analysis.flights.data import FlightData
from kiteocp.analysis.flights.frames import model_course, spherical_velocity
from kiteocp.analysis.flights.recording import read_table
from kiteocp.errors import InputError, printable
from kiteocp.problem.files import user_path

#: A step in time longer than so many median steps is a gap.
GAP_STEPS = 3.0

#: Velocity and course column are compared where the kite moves across the tether faster than this (m/s); further apart
#: than that (deg) they disagree.
COURSE_SPEED_M_S, COURSE_DISAGREES_DEG = 5.0, 45.0


def load_flight(
    path: str | os.PathLike[str], columns: ColumnMap | str | os.PathLike[str] | None = None, *, name: str | None = None
) -> FlightData:
    """Read a recording.

    Parameters
    ----------
    path : str or path-like
        A CSV file with a header row.
    columns : ColumnMap, str or path-like, optional
        The column map, by its shipped name or its path; where left out, the shipped one whose columns are all there.
    name : str, optional
        What the flight is called; the stem of the file where left out.

    Returns
    -------
    FlightData
        In order of time. ``counts`` says what was wrong with the recording: rows dropped (``rows_...``), values set to
        missing or repaired (``values_...``), each by reason, and ``gaps``.

    Raises
    ------
    InputError
        The file is missing, unreadable or empty, lacks a column, or holds no sample of a phase.
    """
    table = read_table(user_path(path), str(path))
    layout = columns if isinstance(columns, ColumnMap) else _layout_for(table, columns, str(path))
    missing = [column for column in layout.columns() if column not in table]
    if missing:
        raise InputError(
            f"has no column {', '.join(missing)} (column map {layout.name}); give the right map with --columns",
            file=str(path),
            key=missing[0],
        )
    reader = _Reader(table, layout, str(path))
    # The name goes into comments, tables and JSON; that of a file may hold what these cannot.
    return reader.flight(printable(name or Path(path).stem))


def _layout_for(table: dict[str, Any], columns: str | os.PathLike[str] | None, label: str) -> ColumnMap:
    """Return the map asked for, or the shipped one that fits."""
    if columns is not None:
        return load_columns(columns)
    layouts = [load_columns(name) for name in shipped_columns()]
    lacking = {layout.name: [c for c in layout.columns() if c not in table] for layout in layouts}
    fitting = [layout for layout in layouts if not lacking[layout.name]]
    if fitting:
        return fitting[0]
    name, nearest = min(lacking.items(), key=lambda item: len(item[1]))
    raise InputError(
        f"fits no shipped column map ({name} lacks {', '.join(nearest[:4])}{', ...' if len(nearest) > 4 else ''}); "
        "describe its columns in a map and give it with --columns",
        file=label,
        key=nearest[0],
    )


class _Reader:
    """One table read by one map, counting what is wrong."""

    def __init__(self, table: dict[str, list[str]], layout: ColumnMap, label: str) -> None:
        self.table, self.layout, self.label = table, layout, label
        self.counts: Counter[str] = Counter()
        time = self._numbers(layout.time.column) * FACTORS[layout.time.unit]
        known = np.isfinite(time)
        self.counts["rows_without_time"] += int((~known).sum())
        rows = np.flatnonzero(known)
        if rows.size < 2:
            raise InputError(f"has no times in column {layout.time.column}; check the map", file=label)
        self.counts["rows_out_of_order"] += int((time[rows] < np.maximum.accumulate(time[rows])).sum())
        rows = rows[np.argsort(time[rows], kind="stable")]
        # Of several rows of one time the first counts.
        new = np.r_[True, np.diff(time[rows]) > 0]
        self.counts["rows_repeated_time"] += int((~new).sum())
        self.rows = rows[new]
        self.time_s: FloatArray = time[self.rows] - time[self.rows][0]
        steps = np.diff(self.time_s)
        if steps.size == 0:
            raise InputError(f"has one time only in column {layout.time.column}; check the map", file=label)
        self.counts["gaps"] += int((steps > GAP_STEPS * np.median(steps)).sum())

    def flight(self, name: str) -> FlightData:
        """Return the flight."""
        layout = self.layout
        phase = self._phases()
        length = self._cleaned(layout.tether_length, "tether_length_m")
        reeling = self._cleaned(layout.reeling_speed, "reeling_speed_m_s")
        force = self._cleaned(layout.tether_force, "tether_force_ground_N")
        distance, elevation, azimuth, bearing0 = self._position(phase)
        off = cleaning.off_tether(distance, length)
        self.counts["values_position_off_tether"] += int(off.sum())
        for values in (distance, elevation, azimuth):
            values[off] = np.nan
        radial, polar, azimuthal = self._velocity(elevation, azimuth, bearing0)
        direction, turned = cleaning.turn_directions(self._wind_direction(), bearing0)
        self.counts["values_wind_direction_turned"] += turned
        flight = FlightData(
            time_s=self.time_s,
            cycle=self._cycles(phase),
            phase=phase,
            distance_m=distance,
            tether_length_m=length,
            elevation_deg=elevation,
            azimuth_deg=azimuth,
            height_m=distance * np.sin(np.radians(elevation)),
            course_deg=self._course(polar, azimuthal),
            radial_speed_m_s=radial,
            polar_speed_m_s=polar,
            azimuthal_speed_m_s=azimuthal,
            reeling_speed_m_s=reeling,
            tether_force_ground_N=force,
            ground_wind_speed_m_s=self._cleaned(layout.ground_wind_speed, "ground_wind_speed_m_s"),
            ground_wind_direction_deg=direction,
            apparent_wind_speed_m_s=self._cleaned(layout.apparent_wind_speed, "apparent_wind_speed_m_s"),
            angle_of_attack_deg=self._cleaned(layout.angle_of_attack, "angle_of_attack_deg"),
            power_setting=self._power_setting(),
            name=name,
            downwind_bearing_deg=bearing0,
        )
        self._check(flight)
        counts = {reason: count for reason, count in sorted(self.counts.items()) if count}
        return FlightData(**flight.arrays(), name=name, downwind_bearing_deg=bearing0, counts=counts)

    def _numbers(self, column: str) -> FloatArray:
        """Return a column as numbers, missing where it holds none; what is neither number nor blank is counted."""
        values = np.full(len(self.table[column]), np.nan)
        unreadable = 0
        for index, text in enumerate(self.table[column]):
            try:
                values[index] = float(text)
            except ValueError:
                unreadable += text.lower() not in ("", "nan", "na", "null", "none", "-")
        values[np.isinf(values)] = np.nan
        self.counts["values_unreadable"] += unreadable
        return values

    def _column(self, column: str, unit: str) -> FloatArray:
        values: FloatArray = self._numbers(column)[self.rows] * FACTORS[unit]
        self.counts["values_missing"] += int(np.isnan(values).sum())
        return values

    def _clean(self, values: FloatArray, quantity: str, *, frozen: bool = True) -> FloatArray:
        self.counts["values_out_of_range"] += cleaning.clip_range(values, quantity)
        if frozen:
            self.counts["values_frozen"] += cleaning.drop_frozen(values, self.time_s)
        self.counts["values_spikes"] += cleaning.drop_spikes(values, self.time_s)
        return values

    def _cleaned(self, block: Any, quantity: str) -> FloatArray:
        """Return a single quantity in the unit of `FlightData`, its faults set to missing."""
        if block is None:
            return np.full(self.rows.size, np.nan)
        values = self._column(block.column, block.unit) * getattr(block, "sign", 1)
        # A drum at rest repeats its length, a calm its wind; forces and air speeds never stand still.
        return self._clean(values, quantity, frozen=quantity in ("tether_force_ground_N", "apparent_wind_speed_m_s"))

    def _phases(self) -> np.ndarray[Any, np.dtype[np.str_]]:
        block = self.layout.phase
        texts = [self.table[block.column][row] for row in self.rows]
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

    def _cycles(self, phase: np.ndarray[Any, np.dtype[np.str_]]) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Return the number of the cycle; where the recording has none, a new one begins with each traction."""
        if self.layout.cycle is not None:
            numbers = self._numbers(self.layout.cycle.column)[self.rows]
            return np.where(np.isfinite(numbers), numbers, -1.0).astype(np.int64)
        named = np.where(phase == "", np.roll(phase, 1), phase)
        begins = (named[1:] == "traction") & (named[:-1] != "traction")
        return np.cumsum(np.r_[False, begins]).astype(np.int64)

    def _position(self, phase: np.ndarray[Any, np.dtype[np.str_]]) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Return distance (m), elevation, azimuth (deg) and the bearing of zero azimuth (deg)."""
        position = self.layout.position
        if isinstance(position, CartesianPosition):
            parts = (position.east, position.north, position.up)
            east, north, up = (self._clean(self._column(p.column, p.unit), "cartesian_m") for p in parts)
            across = np.hypot(east, north)
            distance = np.hypot(across, up)
            elevation = np.degrees(np.arctan2(up, across))
            bearing = np.degrees(np.arctan2(east, north))
            recorded = position.azimuth
        else:
            distance = self._column(position.distance.column, position.distance.unit)
            elevation = self._column(position.elevation.column, position.elevation.unit)
            recorded = position.azimuth
            if recorded.zero_bearing_deg is None:
                raise InputError(
                    "position.azimuth.zero_bearing_deg is missing; give the bearing of zero azimuth in deg",
                    file=f"column map {self.layout.name}",
                    key="position.azimuth.zero_bearing_deg",
                )
            bearing = recorded.zero_bearing_deg + self._clockwise(recorded)
        self._clean(distance, "distance_m", frozen=False)
        self._clean(elevation, "elevation_deg", frozen=False)
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
        return sign * self._column(azimuth.column, azimuth.unit)

    def _velocity(self, elevation: FloatArray, azimuth: FloatArray, bearing0: float) -> tuple[FloatArray, ...]:
        """Return the radial, polar and azimuthal velocity of the kite (m/s)."""
        block = self.layout.velocity
        first, second, third = (self._clean(self._column(c, block.unit), "speed_m_s") for c in block.columns)
        if block.frame == "spherical":
            return first, second, third
        north, east, up = (first, second, -third) if block.frame == "NED" else (second, first, third)
        return spherical_velocity((north, east, up), elevation, azimuth, bearing0)

    def _course(self, polar: FloatArray, azimuthal: FloatArray) -> FloatArray:
        """Return the course of the velocity, and count where the recorded one disagrees.

        The velocity is taken because forces follow from it too; a course recorded on its own may lag behind.
        """
        course: FloatArray = np.degrees(np.arctan2(azimuthal, polar)) % 360.0
        block = self.layout.course
        if block is not None:
            recorded = model_course(block, self._column(block.column, block.unit))
            moving = np.hypot(polar, azimuthal) > COURSE_SPEED_M_S
            off = np.abs(wrapped(recorded - course)) > COURSE_DISAGREES_DEG
            self.counts["values_course_disagrees"] += int((off & moving).sum())
        return course

    def _wind_direction(self) -> FloatArray:
        block = self.layout.ground_wind_direction
        if block is None:
            return np.full(self.rows.size, np.nan)
        direction = self._column(block.column, block.unit)
        return (direction + (180.0 if block.of == "to" else 0.0)) % 360.0

    def _power_setting(self) -> FloatArray:
        block = self.layout.power_setting
        if block is None:
            return np.full(self.rows.size, np.nan)
        if block.powered == block.depowered:
            raise InputError(
                f"power_setting.powered and power_setting.depowered are both {block.powered:g}; give the two ends",
                file=f"column map {self.layout.name}",
                key="power_setting.powered",
            )
        values = self._numbers(block.column)[self.rows]
        self.counts["values_missing"] += int(np.isnan(values).sum())
        return np.clip((values - block.depowered) / (block.powered - block.depowered), 0.0, 1.0)

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
