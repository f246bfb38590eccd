"""Cycles with and without gravity in one picture, one column for each case: paths, and channels over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation

from kiteocp.plots.panels import draw_zero
from kiteocp.plots.side_view import path_of, segments
from kiteocp.plots.style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    PHASE_ALPHA,
    SMALL_SIZE,
    make_figure,
    phase_colour,
    style_axes,
)
from kiteocp.problem import TableWind
from kiteocp.result import Result
from kiteocp.result.channels import PHASES

#: Case to treatment of gravity to the cycle.
Cases = Mapping[str, Mapping[str, Result]]

INCLUDED, EXCLUDED = "gravity included", "gravity excluded"

# The full width of a journal page, 190 mm.
_WIDTH_IN, _HEIGHT_IN = 7.48, 2.75
_DASHES = (0, (4, 1.6))
_DOTS = (0, (1, 1.8))
_THICK, _THIN = 1.4, 0.7
_LINES: dict[str, dict[str, Any]] = {
    INCLUDED: {"color": INK, "linestyle": "-", "zorder": 3},
    EXCLUDED: {"color": BLUE, "linestyle": _DASHES, "zorder": 2.5},
}
#: Phase change of the cycle without gravity, whose phases are not shaded.
_CHANGE: dict[str, Any] = {
    "marker": "o",
    "markersize": 4.0,
    "markerfacecolor": "white",
    "markeredgecolor": BLUE,
    "markeredgewidth": 1.0,
    "linestyle": "none",
    "zorder": 4,
}
_LEVEL: dict[str, Any] = {"color": GREY, "linewidth": 0.9, "linestyle": _DOTS, "zorder": 1.8}


def draw_time_series(cases: Cases, channel: str, label: str, factor: float = 1.0) -> Figure:
    """Return one channel over time; `factor` leads from its unit to that of `label`."""
    figure, columns = _columns(cases, label)
    for axes, cycles in zip(columns, cases.values(), strict=True):
        for gravity, cycle in cycles.items():
            _draw_channel(axes, cycle, gravity, channel, factor)
        _finish_time_axes(axes, cycles)
    _write_legend(figure, _gravity_entries(change=True) + _phase_entries())
    return figure


def draw_wind_speed(cases: Cases) -> Figure:
    """Return apparent wind and wind at the kite over time, and the wind at the reference height where there is one."""
    figure, columns = _columns(cases, "wind speed (m/s)", rows=2)
    extra = [
        (Line2D([], [], color=INK, linewidth=1.8), "apparent wind"),
        (Line2D([], [], color=INK, linewidth=_THIN), "wind at the kite"),
    ]
    for axes, cycles in zip(columns, cases.values(), strict=True):
        for gravity, cycle in cycles.items():
            _draw_channel(axes, cycle, gravity, "wind_speed_m_s", width=_THIN, changes=False)
            _draw_channel(axes, cycle, gravity, "apparent_wind_speed_m_s", width=1.8)
        wind = cycles[INCLUDED].problem.environment.wind
        # A tabulated wind has no reference height.
        if not isinstance(wind, TableWind):
            axes.axhline(wind.reference_speed_m_s, **_LEVEL)
        axes.set_ylim(bottom=0.0)
        _finish_time_axes(axes, cycles)
    extra.append((Line2D([], [], **_LEVEL), "wind at the reference height"))
    _write_legend(figure, [*_gravity_entries(change=True), *extra, *_phase_entries()], rows=2)
    return figure


def draw_tether_force(cases: Cases) -> Figure:
    """Return the tether force at the ground over time, with the set values and where they hold."""
    figure, columns = _columns(cases, "ground tether force (kN)", rows=2)
    references = set()
    for axes, cycles in zip(columns, cases.values(), strict=True):
        for gravity, cycle in cycles.items():
            _draw_channel(axes, cycle, gravity, "tether_force_ground_N", 1e-3)
        operation = cycles[INCLUDED].problem.operation
        references.add(operation.force_reference)
        for force in (operation.retraction.tether_force_N, operation.traction.tether_force_N):
            if force is not None:
                axes.axhline(1e-3 * force, **_LEVEL)
        axes.set_ylim(bottom=0.0)
        _finish_time_axes(axes, cycles)
    where = f" (at the {references.pop()})" if len(references) == 1 else ""
    entries = [*_gravity_entries(change=True), (Line2D([], [], **_LEVEL), f"set value{where}"), *_phase_entries()]
    _write_legend(figure, entries, rows=2)
    return figure


def draw_side_views(cases: Cases) -> Figure:
    """Return the flight paths seen from the side, phases by colour, gravity by line style."""
    figure, columns = _columns(cases, "height (m)", height_in=3.4)
    for axes, cycles in zip(columns, cases.values(), strict=True):
        paths = {gravity: path_of(cycle) for gravity, cycle in cycles.items()}
        for gravity, cycle in cycles.items():
            x, y = paths[gravity]
            style = {**_LINES[gravity], "linewidth": _THICK}
            for phase, run in segments(cycle):
                axes.plot(x[run], y[run], **{**style, "color": phase_colour(phase)})
        left, right = _reach([x for x, _ in paths.values()])
        _, top = _reach([y for _, y in paths.values()])
        left = min(left, 0.0)
        axes.set_xlim(left - 0.04 * (right - left), right * 1.07)
        axes.set_ylim(0.0, 1.08 * top)
        operation = cycles[INCLUDED].problem.operation
        steepest = max(float(np.max(cycle["elevation_deg"])) for cycle in cycles.values())
        angle = np.deg2rad(np.linspace(0.0, max(90.0, steepest), 121))
        for length in (operation.tether_length_min_m, operation.tether_length_max_m):
            if length is not None:
                axes.plot(length * np.cos(angle), length * np.sin(angle), **_LEVEL)
        axes.plot(0.0, 0.0, "s", markersize=4.5, color=INK, clip_on=False, zorder=5)
        axes.set_aspect("equal", adjustable="box", anchor="S")
        axes.set_xlabel("ground distance (m)", fontsize=LABEL_SIZE)
    entries = [*_gravity_entries(INK), *_phase_entries(lines=True), (Line2D([], [], **_LEVEL), "tether limits")]
    _write_legend(figure, entries)
    return figure


def draw_angular_coordinates(cases: Cases) -> Figure:
    """Return azimuth against elevation, lines that would cover each other side by side."""
    figure, columns = _columns(cases, "elevation (deg)", height_in=3.2)
    for axes, cycles in zip(columns, cases.values(), strict=True):
        widest, ends = 0.0, []
        for gravity, cycle in cycles.items():
            azimuth, elevation = cycle["azimuth_deg"], cycle["elevation_deg"]
            aside = 1.4 if gravity == INCLUDED else 4.2
            for phase, run in segments(cycle):
                style = {**_LINES[gravity], "linewidth": _THICK, "color": phase_colour(phase)}
                if np.ptp(elevation[run]) < 1e-6 and np.ptp(azimuth[run]) < 1e-6:
                    # A phase at one place; without gravity it is the same place.
                    axes.plot(azimuth[run][0], elevation[run][0], "o", markersize=7, color=style["color"], zorder=3)
                else:
                    shift = -aside if phase == PHASES[0] else aside
                    offset = ScaledTranslation(shift / 72, 0.0, figure.dpi_scale_trans)
                    axes.plot(azimuth[run], elevation[run], **style, transform=axes.transData + offset)
                if phase == PHASES[0]:
                    ends.append((float(azimuth[run][-1]), float(elevation[run][-1])))
            widest = max(widest, float(np.max(np.abs(azimuth))))
        for azimuth_end, elevation_end in ends:
            axes.annotate(
                f"{elevation_end:.1f} deg",
                (azimuth_end, elevation_end),
                xytext=(8, 0),
                textcoords="offset points",
                fontsize=SMALL_SIZE,
                color=INK,
                va="center",
            )
        axes.set_xlim(-1.9 * max(widest, 5.0), 1.9 * max(widest, 5.0))
        axes.set_ylim(0.0, 1.06 * max(elevation_end for _, elevation_end in ends))
        axes.set_xlabel("azimuth (deg)", fontsize=LABEL_SIZE)
    _write_legend(figure, _gravity_entries(INK) + _phase_entries(lines=True))
    return figure


def _columns(cases: Cases, label: str, *, rows: int = 1, height_in: float = _HEIGHT_IN) -> tuple[Figure, list[Any]]:
    """Return a figure and its axes, one for each case side by side, with room for the rows of a legend on top."""
    figure = make_figure(_WIDTH_IN, height_in)
    gap, left, right = 0.085, 0.082, 0.02
    width = (1.0 - left - right - gap * (len(cases) - 1)) / len(cases)
    bottom, top = 0.43 / height_in, 1.0 - (0.29 + 0.165 * rows) / height_in
    columns = []
    for place, name in enumerate(cases):
        axes = figure.add_axes((left + place * (width + gap), bottom, width, top - bottom))
        style_axes(axes)
        axes.set_title(
            f"({'abcdefgh'[place]}) {name.replace('-', ' ')}", fontsize=LABEL_SIZE, loc="left", color=INK, pad=4.0
        )
        columns.append(axes)
    columns[0].set_ylabel(label, fontsize=LABEL_SIZE)
    return figure, columns


def _draw_channel(
    axes: Any,
    cycle: Result,
    gravity: str,
    channel: str,
    factor: float = 1.0,
    *,
    width: float = _THICK,
    changes: bool = True,
) -> None:
    """Draw a channel phase by phase: what jumps at a phase change is not joined by a slope that was never flown."""
    time, values = cycle["time_s"], factor * cycle[channel]
    runs = segments(cycle)
    for _, run in runs:
        axes.plot(time[run], values[run], **_LINES[gravity], linewidth=width)
    if gravity == EXCLUDED and changes:
        ends = [run.stop - 1 for _, run in runs[:-1]]
        axes.plot(time[ends], values[ends], **_CHANGE)


def _finish_time_axes(axes: Any, cycles: Mapping[str, Result]) -> None:
    """Shade the phases of the cycle with gravity, and name the time axis."""
    included = cycles[INCLUDED]
    time = included["time_s"]
    for phase, run in segments(included):
        axes.axvspan(time[run][0], time[run][-1], color=phase_colour(phase), alpha=PHASE_ALPHA, linewidth=0, zorder=0)
    start, end = _reach([cycle["time_s"] for cycle in cycles.values()])
    axes.set_xlim(start, end + 0.015 * (end - start))
    axes.set_xlabel("time (s)", fontsize=LABEL_SIZE)
    draw_zero(axes)


def _reach(values: Sequence[np.ndarray[Any, Any]]) -> tuple[float, float]:
    """Return the least and the largest value of several arrays."""
    return min(float(np.min(array)) for array in values), max(float(np.max(array)) for array in values)


def _gravity_entries(colour: str | None = None, *, change: bool = False) -> list[tuple[Any, str]]:
    """Return legend entries of both treatments of gravity, in one colour where the phases have theirs."""
    entries: list[tuple[Any, str]] = []
    for gravity, style in _LINES.items():
        line = Line2D([], [], linewidth=_THICK, color=colour or style["color"], linestyle=style["linestyle"])
        entries.append((line, gravity))
    return [*entries, (Line2D([], [], **_CHANGE), "its phase changes")] if change else entries


def _phase_entries(*, lines: bool = False) -> list[tuple[Any, str]]:
    """Return legend entries of the phases, as lines or as bands."""
    if lines:
        return [(Line2D([], [], color=phase_colour(phase), linewidth=2.4), phase) for phase in PHASES]
    return [(Patch(color=phase_colour(phase), alpha=2.5 * PHASE_ALPHA, linewidth=0), phase) for phase in PHASES]


def _write_legend(figure: Figure, entries: Sequence[tuple[Any, str]], *, rows: int = 1) -> None:
    """Write the legend on top, in as many rows as `_columns` left room for."""
    figure.legend(
        handles=[handle for handle, _ in entries],
        labels=[label for _, label in entries],
        loc="upper center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=-(-len(entries) // rows),
        frameon=False,
        fontsize=SMALL_SIZE,
        handlelength=1.9,
        handletextpad=0.4,
        columnspacing=1.0,
        borderaxespad=0.2,
        labelspacing=0.25,
    )
