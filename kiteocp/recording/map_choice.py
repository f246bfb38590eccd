"""Which column map a recording is read by."""

from __future__ import annotations

import os
from collections.abc import Container

from kiteocp.errors import InputError
from kiteocp.recording.columns import ColumnMap, load_columns, shipped_columns


def map_for(
    present: Container[str], columns: ColumnMap | str | os.PathLike[str] | None, label: str
) -> tuple[ColumnMap, list[str]]:
    """Return the map asked for, or the shipped one that fits, without what the recording lacks, and warnings of that.

    A shipped map is for many recordings, some of which lack some optional quantity; one of the user's is for this.

    Parameters
    ----------
    present
        Names of the columns of the recording.
    columns, label
        The map asked for, and the path of the recording.

    Raises
    ------
    InputError
        A necessary column is missing, or no shipped map fits.
    """
    if columns is None:
        return _fitting(present, label), []
    asked = columns if isinstance(columns, ColumnMap) else load_columns(columns)
    layout = asked.without_absent(present)
    missing = [column for column in layout.columns() if column not in present]
    if missing:
        raise InputError(
            f"has no column {', '.join(missing)} (column map {layout.name}); give the right map with --columns",
            file=label,
            key=missing[0],
        )
    if isinstance(columns, str) and columns in shipped_columns():
        return layout, []
    used = set(layout.columns())
    absent = [column for column in asked.columns() if column not in used and column not in present]
    keys = [key for key in asked.__struct_fields__ if getattr(asked, key) is not None and getattr(layout, key) is None]
    if not keys:
        return layout, []
    shown = f"{', '.join(absent[:4])}{', ...' if len(absent) > 4 else ''}"
    return layout, [
        f"the recording has no column {shown}: it was read without {', '.join(keys)} (column map {layout.name}); "
        "correct the name of the column, or take the key out of the map"
    ]


def _fitting(present: Container[str], label: str) -> ColumnMap:
    """Return the shipped map that fits."""
    layouts = [load_columns(name).without_absent(present) for name in shipped_columns()]
    lacking = {layout.name: [c for c in layout.columns() if c not in present] for layout in layouts}
    fitting = [layout for layout in layouts if not lacking[layout.name]]
    if fitting:
        # The one that reads most of the recording.
        return max(fitting, key=lambda layout: len(layout.columns()))
    name, nearest = min(lacking.items(), key=lambda item: len(item[1]))
    raise InputError(
        f"fits no shipped column map ({name} lacks {', '.join(nearest[:4])}{', ...' if len(nearest) > 4 else ''}); "
        "describe its columns in a map (kiteocp new NAME --columns writes a template) and give it with --columns",
        file=label,
        key=nearest[0],
    )
