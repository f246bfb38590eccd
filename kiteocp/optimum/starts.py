"""Starting points of the optimal cycle: crude cycles from which IPOPT finds its way, cold."""

from __future__ import annotations

import msgspec
import numpy as np

from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.trajectory import Guess, PhaseGuess, Profile, Trajectory
from kiteocp.optimum.phases import SHORTEST_S
from kiteocp.physics.aerodynamics import total_drag_coefficient
from kiteocp.physics.parameters import ParameterValues


class Start(msgspec.Struct, frozen=True):
    """A crude cycle of straight lines.

    Attributes
    ----------
    name
        For the report.
    traction_elevation_deg, top_elevation_deg
        Elevation of the traction, and at the end of the retraction.
    stroke_share
        Stroke as a share of the range of tether lengths, from the shortest tether on.
    durations_s
        Of retraction, transition and traction.
    """

    name: str
    traction_elevation_deg: float
    top_elevation_deg: float
    stroke_share: float
    durations_s: tuple[float, float, float]


#: Long tractions after a steep transition, long strokes, and short cycles are the kinds of local optima that were seen;
#: one start near each. Of 332 problems with a cycle (75 winds and 400 random draws of `benchmarks.family`) the first
#: led to the best optimum of all in 328 and failed in 4; it never led to a worse one. The others: 325 and 324.
STARTS = (
    Start("steep transition", 27.0, 80.0, 1.0, (45.0, 12.0, 90.0)),
    Start("long stroke", 27.0, 70.0, 1.0, (45.0, 8.0, 45.0)),
    Start("short cycle", 22.0, 40.0, 0.2, (15.0, 4.0, 20.0)),
)

#: Duration of a turn at the start, and its climb as a share of that to the end of the retraction.
TURN_S, TURN_CLIMB_SHARE = 4.0, 0.3

#: How many random starts are tried where none of the others led to a cycle, and the seed that makes them repeatable.
RESCUE_STARTS = 10
RESCUE_SEED = 20190101


def random_start(random: np.random.Generator, name: str = "random") -> Start:
    """Draw a crude cycle from a wide range."""
    low = float(random.uniform(20.0, 60.0))
    return Start(
        name,
        low,
        float(random.uniform(low, 85.0)),
        float(random.uniform(0.05, 1.0)),
        (float(random.uniform(5.0, 100.0)), float(random.uniform(1.0, 20.0)), float(random.uniform(20.0, 120.0))),
    )


def rescue_starts() -> list[Start]:
    """Return the random starts for problems that resist the others, the same ones at every call."""
    random = np.random.default_rng(RESCUE_SEED)
    return [random_start(random, f"random {i + 1}") for i in range(RESCUE_STARTS)]


#: Forces of the start over the limits: a little inside them.
TRACTION_FORCE_SHARE = 0.9
RETRACTION_FORCE_SHARE = 1.1


