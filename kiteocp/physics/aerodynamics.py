"""Lumped aerodynamic coefficients and force of kite and tether (section 2.2 of the paper)."""

from __future__ import annotations

from typing import Any

import casadi as ca


def total_drag_coefficient(
    kite_drag_coefficient: Any,
    projected_area: Any,
    tether_length: Any,
    tether_diameter: Any,
    tether_drag_coefficient: Any,
) -> Any:
    """Drag coefficient of the kite with a quarter of the tether's drag area lumped to it (eq:totaldragcoeff)."""
    return kite_drag_coefficient + 0.25 * tether_diameter * tether_length / projected_area * tether_drag_coefficient


def resultant_coefficient(lift_coefficient: Any, drag_coefficient: Any) -> Any:
    """Coefficient of the resultant aerodynamic force (eq:aerocoeff)."""
    return ca.sqrt(lift_coefficient**2 + drag_coefficient**2)


def aerodynamic_force(density: Any, coefficient: Any, apparent_wind_speed: Any, projected_area: Any) -> Any:
    """Magnitude of an aerodynamic force (eq:tetherforce_a, eq:F_a_magnitude2), N."""
    return 0.5 * density * coefficient * apparent_wind_speed**2 * projected_area


def apparent_wind_speed_of_force(force: Any, density: Any, coefficient: Any, projected_area: Any) -> Any:
    """Apparent wind speed at which the aerodynamic force has the given magnitude (eq:tetherforce_a solved), m/s."""
    return ca.sqrt(2 * force / (density * coefficient * projected_area))


def wind_power_density(density: Any, wind_speed: Any) -> Any:
    """Power of the wind through a unit area (eq:powerdensity), W/m2."""
    return 0.5 * density * wind_speed**3


def harvesting_factor(power: Any, density: Any, wind_speed: Any, projected_area: Any) -> Any:
    """Power over the wind power through the projected kite area (eq:power, eq:meanharvestfact)."""
    return power / (wind_power_density(density, wind_speed) * projected_area)
