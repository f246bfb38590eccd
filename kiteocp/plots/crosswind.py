"""Picture of a crosswind-resolved traction: the figure in the sky, and the representative course over kite mass."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kiteocp.plots.style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    LEGEND_STYLE,
    SMALL_SIZE,
    TITLE_STYLE,
    make_figure,
    style_axes,
    write_line,
)
from kiteocp.result import Result

_PATH_COLOURS = {"eight-up": BLUE, "eight-down": "#D55E00", "circle": "#009E73"}
_DASHES = (0, (4, 1.6))
_ARROWS = 6
#: Courses further than this from the middle of the picture are left out of its view (deg).
_MOST_SHOWN_DEG = 25.0


def compose_crosswind(result: Result) -> Figure:
    """Draw a result of verb ``crosswind``, of its time series and ``details["crosswind"]``."""
    study = result.details["crosswind"]
    figure = make_figure(12.5, 4.6)
    title = f"{result.problem.name}: crosswind-resolved traction"
    write_line(figure, 0.965, title, **TITLE_STYLE)
    _draw_path(figure, result, study)
    axes = figure.add_axes((0.605, 0.13, 0.38, 0.56))
    style_axes(axes)
    _draw_courses(axes, study)
    return figure


def _draw_path(figure: Figure, result: Result, study: dict[str, Any]) -> None:
    """Draw the figure by path speed, and the representative state with both its courses."""
    axes = figure.add_axes((0.05, 0.13, 0.42, 0.68))
    style_axes(axes)
    azimuth, elevation = result["azimuth_deg"], result["elevation_deg"]
    speed = result["tangential_speed_m_s"]
    points = np.column_stack([azimuth, elevation])
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    lines = LineCollection(list(pieces), cmap="viridis", linewidths=3.0, capstyle="round", zorder=3)
    lines.set_array(0.5 * (speed[:-1] + speed[1:]))
    axes.add_collection(lines)
    for index in (np.arange(_ARROWS) + 0.5) * (len(speed) - 1) / _ARROWS:
        start, end = points[int(index)], points[int(index) + 1]
        axes.annotate(
            "",
            xy=tuple(end),
            xytext=tuple(start),
            arrowprops={"arrowstyle": "-|>,head_width=0.42,head_length=0.8", "color": INK, "linewidth": 0},
            zorder=4,
        )
    comparison = study["comparison"]
    place = comparison["azimuth_deg"], comparison["elevation_deg"]
    axes.plot(*place, "o", markersize=5, color=INK, zorder=5)
    for course, colour in ((comparison["problem_course_deg"], GREY), (comparison["course_deg"], INK)):
        if course is not None:
            _draw_course(axes, place, course, colour)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.autoscale_view()
    axes.set_xlabel("azimuth (deg)", fontsize=LABEL_SIZE)
    axes.set_ylabel("elevation (deg)", fontsize=LABEL_SIZE)
    bar = figure.colorbar(lines, cax=figure.add_axes((0.48, 0.13, 0.011, 0.68)))
    bar.set_label("path speed (m/s)", fontsize=LABEL_SIZE)
    bar.ax.tick_params(labelsize=SMALL_SIZE)
    bar.outline.set_visible(False)
    figure.legend(
        handles=[Line2D([], [], marker="o", markersize=5, color=colour, linewidth=1.4) for colour in (INK, GREY)],
        labels=["representative state, course with the figure's power", "course of the problem"],
        loc="upper left",
        bbox_to_anchor=(0.045, 0.895),
        ncols=2,
        **LEGEND_STYLE,
    )


def _draw_course(axes: Any, place: tuple[float, float], course_deg: float, colour: str) -> None:
    """Draw an arrow of fixed length on the page along a course."""
    angle = np.deg2rad(course_deg)
    axes.quiver(
        *place,
        np.sin(angle),
        -np.cos(angle),
        angles="uv",
        scale_units="inches",
        scale=2.1,
        width=0.004,
        color=colour,
        zorder=4.5,
    )


def _draw_courses(axes: Any, study: dict[str, Any]) -> None:
    """Draw the course of equal power and that of equal loss to gravity over mass, for every kind of path."""
    shown: list[float] = []
    comparison = study["comparison"]
    centre = comparison["gravity_course_deg"] or 90.0
    for kind, rows in study["masses"].items():
        flown = [row for row in rows if "message" not in row]
        masses = [row["mass_kg"] for row in flown]
        for key, style, width in (("course_deg", "-", 1.8), ("gravity_course_deg", _DASHES, 1.2)):
            courses = np.array([np.nan if row[key] is None else row[key] for row in flown], dtype=float)
            axes.plot(masses, courses, color=_PATH_COLOURS[kind], linestyle=style, linewidth=width, zorder=3)
            shown += courses[np.abs(courses - centre) < _MOST_SHOWN_DEG].tolist()
    axes.plot(comparison["mass_kg"], comparison["problem_course_deg"], "D", color=INK, markersize=6, zorder=4)
    shown.append(comparison["problem_course_deg"])
    margin = 0.08 * (max(shown) - min(shown)) + 0.5
    axes.set_ylim(min(shown) - margin, max(shown) + margin)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("mass of the kite (kg)", fontsize=LABEL_SIZE)
    axes.set_ylabel("representative course (deg)", fontsize=LABEL_SIZE)
    entries = [(Line2D([], [], color=_PATH_COLOURS[kind], linewidth=1.8), kind) for kind in study["masses"]]
    entries += [
        (Line2D([], [], color=INK, linewidth=1.8), "power of the figure"),
        (Line2D([], [], color=INK, linewidth=1.2, linestyle=_DASHES), "its loss to gravity"),
        (Line2D([], [], color=INK, marker="D", linestyle="none", markersize=6), "the problem"),
    ]
    axes.legend(
        handles=[handle for handle, _ in entries],
        labels=[label for _, label in entries],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.01),
        ncols=2,
        **LEGEND_STYLE,
    )
