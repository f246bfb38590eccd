"""A commented column map to start from, written from the layout of maps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args

import msgspec
from msgspec import Struct

from kiteocp.errors import InputError
from kiteocp.problem.layout import NAME_PATTERN
from kiteocp.recording.columns import ColumnMap
from kiteocp.recording.data import FLIGHT_PHASES

#: What each quantity is, and an example of its block with made-up column names.
_MEANINGS: dict[str, tuple[str, str]] = {
    "time": ("time from any origin", "{column: time, unit: s}"),
    "cycle": ("number of the pumping cycle", "{column: cycle}"),
    "phase": (
        "phase of the cycle; other labels are samples without a phase",
        "{column: phase, labels: {reel-in: retraction, ri-ro: transition, reel-out: traction, ro-ri: turn}}",
    ),
    "position": (
        "position from the ground station: spherical, or cartesian with east, north and up",
        "{frame: spherical, distance: {column: distance, unit: m}, elevation: {column: elevation, unit: deg}, "
        "azimuth: {column: azimuth, unit: deg, sense: clockwise, zero_bearing_deg: 250}}",
    ),
    "velocity": (
        "velocity of the kite; without it, the derivative of the position",
        "{frame: NED, columns: [v_north, v_east, v_down], unit: m/s}",
    ),
    "course": (
        "course; without it, from the velocity",
        "{column: course, unit: deg, zero: up, sense: counter-clockwise}",
    ),
    "tether_length": ("length reeled out", "{column: tether_length, unit: m}"),
    "reeling_speed": ("reeling speed at the ground, positive out; sign: -1 where in", "{column: speed, unit: m/s}"),
    "tether_force": ("tether force at the ground", "{column: force, unit: N}"),
    "mechanical_power": ("power at the drum; checked against force and speed", "{column: power, unit: W}"),
    "ground_wind_speed": ("wind speed measured at the ground", "{column: wind_speed, unit: m/s}"),
    "ground_wind_direction": (
        "direction the wind comes from, or blows to, clockwise from north",
        "{column: wind_direction, unit: deg, of: from}",
    ),
    "wind_at_height": (
        "wind measured at several heights, as by a lidar; it is then the wind",
        "{heights: [50, 100, 200], unit: m, speed: {columns: [w50, w100, w200], unit: m/s}}",
    ),
    "apparent_wind_speed": ("airspeed measured at the kite", "{column: airspeed, unit: m/s}"),
    "angle_of_attack": ("angle of attack measured at the kite", "{column: angle_of_attack, unit: deg}"),
    "power_setting": (
        "depower or power signal; levels left out are found from the flight",
        "{column: depower, powered: 40, depowered: 50}",
    ),
}


def columns_template(name: str) -> str:
    """Return a column map with every quantity, its units and its meaning, which loads as it is.

    Optional quantities are commented out.

    Parameters
    ----------
    name : str
        Name of the map.

    Raises
    ------
    InputError
        If the name cannot be one.
    """
    if not re.fullmatch(NAME_PATTERN, name) or len(name) > 100:
        raise InputError(
            f"{name!r} cannot name a column map; begin with a letter or digit and use at most 100 letters, digits, "
            "'.', '_' and '-'"
        )
    fields = [item for item in msgspec.structs.fields(ColumnMap) if item.name in _MEANINGS]
    lines = [
        f"# Column map {name}: which column of a recording is which quantity. Give it with --columns.",
        "# Put the names of your columns in; quantities that are commented out are optional.",
        "#",
        f"# {'quantity':22}{'needed':8}units",
        *(f"# {item.name:22}{'yes' if item.required else '':8}{', '.join(_units(item.type))}" for item in fields),
        "#",
        f"# phase.labels gives each label of the column one of {', '.join(FLIGHT_PHASES)}.",
        "# Senses of angles are as seen from above (azimuth) and from the ground station (course).",
        f"name: {name}",
        "# downwind_bearing_deg: 70    # bearing of zero azimuth in deg, where the recording has none",
        "",
    ]
    for item in fields:
        meaning, example = _MEANINGS[item.name]
        lines += [f"# {meaning}", f"{'' if item.required else '# '}{item.name}: {example}"]
    return "\n".join(lines) + "\n"


def _units(kind: Any) -> Iterator[str]:
    """Yield the units that the blocks of a quantity may have, each once."""
    seen: dict[str, None] = {}
    pending = [kind]
    while pending:
        found = pending.pop(0)
        if isinstance(found, type) and issubclass(found, Struct):
            for item in msgspec.structs.fields(found):
                if item.name == "unit":
                    seen.update(dict.fromkeys(get_args(item.type)))
                else:
                    pending.append(item.type)
        else:
            pending += [option for option in get_args(found) if isinstance(option, type)]
    yield from seen
