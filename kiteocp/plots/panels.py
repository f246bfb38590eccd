"""Stacked panels over time: tether length, reeling speed, force, power and elevation, phases shaded."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.markers import TICKDOWN
from matplotlib.ticker import NullLocator

from kiteocp.plots.labels import stack
from kiteocp.plots.side_view import segments
from kiteocp.plots.style import (
    BLUE,
    GREY,
    GRID,
    GRID_WIDTH,
    INK,
    LABEL_SIZE,
    LIMIT_STYLE,
    LINE_WIDTH,
    PHASE_ALPHA,
    PRESCRIBED_STYLE,
    SMALL_SIZE,
    TICK_LENGTH,
    phase_colour,
)
from kiteocp.result import Result

#: A limit further from the data than this share of the data's range is left out of the view.
_LIMIT_REACH = 0.35
#: Height of a label in the margin, in parts of the height of a panel.
_LABEL_GAP = 0.14


def draw_panel(
    axes: Any,
    result: Result,
    prescribed: Result | None,
    channel: str,
    label: str,
    limits: Sequence[tuple[float | None, str]] = (),
    factor: float = 1.0,
    mean: tuple[float | None, str] = (None, ""),
) -> None:
    """Draw one channel over time with its limits.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    result, prescribed : Result
        Drawn as a solid line; the second, where there is one, thin and dashed.
    channel, label : str
        Name of the channel, and of the axis with its unit.
    limits : sequence of (float or None, str)
        Values in the unit of the channel, drawn dashed, and what to call each; None is no limit.
    factor : float
        From the unit of the channel to that of the label.
    mean : tuple of float or None, and str
        Mean over the cycle in the unit of the channel, drawn as a level of its own, and what to call it.
    """
    if prescribed is not None:
        _draw_line(axes, prescribed, channel, factor, **PRESCRIBED_STYLE)
    _draw_line(axes, result, channel, factor, color=INK, linewidth=LINE_WIDTH, zorder=3)
    shown = [cycle[channel] for cycle in (result, prescribed) if cycle is not None]
    values = np.concatenate([part[np.isfinite(part)] for part in shown]) * factor
    low, high = (float(np.min(values)), float(np.max(values))) if values.size else (0.0, 1.0)
    span = max(high - low, 0.05 * max(abs(low), abs(high)), 1e-9)
    reach = _LIMIT_REACH * span
    labels: list[tuple[float, str, str]] = []
    for value, name in limits:
        if value is None or not low - reach <= value * factor <= high + reach:
            continue
        axes.axhline(value * factor, **LIMIT_STYLE)
        labels.append((value * factor, name, INK))
    level, called = mean
    if level is not None:
        axes.axhline(level * factor, color=BLUE, linewidth=1.1, zorder=2.5)
        # The label of the axis ends with the unit in brackets.
        unit = label.rpartition("(")[2].rstrip(")")
        labels.append((level * factor, f"{called} {level * factor:.2f} {unit}", BLUE))
    low, high = min([low, *(level for level, *_ in labels)]), max([high, *(level for level, *_ in labels)])
    margin = 0.08 * max(high - low, span)
    axes.set_ylim(low - margin, high + margin)
    axes.set_ylabel(label, fontsize=LABEL_SIZE)
    _label_levels(axes, labels)


def _label_levels(axes: Any, labels: Sequence[tuple[float, str, str]]) -> None:
    """Name levels in the right margin of a panel, moved up where two would overlap."""
    low, high = axes.get_ylim()
    previous = -math.inf
    for value, text, colour in sorted(labels):
        height = max((value - low) / (high - low), previous + _LABEL_GAP)
        previous = height
        axes.annotate(
            text,
            (1.0, height),
            xycoords="axes fraction",
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=SMALL_SIZE,
            color=colour,
            va="center",
            annotation_clip=False,
        )


def draw_ground_force(axes: Any, result: Result) -> None:
    """Add the force at the ground, which differs from that at the kite by the weight of tether and kite."""
    _draw_line(axes, result, "tether_force_ground_N", 1e-3, color=BLUE, linewidth=1.1, zorder=3.5)


def draw_zero(axes: Any) -> None:
    """Mark zero where the panel shows both signs."""
    low, high = axes.get_ylim()
    if low < 0.0 < high:
        axes.axhline(0.0, color=INK, linewidth=0.7, zorder=1.4)


def mark_times(all_axes: Sequence[Any], below: Any) -> None:
    """Mark the times of the panel below in those above it, which have no words for them.

    Ticks of matplotlib are five artists each, words included, and a tenth of the time of the picture.
    """
    start, end = below.get_xlim()
    times = [time for time in below.get_xticks() if start <= time <= end]
    for axes in all_axes:
        axes.xaxis.set_major_locator(NullLocator())
        along = axes.get_xaxis_transform()
        axes.vlines(times, 0.0, 1.0, transform=along, color=GRID, linewidth=GRID_WIDTH, zorder=0.5)
        axes.plot(
            times,
            [0.0] * len(times),
            linestyle="",
            marker=TICKDOWN,
            markersize=TICK_LENGTH,
            markeredgewidth=0.8,
            color=GREY,
            transform=along,
            clip_on=False,
        )


def shade_phases(all_axes: Sequence[Any], result: Result) -> None:
    """Shade the phases in every panel and name them above the first, those without room beside others higher."""
    time = result["time_s"]
    names = []
    for phase, run in segments(result):
        start, end = float(time[run][0]), float(time[run][-1])
        for axes in all_axes:
            axes.axvspan(start, end, color=phase_colour(phase), alpha=PHASE_ALPHA, linewidth=0, zorder=0)
        name = all_axes[0].annotate(
            phase,
            (0.5 * (start + end), 1.0),
            xycoords=all_axes[0].get_xaxis_transform(),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=LABEL_SIZE,
            fontweight="bold",
            color=phase_colour(phase),
            annotation_clip=False,
        )
        names.append((end - start, name))
    # The longest phase keeps the place beside the panel.
    stack([name for _, name in sorted(names, key=lambda item: -item[0])], 15.0)


def _draw_line(axes: Any, result: Result, channel: str, factor: float, **style: Any) -> None:
    """Draw a channel phase by phase: what jumps at a phase change is not joined by a slope that was never flown."""
    time, values = result["time_s"], result[channel] * factor
    plot: Callable[..., Any] = axes.plot
    for _, run in segments(result):
        plot(time[run], values[run], **style)