def guess_of(start: Start, values: ParameterValues, program: NonlinearProgram) -> Guess:
    """Return the values of a start for the variables a program has.

    Parameters
    ----------
    start
        The crude cycle.
    values
        The problem's numbers.
    program
        Decides which variables there are; the values serve any mesh.
    """
    shortest, longest = values["limits.tether_length_min_m"], values["limits.tether_length_max_m"]
    end = shortest + start.stroke_share * (longest - shortest)
    lowest, highest = values["limits.tether_force_min_N"], values["limits.tether_force_max_N"]
    low, top = np.radians([start.traction_elevation_deg, start.top_elevation_deg])
    lengths = {
        "retraction": (end, shortest),
        "transition": (shortest, shortest),
        "traction": (shortest, end),
        "turn": (end, end),
    }
    turned = low + TURN_CLIMB_SHARE * (top - low) if len(program.problem.phases) > len(start.durations_s) else low
    elevations = {"retraction": (turned, top), "transition": (top, low), "traction": (low, low), "turn": (low, turned)}
    forces = {
        "retraction": RETRACTION_FORCE_SHARE * lowest,
        "transition": 0.5 * (lowest + highest),
        "traction": TRACTION_FORCE_SHARE * highest,
        "turn": TRACTION_FORCE_SHARE * highest,
    }
    phases = {}
    for phase, duration in zip(program.problem.phases, (*start.durations_s, TURN_S), strict=False):
        setting = "depowered" if phase.name == "retraction" else "powered"
        profiles: dict[str, Profile] = {
            "tether_length": _line(*lengths[phase.name]),
            "elevation": _line(*elevations[phase.name]),
            "radial_ground_force": forces[phase.name],
            # The massless kite's (eq:triangle_similarity), with the drag of half the longest tether.
            "inflow_angle": float(np.arctan(_lift_to_drag(values, setting, 0.5 * longest))),
            "power_setting": 0.1 if setting == "depowered" else 0.9,
            "elevation_rate": 0.0,
            "course": float(np.radians(values["operation.traction.course_deg"])),
        }
        names = [v.name for v in (*phase.states, *phase.algebraics, *phase.controls)]
        phases[phase.name] = PhaseGuess(duration, {name: profiles[name] for name in names})
    fixed = {"elevation": float(low), "elevation_rate": 0.0}
    return Guess(phases, {static.name: fixed[static.name] for static in program.problem.statics})


def enriched(trajectory: Trajectory, values: ParameterValues, program: NonlinearProgram) -> Guess:
    """Return a cycle of less freedom as a start for a program of more, which takes its further controls as they were.

    Parameters
    ----------
    trajectory
        A solution with constant elevation and fixed power setting.
    values, program
        As for `guess_of`.
    """
    elevation = trajectory.statics["elevation"]
    known = trajectory.guess().phases
    held: dict[str, Profile] = {
        "elevation": elevation,
        "elevation_rate": 0.0,
        "course": float(np.radians(values["operation.traction.course_deg"])),
    }
    phases = {}
    known = {**known, "turn": _no_turn(trajectory, SHORTEST_S)}
    for phase in program.problem.phases:
        settings: dict[str, Profile] = {"power_setting": 0.0 if phase.name == "retraction" else 1.0}
        available = {**held, **settings, **known[phase.name].values}
        names = [v.name for v in (*phase.states, *phase.algebraics, *phase.controls)]
        phases[phase.name] = PhaseGuess(known[phase.name].duration, {name: available[name] for name in names})
    fixed = {"elevation": elevation, "elevation_rate": 0.0}
    return Guess(phases, {static.name: fixed[static.name] for static in program.problem.statics})


def _no_turn(trajectory: Trajectory, duration: float) -> PhaseGuess:
    """Return a turn of next to no time where the traction of a cycle ends."""
    traction, names = trajectory["traction"], ("tether_length", "radial_ground_force", "inflow_angle")
    values: dict[str, Profile] = {name: float(traction.values[name][-1]) for name in names if name in traction.values}
    return PhaseGuess(duration, {"elevation": trajectory.statics["elevation"], **values})


def _line(start: float, end: float) -> Profile:
    return lambda fractions: start + (end - start) * fractions


def _lift_to_drag(values: ParameterValues, setting: str, tether_length: float) -> float:
    lift = values[f"kite.{setting}.lift_coefficient"]
    drag = total_drag_coefficient(
        values.kite_drag_coefficient(setting),
        values["kite.projected_area_m2"],
        tether_length,
        values["tether.diameter_m"],
        values["tether.drag_coefficient"],
    )
    return float(lift / drag)


def pinned_start(values: ParameterValues, program: NonlinearProgram) -> tuple[Guess, dict[int, float]]:
    """Return a start near the shortest traction, and the pin that holds its duration there.

    Solving with the pin and then releasing it leads to the local optimum of short cycles from far away.
    """
    [index] = program.find_variables(phase="traction", kind="duration")
    shortest = values["limits.traction_duration_min_s"]
    start = Start("shortest traction", 27.0, 50.0, 0.3, (20.0, 5.0, shortest))
    return guess_of(start, values, program), {int(index): shortest / program.variables[index].scale}
