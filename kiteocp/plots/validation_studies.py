"""The two studies of the paper's results that are no cycles: convergence of its scheme, and isolines of kite mass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator

from kiteocp.plots.style import BLUE, GREY, GRID, INK, LABEL_SIZE, SMALL_SIZE, make_figure, style_axes
from kiteocp.studies.paper.convergence import Convergence
from kiteocp.studies.paper.isolines import GravityIsolines

# One and a half columns of a journal page.
_WIDTH_IN, _HEIGHT_IN = 5.5, 3.2

#: Half width of the paper's convergence range.
BAND = 0.03
#: Largest deviation shown: coarser steps may leave the picture, the band must not become a line.
_LARGEST_SHOWN = 0.25

#: Largest over smallest mass of the isolines, at most.
_LEVEL_RANGE = 40.0
#: Courses on which isolines are labelled, in parts of the picture's width, and the room of a label in its height.
_LABELLED_COURSES = (0.03, 0.5, 0.97)
_LABEL_ROOM = 0.05

_CURVES: tuple[dict[str, Any], ...] = (
    {"color": INK, "linestyle": "-", "marker": "o"},
    {"color": BLUE, "linestyle": (0, (4, 1.6)), "marker": "s"},
    {"color": "#D55E00", "linestyle": (0, (7, 1.6)), "marker": "^"},
    {"color": "#009E73", "linestyle": (0, (1, 1.2)), "marker": "D"},
)


def draw_convergence(convergence: Convergence) -> Figure:
    """Return the normalised mean harvesting factor over the time step, with the band and the adaptive integrator."""
    figure = make_figure(_WIDTH_IN, _HEIGHT_IN)
    axes = figure.add_axes((0.115, 0.135, 0.87, 0.705))
    smallest = min(float(np.min(curve.time_steps)) for curve in convergence.curves.values())
    largest = max(float(np.max(curve.time_steps)) for curve in convergence.curves.values())
    beside = smallest / 2.6
    # Sideways, or the marks of the adaptive integrator would be one.
    spread = (largest / smallest) ** 0.025
    shown = [1.0 - BAND, 1.0 + BAND]
    for place, (name, curve) in enumerate(convergence.curves.items()):
        style = _CURVES[place % len(_CURVES)]
        flown = np.isfinite(curve.ratios)
        axes.semilogx(
            curve.time_steps[flown], curve.ratios[flown], **style, linewidth=1.3, markersize=3.2, label=name, zorder=3
        )
        axes.plot(
            beside * spread ** (place - 0.5 * (len(convergence.curves) - 1)),
            curve.accurate_ratio,
            marker=style["marker"],
            color=style["color"],
            markersize=4.5,
            markerfacecolor="white",
            linestyle="none",
            zorder=4,
        )
        shown += curve.ratios[flown].tolist()
    style_axes_logarithmic(axes)
    for level in (1.0 - BAND, 1.0 + BAND):
        axes.axhline(level, color=INK, linewidth=0.9, linestyle="-.", zorder=1.9)
    low, high = max(min(shown), 1.0 - _LARGEST_SHOWN), min(max(shown), 1.0 + _LARGEST_SHOWN)
    margin = 0.06 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(beside / 2.3, largest * 1.25)
    axes.axvline(smallest / 1.35, color=GREY, linewidth=0.8)
    axes.annotate(
        "adaptive",
        (beside, 0.03),
        xycoords=axes.get_xaxis_transform(),
        fontsize=SMALL_SIZE,
        color=INK,
        ha="center",
    )
    axes.set_xlabel("nondimensional time step", fontsize=LABEL_SIZE)
    axes.set_ylabel("normalised harvesting factor", fontsize=LABEL_SIZE)
    figure.legend(
        loc="upper center",
        bbox_to_anchor=(0.55, 1.0),
        ncols=2,
        frameon=False,
        fontsize=SMALL_SIZE,
        handlelength=3.4,
        borderaxespad=0.2,
        labelspacing=0.25,
    )
    return figure


def style_axes_logarithmic(axes: Any) -> None:
    """Give axes with a logarithmic abscissa the common look, every decade a tick and the minor ones unlabelled."""
    ticks, minor = axes.xaxis.get_major_locator(), axes.xaxis.get_minor_locator()
    axes.xaxis.set_major_locator(MaxNLocator())
    style_axes(axes)
    axes.xaxis.set_major_locator(ticks)
    axes.xaxis.set_minor_locator(minor)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.tick_params(which="minor", length=1.8, color=GREY, labelbottom=False)


def draw_mass_isolines(isolines: GravityIsolines) -> Figure:
    """Return the kite mass over course and kinematic ratio as labelled isolines."""
    figure = make_figure(_WIDTH_IN, _HEIGHT_IN)
    axes = figure.add_axes((0.085, 0.135, 0.895, 0.785))
    style_axes(axes)
    course, ratio, mass = isolines.course_deg, isolines.kinematic_ratio, isolines.mass_kg
    missing = np.isnan(mass)
    if missing.any():
        axes.contourf(course, ratio, missing.astype(float), levels=[0.5, 1.5], colors=["#eeeeee"], zorder=0)
    levels = isoline_levels(mass)
    if levels.size:
        lines = axes.contour(course, ratio, mass, levels=levels, colors=[BLUE], linewidths=1.1, zorder=3)
        places = label_places(lines.allsegs, (float(course[0]), float(course[-1])), (float(ratio[0]), float(ratio[-1])))
        axes.clabel(
            lines,
            fmt=lambda level: f"{level:g}",
            fontsize=SMALL_SIZE,
            inline_spacing=3,
            colors=[INK],
            manual=places,
        )
    axes.axhline(isolines.lift_to_drag, color=INK, linewidth=1.1, linestyle=(0, (4, 1.6)), zorder=2)
    axes.set_xlim(float(course[0]), float(course[-1]))
    axes.set_ylim(float(ratio[0]), float(ratio[-1]))
    axes.annotate(
        f"lift-to-drag ratio {isolines.lift_to_drag:g}",
        (float(course[0] + course[-1]) / 2, isolines.lift_to_drag),
        xytext=(0, 4),
        textcoords="offset points",
        fontsize=SMALL_SIZE,
        color=INK,
        ha="center",
    )
    axes.set_title("isolines: mass of the kite (kg)", fontsize=LABEL_SIZE, loc="left", color=INK, pad=4.0)
    axes.xaxis.set_major_locator(MultipleLocator(45.0))
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_xlabel("course angle (deg)", fontsize=LABEL_SIZE)
    axes.set_ylabel("kinematic ratio", fontsize=LABEL_SIZE)
    return figure


def isoline_levels(mass_kg: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return round masses in kg, the closer the smaller, over what most of the plane has."""
    known = mass_kg[np.isfinite(mass_kg)]
    if not known.size or np.max(known) <= 0.0:
        return np.array([])
    largest = float(np.percentile(known, 90.0)) or float(np.max(known))
    decade = 10.0 ** math.floor(math.log10(largest))
    series = [step * decade * 10.0**power for power in (-2, -1, 0) for step in (1.0, 2.0, 3.0, 5.0)]
    return np.array([level for level in series if largest / _LEVEL_RANGE <= level <= largest])


def label_places(
    isolines: Sequence[Sequence[np.ndarray[Any, Any]]], courses: tuple[float, float], ratios: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return where to write the labels: on courses where the isolines are furthest apart, none over another.

    Parameters
    ----------
    isolines
        By level the lines of the contour, each of shape (n, 2).
    courses, ratios
        Ends of the picture in both directions.
    """
    places: list[tuple[float, float]] = []
    height = ratios[1] - ratios[0]
    for share in _LABELLED_COURSES:
        course = courses[0] + share * (courses[1] - courses[0])
        taken = [ratios[0], ratios[1]]
        # The heavier first: the lightest lie closest to each other.
        for lines in reversed(isolines):
            for line in lines:
                if len(line) < 2 or not np.min(line[:, 0]) <= course <= np.max(line[:, 0]):
                    continue
                order = np.argsort(line[:, 0])
                ratio = float(np.interp(course, line[order, 0], line[order, 1]))
                if min(abs(ratio - other) for other in taken) > _LABEL_ROOM * height:
                    taken.append(ratio)
                    places.append((course, ratio))
    return places
