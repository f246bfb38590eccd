"""Limits in conflict, and the sentence that says so to an operator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from kiteocp.cycle.remedies import listed, rounded, wind_text
from kiteocp.ocp.trajectory import Trajectory
from kiteocp.physics.parameters import ParameterValues

#: What the kite cannot do, and what it would need instead, for each limit.
PHRASES: dict[str, tuple[str, str]] = {
    "tether_force_min_N": ("hold the minimum tether force of {} N", "a minimum tether force of {} N"),
    "tether_force_max_N": ("stay below the maximum tether force of {} N", "a maximum tether force of {} N"),
    "reel_in_speed_max_m_s": ("reel in at no more than {} m/s", "a reel-in speed of up to {} m/s"),
    "reel_out_speed_max_m_s": ("reel out at no more than {} m/s", "a reel-out speed of up to {} m/s"),
    "reeling_acceleration_max_m_s2": (
        "change its reeling speed by no more than {} m/s2",
        "a winch acceleration of up to {} m/s2",
    ),
    "generator_power_max_W": ("keep to the generator's {} W", "a generator power of up to {} W"),
    "motor_power_max_W": ("keep to the motor's {} W", "a motor power of up to {} W"),
    "height_min_m": ("stay above {} m of altitude", "a lowest altitude of {} m"),
    "height_max_m": ("stay below {} m of altitude", "a highest altitude of {} m"),
    "tether_length_min_m": ("keep its tether longer than {} m", "a shortest tether of {} m"),
    "tether_length_max_m": ("keep its tether shorter than {} m", "a longest tether of {} m"),
    "traction_elevation_min_deg": (
        "keep its traction above {} deg of elevation",
        "a lowest traction elevation of {} deg",
    ),
    "traction_elevation_max_deg": (
        "keep its traction below {} deg of elevation",
        "a highest traction elevation of {} deg",
    ),
    "elevation_max_deg": ("stay below {} deg of elevation", "a highest elevation of {} deg"),
    "traction_duration_min_s": ("reel out for at least {} s", "a shortest traction of {} s"),
    "retraction_duration_min_s": ("reel in for at least {} s", "a shortest retraction of {} s"),
    "transition_duration_min_s": ("fly a transition of at least {} s", "a shortest transition of {} s"),
    "phase_duration_max_s": ("finish each phase within {} s", "phases of up to {} s"),
    "radial_ground_force_min_N": (
        "keep a radial pull of {} N at the ground",
        "a smallest radial pull at the ground of {} N",
    ),
    "kinematic_ratio_min": ("keep its kinematic ratio above {}", "a smallest kinematic ratio of {}"),
    "kinematic_ratio_max": ("keep its kinematic ratio below {}", "a largest kinematic ratio of {}"),
    "forward_airspeed_ratio_min": (
        "keep an airspeed along its course of {} times the wind speed",
        "a smallest airspeed along the course of {} times the wind speed",
    ),
    "traction_course_min_deg": ("keep its course in traction above {} deg", "a lowest traction course of {} deg"),
    "traction_course_max_deg": ("keep its course in traction below {} deg", "a highest traction course of {} deg"),
    "power_setting_min": ("keep its power setting above {}", "a lowest power setting of {}"),
    "power_setting_max": ("keep its power setting below {}", "a highest power setting of {}"),
    "stroke_min_m": ("reel out by at least {} m", "a smallest stroke of {} m"),
    "traction_elevation_rate_max_deg_s": (
        "change its elevation in traction by no more than {} deg/s",
        "an elevation rate of up to {} deg/s in traction",
    ),
    "phase_change_time_s": ("change phase in {} s", "a phase-change time of {} s"),
}

#: Limits and alternatives that the sentence names; the conflict lists them all.
NAMED, ALTERNATIVES = 4, 3

#: How the kite flies in a phase.
FLYING = {"retraction": "flying up", "transition": "flying down", "traction": "in traction"}


@dataclass(frozen=True)
class Conflict:
    """One limit of a smallest set that cannot hold together.

    Attributes
    ----------
    key
        Key path in the problem file.
    value
        Its number in the file.
    needed
        The number at which a cycle exists with everything else as it is; None where this limit alone cannot do it.
    relative_change
        Of the number, negative for a lower one.
    phase
        Where it bites most; None where that is no phase.
    elevation_deg, tether_length_m
        Least and greatest there.
    """

    key: str
    value: float
    needed: float | None
    relative_change: float | None
    phase: str | None = None
    elevation_deg: tuple[float, float] | None = None
    tether_length_m: tuple[float, float] | None = None

    @property
    def alone(self) -> bool:
        """Whether moving this limit alone makes a cycle possible."""
        return self.needed is not None


@dataclass(frozen=True)
class Infeasibility:
    """Why no cycle was found.

    Attributes
    ----------
    sentence
        For an operator.
    conflict
        A smallest set of limits that cannot hold together: without any one of them the others could. Those that can
        repair it alone first, the smallest relative change first. Empty where no limit is to blame.
    wind_factor
        Nearest factor of the wind speed at which a cycle exists with all limits as they are; None if none was found.
    wind_needed_m_s
        The reference wind speed then, of a table its largest speed.
    relaxation
        The smallest joint relaxation found: limits and their numbers; empty if no relaxation of limits helps.
    elastic_sum
        Sum of the relative slacks at the joint elastic optimum.
    starts
        From how many starts that was reached.
    start
        The cycle at the elastic optimum, if that vanishes: a start from which to try again, on any mesh.
    """

    sentence: str
    conflict: tuple[Conflict, ...]
    wind_factor: float | None = None
    wind_needed_m_s: float | None = None
    relaxation: Mapping[str, float] = field(default_factory=dict)
    elastic_sum: float | None = None
    starts: int = 0
    start: Trajectory | None = field(default=None, repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for the summary."""
        return {
            "sentence": self.sentence,
            "conflict": [asdict(conflict) | {"alone": conflict.alone} for conflict in self.conflict],
            "wind_factor": self.wind_factor,
            "wind_needed_m_s": self.wind_needed_m_s,
            "relaxation": dict(self.relaxation),
            "elastic_sum": self.elastic_sum,
            "starts": self.starts,
        }


