"""What the phases of a pumping cycle are: setting and course of the kite, what ends them, and their order.

A phase is a row here. Programs, laws, schedules and reports take the phases of a cycle from `phases_of`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import msgspec
import numpy as np

from kiteocp.errors import InputError
from kiteocp.physics.kinematics import DOWN, UP, Course, radians
from kiteocp.physics.model import Model, Position
from kiteocp.physics.parameters import Structure

PhaseName = Literal["retraction", "transition", "traction", "turn"]


class PhaseKind(msgspec.Struct, frozen=True):
    """How the kite flies in a phase.

    Attributes
    ----------
    name
        The phase.
    setting
        Which coefficients of the kite apply.
    course
        Course flown in the plane of the wind; None for crosswind flight at the mean course and azimuth of the file.
    progress
        What tells how far the phase is, and ends it: ``tether_length`` or ``elevation``.
    words
        How the kite flies in it, in a sentence.
    """

    name: PhaseName
    setting: Literal["powered", "depowered"]
    course: Course | None
    progress: Literal["tether_length", "elevation"]
    words: str

    def position(self, model: Model, tether_length: Any, elevation: Any) -> Position:
        """Position and course of the kite at a tether length (m) and an elevation (rad)."""
        if self.course is not None:
            return Position(tether_length, elevation, 0.0, self.course)
        p = model.parameters
        azimuth = radians(p["operation.traction.azimuth_deg"])
        return Position(tether_length, elevation, azimuth, Course.of_angle(radians(p["operation.traction.course_deg"])))


RETRACTION = PhaseKind("retraction", "depowered", UP, "tether_length", "while flying up")
TRANSITION = PhaseKind("transition", "powered", DOWN, "elevation", "while flying down")
TRACTION = PhaseKind("traction", "powered", None, "tether_length", "in traction")
#: The powered climb after the traction, before the kite is depowered; flown with ``optimisation.turn: flown``.
TURN = PhaseKind("turn", "powered", UP, "elevation", "while turning up")

KINDS: dict[PhaseName, PhaseKind] = {kind.name: kind for kind in (RETRACTION, TRANSITION, TRACTION, TURN)}

#: The phases of the paper in the order of its cycle, which starts with the retraction (section 2.8).
PHASES: tuple[PhaseName, ...] = ("retraction", "transition", "traction")

#: Changes between phases that take time, ``limits.phase_change_time_s`` each: the kite is powered or depowered, or
#: begins to fly crosswind. From the traction into the turn it just flies on.
PHASE_CHANGES = 3


def phases_with(turn: str) -> tuple[PhaseName, ...]:
    """Return the phases of a cycle, the retraction first, for a word of ``optimisation.turn``."""
    return (*PHASES, TURN.name) if turn == "flown" else PHASES


def phases_of(structure: Structure) -> tuple[PhaseName, ...]:
    """Return the phases of the cycle of a problem in their order."""
    return phases_with(structure.choice("optimisation.turn"))


def require_three_phases(structure: Structure, who: str) -> None:
    """Refuse a cycle with a turn where only the phases of the paper are known.

    Raises
    ------
    InputError
        The turn is flown.
    """
    if phases_of(structure) != PHASES:
        raise InputError(f"{who} flies {', '.join(PHASES)} only; set optimisation.turn to none")


def pauses_after(names: Sequence[str], pause: Any) -> list[Any]:
    """Return the time that passes after each phase of a cycle until the next begins, of a phase change that takes time.

    Parameters
    ----------
    names
        Phases in their order.
    pause
        Time of a phase change, symbolic or numeric.
    """
    return [0.0 * pause if after == TURN.name else pause for after in (*names[1:], names[0])]


class FlownPhase(msgspec.Struct, frozen=True):
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
