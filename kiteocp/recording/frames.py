"""From the frames of a recording to the model's: velocities in spherical components, courses from straight down."""

from __future__ import annotations

import numpy as np

from kiteocp.recording.blocks import Course
from kiteocp.recording.cleaning import FloatArray


def cartesian(
    distance_m: FloatArray, elevation_deg: FloatArray, bearing_deg: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the position to east, to north and upwards (m) from distance, elevation and bearing."""
    across = distance_m * np.cos(np.radians(elevation_deg))
    bearing = np.radians(bearing_deg)
    return across * np.sin(bearing), across * np.cos(bearing), distance_m * np.sin(np.radians(elevation_deg))


def cartesian_velocity(
    velocity: tuple[FloatArray, FloatArray, FloatArray],
    elevation_deg: FloatArray,
    azimuth_deg: FloatArray,
    bearing0: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the velocity to east, to north and upwards of a spherical one (`spherical_velocity` undone)."""
    radial, polar, azimuthal = velocity
    beta, bearing = np.radians(elevation_deg), np.radians(bearing0 - azimuth_deg)
    outwards = radial * np.cos(beta) + polar * np.sin(beta)
    # Azimuthal is to the left, seen from above looking outwards.
    east = outwards * np.sin(bearing) - azimuthal * np.cos(bearing)
    north = outwards * np.cos(bearing) + azimuthal * np.sin(bearing)
    return east, north, radial * np.sin(beta) - polar * np.cos(beta)


def spherical_velocity(
    velocity: tuple[FloatArray, FloatArray, FloatArray],
    elevation_deg: FloatArray,
    azimuth_deg: FloatArray,
    bearing0: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return radial, polar (towards the ground) and azimuthal velocity of a velocity to north, east and up, in m/s.

    Parameters
    ----------
    velocity
        To north, to east and upwards, m/s, each of shape (n,).
    elevation_deg, azimuth_deg
        Of the kite, in the conventions of the model.
    bearing0
        Bearing of azimuth zero, that is of downwind, deg clockwise from north.
    """
    north, east, up = velocity
    # The wind reference frame: x downwind, y to the left of it, z up.
    bearing = np.radians(bearing0)
    downwind = north * np.cos(bearing) + east * np.sin(bearing)
    left = north * np.sin(bearing) - east * np.cos(bearing)
    beta, phi = np.radians(elevation_deg), np.radians(azimuth_deg)
    outwards = downwind * np.cos(phi) + left * np.sin(phi)
    radial = outwards * np.cos(beta) + up * np.sin(beta)
    polar = outwards * np.sin(beta) - up * np.cos(beta)
    azimuthal = left * np.cos(phi) - downwind * np.sin(phi)
    return radial, polar, azimuthal


def model_course(block: Course, recorded_deg: FloatArray) -> FloatArray:
    """Return the model's course (0 down, 90 to the left as seen from the ground station, 180 up) of a recorded one."""
    if block.zero == "up":
        return 180.0 - recorded_deg if block.sense == "counter-clockwise" else 180.0 + recorded_deg
    return recorded_deg if block.sense == "clockwise" else -recorded_deg