def sentence_of(
    values: ParameterValues,
    conflict: Sequence[Conflict],
    wind_factor: float | None,
    relaxation: Mapping[str, float],
) -> str:
    """Compose the sentence: what cannot be held, where, and the alternatives, the smallest relative change first."""
    if conflict:
        cannot = [_phrase(c.key, 0).format(f"{c.value:.4g}") for c in conflict[:NAMED]]
        if len(conflict) > NAMED:
            cannot.append(f"keep {len(conflict) - NAMED} more of its limits")
        what = f"the kite cannot {listed(cannot, 'and')}{_place(conflict)}"
    else:
        what = "the kite cannot fly a cycle however far its limits are relaxed"
    alternatives = [
        (abs(c.relative_change), need_of(c.key, c.value, c.needed))
        for c in conflict
        if c.needed is not None and c.relative_change is not None
    ]
    if wind_factor is not None:
        alternatives.append((abs(wind_factor - 1), wind_text(values, wind_factor)))
    needs = [text for _, text in sorted(alternatives)[:ALTERNATIVES]]
    if relaxation and not any(c.alone for c in conflict):
        together = listed([need_of(key, values[key], needed) for key, needed in relaxation.items()], "and")
        needs.append(f"{together} together")
    remedy = f"smallest relaxation found: {listed(needs, 'or', always_comma=True)}" if needs else "no relaxation found"
    return f"no cycle found: with {wind_text(values, 1.0)} {what}; {remedy}"


def need_of(key: str, value: float, needed: float) -> str:
    """Name the value a limit would need, rounded to the side that loosens it."""
    return _phrase(key, 1).format(rounded(needed, up=needed > value))


def _phrase(key: str, index: int) -> str:
    return PHRASES[key.partition(".")[2]][index]


def _place(conflict: Sequence[Conflict]) -> str:
    """Say where the conflict bites: there where its first limit does that has a place."""
    for entry in conflict:
        # A limit of the elevation says itself where it bites.
        if entry.phase is not None and entry.elevation_deg is not None and "elevation" not in entry.key:
            low, high = entry.elevation_deg
            at = f"{low:.0f} deg" if high - low < 1 else f"{low:.0f} to {high:.0f} deg"
            joint = "while " if entry.phase != "traction" else ""
            return f" {joint}{FLYING[entry.phase]} at {at} of elevation"
    return ""
