"""The limits of the cycle: which quantity each one bounds, in which phases, from which side.

One table serves the optimal control problem (its bounds), the report of active limits and the check of margins. Every
bound that can shape an optimum is a row of it, and so a key of the problem file: those of the machine and those within
which the model has a steady state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from kiteocp.cycle.phases import PHASES, PhaseName
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.physics.equilibrium import OUTPUTS
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure

Side = Literal["lower", "upper", "both"]


@dataclass(frozen=True)
class Measure:
    """How the number in the file becomes the bound of a quantity in SI units, symbolic or numeric, and back."""

    to_quantity: Callable[[Any], Any]
    to_file: Callable[[Any], Any]


SAME = Measure(lambda number: number, lambda value: value)
#: Speeds and powers of reeling in are positive in the file and negative in the model.
OPPOSITE = Measure(lambda number: -number, lambda value: -value)
DEGREES = Measure(lambda number: number * (np.pi / 180), lambda value: value * (180 / np.pi))
#: The kinematic ratio is the tangent of the inflow angle.
RATIO_OF_ANGLE = Measure(ca.atan, np.tan)


@dataclass(frozen=True)
class Limit:
    """A limit that holds in some phases: at every instant, or for the phase as a whole.

    Attributes
    ----------
    key
        Key path in the problem file.
    quantity
        The bounded quantity, a place, an output of a flight state or a control; of a whole phase ``duration`` or
        ``stroke``.
    side
        Whether it is a lower or an upper bound of the quantity, or an upper one of its magnitude.
    measure
        From the number in the file to the bound.
    phases
        Where it holds.
    whole
        Whether it holds for the phase as a whole.
    """

    key: str
    quantity: str
    side: Side
    measure: Measure = SAME
    phases: tuple[PhaseName, ...] = PHASES
    whole: bool = False

    def bound(self, values: Parameters | ParameterValues) -> Any:
        """Bound of the quantity in SI units, symbolic or numeric."""
        return self.measure.to_quantity(values[self.key])

    def samples(self, record: PhaseRecord) -> np.ndarray | None:
        """Return the bounded quantity over a record in SI units, shape (n,), of a whole phase shape (1,).

        None where the limit does not hold in that phase, or the phase has no such quantity.
        """
        if record.name not in self.phases:
            return None
        found = quantity_of(record, self.quantity)
        return None if found is None else np.atleast_1d(found)

    def size(self, values: ParameterValues) -> float:
        """Size that gaps to the limit are relative to: the bound, or a hundredth of the quantity's scale if larger."""
        return max(abs(float(self.bound(values))), 0.01 * SCALES[self.quantity])

    def margin(self, record: PhaseRecord, values: ParameterValues) -> float | None:
        """Return the smallest of `distances`, minus infinity where one is not a number."""
        found = self.distances(record, values)
        if found is None:
            return None
        return float(np.min(found)) if np.all(np.isfinite(found)) else -np.inf

    def distances(self, record: PhaseRecord, values: ParameterValues) -> np.ndarray | None:
        """Return the distance of each of `samples` to the limit over `size`, negative where it is exceeded."""
        samples = self.samples(record)
        return None if samples is None else self._gaps(samples, float(self.bound(values))) / self.size(values)

    def share(self, record: PhaseRecord, values: ParameterValues, within: float) -> float | None:
        """Return the share of the time of a record during which the quantity is this near to the limit, over `size`.

        Zero where it is near at single instants only, None where it never is.
        """
        samples = self.samples(record)
        if samples is None:
            return None
        near = np.abs(self._gaps(samples, float(self.bound(values)))) <= within * self.size(values)
        if not near.any():
            return None
        if self.whole:
            return 1.0
        return min(float(np.trapezoid(near.astype(float), record.time_s) / record.duration_s), 1.0)

    def reached(self, record: PhaseRecord) -> float | None:
        """Return the sample that comes nearest to the limit or exceeds it most, in the unit of the file."""
        samples = self.samples(record)
        if samples is None:
            return None
        worst = samples[np.argmin(self._gaps(samples, 0.0))]
        return float(self.measure.to_file(abs(worst) if self.side == "both" else worst))

    def _gaps(self, samples: np.ndarray, bound: float) -> np.ndarray:
        if self.side == "lower":
            return samples - bound
        return bound - (np.abs(samples) if self.side == "both" else samples)


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
    "elevation_rate": 0.01,
    "course": 1.0,
    "power_setting": 1.0,
    "inflow_angle": 1.0,
    "forward_airspeed_ratio": 1.0,
    "duration": 10.0,
    "stroke": 100.0,
}

