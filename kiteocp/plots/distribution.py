"""Picture of a global sensitivity: the distribution of the optimal mean power, and the Sobol indices."""

from __future__ import annotations

import itertools
from typing import Any

from matplotlib.figure import Figure

from kiteocp.plots.labels import stack
from kiteocp.plots.style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    NOTE_STYLE,
    SMALL_SIZE,
    TITLE_STYLE,
    make_figure,
    style_axes,
    write_line,
)
from kiteocp.plots.words import words_of
from kiteocp.result import Result

_TOTAL = "#E69F00"
_BAR = 0.38


def compose_distribution(result: Result) -> Figure:
    """Draw ``details["global"]``: histogram with quantiles, first-order and total indices with their intervals."""
    summary: dict[str, Any] = result.details["global"]
    figure = make_figure(12.5, 5.6)
    title = f"{result.problem.name}: distribution of the optimal mean power"
    write_line(figure, 0.965, title, **TITLE_STYLE)
    if summary["note"]:
        write_line(figure, 0.915, summary["note"], fontsize=SMALL_SIZE, color=GREY)
    _draw_histogram(figure.add_axes((0.055, 0.11, 0.37, 0.71)), summary)
    _draw_indices(figure.add_axes((0.65, 0.11, 0.335, 0.71)), summary)
    return figure


def _draw_histogram(axes: Any, summary: dict[str, Any]) -> None:
    style_axes(axes)
    edges, counts = [1e-3 * edge for edge in summary["histogram"]["edges_W"]], summary["histogram"]["counts"]
    widths = [right - left for left, right in itertools.pairwise(edges)]
    axes.bar(edges[:-1], counts, width=widths, align="edge", color=BLUE, alpha=0.55, linewidth=0)
    # Labels above the bars.
    top = 1.22 * max(counts, default=1)
    axes.set_ylim(0.0, top)
    spread = summary["distribution"]
    names = []
    for quantile in (5, 50, 95):
        power = spread[f"quantile_{quantile}_W"]
        if power is not None:
            axes.axvline(1e-3 * power, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
            names.append(_name_level(axes, 1e-3 * power, f"{quantile} %", INK))
    nominal = 1e-3 * summary["nominal_mean_power_W"]
    axes.axvline(nominal, color=_TOTAL, linewidth=1.6)
    names.append(_name_level(axes, nominal, "nominal", _TOTAL))
    stack(names, -14.0)
    # A sample is whole.
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("optimal mean power (kW)", fontsize=LABEL_SIZE)
    axes.set_ylabel("samples", fontsize=LABEL_SIZE)
    told = f"{spread['solved']} of {spread['samples']} independent samples solved"
    if spread["mean_W"] is not None:
        told += f"; mean {1e-3 * spread['mean_W']:.2f} kW, sd {1e-3 * spread['standard_deviation_W']:.2f} kW"
    axes.set_title(told, **NOTE_STYLE)


def _name_level(axes: Any, power_kW: float, text: str, colour: str) -> Any:
    """Name an upright line beside its upper end; the name hides other lines."""
    return axes.annotate(
        text,
        (power_kW, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(4, -3),
        textcoords="offset points",
        va="top",
        fontsize=SMALL_SIZE,
        color=colour,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        zorder=5,
    )


def _draw_indices(axes: Any, summary: dict[str, Any]) -> None:
    """Draw both indices of every key, the largest on top, with the intervals of the bootstrap."""
    style_axes(axes)
    rows = sorted(
        (row for row in summary["indices"] if row["total_order"] is not None), key=lambda row: row["total_order"]
    )
    for name, shift, colour in (("first_order", 0.5 * _BAR, BLUE), ("total_order", -0.5 * _BAR, _TOTAL)):
        for place, row in enumerate(rows):
            axes.barh(place + shift, row[name], height=_BAR, color=colour, linewidth=0)
            ends = [row[f"{name}_from"], row[f"{name}_to"]]
            axes.plot(ends, [place + shift] * 2, color=INK, linewidth=1.1, marker="|", markersize=5)
    axes.set_yticks(range(len(rows)), [words_of(row["key"]) for row in rows], fontsize=SMALL_SIZE)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("share of the variance of the optimal mean power", fontsize=LABEL_SIZE)
    interval = f"{100 * summary['confidence']:g} %"
    axes.set_title(f"Sobol indices: first order (blue) and total (orange), black: {interval} interval", **NOTE_STYLE)
