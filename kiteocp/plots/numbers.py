"""The numbers below the side view: the phases of the cycle, and for an optimum the limits that hold it."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from kiteocp.plots.style import GREY, INK, LABEL_SIZE, SMALL_SIZE, phase_colour
from kiteocp.result import Result
from kiteocp.result.table import ENERGIES, LASTING_SHARE, describe_cycle, describe_limit, mean_power_of

# Title, key of the summary, factor to the unit of the title, decimals.
_Columns = tuple[tuple[str, str, float, int], ...]
# In parts of the figure.
_LEFT, _FIRST_COLUMN, _COLUMN_WIDTH, _ROW_HEIGHT = 0.055, 0.195, 0.095, 0.026
_NOTE_HEIGHT, _BOTTOM = 0.021, 0.02


def write_numbers(figure: Figure, side: Any, result: Result, prescribed: Result | None) -> None:
    """Write the phases in numbers below the side view, the prescribed ones in grey beside them."""
    # Equal scales shrink the side view to the shape of the cycle: follow its lower edge.
    side.apply_aspect()
    y = side.get_position().y0 - 0.085
    columns = _columns(result)
    for index, (title, *_) in enumerate(columns):
        x = _FIRST_COLUMN + _COLUMN_WIDTH * index
        figure.text(x + 0.055, y, title, fontsize=SMALL_SIZE, color=GREY, ha="right")
    if prescribed is not None:
        figure.text(_LEFT, y, "grey: prescribed", fontsize=SMALL_SIZE, color=GREY)
    rows: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
        (name, dict(values), dict(prescribed.phases.get(name, {})) if prescribed else {})
        for name, values in result.phases.items()
    ]
    rows.append(("cycle", dict(result.cycle), dict(prescribed.cycle) if prescribed else {}))
    for name, values, reference in rows:
        y -= _ROW_HEIGHT
        colour = INK if name == "cycle" else phase_colour(name)
        figure.text(_LEFT, y, name, fontsize=LABEL_SIZE, fontweight="bold", color=colour)
        for index, (_, key, factor, decimals) in enumerate(columns):
            x = _FIRST_COLUMN + _COLUMN_WIDTH * index + 0.055
            if (value := values.get(key)) is not None:
                figure.text(x, y, f"{factor * value:.{decimals}f}", fontsize=LABEL_SIZE, ha="right")
            if (value := reference.get(key)) is not None:
                text = f"{factor * value:.{decimals}f}"
                figure.text(x - 0.042, y, text, fontsize=SMALL_SIZE, color=GREY, ha="right")
    _write_notes(figure, result, y - 1.4 * _ROW_HEIGHT)


def _columns(result: Result) -> _Columns:
    power, title = mean_power_of(result)
    # There is no room for more beside the duration.
    title = title.replace("electrical", "el.")
    energy = ENERGIES[power]
    return (
        ("duration (s)", "duration_s", 1.0, 1),
        (f"{title} (kW)", power, 1e-3, 2),
        ("energy (kJ)", energy, 1e-3, 0),
    )


def _write_notes(figure: Figure, result: Result, y: float) -> None:
    """Write what describes the cycle and the limits that hold for part of a phase; the table has those met once."""
    for line in describe_cycle(result):
        figure.text(_LEFT, y, line, fontsize=SMALL_SIZE, color=INK)
        y -= _NOTE_HEIGHT
    active: dict[str, list[dict[str, Any]]] = result.details.get("active_limits") or {}
    rows: list[tuple[str, str, str]] = []
    for phase, limits in active.items():
        lasting = [describe_limit(limit) for limit in limits if _is_lasting(limit)]
        rows += [(phase if index == 0 else "", phase, text) for index, text in enumerate(lasting)]
    if not rows:
        return
    y -= 0.4 * _NOTE_HEIGHT
    figure.text(_LEFT, y, "active limits (share of the time of the phase)", fontsize=SMALL_SIZE, color=GREY)
    room = int((y - _BOTTOM) / _NOTE_HEIGHT)
    if len(rows) > room:
        rows = [*rows[: room - 1], ("", "", "... and more in summary.json")]
    for name, phase, text in rows:
        y -= _NOTE_HEIGHT
        figure.text(_LEFT, y, name, fontsize=SMALL_SIZE, color=phase_colour(phase))
        figure.text(_LEFT + 0.07, y, text, fontsize=SMALL_SIZE, color=INK)


def _is_lasting(limit: dict[str, Any]) -> bool:
    share = limit.get("share")
    return share is None or share >= LASTING_SHARE
