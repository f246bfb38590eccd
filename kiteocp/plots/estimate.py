"""Estimates over time: resultant coefficient, the stages of the lift-to-drag ratio, lift and drag by both ways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kiteocp.plots.style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    PHASE_ALPHA,
    PHASE_COLOURS,
    SMALL_SIZE,
    TITLE_STYLE,
    make_figure,
    phase_colour,
    style_axes,
    write_line,
)
from kiteocp.result import Result

#: Colours of the ways, and of the stages of the lift-to-drag ratio.
_PAPER, _EXACT, _KAPPA = "#E69F00", BLUE, GREY

#: The view of a panel ends where this share of its samples lies within; the rest is in the table.
_VIEW = (0.005, 0.985)

#: Height of a label in the margin, in parts of the height of a panel.
_LABEL_GAP = 0.09

#: Label of a panel, the coefficient whose averages it shows, and its lines: channel, colour, label.
_PANELS: tuple[tuple[str, str | None, tuple[tuple[str, str, str], ...]], ...] = (
    ("$C_R$", "resultant_coefficient", (("exact_resultant_coefficient", INK, "each sample"),)),
    (
        "$L/D$ with tether",
        "lift_to_drag",
        (
            ("kinematic_ratio", _KAPPA, r"kinematic ratio $\kappa$ ($G_1$)"),
            ("paper_lift_to_drag", _PAPER, "paper ($G_3$)"),
            ("exact_lift_to_drag", _EXACT, "exact"),
        ),
    ),
    (
        "$L/D_k$ of the kite",
        "kite_lift_to_drag",
        (("paper_kite_lift_to_drag", _PAPER, "paper"), ("exact_kite_lift_to_drag", _EXACT, "exact")),
    ),
    ("$C_L$", "lift_coefficient", (("exact_lift_coefficient", _EXACT, "exact"),)),
    ("$C_{D,k}$ of the kite", "kite_drag_coefficient", (("exact_kite_drag_coefficient", _EXACT, "exact"),)),
)


def compose_estimate(result: Result) -> Figure:
    """Return a result of verb ``estimate`` over time, with the mean of each phase and its interval."""
    found = result.details["estimates"]
    figure = make_figure(12.5, 11.0)
    title = f"{found['flight']}: aerodynamics of {result.problem.name}"
    write_line(figure, 0.987, title, **TITLE_STYLE)
    wind = found["wind"]
    subtitle = (
        f"wind by {wind['source']}: {wind['reference_speed_m_s']:.2f} m/s at {wind['reference_height_m']:g} m; bars: "
        "mean of each phase (exact) and its 95 % interval; dotted: coefficients of the fit"
    )
    write_line(figure, 0.964, subtitle, fontsize=SMALL_SIZE, color=GREY)
    bottom, height, gap = 0.045, 0.9, 0.015
    each = (height - gap * (len(_PANELS) - 1)) / len(_PANELS)
    first: Any = None
    for place, (label, coefficient, lines) in enumerate(_PANELS):
        rectangle = (0.06, bottom + (each + gap) * (len(_PANELS) - 1 - place), 0.80, each)
        axes = figure.add_axes(rectangle, sharex=first) if first is not None else figure.add_axes(rectangle)
        first = first or axes
        style_axes(axes)
        _draw_lines(axes, result, lines)
        _shade(axes, result, named=place == 0)
        if coefficient is not None:
            _draw_averages(axes, result, coefficient)
        _draw_fit(axes, result, coefficient)
        axes.set_ylabel(label, fontsize=LABEL_SIZE)
        axes.tick_params(labelbottom=place == len(_PANELS) - 1)
    axes.set_xlabel("time (s)", fontsize=LABEL_SIZE)
    return figure


def _draw_lines(axes: Any, result: Result, lines: Sequence[tuple[str, str, str]]) -> None:
    """Draw the samples, broken where none are, and see that the bulk of them fills the panel."""
    time = result["time_s"]
    step = float(np.median(np.diff(time)))
    shown = []
    for channel, colour, label in lines:
        values = np.where(np.isfinite(result[channel]), result[channel], np.nan)
        gaps = np.flatnonzero(np.diff(time) > 3.0 * step) + 1
        axes.plot(np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan), color=colour, linewidth=0.7)
        shown.append(values[np.isfinite(values)])
        axes.plot([], [], color=colour, linewidth=1.6, label=label)
    values = np.concatenate(shown)
    if values.size:
        low, high = np.quantile(values, _VIEW)
        margin = 0.08 * max(high - low, 0.1 * abs(high), 1e-6)
        axes.set_ylim(min(low - margin, 0.0) if low >= 0 else low - margin, high + margin)
    axes.set_xlim(float(time[0]), float(time[-1]))
    # The next panel has the same colours.
    if len(lines) > 2:
        axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), frameon=False, fontsize=SMALL_SIZE)


def _shade(axes: Any, result: Result, *, named: bool) -> None:
    """Shade the phases of every cycle; the colours are named once."""
    for phase, start, end in _stretches(result):
        axes.axvspan(start, end, color=phase_colour(phase), alpha=PHASE_ALPHA, linewidth=0, zorder=0)
    if named:
        present = [phase for phase in (*PHASE_COLOURS, "turn") if phase in set(result["phase"].tolist())]
        handles = [Line2D([], [], color=phase_colour(phase), linewidth=7, alpha=0.35) for phase in present]
        axes.figure.legend(
            handles,
            present,
            loc="upper right",
            bbox_to_anchor=(0.99, 0.995),
            ncol=len(present),
            frameon=False,
            fontsize=SMALL_SIZE,
        )


def _stretches(result: Result) -> list[tuple[str, float, float]]:
    """Return phase, start and end of every stretch of one phase."""
    phase, time = result["phase"], result["time_s"]
    if not time.size:
        return []
    ends = np.flatnonzero(phase[1:] != phase[:-1])
    starts = np.concatenate([[0], ends + 1])
    stops = np.concatenate([ends + 1, [time.size - 1]])
    return [
        (str(phase[first]), float(time[first]), float(time[last]))
        for first, last in zip(starts, stops, strict=True)
        if phase[first]
    ]


def _draw_averages(axes: Any, result: Result, coefficient: str) -> None:
    """Draw the mean of each phase over every stretch of it, with its interval as a band."""
    phases: Mapping[str, Any] = result.details["estimates"]["phases"]
    for phase, start, end in _stretches(result):
        found = phases.get(phase, {}).get("exact", {}).get(coefficient)
        if found is None or found["mean"] is None or not np.isfinite(found["mean"]):
            continue
        colour = phase_colour(phase) if phase in PHASE_COLOURS else BLUE
        axes.plot([start, end], [found["mean"]] * 2, color=colour, linewidth=2.2, zorder=4)
        low, high = found["interval"]
        if low is not None and np.isfinite(low):
            axes.fill_between([start, end], low, high, color=colour, alpha=0.3, linewidth=0, zorder=3)


def _draw_fit(axes: Any, result: Result, coefficient: str | None) -> None:
    """Draw the coefficients of the fit, powered and depowered, as dotted levels."""
    name = {"lift_coefficient": "lift_coefficient", "kite_drag_coefficient": "drag_coefficient"}.get(coefficient or "")
    name = "lift_to_drag" if coefficient == "kite_lift_to_drag" else name
    if name is None:
        return
    low, high = axes.get_ylim()
    below = -np.inf
    settings: Mapping[str, Any] = result.details["estimates"]["fit"]["settings"]
    levels = [(found[name]["value"], setting) for setting, found in settings.items()]
    for value, setting in sorted(levels):
        # A label too near to the one below moves up.
        height = max((value - low) / (high - low), below + _LABEL_GAP)
        below = height
        axes.axhline(value, color=INK, linewidth=1.0, linestyle=(0, (1, 2)), zorder=5)
        axes.annotate(
            f"fit {setting} {value:.3g}",
            (1.0, height),
            xycoords="axes fraction",
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=SMALL_SIZE,
            va="center",
            annotation_clip=False,
        )
