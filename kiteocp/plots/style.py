"""How every picture looks, and how it becomes a file.

Colours are those of Okabe and Ito (Color Universal Design, 2008), told apart by readers with any colour vision.
Figures are made through the object interface of matplotlib: no pyplot, no global state, no window.
"""

from __future__ import annotations

import io
from contextlib import AbstractContextManager
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK = "#222222"
GREY = "#767676"
BLUE = "#0072B2"
GRID = "#dddddd"
PHASE_COLOURS: dict[str, str] = {
    "retraction": "#D55E00",
    "transition": "#CC79A7",
    "traction": "#009E73",
    "turn": "#E69F00",
}
PHASE_ALPHA = 0.11

TITLE_SIZE = 12.0
TITLE_STYLE: dict[str, Any] = {"fontsize": TITLE_SIZE, "fontweight": "bold", "color": INK}
LABEL_SIZE = 9.0
SMALL_SIZE = 8.0
LINE_WIDTH = 1.6
GRID_WIDTH, TICK_LENGTH = 0.6, 3.0

#: The prescribed cycle beside an optimum: there to compare with, not to look at first.
PRESCRIBED_STYLE: dict[str, Any] = {"color": GREY, "linewidth": 1.1, "linestyle": (0, (5, 2)), "zorder": 2}
LIMIT_STYLE: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": (0, (2, 2)), "zorder": 1.5}

#: A sentence above axes, for ``axes.set_title``.
NOTE_STYLE: dict[str, Any] = {"fontsize": SMALL_SIZE, "color": GREY, "loc": "left"}
#: A legend that stands in line with the axes, without a box.
LEGEND_STYLE: dict[str, Any] = {"frameon": False, "fontsize": SMALL_SIZE, "borderaxespad": 0.0}

#: Left edge of titles, in parts of the figure.
_LINE_LEFT = 0.012

#: The resolution of the files, and from the beginning: what was measured to place words is not measured again.
_DPI = 120
# Level 3 of zlib takes half the time of the usual 6 for a file a tenth larger.
_PNG_COMPRESSION = 3


def look() -> AbstractContextManager[None]:
    """Set what matplotlib knows as settings only, while a figure is composed and written."""
    # Letters as they are: to fit them to whole pixels takes a fifth of the time of a picture, and is not seen at this
    # resolution. The names inside an SVG are random without a salt.
    return rc_context({"text.hinting": "no_hinting", "svg.hashsalt": "kiteocp"})


def make_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty white figure that draws without a display."""
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def write_line(figure: Figure, height: float, text: str, **style: Any) -> None:
    """Write a line at the left edge that may hold anything: as it stands, and cut off where the figure ends.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Where to write.
    height : float
        Of the upper edge, in parts of the figure.
    text : str
        Dollar signs do not start a formula; a line break is a space.
    **style
        Of `matplotlib.text.Text`.
    """
    words = " ".join(text.split())
    line = figure.text(_LINE_LEFT, height, words, va="top", parse_math=False, **style)
    room = (1.0 - 2.0 * _LINE_LEFT) * figure.bbox.width
    while len(words) > 1 and (width := line.get_window_extent().width) > room:
        words = words[: min(int(len(words) * room / width), len(words) - 1)]
        line.set_text(f"{words.rstrip()} ...")


def style_axes(axes: Any) -> None:
    """Give axes the common look: light grid behind the lines, no box, small ticks."""
    axes.grid(True, color=GRID, linewidth=GRID_WIDTH)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(GREY)
    # Few ticks: easier to read, and the costliest part of a figure to draw.
    axes.xaxis.get_major_locator().set_params(nbins=8, steps=[1, 2, 5, 10])
    axes.yaxis.get_major_locator().set_params(nbins=5, steps=[1, 2, 5, 10])
    axes.tick_params(labelsize=SMALL_SIZE, color=GREY, labelcolor=INK, length=TICK_LENGTH)


def phase_colour(phase: str) -> str:
    """Return the colour of a phase; one the palette does not know is blue."""
    return PHASE_COLOURS.get(phase, BLUE)


def figure_bytes(figure: Figure, suffix: str) -> bytes:
    """Return a figure as the content of a file; the same figure gives the same bytes."""
    stream = io.BytesIO()
    # No date, so that the same result gives the same file.
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(suffix)
    options: dict[str, Any] = {"pil_kwargs": {"compress_level": _PNG_COMPRESSION}} if suffix == "png" else {}
    with look():
        figure.savefig(stream, format=suffix, dpi=_DPI, metadata=metadata, **options)
    return stream.getvalue()
