"""Pictures of sensitivities: tornado chart and elasticities by component, and the optimum along one key."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from kiteocp.plots.style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    LIMIT_STYLE,
    LINE_WIDTH,
    NOTE_STYLE,
    SMALL_SIZE,
    TITLE_STYLE,
    make_figure,
    phase_colour,
    style_axes,
    write_line,
)
from kiteocp.plots.words import label_of, name_words, words_of
from kiteocp.result import Result

#: Bars of the tornado chart; the rest is in the table.
BARS = 18
_LOW, _HIGH = "#D55E00", BLUE
_BLOCK_COLOURS = {
    "environment": "#56B4E9",
    "kite": "#009E73",
    "tether": "#CC79A7",
    "operation": "#E69F00",
    "limits": "#D55E00",
    "machine": GREY,
}


def compose_sensitivities(result: Result) -> Figure:
    """Draw ``details["sensitivities"]``: tornado chart, and elasticities grouped by component."""
    rows: list[dict[str, Any]] = result.details["sensitivities"]
    figure = make_figure(12.5, 7.0)
    power = result.details["optimal_mean_power_W"]
    title = f"{result.problem.name}: sensitivity of the optimal mean power ({1e-3 * power:.2f} kW)"
    write_line(figure, 0.972, title, **TITLE_STYLE)
    _draw_tornado(figure.add_axes((0.2, 0.09, 0.29, 0.8)), rows)
    _draw_elasticities(figure.add_axes((0.7, 0.09, 0.28, 0.8)), rows)
    return figure


def _draw_tornado(axes: Any, rows: Sequence[dict[str, Any]]) -> None:
    """Draw the change of power at both ends of each uncertainty, the largest on top."""
    style_axes(axes)
    drawn = sorted((row for row in rows if _swing(row)), key=_swing)[-BARS:]
    for place, row in enumerate(drawn):
        for name, colour in (("from", _LOW), ("to", _HIGH)):
            change = row[f"change_at_{name}_W"]
            resolved = row.get(f"resolved_change_at_{name}_W")
            if change is not None:
                axes.barh(place, change, height=0.7, color=colour)
            if resolved is not None:
                axes.plot([resolved], [place], marker="|", markersize=9, color=INK, linestyle="none")
    axes.set_yticks(range(len(drawn)), [_named(row) for row in drawn], fontsize=SMALL_SIZE)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("change of the optimal mean power (W)", fontsize=LABEL_SIZE)
    axes.set_title(
        "at the low (orange) and high (blue) end of the stated uncertainty (*) or of 1 %;\nblack: re-solved",
        **NOTE_STYLE,
    )


def _draw_elasticities(axes: Any, rows: Sequence[dict[str, Any]]) -> None:
    """Draw the elasticities, grouped by component."""
    style_axes(axes)
    drawn = [row for row in rows if abs(row["elasticity"] or 0.0) >= 1e-3][::-1]
    for place, row in enumerate(drawn):
        block = row["key"].partition(".")[0]
        axes.barh(place, row["elasticity"], height=0.7, color=_BLOCK_COLOURS.get(block, GREY))
    axes.set_yticks(range(len(drawn)), [words_of(row["key"]) for row in drawn], fontsize=SMALL_SIZE)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("elasticity (% of power per % of the number)", fontsize=LABEL_SIZE)


def _swing(row: dict[str, Any]) -> float:
    return float(max(abs(row["change_at_from_W"] or 0.0), abs(row["change_at_to_W"] or 0.0)))


def _named(row: dict[str, Any]) -> str:
    return words_of(row["key"]) + (" *" if row["uncertainty_stated"] else "") + (" !" if row.get("misleading") else "")


def compose_variation(result: Result) -> Figure:
    """Draw ``details["variation"]``: the optimal power along one key with its tangent, and which limits are active."""
    variation = result.details["variation"]
    key, points = variation["key"], variation["points"]
    figure = make_figure(9.0, 7.0)
    write_line(figure, 0.972, f"{result.problem.name}: optimum along {key}", **TITLE_STYLE)
    power, limits = figure.add_axes((0.36, 0.52, 0.61, 0.38)), figure.add_axes((0.36, 0.09, 0.61, 0.38))
    for axes in (power, limits):
        style_axes(axes)
        margin = 0.02 * (points[-1]["value"] - points[0]["value"])
        axes.set_xlim(points[0]["value"] - margin, points[-1]["value"] + margin)
    solved = [point for point in points if point["mean_power_W"] is not None]
    values, powers = [p["value"] for p in solved], [1e-3 * p["mean_power_W"] for p in solved]
    power.plot(values, powers, color=INK, linewidth=LINE_WIDTH, marker="o", markersize=3.5)
    if points[0]["tangent_W"] is not None:
        row = next(row for row in result.details["sensitivities"] if row["key"] == key)
        tangent = [1e-3 * point["tangent_W"] for point in points]
        power.plot([p["value"] for p in points], tangent, color=_HIGH, linewidth=1.1, linestyle=(0, (5, 2)))
        if points[0]["value"] <= row["value"] <= points[-1]["value"]:
            power.axvline(row["value"], **LIMIT_STYLE)
        if powers:
            room = 0.1 * (max(powers) - min(powers)) or 0.1
            power.set_ylim(min(powers) - room, max(powers) + room)
    power.set_ylabel("optimal mean power (kW)", fontsize=LABEL_SIZE)
    power.set_title("solid: re-solved; dashed: tangent at the value of the file", **NOTE_STYLE)
    power.tick_params(labelbottom=False)
    _draw_limits(limits, points)
    limits.set_xlabel(label_of(key), fontsize=LABEL_SIZE)
    return figure


def _draw_limits(axes: Any, points: Sequence[dict[str, Any]]) -> None:
    """Draw a row for each limit of each phase: a dot where it is active, the larger the longer."""
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for point in points:
        for phase, entries in point["active_limits"].items():
            for entry in entries:
                found.setdefault((phase, entry["limit"]), []).append((point["value"], entry["share"]))
    rows = sorted(found, reverse=True)
    for place, (phase, limit) in enumerate(rows):
        values, shares = zip(*found[phase, limit], strict=True)
        sizes = [8.0 + 40.0 * share for share in shares]
        axes.scatter(values, [place] * len(values), s=sizes, color=phase_colour(phase), linewidths=0)
    axes.set_yticks(
        range(len(rows)),
        [f"{phase}: {name_words(limit.removeprefix('limits.'))}" for phase, limit in rows],
        fontsize=SMALL_SIZE,
    )
    axes.set_ylim(-0.7, len(rows) - 0.3)
    axes.set_title("active limits; the larger, the longer", **NOTE_STYLE)
