"""What the phases of a pumping cycle are: setting and course of the kite, and which numbers of the file apply."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from kiteocp.physics.kinematics import DOWN, UP, Course, radians
from kiteocp.physics.model import Model, Position

PhaseName = Literal["retraction", "transition", "traction"]

#: The phases in the order of the cycle, which starts with the retraction (section 2.8 of the paper).
PHASES: tuple[PhaseName, ...] = ("retraction", "transition", "traction")

#: Changes between phases in a cycle, one after each phase.
PHASE_CHANGES = len(PHASES)


@dataclass(frozen=True)
class PhaseKind:
    """How the kite flies in a phase.

    Attributes
    ----------
    name
        The phase.
    setting
        Which coefficients of the kite apply.
    course
        Course flown in the plane of the wind; None for crosswind flight at the mean course and azimuth of the file.
    """

    name: PhaseName
    setting: Literal["powered", "depowered"]
    course: Course | None

    def position(self, model: Model, tether_length: Any, elevation: Any) -> Position:
        """Position and course of the kite at a tether length (m) and an elevation (rad)."""
        if self.course is not None:
            return Position(tether_length, elevation, 0.0, self.course)
        p = model.parameters
        azimuth = radians(p["operation.traction.azimuth_deg"])
        return Position(tether_length, elevation, azimuth, Course.of_angle(radians(p["operation.traction.course_deg"])))


RETRACTION = PhaseKind("retraction", "depowered", UP)
TRANSITION = PhaseKind("transition", "powered", DOWN)
TRACTION = PhaseKind("traction", "powered", None)

KINDS: dict[PhaseName, PhaseKind] = {kind.name: kind for kind in (RETRACTION, TRANSITION, TRACTION)}


@dataclass(frozen=True)
class FlownPhase:
    """States (time, tether length, elevation in rad, energy) at the steps of an integrator.

    Shape (n, 4); time and energy count from the start of the phase.
    """

    name: PhaseName
    states: np.ndarray

    @property
    def duration_s(self) -> float:
        """Duration of the phase."""
        return float(self.states[-1, 0])

    @property
    def energy_J(self) -> float:
        """Mechanical energy delivered over the phase."""
        return float(self.states[-1, 3])
