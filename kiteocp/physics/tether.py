"""Tether weight and sag (section 2.5 of the paper): how one tether force becomes another.

The straight tether carries at the ground the radial force ``F_gr``. Half its weight across the tether acts at each
end, the whole weight along the tether at the kite.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np


def tether_mass(tether_length: Any, diameter: Any, density: Any) -> Any:
    """Mass of the reeled-out tether, kg."""
    return density * np.pi / 4 * diameter**2 * tether_length


def sag_force(mass: Any, elevation: Any, gravity: Any) -> Any:
    """Force across the tether at either end, half of its weight's component there (eq:tether_force), N."""
    return 0.5 * mass * gravity * ca.cos(elevation)


def weight_along(mass: Any, elevation: Any, gravity: Any) -> Any:
    """Component of a weight along the tether, towards the ground (eq:force_gravity), N."""
    return mass * gravity * ca.sin(elevation)


def force_at_ground(radial_ground_force: Any, sag: Any) -> Any:
    """Tether force at the ground (the equation after eq:tether_force), N."""
    return ca.sqrt(radial_ground_force**2 + sag**2)


def force_at_kite(radial_ground_force: Any, sag: Any, tether_weight_along: Any) -> Any:
    """Tether force at the kite (eq:force_tether solved for F_t), N."""
    return ca.sqrt((radial_ground_force + tether_weight_along) ** 2 + sag**2)


def radial_force_of_ground_force(tether_force_ground: Any, sag: Any) -> Any:
    """Radial ground force of a given tether force at the ground, N; not a number below the sag force."""
    return ca.sqrt(tether_force_ground**2 - sag**2)


def radial_force_of_kite_force(tether_force_kite: Any, sag: Any, tether_weight_along: Any) -> Any:
    """Radial ground force of a given tether force at the kite, N; not a number below the sag force."""
    return ca.sqrt(tether_force_kite**2 - sag**2) - tether_weight_along


def relative_gravitational_force(tether_weight: Any, tether_force_kite: Any) -> Any:
    """Weight of the tether over its tension, gamma of eq:rel_gravitational_Force; small means little sag."""
    return tether_weight / tether_force_kite
