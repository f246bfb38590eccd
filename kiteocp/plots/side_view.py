"""The flight path seen from the side: horizontal distance against height, phases by colour."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.transforms import Bbox

from kiteocp.plots.labels import extent, inside, on_page, place
from kiteocp.plots.style import GREY, INK, LABEL_SIZE, LINE_WIDTH, PRESCRIBED_STYLE, SMALL_SIZE, phase_colour
from kiteocp.result import Result

FloatArray = npt.NDArray[np.float64]


def segments(result: Result) -> list[tuple[str, slice]]:
    """Return the runs of samples of one phase, in flight order, as (phase, slice into the channels)."""
    phase = result["phase"]
    starts = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1).tolist(), len(phase)]
    return [(str(phase[a]), slice(a, b)) for a, b in pairwise(starts) if b > a]


def path_of(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return horizontal distance along the tether's azimuth and height, each in m and of shape (n,).

    The azimuth is left out of the view: the kite turns to its traction azimuth in no time in this model, and the
    path would break there.
    """
    elevation = np.deg2rad(result["elevation_deg"])
    return result["tether_length_m"] * np.cos(elevation), result["height_m"]


def draw_side_view(
    axes: Any, result: Result, prescribed: Result | None, length_min_m: float, length_max_m: float
) -> None:
    """Draw the flight path, its start and direction, and the arcs of the shortest and longest tether."""
    x, y = path_of(result)
    paths = [(x, y)]
    if prescribed is not None:
        paths.append(path_of(prescribed))
        axes.plot(*paths[1], **PRESCRIBED_STYLE)
    for phase, run in segments(result):
        colour = phase_colour(phase)
        axes.plot(x[run], y[run], color=colour, linewidth=LINE_WIDTH + 0.8, solid_capstyle="round", zorder=3)
        _draw_direction(axes, x[run], y[run], colour)
    axes.plot(x[0], y[0], "o", markersize=7, markerfacecolor="white", markeredgecolor=INK, zorder=5)
    names = [
        axes.annotate(
            "start",
            (x[0], y[0]),
            xytext=(8, -12),
            textcoords="offset points",
            fontsize=SMALL_SIZE,
            color=INK,
            zorder=6,
        ),
        axes.annotate(
            "ground station", (0, 0), xytext=(8, 6), textcoords="offset points", fontsize=SMALL_SIZE, color=INK
        ),
    ]
    axes.plot(0.0, 0.0, "s", markersize=6, color=INK, clip_on=False, zorder=5)
    arcs = _draw_arcs(axes, paths, length_min_m, length_max_m)
    names += arcs
    axes.set_aspect("equal", adjustable="box", anchor="N")
    # Where things are on the page is known only now.
    axes.apply_aspect()
    lines = [on_page(axes, *path) for path in paths]
    taken = []
    for name in names:
        # An arc out of view has no name that is cut off at the edge.
        name.set_visible(inside(axes, extent(name)) or name not in arcs)
        if name.get_visible():
            taken.append(extent(name))
    for phase, run in segments(result):
        taken.append(extent(_label_phase(axes, phase, x[run], y[run], lines, taken)))
    axes.set_xlabel("horizontal distance from the ground station (m)", fontsize=LABEL_SIZE)
    axes.set_ylabel("height (m)", fontsize=LABEL_SIZE)


def _draw_arcs(
    axes: Any, paths: list[tuple[FloatArray, FloatArray]], length_min_m: float, length_max_m: float
) -> list[Any]:
    """Draw the tether length limits as arcs, fit the view to paths and ground station, and return the arcs' names."""
    x = np.concatenate([path[0] for path in paths])
    y = np.concatenate([path[1] for path in paths])
    margin = 0.08 * max(np.ptp(x), np.ptp(y), float(np.max(x)), float(np.max(y)))
    axes.set_xlim(min(0.0, float(np.min(x))) - margin, float(np.max(x)) + 1.6 * margin)
    axes.set_ylim(0.0, float(np.max(y)) + 1.6 * margin)
    elevation_max = max(np.pi / 2, float(np.max(np.arctan2(y, x))))
    elevation = np.linspace(0.0, elevation_max, 181)
    names = []
    for length in (length_min_m, length_max_m):
        arc_x, arc_y = length * np.cos(elevation), length * np.sin(elevation)
        axes.plot(arc_x, arc_y, color=GREY, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
        names.append(_label_arc(axes, length))
    return names


def _label_arc(axes: Any, length_m: float) -> Any:
    """Name the arc's tether length low on the arc, along it, where the path is not."""
    elevation = np.deg2rad(8.0)
    return axes.text(
        length_m * np.cos(elevation),
        length_m * np.sin(elevation),
        f"tether {length_m:.0f} m",
        fontsize=SMALL_SIZE,
        color=GREY,
        ha="right",
        va="center",
        rotation=0,
        clip_on=True,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        zorder=1.2,
    )


def _draw_direction(axes: Any, x: FloatArray, y: FloatArray, colour: str) -> None:
    """Put an arrowhead halfway along a phase, by distance flown."""
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    if distance[-1] <= 0.0:
        return
    at = np.interp([0.47 * distance[-1], 0.53 * distance[-1]], distance, np.arange(len(x)))
    index = np.arange(len(x))
    ends = [(float(np.interp(i, index, x)), float(np.interp(i, index, y))) for i in at]
    axes.annotate(
        "",
        xy=ends[1],
        xytext=ends[0],
        arrowprops={"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "color": colour, "linewidth": 1.5},
        zorder=4,
    )


def _label_phase(
    axes: Any, phase: str, x: FloatArray, y: FloatArray, lines: list[FloatArray], taken: list[Bbox]
) -> Any:
    """Name a phase beside its path, where the name covers nothing."""
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    index = np.arange(len(x))
    places = []
    for share in (0.62, 0.5, 0.38, 0.75, 0.25):
        at = np.interp(share * distance[-1], distance, index)
        point = (float(np.interp(at, index, x)), float(np.interp(at, index, y)))
        places += [
            (point, (9 * across, 6 * up if up else 0), side, vertical)
            for across, side in ((1, "left"), (-1, "right"))
            for up, vertical in ((1, "bottom"), (-1, "top"), (0, "center"))
        ]
        places += [(point, (0, 14 * up), "center", vertical) for up, vertical in ((1, "bottom"), (-1, "top"))]
    name = axes.annotate(
        phase,
        places[0][0],
        xytext=places[0][1],
        textcoords="offset points",
        fontsize=LABEL_SIZE,
        fontweight="bold",
        color=phase_colour(phase),
        zorder=6,
    )
    place(name, places, lines, taken)
    return name
