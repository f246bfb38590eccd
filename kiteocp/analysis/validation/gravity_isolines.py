"""Kite mass over course angle and kinematic ratio, the paper's fig:kinematiclifttodragratio."""

from __future__ import annotations

from dataclasses import dataclass

from kiteocp.ocp.collocation import FloatArray


@dataclass(frozen=True)
class GravityIsolines:
    """Mass of a kite without tether that flies a course at a kinematic ratio in equilibrium.

    Attributes
    ----------
    course_deg
        Course angle, shape (n,).
    kinematic_ratio
        Tangential over radial apparent wind speed, shape (m,).
    mass_kg
        Mass, shape (m, n); not a number where no mass of at least 0 gives this state.
    lift_to_drag
        Kinematic ratio of the massless kite.
    """

    course_deg: FloatArray
    kinematic_ratio: FloatArray
    mass_kg: FloatArray
    lift_to_drag: float
