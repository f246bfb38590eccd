"""Velocities of the kite and of the air around it (section 2.2 of the paper).

Spherical components (radial, polar, azimuthal) in the wind reference frame; the polar angle is the complement of the
elevation. A course is given by its cosine and sine, so that straight up and straight down are exact.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import msgspec
import numpy as np


class Course(msgspec.Struct, frozen=True):
    """Course of the kite in the tangential plane: 0 straight down, pi/2 towards positive azimuth, pi straight up."""

    cosine: Any
    sine: Any

    @classmethod
    def of_angle(cls, angle: Any) -> Course:
        """Course of an angle in rad."""
        return cls(ca.cos(angle), ca.sin(angle))


UP = Course(-1.0, 0.0)
DOWN = Course(1.0, 0.0)


class WindComponents(msgspec.Struct, frozen=True):
    """Wind at the kite: along the tether, along the course and across the course (eq:a_trigcoeff, eq:b_trigcoeff)."""

    radial: Any
    along_course: Any
    across_course: Any


def wind_components(wind_speed: Any, elevation: Any, azimuth: Any, course: Course) -> WindComponents:
    """Components of the wind in m/s, radial ``b v_w``, along the course ``a v_w``, and across it."""
    polar = ca.sin(elevation) * ca.cos(azimuth)
    azimuthal = -ca.sin(azimuth)
    return WindComponents(
        radial=wind_speed * ca.cos(elevation) * ca.cos(azimuth),
        along_course=wind_speed * (polar * course.cosine + azimuthal * course.sine),
        across_course=wind_speed * (azimuthal * course.cosine - polar * course.sine),
    )


def tangential_kite_speed(wind: WindComponents, tangential_apparent_wind_speed: Any) -> Any:
    """Tangential kite speed, the larger root (eq:lambda times the wind speed), m/s.

    The apparent wind across the course is the wind's own, so that what remains of its tangential part lies along the
    course: ``a^2 + b^2 - 1 = -(across / v_w)^2``.
    """
    return wind.along_course + ca.sqrt(tangential_apparent_wind_speed**2 - wind.across_course**2)


def elevation_rate(tangential_speed: Any, course: Course, tether_length: Any) -> Any:
    """Rate of the elevation angle, rad/s."""
    return -tangential_speed * course.cosine / tether_length


def kite_speed(reeling_speed: Any, tangential_speed: Any) -> Any:
    """Magnitude of the kite's velocity, m/s."""
    return ca.sqrt(reeling_speed**2 + tangential_speed**2)


def radians(degrees: Any) -> Any:
    """Radians of an angle in degrees."""
    return degrees * (np.pi / 180)
