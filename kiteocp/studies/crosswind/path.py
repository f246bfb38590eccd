"""Closed flight paths on the sphere around the ground station: figure of eight and circle."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from kiteocp.errors import InputError, check_word
from kiteocp.ocp.collocation import FloatArray

#: The kinds of path. A figure of eight with up-loops flies up at its sides and down across its middle.
PATHS: tuple[str, ...] = ("eight-up", "eight-down", "circle")

#: Points of a path: smooth and periodic, its averages converge faster than any power of their number.
POINTS = 128

#: Elevation amplitude over azimuth amplitude of a figure of eight whose shape is not given. The figures that a 60 m2
#: kite flew on 12 May 2023 have 0.32 in the median ("Kitepower flight data acquired on 12 May 2023", Schmehl et al.).
ASPECT = 0.3


class FlightPath(msgspec.Struct, frozen=True):
    """A closed path at points evenly spaced in its own parameter; the last point is not the first again.

    Attributes
    ----------
    kind : str
        One of `PATHS`.
    centre_elevation_deg, azimuth_amplitude_deg, elevation_amplitude_deg : float
        Elevation of the centre and half the extent; of a circle both amplitudes are its angular radius.
    azimuth_rad, elevation_rad : numpy.ndarray, shape (n,)
        The points.
    course_rad : numpy.ndarray, shape (n,)
        Direction of the tangent: 0 straight down, pi/2 towards positive azimuth, pi straight up.
    length_rad : numpy.ndarray, shape (n,)
        Length on the unit sphere that each point stands for; the sum is that of the path.
    curvature : numpy.ndarray, shape (n,)
        Geodesic curvature on the unit sphere: the tether length over it is the turning radius.
    """

    kind: str
    centre_elevation_deg: float
    azimuth_amplitude_deg: float
    elevation_amplitude_deg: float
    azimuth_rad: FloatArray
    elevation_rad: FloatArray
    course_rad: FloatArray
    length_rad: FloatArray
    curvature: FloatArray


def figure_of_eight(
    centre_elevation_deg: float,
    azimuth_amplitude_deg: float,
    elevation_amplitude_deg: float | None = None,
    *,
    up: bool,
    points: int = POINTS,
) -> FlightPath:
    """Return the path ``azimuth = A sin(s)``, ``elevation = centre + B sin(2 s)`` or, with up-loops, minus.

    Parameters
    ----------
    centre_elevation_deg, azimuth_amplitude_deg, elevation_amplitude_deg
        Centre, A and B; B is `ASPECT` of A where left out.
    up
        True for up-loops: up at the sides, down across the middle.
    points
        Number of points, even.

    Raises
    ------
    InputError
        The path is no path above the ground and before the zenith.
    """
    if elevation_amplitude_deg is None:
        elevation_amplitude_deg = ASPECT * azimuth_amplitude_deg
    _check(centre_elevation_deg, azimuth_amplitude_deg, elevation_amplitude_deg)
    s = _parameter(points)
    loop = -np.sin(2 * s) if up else np.sin(2 * s)
    azimuth = math.radians(azimuth_amplitude_deg) * np.sin(s)
    elevation = math.radians(centre_elevation_deg) + math.radians(elevation_amplitude_deg) * loop
    return _path(
        "eight-up" if up else "eight-down",
        (centre_elevation_deg, azimuth_amplitude_deg, elevation_amplitude_deg),
        azimuth,
        elevation,
    )


def circle(centre_elevation_deg: float, radius_deg: float, *, points: int = POINTS) -> FlightPath:
    """Return a circle on the sphere about zero azimuth; its sense makes no difference but the sign of the azimuth.

    Parameters
    ----------
    centre_elevation_deg, radius_deg
        Centre and angular radius.
    points
        Number of points, even.

    Raises
    ------
    InputError
        As `figure_of_eight`.
    """
    _check(centre_elevation_deg, radius_deg, radius_deg)
    s = _parameter(points)
    centre, radius = math.radians(centre_elevation_deg), math.radians(radius_deg)
    # Along the tether of the centre, sideways and up from there.
    outward, side, up = math.cos(radius), math.sin(radius) * np.cos(s), math.sin(radius) * np.sin(s)
    forward = outward * math.cos(centre) - up * math.sin(centre)
    elevation = np.arcsin(outward * math.sin(centre) + up * math.cos(centre))
    azimuth = np.arctan2(side, forward)
    return _path("circle", (centre_elevation_deg, radius_deg, radius_deg), azimuth, elevation)


def make_path(
    kind: str, centre_elevation_deg: float, amplitude_deg: float, elevation_amplitude_deg: float | None = None
) -> FlightPath:
    """Return the path of a kind; `amplitude_deg` is the azimuth amplitude of an eight, the radius of a circle.

    Raises
    ------
    InputError
        The kind is unknown, or as `figure_of_eight`.
    """
    check_word("kind", kind, PATHS)
    if kind == "circle":
        return circle(centre_elevation_deg, amplitude_deg)
    return figure_of_eight(centre_elevation_deg, amplitude_deg, elevation_amplitude_deg, up=kind == "eight-up")


def derivative(values: FloatArray) -> FloatArray:
    """Return the derivative of a periodic function over one period of 2 pi, by its Fourier series."""
    n = values.shape[-1]
    order = np.arange(n // 2 + 1)
    # The highest frequency has no derivative on an even number of points.
    order[-1] = 0 if n % 2 == 0 else order[-1]
    slope: FloatArray = np.fft.irfft(1j * order * np.fft.rfft(values), n)
    return slope


def antiderivative(values: FloatArray) -> FloatArray:
    """Return the integral of a periodic function from its first point to each, by its Fourier series."""
    n = values.shape[-1]
    coefficients = np.fft.rfft(values)
    order = np.arange(len(coefficients))
    wave = np.zeros_like(coefficients)
    wave[1:] = coefficients[1:] / (1j * order[1:])
    # Of the highest frequency the points see the cosine only, whose integral vanishes at all of them.
    wave[-1] = 0.0 if n % 2 == 0 else wave[-1]
    periodic: FloatArray = np.fft.irfft(wave, n)
    integral: FloatArray = periodic - periodic[0] + np.mean(values) * _parameter(n)
    return integral


def _parameter(points: int) -> FloatArray:
    return np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)


def _path(kind: str, sizes: tuple[float, float, float], azimuth: FloatArray, elevation: FloatArray) -> FlightPath:
    """Return the path of its points: course, lengths and curvature are those of the curve through them."""
    place = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    tangent = derivative(place)
    speed = np.sqrt(np.sum(tangent**2, axis=0))
    upward = tangent[2] / np.cos(elevation)
    sideward = tangent[1] * np.cos(azimuth) - tangent[0] * np.sin(azimuth)
    bend = np.sum(place * np.cross(tangent, derivative(tangent), axis=0), axis=0)
    return FlightPath(
        kind,
        *sizes,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        course_rad=np.arctan2(sideward, -upward),
        length_rad=speed * (2.0 * np.pi / len(azimuth)),
        curvature=bend / speed**3,
    )


def _check(centre_deg: float, azimuth_amplitude_deg: float, elevation_amplitude_deg: float) -> None:
    for name, amplitude in (("azimuth", azimuth_amplitude_deg), ("elevation", elevation_amplitude_deg)):
        if not 0.0 < amplitude < 90.0:
            raise InputError(f"the {name} amplitude of the path is {amplitude:g} deg; give one between 0 and 90 deg")
    low, high = centre_deg - elevation_amplitude_deg, centre_deg + elevation_amplitude_deg
    if not (low > 0.0 and high < 90.0):
        raise InputError(
            f"the path reaches from {low:.4g} to {high:.4g} deg of elevation; choose a centre and an elevation "
            "amplitude that keep it between 0 and 90 deg"
        )
