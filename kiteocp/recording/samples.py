"""The samples of a recording: its rows in order of time, columns as numbers, and what is wrong with them counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiteocp.errors import InputError
from kiteocp.recording import cleaning
from kiteocp.recording.blocks import FACTORS
from kiteocp.recording.cleaning import FloatArray
from kiteocp.recording.clock import GAP_STEPS, is_coarse, rebuilt
from kiteocp.recording.columns import ColumnMap
from kiteocp.recording.data import GROUND_HEIGHT_M


class Samples:
    """One table read by one map.

    Attributes
    ----------
    rows : int array
        The rows of the table that are samples, in order of time.
    time_s : float array
        Of each sample, from the start of the recording.
    counts : Counter
        What was wrong, by reason.
    notes, warnings : list of str
        One sentence each.
    """

    def __init__(self, table: dict[str, list[str]], layout: ColumnMap, label: str) -> None:
        self.table, self.layout, self.label = table, layout, label
        self.counts: Counter[str] = Counter()
        self.notes: list[str] = []
        self.warnings: list[str] = []
        column = layout.time.column
        time = self.numbers(column) * FACTORS[layout.time.unit]
        known = np.isfinite(time)
        self.counts["rows_without_time"] += int((~known).sum())
        rows = np.flatnonzero(known)
        if rows.size < 2:
            raise InputError(f"has no times in column {column}; check the map", file=label)
        copies = self._copies(rows)
        if is_coarse(time[rows], copies):
            time = self._rebuilt(time, rows)
        self.counts["rows_out_of_order"] += int((time[rows] < np.maximum.accumulate(time[rows])).sum())
        rows = rows[np.argsort(time[rows], kind="stable")]
        # Of several rows of one time the first counts.
        new = np.r_[True, np.diff(time[rows]) > 0]
        self.counts["rows_repeated_time"] += int((~new).sum())
        self.rows: NDArray[np.int64] = rows[new]
        self.time_s: FloatArray = time[self.rows] - time[self.rows][0]
        steps = np.diff(self.time_s)
        if steps.size == 0:
            raise InputError(f"has one time only in column {column}; check the map", file=label)
        self.counts["gaps"] += int((steps > GAP_STEPS * np.median(steps)).sum())

    def _copies(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return where a row says in every column of the map what the row before it says."""
        same = np.ones(rows.size, dtype=bool)
        same[0] = False
        for column in self.layout.columns():
            texts = np.array(self.table[column])[rows]
            same[1:] &= texts[1:] == texts[:-1]
        return same

    def _rebuilt(self, time: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
        """Return the times of the table with those of the rows spread between the ticks of the clock."""
        spread, step = rebuilt(time[rows])
        tick = float(np.median(np.diff(np.unique(time[rows]))))
        self.counts["rows_time_rebuilt"] += rows.size
        self.warnings.append(
            f"the times in column {self.layout.time.column} count in steps of {tick:g} s, but there are "
            f"{tick / step:.3g} samples in each: the time was rebuilt from the order of the rows, {step:.3g} s apart"
        )
        found = time.copy()
        found[rows] = spread
        return found

    def numbers(self, column: str) -> FloatArray:
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

    def texts(self, column: str) -> list[str]:
        """Return a column as texts."""
        return [self.table[column][row] for row in self.rows]

    def drop_ground(self, height_m: FloatArray) -> None:
        """Leave out, and count, the samples with the kite on the ground by its height; ``(n,)``.

        Raises
        ------
        InputError
            It is there throughout.
        """
        with np.errstate(invalid="ignore"):
            ground = np.abs(height_m) < GROUND_HEIGHT_M
        if ground.all():
            raise InputError(
                f"has the kite on the ground throughout (height below {GROUND_HEIGHT_M:g} m); check column and unit of "
                "the position in the column map, or give a recording with a flight",
                file=self.label,
                key="position",
            )
        self.counts["rows_on_ground"] += int(ground.sum())
        self.rows, self.time_s = self.rows[~ground], self.time_s[~ground]

    def column(self, column: str, unit: str, *, count_missing: bool = True) -> FloatArray:
        """Return the samples of a column in the unit of `FlightData`."""
        values: FloatArray = self.numbers(column)[self.rows] * FACTORS[unit]
        if count_missing:
            self.counts["values_missing"] += int(np.isnan(values).sum())
        return values

    def clean(self, values: FloatArray, quantity: str, *, frozen: bool = True) -> FloatArray:
        """Set what is wrong with values to missing, in place, and count it."""
        self.counts["values_out_of_range"] += cleaning.clip_range(values, quantity)
        if frozen:
            self.counts["values_frozen"] += cleaning.drop_frozen(values, self.time_s)
        self.counts["values_spikes"] += cleaning.drop_spikes(values, self.time_s)
        return values

    def cleaned(self, block: Any, quantity: str) -> FloatArray:
        """Return a single quantity in the unit of `FlightData`, its faults set to missing."""
        if block is None:
            return np.full(self.rows.size, np.nan)
        values = self.column(block.column, block.unit) * getattr(block, "sign", 1)
        # A drum at rest repeats its length, a calm its wind; forces and air speeds never stand still.
        return self.clean(values, quantity, frozen=quantity in ("tether_force_ground_N", "apparent_wind_speed_m_s"))

    def stacked(self, columns: Iterable[str], unit: str, quantity: str | None = None) -> FloatArray:
        """Return several columns side by side, shape (n, m), values outside the range of a quantity missing."""
        values = [self.column(column, unit, count_missing=False) for column in columns]
        if quantity is not None:
            for each in values:
                self.counts["values_out_of_range"] += cleaning.clip_range(each, quantity)
        return np.column_stack(values)
