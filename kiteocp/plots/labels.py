"""Placing names in a picture so that they cover neither each other nor what is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.transforms import Bbox

#: Room between two names, in points.
_ROOM_PT = 2.0

#: Alignment to the share of a text that lies left of its place, or below it.
_SHARE_BEFORE = {"left": 0.0, "bottom": 0.0, "center": 0.5, "right": 1.0, "top": 1.0}


def extent(text: Any) -> Bbox:
    """Return the box of a text or annotation on the page, in pixels, with a little room around it."""
    figure = text.figure
    return Bbox(text.get_window_extent()).padded(_ROOM_PT * figure.dpi / 72.0)


def stack(texts: Sequence[Any], line_pt: float) -> None:
    """Move annotations by whole lines until none covers one before it.

    Parameters
    ----------
    texts : sequence of matplotlib.text.Annotation
        With offsets in points; the first one stays where it is.
    line_pt : float
        Height of a line, in points; negative to move them down.
    """
    taken: list[Bbox] = []
    for text in texts:
        while any(extent(text).overlaps(box) for box in taken):
            across, up = text.xyann
            text.xyann = (across, up + line_pt)
        taken.append(extent(text))


def place(text: Any, places: Sequence[tuple[Any, ...]], lines: Sequence[Any], taken: Sequence[Bbox]) -> None:
    """Move an annotation to the place where it covers least: first other names, then lines, then early places.

    Out of its axes it may be in the way of anything, as on another name.

    Parameters
    ----------
    text : matplotlib.text.Annotation
        With its offset in points.
    places : sequence of tuple
        Point in data, offset in points, horizontal and vertical alignment of each place.
    lines : sequence of numpy.ndarray, shape (n, 2)
        Points of lines on the page, in pixels, close together.
    taken : sequence of matplotlib.transforms.Bbox
        Names already placed, in pixels.
    """
    # Its size is the same everywhere, and measuring a text takes longer than all the rest.
    size = extent(text)
    pixels_pt = text.figure.dpi / 72.0
    room = _ROOM_PT * pixels_pt
    width, height = size.width - 2.0 * room, size.height - 2.0 * room
    found = []
    for rank, (point, offset, across, up) in enumerate(places):
        x, y = text.axes.transData.transform(point) + np.array(offset) * pixels_pt
        left, below = x - _SHARE_BEFORE[across] * width, y - _SHARE_BEFORE[up] * height
        box = Bbox.from_bounds(left, below, width, height).padded(room)
        names = sum(box.overlaps(other) for other in taken) + (not inside(text.axes, box))
        found.append((names, sum(box.count_contains(line) for line in lines), rank))
    text.xy, text.xyann, across, up = places[min(found)[-1]]
    text.set(ha=across, va=up)


def inside(axes: Any, box: Bbox) -> bool:
    """Whether a box in pixels lies within axes."""
    view = axes.get_window_extent()
    return bool(view.x0 <= box.x0 and box.x1 <= view.x1 and view.y0 <= box.y0 and box.y1 <= view.y1)


def on_page(axes: Any, x: np.ndarray, y: np.ndarray, step_px: float = 3.0) -> np.ndarray:
    """Return points of a line in pixels, no farther apart than a few pixels, shape (n, 2)."""
    pixels = axes.transData.transform(np.column_stack([x, y]))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pixels, axis=0).T))])
    at = np.linspace(0.0, way[-1], max(int(way[-1] / step_px), 2))
    return np.column_stack([np.interp(at, way, pixels[:, column]) for column in (0, 1)])