_STEEP: tuple[PhaseName, ...] = ("retraction", "transition")
_RETRACTION: tuple[PhaseName, ...] = ("retraction",)
_TRANSITION: tuple[PhaseName, ...] = ("transition",)
_TRACTION: tuple[PhaseName, ...] = ("traction",)


def limits_of(structure: Structure) -> list[Limit]:
    """Return all limits that a problem of this structure has, but for that of the winch's acceleration."""
    lowest = f"tether_force_{structure.choice('limits.tether_force_min_at')}"
    highest = f"tether_force_{structure.choice('limits.tether_force_max_at')}"
    limits = [
        Limit("limits.tether_force_min_N", lowest, "lower"),
        Limit("limits.tether_force_max_N", highest, "upper"),
        Limit("limits.radial_ground_force_min_N", "radial_ground_force", "lower"),
        Limit("limits.reel_in_speed_max_m_s", "reeling_speed", "lower", OPPOSITE),
        Limit("limits.reel_out_speed_max_m_s", "reeling_speed", "upper"),
        Limit("limits.motor_power_max_W", "power", "lower", OPPOSITE),
        Limit("limits.generator_power_max_W", "power", "upper"),
        Limit("limits.height_min_m", "height", "lower"),
        Limit("limits.height_max_m", "height", "upper"),
        Limit("limits.tether_length_min_m", "tether_length", "lower"),
        Limit("limits.tether_length_max_m", "tether_length", "upper"),
        Limit("limits.elevation_max_deg", "elevation", "upper", DEGREES, _STEEP),
        Limit("limits.traction_elevation_min_deg", "elevation", "lower", DEGREES, _TRACTION),
        Limit("limits.traction_elevation_max_deg", "elevation", "upper", DEGREES, _TRACTION),
        Limit("limits.traction_elevation_rate_max_deg_s", "elevation_rate", "both", DEGREES, _TRACTION),
        Limit("limits.traction_course_min_deg", "course", "lower", DEGREES, _TRACTION),
        Limit("limits.traction_course_max_deg", "course", "upper", DEGREES, _TRACTION),
        Limit("limits.power_setting_min", "power_setting", "lower"),
        Limit("limits.power_setting_max", "power_setting", "upper"),
        Limit("limits.kinematic_ratio_min", "inflow_angle", "lower", RATIO_OF_ANGLE),
        Limit("limits.kinematic_ratio_max", "inflow_angle", "upper", RATIO_OF_ANGLE),
        Limit("limits.forward_airspeed_ratio_min", "forward_airspeed_ratio", "lower", phases=_TRACTION),
        Limit("limits.retraction_duration_min_s", "duration", "lower", phases=_RETRACTION, whole=True),
        Limit("limits.transition_duration_min_s", "duration", "lower", phases=_TRANSITION, whole=True),
        Limit("limits.traction_duration_min_s", "duration", "lower", phases=_TRACTION, whole=True),
        Limit("limits.phase_duration_max_s", "duration", "upper", whole=True),
        Limit("limits.stroke_min_m", "stroke", "lower", phases=_TRACTION, whole=True),
    ]
    return [limit for limit in limits if limit.key in structure.keys]


def path_limits(structure: Structure) -> list[Limit]:
    """Return the limits that a problem of this structure has at every instant."""
    return [limit for limit in limits_of(structure) if not limit.whole]


def bounds_of(
    limits: Sequence[Limit], values: Parameters | ParameterValues, phase: PhaseName, quantity: str
) -> tuple[Any, Any]:
    """Lower and upper bound of a quantity in a phase, infinite where there is none."""
    lower, upper = -np.inf, np.inf
    for limit in limits:
        if limit.quantity == quantity and phase in limit.phases:
            if limit.side in ("lower", "both"):
                lower = -limit.bound(values) if limit.side == "both" else limit.bound(values)
            if limit.side in ("upper", "both"):
                upper = limit.bound(values)
    return lower, upper


def quantity_of(record: PhaseRecord, name: str) -> Any:
    """Return a limited quantity over a record in SI units, shape (n,), one number for ``duration`` and ``stroke``.

    None where the phase has no such quantity.
    """
    if name == "tether_length":
        return record.tether_length_m
    if name == "elevation":
        return record.elevation_rad
    if name == "duration":
        return record.duration_s
    if name == "stroke":
        return record.tether_length_m[-1] - record.tether_length_m[0]
    return record.output(name) if name in OUTPUTS else record.steered.get(name)
