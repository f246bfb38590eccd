"""The paper's equations in plain NumPy, written from the paper and apart from the package, for the tests to hold it to.

Angles in rad, SI units, spherical components (radial, polar, azimuthal); ``theta`` is the polar angle, 90 deg less the
elevation. Arrays of places have the columns of `kiteocp.physics.equilibrium.POSITION_ARGUMENTS`, angles in deg.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kiteocp import Problem

#: Columns of named quantities, shape (n,) each, from parameter values, places (n, 6) and what is given (n,).
StateTable = Callable[..., dict[str, np.ndarray]]


@dataclass(frozen=True)
class Places:
    """Places of random or chosen states as columns, with what of the environment follows from them."""

    r: np.ndarray
    theta: np.ndarray
    phi: np.ndarray
    chi: np.ndarray
    lift: np.ndarray
    drag: np.ndarray
    v_w: np.ndarray
    rho: np.ndarray
    area: float
    mass: float
    tether_mass: np.ndarray
    gravity: float

    @classmethod
    def of(cls, problem: Problem, table: np.ndarray) -> Places:
        """Evaluate atmosphere, lumped drag and tether mass at places, shape (n, 6), with a logarithmic wind."""
        r, elevation, azimuth, course, lift, kite_drag = table.T
        wind, air, tether = problem.environment.wind, problem.environment.air, problem.tether
        theta = np.radians(90 - elevation)
        z = r * np.cos(theta)
        z0 = wind.roughness_length_m
        return cls(
            r=r,
            theta=theta,
            phi=np.radians(azimuth),
            chi=np.radians(course),
            lift=lift,
            # eq:totaldragcoeff
            drag=kite_drag + tether.diameter_m * r / problem.kite.projected_area_m2 * tether.drag_coefficient / 4,
            # eq:windshear, eq:airdensity
            v_w=wind.reference_speed_m_s * np.log(z / z0) / np.log(wind.reference_height_m / z0),
            rho=air.density_sea_level_kg_m3 * np.exp(-z / air.density_scale_height_m),
            area=problem.kite.projected_area_m2,
            mass=problem.kite.mass_kg,
            tether_mass=tether.density_kg_m3 * np.pi * tether.diameter_m**2 / 4 * r,
            gravity=problem.environment.gravity_m_s2,
        )

    @property
    def c_r(self) -> np.ndarray:
        """Resultant coefficient, eq:aerocoeff."""
        return np.sqrt(self.lift**2 + self.drag**2)

    @property
    def q(self) -> np.ndarray:
        """Dynamic pressure of the wind, eq:dynamicpressure."""
        return 0.5 * self.rho * self.v_w**2

    @property
    def a(self) -> np.ndarray:
        """Wind along the course over the wind speed, eq:a_trigcoeff."""
        return np.cos(self.theta) * np.cos(self.phi) * np.cos(self.chi) - np.sin(self.phi) * np.sin(self.chi)

    @property
    def b(self) -> np.ndarray:
        """Wind along the tether over the wind speed, eq:b_trigcoeff."""
        return np.sin(self.theta) * np.cos(self.phi)

    def discriminant(self, kappa: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Radicand of eq:lambda."""
        return self.a**2 + self.b**2 - 1 + kappa**2 * (self.b - f) ** 2

    def factor(self, kappa: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Tangential speed factor, eq:lambda (the larger root)."""
        return self.a + np.sqrt(self.discriminant(kappa, f))

    def apparent_wind(self, f: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """Apparent wind in spherical components, eq:v_a3, shape (3, n)."""
        return self.v_w * np.array(
            [
                np.sin(self.theta) * np.cos(self.phi) - f,
                np.cos(self.theta) * np.cos(self.phi) - factor * np.cos(self.chi),
                -np.sin(self.phi) - factor * np.sin(self.chi),
            ]
        )

    def unit_vectors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Radial, polar and azimuthal unit vectors in Cartesian components (x downwind, z up), each of shape (3, n)."""
        sin_t, cos_t, sin_p, cos_p = np.sin(self.theta), np.cos(self.theta), np.sin(self.phi), np.cos(self.phi)
        zero = np.zeros_like(sin_t)
        return (
            np.array([sin_t * cos_p, sin_t * sin_p, cos_t]),
            np.array([cos_t * cos_p, cos_t * sin_p, -sin_t]),
            np.array([-sin_p, cos_p, zero]),
        )


def random_places(count: int, seed: int, *, plane: bool = False) -> np.ndarray:
    """Return places of a wide range of kites, tethers and directions, shape (count, 6)."""
    rng = np.random.default_rng(seed)
    azimuth = np.zeros(count) if plane else rng.uniform(-60, 60, count)
    course = rng.choice([0.0, 180.0], count) if plane else rng.uniform(-180, 180, count)
    return np.column_stack(
        [
            rng.uniform(100, 1000, count),
            rng.uniform(5, 85, count),
            azimuth,
            course,
            rng.uniform(0.1, 1.0, count),
            rng.uniform(0.03, 0.25, count),
        ]
    )
