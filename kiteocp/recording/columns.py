"""The column map: which column of a flight recording is which quantity, in what unit, frame and sense.

A map is a small YAML file; the structures here are its layout. Maps that come with kiteocp lie beside this file and go
by their name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec
from msgspec import Struct

from kiteocp.errors import InputError
from kiteocp.problem.checking import nearest
from kiteocp.problem.files import user_path
from kiteocp.problem.reading import read_document
from kiteocp.recording.blocks import (
    Angle,
    Block,
    CartesianPosition,
    Course,
    Force,
    Length,
    Number,
    PhaseLabels,
    Power,
    PowerSetting,
    Speed,
    SphericalPosition,
    Time,
    Velocity,
    WindAtHeight,
    WindDirection,
)
from kiteocp.recording.data import FLIGHT_PHASES


class ColumnMap(Block, frozen=True, kw_only=True):
    """The layout of a recording.

    ``downwind_bearing_deg`` fixes the bearing of the model's zero azimuth; where it is left out it is that of the
    recording's own azimuth. Without a ``velocity`` that of the kite is the derivative of its position.
    """

    name: str
    description: str = ""
    source: str = ""
    downwind_bearing_deg: float | None = None
    time: Time
    cycle: Number | None = None
    phase: PhaseLabels
    position: CartesianPosition | SphericalPosition
    velocity: Velocity | None = None
    course: Course | None = None
    tether_length: Length | None = None
    reeling_speed: Speed
    tether_force: Force
    mechanical_power: Power | None = None
    ground_wind_speed: Speed | None = None
    ground_wind_direction: WindDirection | None = None
    wind_at_height: WindAtHeight | None = None
    apparent_wind_speed: Speed | None = None
    angle_of_attack: Angle | None = None
    power_setting: PowerSetting | None = None

    def columns(self) -> list[str]:
        """Return the name of every column that the map uses, each once."""
        return list(dict.fromkeys(_columns(self)))

    def without_absent(self, present: Container[str]) -> ColumnMap:
        """Return the map without the optional quantities of which a column is not among those `present`."""
        absent: dict[str, None] = {}
        for field in msgspec.structs.fields(type(self)):
            block = getattr(self, field.name)
            if not field.required and isinstance(block, Struct) and any(c not in present for c in _columns(block)):
                absent[field.name] = None
        return msgspec.structs.replace(self, **absent)


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
        return f"{prefix}{quoted[0]} is missing; kiteocp new NAME --columns shows how", prefix + quoted[0]
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
