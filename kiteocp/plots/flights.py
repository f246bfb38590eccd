"""Pictures of a flight beside the model: each cycle over time, its side view, the comparison by phase, the optimum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from kiteocp.plots.labels import stack
from kiteocp.plots.style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    LINE_WIDTH,
    PHASE_ALPHA,
    PHASE_COLOURS,
    SMALL_SIZE,
    TITLE_SIZE,
    make_figure,
    style_axes,
)
from kiteocp.recording.data import FLIGHT_PHASES
from kiteocp.studies.prediction.measured import model_lengths
from kiteocp.studies.prediction.optimum import LEFT_OUT, OptimumStudy
from kiteocp.studies.prediction.predictions import CycleComparison
from kiteocp.studies.prediction.reasons import LAW_WORDS, QUANTITY_WORDS
from kiteocp.studies.prediction.study import FlightStudy

#: The turn beside the phases of the model.
COLOURS = {**PHASE_COLOURS, "turn": "#56B4E9"}

#: How each law is drawn.
LAW_STYLES: dict[str, dict[str, Any]] = {
    "constant_force": {"color": BLUE, "linewidth": 1.4},
    "force_schedule": {"color": "#D55E00", "linewidth": 0.9},
    "speed_schedule": {"color": "#009E73", "linewidth": 0.9},
    "winch_law": {"color": "#CC79A7", "linewidth": 0.9},
}

#: Deviations beyond this are drawn at the edge, with an arrow.
LARGEST_DEVIATION = 1.0


def figures(study: FlightStudy) -> dict[str, Callable[[], Figure]]:
    """Return by file stem what draws each figure of a study."""
    drawn: dict[str, Callable[[], Figure]] = {}
    for cycle in study.cycles:
        number = cycle.measured.number
        drawn[f"cycle_{number}"] = lambda cycle=cycle: draw_cycle(study, cycle)  # type: ignore[misc]
        drawn[f"side_view_{number}"] = lambda cycle=cycle: draw_side_view(study, cycle)  # type: ignore[misc]
    drawn["comparison"] = lambda: draw_comparison(study)
    optimum = study.optimum
    if optimum is not None:
        drawn["optimum"] = lambda: draw_optimum(optimum)
    return drawn


def draw_cycle(study: FlightStudy, cycle: CycleComparison) -> Figure:
    """Return length, elevation, speed, force and power of a cycle over time."""
    figure = make_figure(8.6, 9.0)
    panels = figure.subplots(5, 1, sharex=True)
    flight = cycle.wind.estimate.turned(study.flight)
    among = flight.cycle == cycle.measured.number
    flown, start = flight.where(among), float(flight.time_s[among][0])
    time = flown.time_s - start
    force, speed = flown.tether_force_ground_N, flown.reeling_speed_m_s
    measured = (model_lengths(flight)[among], flown.elevation_deg, speed, 1e-3 * force, 1e-3 * force * speed)
    for axes, values in zip(panels, measured, strict=True):
        axes.plot(time, values, color=INK, linewidth=LINE_WIDTH, label="flown", zorder=3)
    names = []
    for name, phase in cycle.phases.items():
        begin, end = phase.replayed.path.time_s[[0, -1]] - start
        for axes in panels:
            axes.axvspan(begin, end, color=COLOURS[name], alpha=PHASE_ALPHA, linewidth=0, zorder=0)
        names.append(
            panels[0].annotate(
                name,
                (0.5 * (begin + end), 1.0),
                xycoords=panels[0].get_xaxis_transform(),
                xytext=(0, 3),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=SMALL_SIZE,
                color=COLOURS[name],
                fontweight="bold",
            )
        )
        _draw_laws(panels, phase, begin, end)
    labels = ("tether length (m)", "elevation (deg)", "reeling speed (m/s)", "tether force (kN)", "power (kW)")
    for axes, label, values in zip(panels, labels, measured, strict=True):
        style_axes(axes)
        axes.set_ylabel(label, fontsize=LABEL_SIZE)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        axes.set_ylim(low - 0.35 * (high - low), high + 0.35 * (high - low))
    panels[-1].set_xlabel("time in the cycle (s)", fontsize=LABEL_SIZE)
    panels[-1].set_xlim(0.0, float(time[-1]))
    handles = {label: line for axes in panels for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="upper center", ncols=3, fontsize=SMALL_SIZE, frameon=False)
    figure.subplots_adjust(left=0.09, right=0.98, bottom=0.06, top=0.905, hspace=0.14)
    # Where the names are on the page is known only now.
    stack(names, 13.0)
    return figure


def _draw_laws(panels: Any, phase: Any, begin: float, end: float) -> None:
    """Draw the laws over one phase: constant force from its beginning, the others along its path."""
    if phase.law is not None:
        law = phase.law
        # A phase that the model flies more slowly is cut where the flown one ends.
        time = np.linspace(0.0, min(float(law.time_s[-1]), end - begin), 60)
        force, speed = 1e-3 * law.force_N, law.reeling_speed_m_s
        for axes, values in zip(
            panels, (law.tether_length_m, law.elevation_deg, speed, force, force * speed), strict=True
        ):
            shown = np.interp(time, law.time_s, values)
            style = LAW_STYLES["constant_force"]
            axes.plot(begin + time, shown, **style, label=LAW_WORDS["constant_force"], zorder=4)
    again, path = phase.replayed, phase.replayed.path
    time = begin + path.time_s - path.time_s[0]
    series = {
        "force_schedule": (again.reeling_speed_m_s, None, path.force_N * again.reeling_speed_m_s),
        "speed_schedule": (None, again.force_N, again.force_N * path.reeling_speed_m_s),
        "winch_law": (again.winch_speed_m_s, again.winch_force_N, again.winch_force_N * again.winch_speed_m_s),
    }
    for law, (speed, force, power) in series.items():
        for axes, values in ((panels[2], speed), (panels[3], force), (panels[4], power)):
            if values is not None and np.isfinite(values).any():
                factor = 1.0 if axes is panels[2] else 1e-3
                axes.plot(time, factor * values, **LAW_STYLES[law], label=LAW_WORDS[law], zorder=2)


def draw_side_view(study: FlightStudy, cycle: CycleComparison) -> Figure:
    """Return height over downwind distance of a cycle."""
    figure = make_figure(6.4, 4.6)
    axes = figure.add_axes((0.1, 0.12, 0.87, 0.8))
    flight = cycle.wind.estimate.turned(study.flight).select([cycle.measured.number])
    downwind = flight.distance_m * np.cos(np.radians(flight.elevation_deg)) * np.cos(np.radians(flight.azimuth_deg))
    labelled: set[str] = set()
    for name in FLIGHT_PHASES:
        among = flight.phase == name
        if among.any():
            shown = (np.where(among, downwind, np.nan), np.where(among, flight.height_m, np.nan))
            axes.plot(*shown, color=COLOURS[name], linewidth=1.0, label=f"{name}, flown")
        law = cycle.phases[name].law if name in cycle.phases else None
        if law is not None:
            elevation = np.radians(law.elevation_deg)
            # The traction's mean state is off the plane of the wind.
            azimuth = np.radians(cycle.phases[name].measured.azimuth_deg if name == "traction" else 0.0)
            x, z = law.tether_length_m * np.cos(elevation) * np.cos(azimuth), law.tether_length_m * np.sin(elevation)
            label = None if labelled else f"model {LAW_WORDS['constant_force']}"
            labelled.add("model")
            axes.plot(x, z, color=INK, linewidth=2.0, label=label, zorder=3)
    style_axes(axes)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("downwind (m)", fontsize=LABEL_SIZE)
    axes.set_ylabel("height (m)", fontsize=LABEL_SIZE)
    axes.set_title(f"cycle {cycle.measured.number}", fontsize=TITLE_SIZE, loc="left")
    axes.legend(fontsize=SMALL_SIZE, frameon=False, loc="best")
    return figure


def draw_comparison(study: FlightStudy) -> Figure:
    """Return the deviations by phase, law and quantity, one mark for each cycle with its band."""
    rows = []
    for name in FLIGHT_PHASES:
        for law in LAW_STYLES:
            quantities = dict.fromkeys(
                q for c in study.cycles if name in c.phases for q in c.phases[name].predictions.get(law, {})
            )
            for quantity in quantities:
                found = [
                    c.phases[name].predictions[law][quantity]
                    for c in study.cycles
                    if name in c.phases and quantity in c.phases[name].predictions[law]
                ]
                rows.append((name, law, quantity, found))
    figure = make_figure(8.2, 1.2 + 0.23 * len(rows))
    axes = figure.add_axes((0.37, 0.6 / figure.get_figheight(), 0.6, 1.0 - 1.15 / figure.get_figheight()))
    for row, (name, law, _, found) in enumerate(rows):
        place = len(rows) - 1 - row
        axes.axhspan(place - 0.5, place + 0.5, color=COLOURS[name], alpha=PHASE_ALPHA, linewidth=0)
        for index, prediction in enumerate(found):
            y = place + 0.28 * (index - 0.5 * (len(found) - 1)) / max(len(found) - 1, 1)
            deviation = float(np.clip(prediction.deviation, -LARGEST_DEVIATION, LARGEST_DEVIATION))
            half = 1.96 * prediction.standard_error / abs(prediction.measured) if prediction.measured else np.nan
            beyond = abs(prediction.deviation) > LARGEST_DEVIATION
            marker = (">" if deviation > 0 else "<") if beyond else "o"
            if np.isfinite(half):
                axes.plot(
                    [prediction.deviation - half, prediction.deviation + half],
                    [y, y],
                    color=LAW_STYLES[law]["color"],
                    alpha=0.45,
                    linewidth=1.5,
                )
            axes.plot([deviation], [y], marker=marker, color=LAW_STYLES[law]["color"], markersize=4.5)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    for edge in (-0.1, 0.1):
        axes.axvline(edge, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    axes.set_xlim(-1.08 * LARGEST_DEVIATION, 1.08 * LARGEST_DEVIATION)
    axes.set_ylim(-0.5, len(rows) - 0.5)
    style_axes(axes)
    axes.set_xticks(np.linspace(-1.0, 1.0, 5), [f"{100 * tick:+.0f} %" for tick in np.linspace(-1.0, 1.0, 5)])
    axes.set_yticks(
        range(len(rows)),
        [f"{name}: {QUANTITY_WORDS[quantity]}" for name, _, quantity, _ in reversed(rows)],
        fontsize=SMALL_SIZE,
    )
    axes.set_xlabel("model less flight, over flight", fontsize=LABEL_SIZE)
    handles = [axes.plot([], [], marker="o", color=style["color"])[0] for style in LAW_STYLES.values()]
    words = [LAW_WORDS[law] for law in LAW_STYLES]
    figure.legend(handles, words, loc="upper center", ncols=4, fontsize=SMALL_SIZE, frameon=False)
    return figure


def draw_optimum(optimum: OptimumStudy) -> Figure:
    """Return the way from flown to optimal power as a waterfall."""
    figure = make_figure(7.4, 3.6)
    axes = figure.add_axes((0.33, 0.16, 0.64, 0.8))
    # What the model leaves out comes between the flight and the model, before what the schedule brings.
    parts = dict(sorted(optimum.contributions.items(), key=lambda item: item[0] != LEFT_OUT))
    names = ["flown", *parts, "optimal"]
    level = 1e-3 * optimum.flown_power_W
    axes.barh(0, level, color=GREY)
    axes.annotate(
        f"{level:.1f} kW", (level, 0), xytext=(4, 0), textcoords="offset points", va="center", fontsize=LABEL_SIZE
    )
    for place, part in enumerate(parts.values(), start=1):
        change = 1e-3 * part
        axes.barh(
            place, change, left=level, color=PHASE_COLOURS["traction"] if change > 0 else PHASE_COLOURS["retraction"]
        )
        axes.annotate(
            f"{change:+.2f}",
            (max(level, level + change), place),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=LABEL_SIZE,
        )
        level += change
    axes.barh(len(names) - 1, level, color=BLUE)
    axes.annotate(
        f"{level:.1f} kW",
        (level, len(names) - 1),
        xytext=(4, 0),
        textcoords="offset points",
        va="center",
        fontsize=LABEL_SIZE,
    )
    style_axes(axes)
    axes.set_yticks(range(len(names)), names, fontsize=LABEL_SIZE)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.18 * 1e-3 * max(optimum.flown_power_W, 1e3 * level, optimum.prescribed_power_W or 0.0))
    axes.set_xlabel("mean cycle power (kW)", fontsize=LABEL_SIZE)
    return figure
