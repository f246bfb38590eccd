"""The column map: which column of a flight recording is which quantity, in what unit, frame and sense.

A map is a small YAML file; the structures here are its layout. Maps that come with kiteocp lie beside this file and go
by their name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args

import msgspec
from msgspec import Struct

from kiteocp.analysis.flights.data import FLIGHT_PHASES
from kiteocp.errors import InputError
from kiteocp.problem.checking import nearest
from kiteocp.problem.files import user_path
from kiteocp.problem.reading import read_document

AngleUnit = Literal["deg", "rad"]
LengthUnit = Literal["m", "km", "ft"]
SpeedUnit = Literal["m/s", "km/h", "kn", "ft/s"]
ForceUnit = Literal["N", "kN", "daN", "kgf", "lbf"]
TimeUnit = Literal["s", "ms", "min", "h"]

#: What one of each unit is in the unit of `FlightData` (degrees for angles).
FACTORS: dict[str, float] = {
    "deg": 1.0, "rad": 57.29577951308232, "m": 1.0, "km": 1000.0, "ft": 0.3048, "m/s": 1.0, "km/h": 1 / 3.6,
    "kn": 1852.0 / 3600.0, "ft/s": 0.3048, "N": 1.0, "kN": 1000.0, "daN": 10.0, "kgf": 9.80665,
    "lbf": 4.4482216152605, "s": 1.0, "ms": 0.001, "min": 60.0, "h": 3600.0,
}  # fmt: skip


class _Block(Struct, frozen=True, forbid_unknown_fields=True):
    """Common settings of all blocks."""


class Angle(_Block, frozen=True):
    """An angle that means the same everywhere (elevation, angle of attack)."""

    column: str
    unit: AngleUnit


class Length(_Block, frozen=True):
    """A length."""

    column: str
    unit: LengthUnit


class Speed(_Block, frozen=True):
    """A speed; ``sign`` -1 where the recording counts it the other way round."""

    column: str
    unit: SpeedUnit
    sign: Literal[1, -1] = 1


class Force(_Block, frozen=True):
    """A force."""

    column: str
    unit: ForceUnit


class Time(_Block, frozen=True):
    """Time, from any origin."""

    column: str
    unit: TimeUnit


class Number(_Block, frozen=True):
    """A column of whole numbers."""

    column: str


class Phase(_Block, frozen=True):
    """The phase of the cycle, by labels: each label to retraction, transition, traction or turn."""

    column: str
    labels: dict[str, Literal["retraction", "transition", "traction", "turn"]]


class Azimuth(_Block, frozen=True):
    """Azimuth of the kite: bearing from a zero, in a sense as seen from above.

    ``zero_bearing_deg`` is the bearing of its zero, clockwise from north; where the position is Cartesian it may be
    left out and follows from position and azimuth.
    """

    column: str
    unit: AngleUnit
    sense: Literal["clockwise", "counter-clockwise"]
    zero_bearing_deg: float | None = None


class Course(_Block, frozen=True):
    """Course of the kite in the tangential plane, in a sense as seen from the ground station."""

    column: str
    unit: AngleUnit
    zero: Literal["up", "down"]
    sense: Literal["clockwise", "counter-clockwise"]


class WindDirection(_Block, frozen=True):
    """Direction of the wind, clockwise from north: where it comes from, or where it blows to."""

    column: str
    unit: AngleUnit
    of: Literal["from", "to"]


class PowerSetting(_Block, frozen=True):
    """A depower or power signal, with its own values where the kite is fully powered and fully depowered."""

    column: str
    powered: float
    depowered: float


class CartesianPosition(_Block, frozen=True, tag_field="frame", tag="cartesian"):
    """Position from the ground station, towards east, north and up."""

    east: Length
    north: Length
    up: Length
    azimuth: Azimuth | None = None


class SphericalPosition(_Block, frozen=True, tag_field="frame", tag="spherical"):
    """Position by straight distance, elevation and azimuth."""

    distance: Length
    elevation: Angle
    azimuth: Azimuth


class Velocity(_Block, frozen=True):
    """Velocity of the kite in three columns: north, east, down; east, north, up; or radial, polar, azimuthal.

    Polar is downwards (towards the ground), azimuthal counter-clockwise as seen from above.
    """

    frame: Literal["NED", "ENU", "spherical"]
    columns: tuple[str, str, str]
    unit: SpeedUnit


class ColumnMap(_Block, frozen=True, kw_only=True):
    """The layout of a recording.

    ``downwind_bearing_deg`` fixes the bearing of the model's zero azimuth; where it is left out it is that of the
    recording's own azimuth.
    """

    name: str
    description: str = ""
    source: str = ""
    downwind_bearing_deg: float | None = None
    time: Time
    cycle: Number | None = None
    phase: Phase
    position: CartesianPosition | SphericalPosition
    velocity: Velocity
    course: Course | None = None
    tether_length: Length | None = None
    reeling_speed: Speed
    tether_force: Force
    ground_wind_speed: Speed | None = None
    ground_wind_direction: WindDirection | None = None
    apparent_wind_speed: Speed | None = None
    angle_of_attack: Angle | None = None
    power_setting: PowerSetting | None = None

    def columns(self) -> list[str]:
        """Return the name of every column that the map uses, each once."""
        return list(dict.fromkeys(_columns(self)))


def _columns(block: Struct) -> Iterator[str]:
    for name in block.__struct_fields__:
        value = getattr(block, name)
        if name == "column":
            yield value
        elif name == "columns":
            yield from value
        elif isinstance(value, Struct):
            yield from _columns(value)


def shipped_columns() -> dict[str, Path]:
    """Return the path of every shipped column map by its name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.yaml"))}


