"""A column map against the recording it reads: columns that contradict each other under it, each named in a sentence.

What moves is recorded more than once: the velocity is the derivative of the position, the reeling speed that of the
tether length, the course the direction of the velocity, and power is force times speed. A wrong sign, sense, unit or
order of the columns breaks one of these and leaves the others, which tells it from noise.
"""

from __future__ import annotations

import numpy as np

from kiteocp.recording.cleaning import FloatArray, wrapped
from kiteocp.recording.columns import ColumnMap
from kiteocp.recording.data import FlightData
from kiteocp.recording.likeness import CORRELATED, FACTORS_OF_AGREEMENT, FEWEST, WORKING_W, likeness
from kiteocp.recording.motion import derivative
from kiteocp.recording.motion_check import azimuth_contradictions, velocity_contradictions

#: A power that is so many times force times speed, or that part of it, over traction and retraction together, is in
#: another unit: kgf for N is a factor of 9.8. In the two open data sets, where it is not the same power, it is 1.6.
ANOTHER_UNIT = 4.0

#: Velocity and course column are compared where the kite moves across the tether faster than this (m/s); further apart
#: than that (deg) they disagree, and where they do in more than this share of the samples one is wrong.
COURSE_SPEED_M_S, COURSE_DISAGREES_DEG, DOUBTFUL_COURSES = 5.0, 45.0, 0.1


def contradictions(
    flight: FlightData,
    layout: ColumnMap,
    bearing_deg: FloatArray | None,
    course_deg: FloatArray | None,
    power_W: FloatArray | None,
) -> tuple[list[str], list[str]]:
    """Return warnings of columns that contradict each other, and notes of such that are another quantity.

    Parameters
    ----------
    flight
        As read by the map.
    layout
        The map.
    bearing_deg, course_deg, power_W
        Recorded azimuth, clockwise from its own zero; course in the model's sense; mechanical power; each of shape
        (n,), None where it is not recorded.
    """
    warnings = [
        *azimuth_contradictions(flight, layout, bearing_deg),
        *velocity_contradictions(flight, layout),
        *_reeling(flight, layout),
        *_course(flight, layout, course_deg),
        *_vane(flight, layout),
    ]
    unlike, notes = _power(flight, layout, power_W)
    return [f"column map {layout.name}: {text}" for text in [*warnings, *unlike]], notes


def _reeling(flight: FlightData, layout: ColumnMap) -> list[str]:
    """Hold the reeling speed against length and distance, and against the phases."""
    speed, time = flight.reeling_speed_m_s, flight.time_s
    radial = derivative(time, flight.distance_m)
    column = layout.reeling_speed.column
    if layout.tether_length is not None:
        reeled = derivative(time, flight.tether_length_m)
        found = likeness(speed, reeled)
        if not found.agrees:
            by_speed, by_length = likeness(radial, speed), likeness(radial, reeled)
            guilty = "tether_length" if by_speed.agrees and not by_length.agrees else "reeling_speed"
            return [
                f"the reeling speed in column {column} {found.words} against the tether length in column "
                f"{layout.tether_length.column}; correct sign or unit of {guilty}"
            ]
    else:
        found = likeness(speed, radial)
        if not found.agrees and abs(found.correlation) >= CORRELATED:
            return [
                f"the reeling speed in column {column} {found.words} against the distance of the kite; correct sign or "
                "unit of reeling_speed"
            ]
    out, back = (np.nanmedian(speed[flight.phase == name]) if np.isfinite(speed[flight.phase == name]).any() else None
                 for name in ("traction", "retraction"))  # fmt: skip
    if out is not None and back is not None and out < 0.0 < back:
        return [
            f"by column {column} the tether is reeled in in the traction ({out:.2g} m/s) and out in the retraction "
            f"({back:.2g} m/s); correct reeling_speed.sign or phase.labels"
        ]
    return []


def recorded_course_disagrees(flight: FlightData, course_deg: FloatArray | None) -> int:
    """Return how many samples of a recorded course are far off that of the velocity."""
    return 0 if course_deg is None else int(_off_course(flight, course_deg).sum())


