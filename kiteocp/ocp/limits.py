"""The limits of the machine: which quantity each one bounds, in which phases, from which side.

One table serves the optimal control problem (its bounds), the report of active limits and the check of margins.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from kiteocp.cycle.phases import PHASES, PhaseName
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure

Side = Literal["lower", "upper"]


@dataclass(frozen=True)
class PathLimit:
    """A limit that holds at every instant of some phases.

    Attributes
    ----------
    key
        Key path in the problem file.
    quantity
        The bounded quantity in SI units, an output of the phase or a state.
    side
        Whether it is a lower or an upper bound of the quantity.
    factor
        The quantity's bound is this times the number in the file: a unit, and -1 for speeds and powers reeling in.
    phases
        Where it holds.
    """

    key: str
    quantity: str
    side: Side
    factor: float = 1.0
    phases: tuple[PhaseName, ...] = PHASES

    def bound(self, values: Parameters | ParameterValues) -> Any:
        """Bound of the quantity in SI units, symbolic or numeric."""
        return self.factor * values[self.key]


#: Typical sizes of the bounded quantities, by which the optimal control problem scales them.
SCALES: dict[str, float] = {
    "tether_force_kite": 1000.0,
    "tether_force_ground": 1000.0,
    "radial_ground_force": 1000.0,
    "reeling_speed": 10.0,
    "power": 1e4,
    "height": 100.0,
    "tether_length": 100.0,
    "elevation": 1.0,
}

_STEEP: tuple[PhaseName, ...] = ("retraction", "transition")


def path_limits(structure: Structure) -> list[PathLimit]:
    """Return the limits that a problem of this structure has at every instant."""
    lowest = f"tether_force_{structure.choice('limits.tether_force_min_at')}"
    highest = f"tether_force_{structure.choice('limits.tether_force_max_at')}"
    degree = np.pi / 180
    limits = [
        PathLimit("limits.tether_force_min_N", lowest, "lower"),
        PathLimit("limits.tether_force_max_N", highest, "upper"),
        PathLimit("limits.reel_in_speed_max_m_s", "reeling_speed", "lower", -1.0),
        PathLimit("limits.reel_out_speed_max_m_s", "reeling_speed", "upper"),
        PathLimit("limits.motor_power_max_W", "power", "lower", -1.0),
        PathLimit("limits.generator_power_max_W", "power", "upper"),
        PathLimit("limits.height_min_m", "height", "lower"),
        PathLimit("limits.height_max_m", "height", "upper"),
        PathLimit("limits.tether_length_min_m", "tether_length", "lower"),
        PathLimit("limits.tether_length_max_m", "tether_length", "upper"),
        PathLimit("limits.elevation_max_deg", "elevation", "upper", degree, _STEEP),
        PathLimit("limits.traction_elevation_min_deg", "elevation", "lower", degree, ("traction",)),
        PathLimit("limits.traction_elevation_max_deg", "elevation", "upper", degree, ("traction",)),
    ]
    return [limit for limit in limits if limit.key in structure.keys]


def bounds_of(
    limits: list[PathLimit], values: Parameters | ParameterValues, phase: PhaseName, quantity: str
) -> tuple[Any, Any]:
    """Lower and upper bound of a quantity in a phase, infinite where there is none."""
    found: dict[Side, Any] = {"lower": -np.inf, "upper": np.inf}
    for limit in limits:
        if limit.quantity == quantity and phase in limit.phases:
            found[limit.side] = limit.bound(values)
    return found["lower"], found["upper"]
