"""Azimuth and velocity of a recording against the motion of its position."""

from __future__ import annotations

import numpy as np

from kiteocp.recording.blocks import CartesianPosition, SphericalPosition, Velocity
from kiteocp.recording.cleaning import MAD_TO_SIGMA, FloatArray, wrapped
from kiteocp.recording.columns import ColumnMap
from kiteocp.recording.data import FlightData
from kiteocp.recording.frames import cartesian, cartesian_velocity, spherical_velocity
from kiteocp.recording.likeness import CORRELATED, Likeness, likeness
from kiteocp.recording.motion import derivative

#: A recorded azimuth may lie so far (deg) off the position, and its zero so far off the given one.
AZIMUTH_SPREAD_DEG, ZERO_OFF_DEG = 3.0, 15.0


def azimuth_contradictions(flight: FlightData, layout: ColumnMap, bearing_deg: FloatArray | None) -> list[str]:
    """Hold a recorded azimuth against a Cartesian position."""
    position = layout.position
    if bearing_deg is None or not isinstance(position, CartesianPosition) or position.azimuth is None:
        return []
    bearing = flight.downwind_bearing_deg - flight.azimuth_deg
    column, place = position.azimuth.column, f"{position.east.column} and {position.north.column}"
    spread, zero = _circular(bearing - bearing_deg)
    mirrored, _ = _circular(bearing + bearing_deg)
    if spread > AZIMUTH_SPREAD_DEG and mirrored < 0.5 * spread:
        return [
            f"the azimuth in column {column} contradicts the position ({place}), and does not where it counts the "
            f"other way round; position.azimuth.sense is {position.azimuth.sense}: correct it"
        ]
    if spread > 5.0 * AZIMUTH_SPREAD_DEG:
        return [
            f"the azimuth in column {column} contradicts the position ({place}): their difference varies by "
            f"{spread:.0f} deg; check position.azimuth and its unit"
        ]
    given = position.azimuth.zero_bearing_deg
    off = 0.0 if given is None else float(wrapped(np.array([zero - given]))[0])
    if abs(off) > ZERO_OFF_DEG:
        return [
            f"the zero of column {column} is at a bearing of {zero % 360.0:.0f} deg by the position ({place}), not of "
            f"{given:g} deg; correct position.azimuth.zero_bearing_deg"
        ]
    return []


def _circular(angle_deg: FloatArray) -> tuple[float, float]:
    """Return robust spread and median of angles, deg."""
    known = np.radians(angle_deg[np.isfinite(angle_deg)])
    middle = float(np.degrees(np.angle(np.mean(np.exp(1j * known)))))
    off = wrapped(np.degrees(known) - middle)
    median = float(np.median(off))
    return MAD_TO_SIGMA * float(np.median(np.abs(off - median))), middle + median


def velocity_contradictions(flight: FlightData, layout: ColumnMap) -> list[str]:
    """Hold the velocity against the motion of the position."""
    if layout.velocity is None:
        return []
    recorded = flight.radial_speed_m_s, flight.polar_speed_m_s, flight.azimuthal_speed_m_s
    east, north, up = (
        derivative(flight.time_s, part)
        for part in cartesian(flight.distance_m, flight.elevation_deg, flight.downwind_bearing_deg - flight.azimuth_deg)
    )
    frame = (flight.elevation_deg, flight.azimuth_deg, flight.downwind_bearing_deg)
    moved: tuple[FloatArray, ...]
    if layout.velocity.frame == "spherical":
        moved, names = spherical_velocity((north, east, up), *frame), ("radial", "polar", "azimuthal")
    else:
        recorded = cartesian_velocity(recorded, *frame)
        moved, names = (east, north, up), ("east", "north", "up")
    found = [likeness(v, d) for v, d in zip(recorded, moved, strict=True)]
    wrong = [index for index, like in enumerate(found) if not like.agrees]
    if not wrong:
        return []
    turned = _turned(layout.position, layout.velocity, recorded, moved, wrong)
    return turned or _components(layout.velocity, names, recorded, moved, found)


def _turned(
    position: CartesianPosition | SphericalPosition,
    block: Velocity,
    recorded: tuple[FloatArray, ...],
    moved: tuple[FloatArray, ...],
    wrong: list[int],
) -> list[str]:
    """Say where sense or zero of a recorded azimuth explains that the horizontal velocities contradict the position."""
    if isinstance(position, CartesianPosition) or 2 in wrong or block.frame == "spherical":
        return []
    azimuth = position.azimuth
    known = np.isfinite(recorded[0] + recorded[1] + moved[0] + moved[1])
    velocity, motion = ((part[0] + 1j * part[1])[known] for part in (recorded, moved))
    size = float(np.sqrt(np.sum(np.abs(velocity) ** 2) * np.sum(np.abs(motion) ** 2)))
    same = complex(np.sum(velocity * np.conj(motion)) / size)
    mirrored = complex(np.sum(velocity * motion) / size)
    columns = f"column {azimuth.column} contradicts the velocity ({', '.join(block.columns)})"
    if abs(mirrored) > CORRELATED and abs(mirrored) > abs(same):
        return [
            f"the azimuth in {columns}, and does not where it counts the other way round; position.azimuth.sense is "
            f"{azimuth.sense}: correct it"
        ]
    if abs(same) > CORRELATED:
        # Angles in the plane are against the clock from east, bearings with it from north.
        zero = ((azimuth.zero_bearing_deg or 0.0) - np.degrees(np.angle(same))) % 360.0
        return [
            f"the azimuth in {columns} unless its zero is at a bearing of about {zero:.0f} deg; "
            f"position.azimuth.zero_bearing_deg is {azimuth.zero_bearing_deg:g}: correct it"
        ]
    return []


def _components(
    block: Velocity,
    names: tuple[str, ...],
    recorded: tuple[FloatArray, ...],
    moved: tuple[FloatArray, ...],
    found: list[Likeness],
) -> list[str]:
    """Name the components of the velocity that contradict the position."""
    order = {"NED": ("north", "east", "up"), "ENU": ("east", "north", "up")}.get(block.frame, names)
    column = dict(zip(order, block.columns, strict=True))
    wrong = [index for index, like in enumerate(found) if not like.agrees]
    swapped = len(wrong) == 2 and all(
        likeness(recorded[a], moved[b]).correlation >= CORRELATED for a, b in (wrong, wrong[::-1])
    )
    if swapped:
        first, second = (column[names[index]] for index in wrong)
        return [
            f"the velocities in columns {first} and {second} contradict the position, and do not where they change "
            "places; correct velocity.columns or velocity.frame"
        ]
    if len(wrong) == 3 and all(like.correlation >= CORRELATED for like in found):
        factor = float(np.median([like.factor for like in found]))
        return [
            f"the velocity ({', '.join(block.columns)}) is {factor:.3g} times that of the position; correct "
            "velocity.unit, or the units of the position"
        ]
    told = [f"{column[names[index]]} ({names[index]}) {found[index].words}" for index in wrong]
    return [
        f"the velocity contradicts the motion of the position: {', '.join(told)}; correct velocity.frame, "
        "velocity.columns or velocity.unit, or the columns of the position"
    ]
