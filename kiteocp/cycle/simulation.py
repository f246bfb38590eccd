"""Forward simulation of the prescribed cycle (sections 2.8 to 2.11 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import get_args

import numpy as np

from kiteocp.cycle.finite_difference import characteristic_time, finite_difference_phase
from kiteocp.cycle.laws import PHASE_ENDS, Equilibrium, flown_in_order, phase_functions
from kiteocp.cycle.limits import Limit, limits_of
from kiteocp.cycle.phases import KINDS, FlownPhase, PhaseName, phases_of
from kiteocp.cycle.summary import (
    PhaseRecord,
    channels_of,
    cycle_summary,
    electrical_energy_J,
    phase_summaries,
    validity_warnings,
)
from kiteocp.cycle.transition import transition_branches
from kiteocp.errors import CycleError, InputError, NoEquilibriumError, check_word
from kiteocp.execution import one_at_a_time
from kiteocp.numerics.integrator import IntegrationError, Integrator
from kiteocp.physics.flight import OperatingPoint, solve_state
from kiteocp.physics.kinematics import UP
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values
from kiteocp.problem import Problem
from kiteocp.report.words import rounded
from kiteocp.result import Result

#: Sizes of the components of the state for the integration error: 10 s, 100 m, 1 rad, 10 kJ.
STATE_SCALES = np.array([10.0, 100.0, 1.0, 1e4])

#: The longest that a phase may take; one that takes longer does not end in practice.
LONGEST_PHASE = "limits.phase_duration_max_s"
#: Smallest nondimensional time step of the finite differences: some million steps a cycle, a minute or so. Rounding
#: outweighs what smaller ones gain.
TIME_STEP_MIN = 1e-6

#: A kite that reels slower than this has come to rest: it comes nearer to a tether length and never gets there.
STANDSTILL_M_S = 1e-6

#: A limit left by less than this share of it is kept: interpolation between samples is no more exact.
LEFT_BY = 1e-4

#: Samples of a time series: one each half second, but so many in every phase.
SAMPLE_TIME_S = 0.5
FEWEST_SAMPLES = 40

#: Parts of a step of order 8 between which cubic polynomials are good to some 1e-6.
PARTS_OF_A_STEP = 6


@one_at_a_time
def simulate(
    problem: Problem,
    *,
    gravity: bool = True,
    time_step: float | None = None,
    equilibrium: Equilibrium = "explicit",
    phase_change_time_s: float = 0.0,
) -> Result:
    """Simulate the prescribed cycle of a problem.

    Parameters
    ----------
    problem
        The problem; its ``operation`` block prescribes the cycle.
    gravity
        False leaves out all weights (section 2.3 of the paper).
    time_step
        Nondimensional time step of the paper's finite-difference scheme (eq:nondimentionaltime); without it the cycle
        is integrated adaptively, to about 1e-7 in powers and durations.
    equilibrium
        ``explicit`` uses the closed form of the force-controlled state, ``rootfinder`` solves the residual at every
        point; they agree to the accuracy of the integration.
    phase_change_time_s
        Time that passes at each of the three phase changes without motion or energy; it counts in the cycle's means.

    Returns
    -------
    Result
        With status ``ok``.

    Raises
    ------
    InputError
        The time step is not a number of at least `TIME_STEP_MIN`, or the word for the equilibrium is not known.
    CycleError
        A state on the way does not exist, or a phase does not end.
    """
    check_word("equilibrium", equilibrium, get_args(Equilibrium))
    if time_step is not None and not TIME_STEP_MIN <= time_step < np.inf:
        raise InputError(
            f"time_step is {time_step:g}, but must be a number not below {TIME_STEP_MIN:g}, as 0.01; without one the "
            "integration is adaptive and more accurate"
        )
    values = parameter_values(problem, gravity=gravity)
    flown = fly(values, equilibrium=equilibrium, time_step=time_step)
    records = [record_of(values, phase, adaptive=time_step is None) for phase in flown]
    phases = phase_summaries(records, values)
    elevation = np.radians(values["operation.traction.elevation_deg"])
    lengths = values["operation.tether_length_min_m"] + values["operation.tether_length_max_m"]
    # eq:meantractionaltitude, with the nominal lengths.
    cycle = cycle_summary(
        values,
        phases,
        traction_altitude_m=0.5 * lengths * float(np.sin(elevation)),
        phase_change_time_s=phase_change_time_s,
    )
    told = problem.warnings()
    left = [limit.key for limit in limits_of(values.structure) if _worst(limit, records, values)[0] < -LEFT_BY]
    integration = {
        "scheme": "adaptive" if time_step is None else "finite-difference",
        "time_step": time_step,
        "steps": sum(len(phase.states) - 1 for phase in flown),
        "gravity": gravity,
        "equilibrium": equilibrium,
    }
    return Result(
        verb="simulate",
        problem=problem,
        status="ok",
        warnings=tuple([*told, *validity_warnings(records, values), *limit_warnings(records, values, told)]),
        phases=phases,
        cycle=dict(cycle),
        channels=channels_of(records, values, phase_change_time_s),
        details={"simulation": integration, "outside_limits": left},
    )


def fly(
    values: ParameterValues, *, equilibrium: Equilibrium = "explicit", time_step: float | None = None
) -> list[FlownPhase]:
    """Integrate the prescribed cycle; `simulate` without time series and summary.

    Raises
    ------
    CycleError
        As `simulate`.
    """

    def run(name: PhaseName, start: np.ndarray, end: float) -> np.ndarray:
        _check_start(name, start, end)
        try:
            if time_step is None:
                integrator = _integrators(values.structure, equilibrium)[name]
                return integrator.run(start, values.vector, end, values[LONGEST_PHASE])
            step = time_step * characteristic_time(values)
            return finite_difference_phase(values, name, start, end, step, values[LONGEST_PHASE])
        except IntegrationError as error:
            raise cycle_error(values, name, error.state, error.reason) from None

    return flown_in_order(values, run)


def _check_start(name: PhaseName, start: np.ndarray, end: float) -> None:
    """Refuse a phase that begins beyond its end: the transition flies down, the traction reels out."""
    length, elevation = float(start[1]), float(np.degrees(start[2]))
    if name == "transition" and start[2] <= end:
        cause = f"the retraction ends at {elevation:.3g} deg, not above the traction ({np.degrees(end):.3g} deg)"
    elif name == "traction" and length >= end:
        cause = f"the transition has reeled out to {length:.4g} m of tether, beyond the {end:.4g} m where traction ends"
    else:
        return
    facts = {"tether_length_m": length, "elevation_deg": elevation}
    raise CycleError(name, f"before it begins: {cause}", facts, reason="domain")


@lru_cache(maxsize=32)
def _integrators(structure: Structure, equilibrium: Equilibrium) -> dict[PhaseName, Integrator]:
    integrators = {}
    for name in phases_of(structure):
        end = PHASE_ENDS[name]
        # The law of the transition has kinks: in closed form it is stepped by its branches.
        kinked = name == "transition"
        by_branches = kinked and equilibrium == "explicit"
        rates = transition_branches(structure) if by_branches else phase_functions(structure, name, equilibrium).rates
        order = 5 if kinked and not by_branches else 8
        integrators[name] = Integrator(rates, end.component, end.monotone, STATE_SCALES, order=order)
    return integrators


def record_of(values: ParameterValues, phase: FlownPhase, *, adaptive: bool = True) -> PhaseRecord:
    """Sample a flown phase evenly in time, by cubic Hermite interpolation between steps.

    The steps of the adaptive integrator are too long for that and are divided first.
    """
    functions = phase_functions(values.structure, phase.name)
    states = phase.states
    if adaptive:
        integrator = _integrators(values.structure, "explicit")[phase.name]
        states = integrator.refined(states, values.vector, PARTS_OF_A_STEP)
    count = max(FEWEST_SAMPLES, round(phase.duration_s / SAMPLE_TIME_S)) + 1
    time = np.linspace(0.0, phase.duration_s, count)
    rates = np.asarray(functions.rates.map(len(states))(states.T, values.vector)).T
    samples = _hermite(time, states, rates)
    outputs = np.asarray(functions.outputs.map(count)(samples.T, values.vector))
    electrical = electrical_energy_J(values, states, rates[:, 3])
    return PhaseRecord(phase.name, time, samples[:, 1], samples[:, 2], outputs, phase.energy_J, electrical)


def _hermite(time: np.ndarray, states: np.ndarray, rates: np.ndarray) -> np.ndarray:
    knots = states[:, 0]
    index = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(knots) - 2)
    step = (knots[index + 1] - knots[index])[:, None]
    s = (time - knots[index])[:, None] / step
    left, right = states[index], states[index + 1]
    change = right - left
    samples: np.ndarray = (
        left
        + s * step * rates[index]
        + s**2 * (3 * change - step * (2 * rates[index] + rates[index + 1]))
        + s**3 * (step * (rates[index] + rates[index + 1]) - 2 * change)
    )
    return samples


def cycle_error(values: ParameterValues, name: PhaseName, state: np.ndarray, reason: str) -> CycleError:
    """Say why a phase cannot go on from a state."""
    time, length, elevation = float(state[0]), float(state[1]), float(np.degrees(state[2]))
    facts = {"time_s": time, "tether_length_m": length, "elevation_deg": elevation}
    at = f"after {time:.3g} s at {length:.4g} m of tether and {elevation:.3g} deg elevation"
    try:
        speed = _held_state(values, name, length, elevation)["reeling_speed"]
    except NoEquilibriumError as error:
        return CycleError(name, f"{at}: {error}", facts, reason=error.reason)
    facts["reeling_speed_m_s"] = speed
    if abs(speed) < STANDSTILL_M_S and name != "transition":
        reason = "too_long"
    elif name == "traction" and speed <= 0:
        force = values["operation.traction.tether_force_N"]
        return CycleError(
            name, f"{at}: the kite cannot hold {force:.4g} N while reeling out", facts, reason="force_too_high"
        )
    if reason == "too_long":
        if abs(speed) < STANDSTILL_M_S:
            why = f"it does not end, reeling at {speed:.1g} m/s"
        else:
            why = f"it takes longer than {LONGEST_PHASE} ({values[LONGEST_PHASE]:g} s), reeling at {speed:.3g} m/s"
        return CycleError(name, f"{at}: {why}", facts, reason="endless")
    return CycleError(name, f"{at}: the next state has no equilibrium", facts, reason="domain")


def _held_state(values: ParameterValues, name: PhaseName, length: float, elevation: float) -> dict[str, float]:
    """Solve the state at the force that the phase holds (in the transition at the lower one)."""
    setting = KINDS[name].setting
    crosswind = name == "traction"
    place = OperatingPoint(
        length,
        elevation,
        values["operation.traction.azimuth_deg"] if crosswind else 0.0,
        values["operation.traction.course_deg"] if crosswind else 180.0 if KINDS[name].course is UP else 0.0,
        values[f"kite.{setting}.lift_coefficient"],
        values.kite_drag_coefficient(setting),
    )
    reference = values.structure.choice("operation.force_reference")
    held = "retraction" if name == "transition" else name
    force = values[f"operation.{held}.tether_force_N"]
    return solve_state(values, place, f"tether_force_{reference}", force)


def _worst(limit: Limit, records: Sequence[PhaseRecord], values: ParameterValues) -> tuple[float, PhaseRecord]:
    """Return the smallest margin of a limit and the phase it is in; zero where none has the quantity."""
    margins = [(margin, r) for r in records if (margin := limit.margin(r, values)) is not None]
    return min(margins, key=lambda pair: pair[0], default=(0.0, records[0]))


def limit_warnings(records: Sequence[PhaseRecord], values: ParameterValues, told: Sequence[str]) -> list[str]:
    """Report where a flown cycle leaves the limits of the problem; it is flown all the same.

    Of a limit that a warning of the problem names already nothing is said again.
    """
    warnings = []
    for limit in limits_of(values.structure):
        worst, record = _worst(limit, records, values)
        if worst >= -LEFT_BY or any(f"{limit.key} (" in text for text in told):
            continue
        unit = "" if limit.row.unit == "1" else f" {limit.row.unit}"
        reached = limit.reached(record)
        assert reached is not None
        needs = limit.row.needs.format(rounded(reached, up=reached > values[limit.key]))
        warnings.append(
            f"the prescribed cycle is outside {limit.key} ({values[limit.key]:g}{unit}): it needs {needs} in the "
            f"{record.name}"
        )
    return warnings
