"""What is checked of an optimal cycle: its limits, its re-simulation by the independent integrator, its mean power."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from kiteocp.cycle.objective import POWERS, energy, mean_power
from kiteocp.cycle.phases import KINDS, PhaseName
from kiteocp.cycle.schedule import outputs_on_schedule, record_of_flight
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.errors import CycleError
from kiteocp.optimum.check import Check, Level
from kiteocp.optimum.cycle import SAMPLES_OF_AN_INTERVAL, OptimalCycle, speed_jumps
from kiteocp.physics.equilibrium import OUTPUTS

#: A limit may be exceeded by this share of itself, anywhere in time.
MARGIN_TOLERANCE = 5e-3

#: Gaps of the re-simulated cycle: energy relative to that of the traction, tether length over the stroke, elevation.
ENERGY_TOLERANCE = 1e-3
LENGTH_TOLERANCE = 1e-3
ELEVATION_TOLERANCE_DEG = 0.1

#: Relative difference between the mean power that was maximised and that of the cycle; both are the same quadrature.
OBJECTIVE_TOLERANCE = 1e-6

#: Difference between the states of a solution at its mesh points and the closed form there, over their typical sizes.
STATE_TOLERANCE = 1e-5
COMPARISON_SCALES = {"reeling_speed": 10.0, "tangential_speed": 10.0, "tether_force_ground": 1e3, "power": 1e4}

#: A quick certificate allows this many times these gaps: on a coarse mesh a force overshoots its limit between two
#: points, the winch of the re-simulation cuts that off, and the cycle drifts by it. The power is not touched by that.
QUICK_ALLOWANCE = 4.0


class LimitMargin(msgspec.Struct, frozen=True):
    """The point where a cycle comes nearest to a limit, or exceeds it most.

    Attributes
    ----------
    key
        Key path of the limit.
    phase
        Where that is.
    margin
        Distance to the limit over the limit; negative where it is exceeded.
    """

    key: str
    phase: str
    margin: float


def limit_margins(cycle: OptimalCycle, flown: Sequence[PhaseRecord]) -> list[LimitMargin]:
    """Find the worst margin of every limit: in the samples that are written, in each mesh interval, re-simulated."""
    values = cycle.values
    records = [*cycle.records, *cycle.fine_records, *flown]
    margins = []
    for limit in cycle.limits:
        # A phase that is flown until its time is over says nothing of limits of the whole.
        judged = cycle.records if limit.whole else records
        reached = zip(limit.margins(judged, values), judged, strict=True)
        found = [(margin, record.name) for margin, record in reached if margin is not None]
        if found:
            margin, name = min(found)
            margins.append(LimitMargin(limit.key, name, margin))
    return margins


def intervals_beyond(cycle: OptimalCycle) -> dict[PhaseName, np.ndarray]:
    """Find the mesh intervals that exceed a limit by more than half the tolerance, by phase; shape (intervals,)."""
    found: dict[PhaseName, np.ndarray] = {}
    for record in cycle.fine_records:
        distances = []
        for limit in cycle.limits:
            found_here = None if limit.whole else limit.distances(record, cycle.values)
            if found_here is not None:
                # Of each two samples the nearer one; a rate is between them already.
                distances.append(found_here if limit.rate else np.fmin(found_here[:-1], found_here[1:]))
        nearest = np.min(distances, axis=0).reshape(-1, SAMPLES_OF_AN_INTERVAL).min(axis=1)
        found[record.name] = ~(nearest >= -0.5 * MARGIN_TOLERANCE)
    return found


def limits_check(margins: Sequence[LimitMargin]) -> Check:
    """Check that no limit is exceeded by more than the tolerance, at the mesh points and between them."""
    worst = min(margins, key=lambda item: item.margin if np.isfinite(item.margin) else -np.inf)
    passed = bool(np.isfinite(worst.margin) and worst.margin >= -MARGIN_TOLERANCE)
    violation = max(-worst.margin, 0.0) if np.isfinite(worst.margin) else None
    if passed and worst.margin >= -1e-6:
        text = f"all {len(margins)} limits are kept, between the mesh points too"
    elif violation is None:
        # Any limit would do: where there is no state, none of its quantities is a number.
        text = f"in the {worst.phase} there is no steady flight between some mesh points, and no limit to compare"
    else:
        allowed = f"{100 * MARGIN_TOLERANCE:g} % allowed"
        text = f"worst: {worst.key} exceeded by {-100 * worst.margin:.2g} % in the {worst.phase} ({allowed})"
    return Check("limits", passed, violation, MARGIN_TOLERANCE, text)


def resimulation_check(cycle: OptimalCycle, level: Level = "full") -> tuple[Check, list[PhaseRecord], dict[str, Any]]:
    """Fly the schedule by the independent integrator and compare energy, tether length and elevation.

    Parameters
    ----------
    cycle
        The solution.
    level
        How near is near enough.

    Returns
    -------
    check, flown, facts
        Of the flown phases there are none where the flight ended early.
    """
    facts: dict[str, Any]
    allowed = QUICK_ALLOWANCE if level == "quick" else 1.0
    tolerance = allowed * ENERGY_TOLERANCE
    if not all(np.array_equal(phase.parameters, cycle.values.vector) for phase in cycle.trajectory.phases.values()):
        text = "the solution belongs to other numbers than those of the problem"
        return Check("re-simulation", False, None, tolerance, text), [], {"completed": False, "message": text}
    try:
        flown = cycle.resimulate()
    except CycleError as error:
        text = f"the optimal schedule cannot be flown, its {error.phase} ends {error.cause}"
        facts = {"completed": False, "message": text}
        return Check("re-simulation", False, None, tolerance, text), [], facts
    records = [record_of_flight(cycle.values, *pair) for pair in zip(cycle.schedules, flown, strict=True)]
    traction = cycle.record("traction")
    ends = {record.name: record for record in cycle.records}
    stroke = float(traction.tether_length_m[-1] - traction.tether_length_m[0])
    # Of the mechanical energy and, behind generator and motor, of the electrical one: the larger of both gaps.
    gaps = {of: (energy(records, of) - energy(cycle.records, of)) / abs(traction.energy_J) for of in POWERS}
    energy_gap = max(gaps.values(), key=abs)
    length_gap = float(flown[-1].states[-1, 1] - cycle.records[-1].tether_length_m[-1])
    missed = [
        phase.states[-1, 2] - ends[phase.name].elevation_rad[-1]
        for phase in flown
        if KINDS[phase.name].progress == "elevation"
    ]
    elevation_gap = float(np.degrees(max(missed, key=abs)))
    state_gap = _state_gap(cycle)
    passed = (
        state_gap <= STATE_TOLERANCE
        and abs(energy_gap) <= tolerance
        and abs(length_gap) <= allowed * LENGTH_TOLERANCE * abs(stroke)
        and abs(elevation_gap) <= allowed * ELEVATION_TOLERANCE_DEG
    )
    text = (
        f"energy differs by {100 * energy_gap:+.1g} % of the traction's, tether length by {length_gap:+.2g} m, "
        f"elevation by {elevation_gap:+.1g} deg"
    )
    if not state_gap <= STATE_TOLERANCE:
        text += f"; the states at the mesh points are not those of the model (by {state_gap:.1g} of their size)"
    facts = {
        "completed": True,
        "energy_J": energy(records, "mechanical"),
        "electrical_energy_J": energy(records, "electrical"),
        "energy_gap": gaps["mechanical"],
        "electrical_energy_gap": gaps["electrical"],
        "tether_length_gap_m": length_gap,
        "elevation_gap_deg": elevation_gap,
        "state_gap": state_gap,
    }
    return Check("re-simulation", bool(passed), abs(energy_gap), tolerance, text), records, facts


def _state_gap(cycle: OptimalCycle) -> float:
    """Compare speeds, force and power of the solution at its mesh points with the closed form there."""
    gap = 0.0
    for schedule in cycle.schedules:
        phase = cycle.trajectory[schedule.name]
        length = phase.values["tether_length"][1:]
        held = cycle.trajectory.statics.get("elevation", np.nan)
        elevation = phase.values["elevation"][1:] if "elevation" in phase.values else np.full(length.size, held)
        # Just inside the piece that ends at a border, where the polynomial of that piece holds.
        times = phase.mesh.points * phase.duration * (1 - 1e-12)
        outputs = outputs_on_schedule(cycle.values, schedule, times, length, elevation)
        for name, scale in COMPARISON_SCALES.items():
            difference = np.abs(outputs[OUTPUTS.index(name)] - phase.values[name]) / scale
            # A number that is missing must not hide.
            gap = max(gap, float(np.max(np.where(np.isfinite(difference), difference, np.inf))))
    return gap


def objective_check(objective_W: float, cycle: OptimalCycle, objective: str) -> Check:
    """Compare the mean power that the program maximised with that of its cycle, phase changes included."""
    mean = mean_power(cycle.records, cycle.values, objective)
    gap = abs(objective_W - mean) / max(abs(mean), 1.0)
    text = f"the program maximised {objective_W:.6g} W, its cycle has {mean:.6g} W of {objective} power"
    return Check("objective", bool(gap <= OBJECTIVE_TOLERANCE), gap, OBJECTIVE_TOLERANCE, text)


def jumps_check(cycle: OptimalCycle, limited: bool) -> Check:
    """Compare the speed jumps between phases with what the winch can do in the phase-change time.

    They decide the status only where the problem asks for jumps that fit (``optimisation.speed_jumps: limited``).
    """
    jumps = speed_jumps(cycle.records, cycle.values)
    worst = max(jumps, key=lambda jump: abs(jump["jump_m_s"]) if np.isfinite(jump["jump_m_s"]) else np.inf)
    fits = abs(worst["jump_m_s"]) <= worst["allowed_m_s"] * (1 + MARGIN_TOLERANCE)
    text = (
        f"largest speed jump {worst['jump_m_s']:+.1f} m/s ({worst['from_phase']} to {worst['to_phase']}), "
        f"the winch can do {worst['allowed_m_s']:g} m/s in the phase-change time"
    )
    return Check("speed jumps", fits if limited else None, abs(worst["jump_m_s"]), worst["allowed_m_s"], text)
