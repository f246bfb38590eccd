"""The picture of a pumping cycle: flight path, time series and the phases in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kiteocp.errors import InputError
from kiteocp.plots.numbers import write_numbers
from kiteocp.plots.panels import draw_ground_force, draw_panel, draw_zero, mark_times, shade_phases
from kiteocp.plots.side_view import draw_side_view
from kiteocp.plots.style import (
    BLUE,
    INK,
    LABEL_SIZE,
    LEGEND_STYLE,
    LINE_WIDTH,
    PRESCRIBED_STYLE,
    TITLE_STYLE,
    make_figure,
    style_axes,
    write_line,
)
from kiteocp.problem.catalogue import limit_keys
from kiteocp.result import Result
from kiteocp.result.table import mean_power_of

#: Panel to the values drawn dashed in it, each with what to call it; None is no limit.
Levels = dict[str, list[tuple[float | None, str]]]

_WIDTH_IN, _HEIGHT_IN = 12.5, 8.0


def compose_cycle(result: Result) -> Figure:
    """Draw a simulated cycle: side view, time series with the set values, phases in numbers.

    Raises
    ------
    InputError
        If the result has no time series.
    """
    return _compose(result, None, _set_values(result), "simulated cycle")


def compose_optimum(result: Result) -> Figure:
    """Draw an optimal cycle beside the prescribed one, with the limits it respects; errors as `compose_cycle`."""
    prescribed = result.prescribed if result.prescribed is not None and result.prescribed.channels else None
    return _compose(result, prescribed, _limits(result), "optimal cycle")


def _set_values(result: Result) -> Levels:
    """Return the levels a simulated cycle is flown at, by panel."""
    operation = result.problem.operation
    return {
        "length": [(operation.tether_length_min_m, "shortest"), (operation.tether_length_max_m, "longest")],
        "force": [
            (operation.retraction.tether_force_N, "retraction set value"),
            (operation.traction.tether_force_N, "traction set value"),
        ],
    }


#: Panel to the quantity that its limits bound.
_LIMITED = {
    "length": "tether_length",
    "speed": "reeling_speed",
    "force": "tether_force",
    "power": "power",
    "elevation": "elevation",
}


def _limits(result: Result) -> Levels:
    """Return the levels an optimal cycle respects, by panel."""
    levels: Levels = {panel: [] for panel in _LIMITED}
    for panel, quantity in _LIMITED.items():
        for key in limit_keys().values():
            row = key.limit
            if row is None or row.quantity != quantity or row.rate:
                continue
            value = getattr(result.problem.limits, key.name)
            called = row.level or ("minimum" if "_min_" in key.name else "maximum")
            levels[panel].append((-value if value is not None and row.measure == "opposite" else value, called))
    return levels


def _compose(
    result: Result,
    prescribed: Result | None,
    levels: Levels,
    kind: str,
) -> Figure:
    """Return the whole figure: side view and table on the left, panels on the right."""
    if not result.channels:
        raise InputError(f"the {result.verb} result of {result.problem.name} holds no time series to draw")
    figure = make_figure(_WIDTH_IN, _HEIGHT_IN)
    side = figure.add_axes((0.055, 0.36, 0.385, 0.51))
    style_axes(side)
    (length_min, _), (length_max, _) = levels["length"]
    draw_side_view(side, result, prescribed, float(length_min or 0.0), float(length_max or 0.0))

    panels = [figure.add_axes((0.525, 0.075 + 0.164 * row, 0.375, 0.138)) for row in range(4, -1, -1)]
    for axes in panels:
        style_axes(axes)
    _draw_panels(panels, result, prescribed, levels)
    _write_title(figure, result, prescribed, kind)
    write_numbers(figure, side, result, prescribed)
    return figure


def _draw_panels(
    panels: Sequence[Any],
    result: Result,
    prescribed: Result | None,
    levels: Levels,
) -> None:
    length, speed, force, power, elevation = panels
    draw_panel(length, result, prescribed, "tether_length_m", "tether length\n(m)", levels.get("length", ()))
    draw_panel(speed, result, prescribed, "reeling_speed_m_s", "reeling speed\n(m/s)", levels.get("speed", ()))
    draw_panel(
        force,
        result,
        prescribed,
        "tether_force_kite_N",
        "tether force\n(kN)",
        levels.get("force", ()),
        factor=1e-3,
    )
    draw_ground_force(force, result)
    key, _ = mean_power_of(result)
    electrical = key != "mean_power_W"
    draw_panel(
        power,
        result,
        prescribed,
        "electrical_power_W" if electrical else "power_W",
        "electrical\npower (kW)" if electrical else "power\n(kW)",
        levels.get("power", ()),
        factor=1e-3,
        mean=(result.cycle.get(key), "mean"),
    )
    draw_panel(elevation, result, prescribed, "elevation_deg", "elevation\n(deg)", levels.get("elevation", ()))
    for axes in (speed, power):
        draw_zero(axes)
    cycles = [result, *([prescribed] if prescribed is not None else [])]
    start = min(float(cycle["time_s"][0]) for cycle in cycles)
    end = max(float(cycle["time_s"][-1]) for cycle in cycles)
    for axes in panels:
        axes.set_xlim(start, end)
        axes.yaxis.set_label_coords(-0.105, 0.5)
    mark_times(panels[:-1], elevation)
    elevation.set_xlabel("time (s)", fontsize=LABEL_SIZE)
    shade_phases(panels, result)
    force.legend(
        handles=[Line2D([], [], color=INK, lw=LINE_WIDTH), Line2D([], [], color=BLUE, lw=1.1)],
        labels=["at the kite", "at the ground"],
        loc="lower right",
        bbox_to_anchor=(1.0, 0.96),
        ncols=2,
        **LEGEND_STYLE,
    )


def _write_title(figure: Figure, result: Result, prescribed: Result | None, kind: str) -> None:
    write_line(figure, 0.972, f"{result.problem.name}: {kind}", **TITLE_STYLE)
    parts = []
    key, title = mean_power_of(result)
    power = result.cycle.get(key)
    if power is not None:
        text = f"{title} {1e-3 * power:.2f} kW"
        reference = prescribed.cycle.get(key) if prescribed is not None else None
        if reference is not None:
            text += f" (prescribed {1e-3 * reference:.2f} kW"
            text += f", {100.0 * (power / reference - 1.0):+.1f} %)" if reference > 0.0 else ")"
        parts.append(text)
    if not result.succeeded:
        parts.append(f"status: {result.status}")
    # Last, as it is what may be cut off.
    parts += [result.problem.description] if result.problem.description else []
    write_line(figure, 0.938, " | ".join(parts), fontsize=LABEL_SIZE, color=INK)
    if prescribed is not None:
        figure.legend(
            handles=[
                Line2D([], [], color=INK, linewidth=LINE_WIDTH + 0.4),
                Line2D([], [], **PRESCRIBED_STYLE),
            ],
            labels=["optimal", "prescribed"],
            loc="upper left",
            bbox_to_anchor=(0.055, 0.905),
            ncols=2,
            **(LEGEND_STYLE | {"fontsize": LABEL_SIZE}),
        )
