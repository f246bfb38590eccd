"""The parts of a column map: a quantity with its column, unit, frame and sense."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

AngleUnit = Literal["deg", "rad"]
LengthUnit = Literal["m", "km", "ft"]
SpeedUnit = Literal["m/s", "km/h", "kn", "ft/s"]
ForceUnit = Literal["N", "kN", "daN", "kgf", "lbf"]
TimeUnit = Literal["s", "ms", "min", "h"]
PowerUnit = Literal["W", "kW"]

#: What one of each unit is in the unit of `FlightData` (degrees for angles).
FACTORS: dict[str, float] = {
    "deg": 1.0, "rad": 57.29577951308232, "m": 1.0, "km": 1000.0, "ft": 0.3048, "m/s": 1.0, "km/h": 1 / 3.6,
    "kn": 1852.0 / 3600.0, "ft/s": 0.3048, "N": 1.0, "kN": 1000.0, "daN": 10.0, "kgf": 9.80665,
    "lbf": 4.4482216152605, "s": 1.0, "ms": 0.001, "min": 60.0, "h": 3600.0, "W": 1.0, "kW": 1000.0,
}  # fmt: skip


class Block(Struct, frozen=True, forbid_unknown_fields=True):
    """Common settings of all blocks."""


class Angle(Block, frozen=True):
    """An angle that means the same everywhere (elevation, angle of attack)."""

    column: str
    unit: AngleUnit


class Length(Block, frozen=True):
    """A length."""

    column: str
    unit: LengthUnit


class Speed(Block, frozen=True):
    """A speed; ``sign`` -1 where the recording counts it the other way round."""

    column: str
    unit: SpeedUnit
    sign: Literal[1, -1] = 1


class Force(Block, frozen=True):
    """A force."""

    column: str
    unit: ForceUnit


class Time(Block, frozen=True):
    """Time, from any origin."""

    column: str
    unit: TimeUnit


class Number(Block, frozen=True):
    """A column of whole numbers."""

    column: str


class PhaseLabels(Block, frozen=True):
    """The phase of the cycle, by labels: each label to retraction, transition, traction or turn."""

    column: str
    labels: dict[str, Literal["retraction", "transition", "traction", "turn"]]


class Azimuth(Block, frozen=True):
    """Azimuth of the kite: bearing from a zero, in a sense as seen from above.

    ``zero_bearing_deg`` is the bearing of its zero, clockwise from north; where the position is Cartesian it may be
    left out and follows from position and azimuth.
    """

    column: str
    unit: AngleUnit
    sense: Literal["clockwise", "counter-clockwise"]
    zero_bearing_deg: float | None = None


class Course(Block, frozen=True):
    """Course of the kite in the tangential plane, in a sense as seen from the ground station."""

    column: str
    unit: AngleUnit
    zero: Literal["up", "down"]
    sense: Literal["clockwise", "counter-clockwise"]


class WindDirection(Block, frozen=True):
    """Direction of the wind, clockwise from north: where it comes from, or where it blows to."""

    column: str
    unit: AngleUnit
    of: Literal["from", "to"]


class PowerSetting(Block, frozen=True):
    """A depower or power signal, with its own values where the kite is fully powered and fully depowered.

    A level that is left out is found from the flight (`power_setting.levels`).
    """

    column: str
    powered: float | None = None
    depowered: float | None = None


class Power(Block, frozen=True):
    """A power, positive where the drum delivers it; ``sign`` -1 where the recording counts it the other way round."""

    column: str
    unit: PowerUnit
    sign: Literal[1, -1] = 1


class Speeds(Block, frozen=True):
    """Speeds in several columns of one unit."""

    columns: tuple[str, ...]
    unit: SpeedUnit


class WindDirections(Block, frozen=True):
    """Directions of the wind in several columns, as in `WindDirection`."""

    columns: tuple[str, ...]
    unit: AngleUnit
    of: Literal["from", "to"]


class WindAtHeight(Block, frozen=True):
    """Wind measured at several heights, as by a lidar: ``heights`` in ``unit``, a column for each, lowest first."""

    heights: tuple[float, ...]
    unit: LengthUnit
    speed: Speeds
    direction: WindDirections | None = None


class CartesianPosition(Block, frozen=True, tag_field="frame", tag="cartesian"):
    """Position from the ground station, towards east, north and up."""

    east: Length
    north: Length
    up: Length
    azimuth: Azimuth | None = None


class SphericalPosition(Block, frozen=True, tag_field="frame", tag="spherical"):
    """Position by straight distance, elevation and azimuth."""

    distance: Length
    elevation: Angle
    azimuth: Azimuth


class Velocity(Block, frozen=True):
    """Velocity of the kite in three columns: north, east, down; east, north, up; or radial, polar, azimuthal.

    Polar is downwards (towards the ground), azimuthal counter-clockwise as seen from above.
    """

    frame: Literal["NED", "ENU", "spherical"]
    columns: tuple[str, str, str]
    unit: SpeedUnit