def load_columns(name_or_path: str | os.PathLike[str]) -> ColumnMap:
    """Load a column map by the name of a shipped one, or by its path.

    Raises
    ------
    InputError
        The file is missing or is no column map; one sentence with file, key and remedy.
    """
    shipped = shipped_columns()
    text = str(name_or_path)
    if isinstance(name_or_path, str) and text in shipped:
        path = shipped[text]
    elif isinstance(name_or_path, str) and not re.search(r"[/\\]|\.(ya?ml|json)$", text):
        near = nearest(text, shipped)
        guess = f"did you mean {near}?" if near else "a file of yours needs its path with the .yaml."
        raise InputError(f"{text!r} is not a shipped column map; {guess} (Shipped: {', '.join(shipped)})")
    else:
        path = user_path(name_or_path)
        # Path.exists raises where a folder may not be entered, or a name is too long.
        if not os.path.lexists(path):
            raise InputError(f"there is no such column map; check the path, or use {', '.join(shipped)}", file=text)
    document = read_document(path, text)
    try:
        return msgspec.convert(document.content, ColumnMap)
    except msgspec.ValidationError as error:
        message, key = _sentence(str(error), document.content)
        raise InputError(message, file=document.label, line=document.lines.get(key), key=key) from None


def _sentence(complaint: str, content: dict[Any, Any]) -> tuple[str, str]:
    """Return msgspec's complaint as a sentence with its remedy, and the key it is about."""
    what, _, place = complaint.partition(" - at `")
    path = place.rstrip("`").removeprefix("$").removeprefix(".")
    prefix = f"{path}." if path else ""
    quoted = re.findall(r"`([^`]*)`", what)
    block = _struct_at(path, content)
    names = list(block.__struct_fields__) if block is not None else []
    if "unknown field" in what:
        near = nearest(quoted[0], names)
        remedy = f"did you mean {prefix}{near}?" if near else f"known are {', '.join(names)}"
        return f"{prefix}{quoted[0]} is not a known key; {remedy}", prefix + quoted[0]
    if "missing required field" in what:
        return f"{prefix}{quoted[0]} is missing; give it as the shipped map does (see its file)", prefix + quoted[0]
    if path.startswith("phase.labels["):
        # msgspec does not say which label.
        labels = content["phase"]["labels"]
        path = next(f"phase.labels.{label}" for label, word in labels.items() if word not in FLIGHT_PHASES)
    choices = _choices_at(path, content)
    if choices:
        return f"{path} is {_value_at(path, content)!r}; it can be {', '.join(map(str, choices))}", path
    return f"{path or 'the file'} is not understood ({what[0].lower()}{what[1:]}); correct it", path


def _value_at(path: str, content: Any) -> Any:
    for part in path.split("."):
        name, _, index = part.partition("[")
        content = content.get(name) if isinstance(content, dict) else None
        if index and isinstance(content, list) and index.rstrip("]").isdigit():
            content = content[int(index.rstrip("]"))]
    return content


def _struct_at(path: str, content: dict[Any, Any]) -> type[Struct] | None:
    """Return the structure that a key path of a map is about, None for a single value."""
    found: Any = ColumnMap
    walked = content
    for part in path.split(".") if path else ():
        hints = {item.name: item.type for item in msgspec.structs.fields(found)}
        options = [hints.get(part), *get_args(hints.get(part))]
        walked = walked.get(part, {}) if isinstance(walked, dict) else {}
        structs = [option for option in options if isinstance(option, type) and issubclass(option, Struct)]
        if len(structs) > 1:
            frame = walked.get("frame") if isinstance(walked, dict) else None
            structs = [option for option in structs if option.__struct_config__.tag == frame]
        if not structs:
            return None
        found = structs[0]
    return found  # type: ignore[no-any-return]


def _choices_at(path: str, content: dict[Any, Any]) -> tuple[Any, ...]:
    """Return the words that a key may have; none where it is no choice."""
    above, _, name = path.rpartition(".")
    if path == "position.frame":
        return ("cartesian", "spherical")
    if above == "phase.labels":
        return FLIGHT_PHASES
    owner = _struct_at(above, content)
    if owner is None:
        return ()
    hints = {item.name: item.type for item in msgspec.structs.fields(owner)}
    if name in hints:
        return get_args(hints[name]) if "Literal" in str(hints[name]) else ()
    return ()