def _off_course(flight: FlightData, course_deg: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    moving = np.hypot(flight.polar_speed_m_s, flight.azimuthal_speed_m_s) > COURSE_SPEED_M_S
    found: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = moving & (
        np.abs(wrapped(course_deg - flight.course_deg)) > COURSE_DISAGREES_DEG
    )
    return found


def _course(flight: FlightData, layout: ColumnMap, course_deg: FloatArray | None) -> list[str]:
    """Hold the recorded course against the direction of the velocity."""
    if course_deg is None or layout.course is None:
        return []
    moving = np.hypot(flight.polar_speed_m_s, flight.azimuthal_speed_m_s) > COURSE_SPEED_M_S
    if np.count_nonzero(moving & np.isfinite(course_deg)) < FEWEST:
        return []

    def share(course: FloatArray) -> float:
        return float(_off_course(flight, course)[moving].mean())

    as_mapped = share(course_deg)
    if as_mapped <= DOUBTFUL_COURSES:
        return []
    # In the model's sense a wrong zero is half a circle; a wrong sense mirrors the recorded angle about its own zero.
    zero = 180.0 if layout.course.zero == "up" else 0.0
    mirrored = 2.0 * zero - course_deg
    others = {"zero": course_deg + 180.0, "sense": mirrored, "zero and course.sense": mirrored + 180.0}
    remedy, best = min(((word, share(course)) for word, course in others.items()), key=lambda item: item[1])
    what = f"correct course.{remedy}" if best <= DOUBTFUL_COURSES else (
        "check zero and sense of the course, and frame and columns of the velocity"
    )  # fmt: skip
    velocity = "velocity"
    if layout.velocity is None:
        velocity = "motion of the position"
        what += ", or position.azimuth.sense" if remedy.startswith("sense") or remedy.endswith("sense") else ""
    return [
        f"the course in column {layout.course.column} contradicts the {velocity} in {100 * as_mapped:.0f} % of the "
        f"samples; {what}"
    ]


def _vane(flight: FlightData, layout: ColumnMap) -> list[str]:
    """Say where most wind directions had to be turned round."""
    block = layout.ground_wind_direction
    known = int(np.isfinite(flight.ground_wind_direction_deg).sum())
    turned = flight.counts.get("values_wind_direction_turned", 0)
    if block is None or known < FEWEST or turned <= 0.5 * known:
        return []
    return [
        f"the wind in column {block.column} would blow towards the ground station in {100 * turned / known:.0f} % of "
        f"the samples; correct ground_wind_direction.of, which is '{block.of}'"
    ]


def _power(flight: FlightData, layout: ColumnMap, power_W: FloatArray | None) -> tuple[list[str], list[str]]:
    """Hold the recorded power against force times reeling speed."""
    block = layout.mechanical_power
    if power_W is None or block is None:
        return [], []
    product = flight.tether_force_ground_N * flight.reeling_speed_m_s
    shares = []
    for name in ("traction", "retraction"):
        among = (flight.phase == name) & np.isfinite(power_W) & np.isfinite(product)
        mean = float(np.mean(product[among])) if among.any() else 0.0
        shares.append(float(np.mean(power_W[among])) / mean if abs(mean) > WORKING_W else np.nan)
    columns = f"{layout.tether_force.column} times {layout.reeling_speed.column}"
    low, high = FACTORS_OF_AGREEMENT
    # Another power, as that behind a machine or with friction, is of the same size and sign on the whole; another unit
    # is not.
    known = bool(np.isfinite(shares).all())
    overall = float(np.sqrt(abs(shares[0] * shares[1]))) if known else 1.0
    if known and overall and (max(shares) < 0.0 or not 1.0 / ANOTHER_UNIT < overall < ANOTHER_UNIT):
        how = "has the opposite sign of" if max(shares) < 0.0 else f"is on the whole {overall:.2g} times"
        return [
            f"the power in column {block.column} {how} {columns}; correct unit or sign of tether_force, reeling_speed "
            "or mechanical_power"
        ], []
    found = likeness(power_W, product, WORKING_W)
    if found.agrees:
        return [], []
    alike = known and low < shares[0] / shares[1] < high
    if alike and abs(found.correlation) >= CORRELATED:
        return [
            f"the power in column {block.column} is {shares[0]:.3g} times {columns}; correct unit or sign of "
            "tether_force, reeling_speed or mechanical_power"
        ], []
    told = " and ".join(
        f"{share:.2g} times it in the {name}"
        for name, share in zip(("traction", "retraction"), shares, strict=True)
        if np.isfinite(share)
    )
    return [], [
        f"column {block.column} is not {columns} ({told or f'correlation {found.correlation:.2f}'}): power here is "
        "force times reeling speed"
    ]
