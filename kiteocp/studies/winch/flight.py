"""The pumping cycle flown under winch laws, the kite in equilibrium with the winch at every instant.

The winch measures the force at the ground and reels at the speed of its law; the kite reels at the speed of its
equilibrium at that force. The force at which the two agree is found inside the symbolic model by bisection, which
needs no smoothness of the law and cannot lose the root: the kite's speed falls with the force, the law's does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from kiteocp.cycle.laws import STATE
from kiteocp.cycle.motion import Motion, at_force, motion
from kiteocp.cycle.phases import KINDS, PhaseName
from kiteocp.cycle.simulation import LONGEST_PHASE, STATE_SCALES
from kiteocp.cycle.summary import PhaseRecord, electrical_energy_J
from kiteocp.errors import CycleError
from kiteocp.numerics.integrator import IntegrationError, Integrator
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.physics.equilibrium import OUTPUTS, outputs_of
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameters_of
from kiteocp.studies.winch.law import WinchLaw, is_monotone, progress_of

#: Numbers of a piecewise linear table as the functions take it; shorter tables are padded by their last value.
TABLE_KNOTS = 17

#: Halvings of the interval of the force, which starts at so many times the largest force: to 1e-9 N.
HALVINGS = 48
FORCE_RANGE = 8.0

#: Difference of the speeds of kite and winch (m/s) above which the bisection ended at the edge of the steady states.
AGREEMENT_M_S = 1e-5

#: Samples of a phase, and the integration error, relative: laws have kinks, on which the integrator takes small steps.
SAMPLES = 241
TOLERANCE = 1e-8


class Switching(msgspec.Struct, frozen=True):
    """When phases end, by what a ground station knows.

    The retraction ends at a tether length or at the highest elevation, whichever comes first, the transition at an
    elevation, the traction at a tether length, a turn at an elevation.
    """

    retraction_length_m: float
    elevation_max_deg: float
    transition_elevation_deg: float
    traction_length_m: float
    start_elevation_deg: float
    start_length_m: float
    turn_elevation_deg: float | None = None

    @classmethod
    def of(cls, cycle: OptimalCycle) -> Switching:
        """Where the phases of an optimum end."""
        retraction, transition, traction, *turn = cycle.records
        return cls(
            retraction_length_m=float(retraction.tether_length_m[-1]),
            elevation_max_deg=cycle.values["limits.elevation_max_deg"],
            transition_elevation_deg=float(np.degrees(transition.elevation_rad[-1])),
            traction_length_m=float(traction.tether_length_m[-1]),
            start_elevation_deg=float(np.degrees(retraction.elevation_rad[0])),
            start_length_m=float(retraction.tether_length_m[0]),
            turn_elevation_deg=float(np.degrees(turn[0].elevation_rad[-1])) if turn else None,
        )


class HeldQuantities(msgspec.Struct, frozen=True):
    """What the kite's own controller holds in a phase: quantities over its progress, as piecewise linear tables.

    ``tables`` has for each of ``power_setting``, ``course`` (rad) and, in the traction, ``elevation`` (rad) that is not
    constant its knots and values.
    """

    tables: Mapping[str, tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, cycle: OptimalCycle, name: PhaseName) -> HeldQuantities:
        """Read the schedules of an optimum beside the winch's.

        Raises
        ------
        CycleError
            A quantity is scheduled and the progress of the phase is not monotone.
        """
        record = cycle.record(name)
        _, progress = progress_of(record)
        samples: dict[str, np.ndarray]
        samples = {q: record.steered[q] for q in ("power_setting", "course") if q in record.steered}
        # The kite holds the elevation itself over the length: a rate or a course held open loop would drift away.
        # That a course other than the mean one climbs is then a matter of the kite's controller.
        if name == "traction" and np.ptp(record.elevation_rad) > 0:
            samples["elevation"] = record.elevation_rad
        if samples and not is_monotone(progress):
            raise CycleError(name, "at once: what the kite holds is no function of tether length", reason="schedule")
        # Knots even in time are dense in length where much happens while little is reeled.
        chosen = np.linspace(0, progress.size - 1, TABLE_KNOTS).round().astype(int)
        knots = progress[chosen]
        rising = np.argsort(knots)
        return cls({q: (knots[rising], s[chosen][rising]) for q, s in samples.items()})


def fly_laws(
    values: ParameterValues,
    laws: Mapping[PhaseName, WinchLaw],
    switching: Switching,
    held: Mapping[PhaseName, HeldQuantities],
) -> list[PhaseRecord]:
    """Simulate a cycle under winch laws.

    It starts where the optimum does, which is where its last phase ends.

    Parameters
    ----------
    values
        Environment, kite and machine; the wind need not be that of the laws.
    laws, switching, held
        What winch and kite do in each phase.

    Returns
    -------
    list of PhaseRecord
        The phases in order.

    Raises
    ------
    CycleError
        A law and the kite agree on no state, or a phase does not end.
    """
    length, elevation = switching.start_length_m, float(np.radians(switching.start_elevation_deg))
    records: list[PhaseRecord] = []
    for name in laws:
        records.append(_fly(values, name, laws[name], held[name], switching, np.array([0.0, length, elevation, 0.0])))
        length, elevation = float(records[-1].tether_length_m[-1]), float(records[-1].elevation_rad[-1])
    return records


def _fly(
    values: ParameterValues,
    name: PhaseName,
    law: WinchLaw,
    held: HeldQuantities,
    switching: Switching,
    start: np.ndarray,
) -> PhaseRecord:
    quantities = tuple(sorted(held.tables))
    functions = law_functions(values.structure, name, quantities)
    none = (np.array([0.0, 1.0]), np.zeros(2))
    own = (law.knots, law.reeling_speed_m_s)
    tables = [own if law.kind == "force" else none, own if law.kind == "length" else none]
    tables += [held.tables[quantity] for quantity in quantities]
    arguments = np.concatenate([values.vector, *(_table(*table) for table in tables)])
    states = _integrated(name, functions.integrators, switching, start, arguments, values[LONGEST_PHASE])
    rates = np.asarray(functions.rates.map(len(states))(states.T, arguments)).T
    time = np.linspace(0.0, states[-1, 0], SAMPLES)
    samples = CubicHermiteSpline(states[:, 0], states, rates)(time)
    outputs = np.asarray(functions.outputs.map(SAMPLES)(samples.T, arguments))
    elevation = samples[:, 2]
    if "elevation" in held.tables:
        elevation = np.interp(samples[:, 1], *held.tables["elevation"])
    electrical = electrical_energy_J(values, states, rates[:, 3])
    return PhaseRecord(name, time, samples[:, 1], elevation, outputs, float(states[-1, 3]), electrical)


def _integrated(
    name: PhaseName,
    integrators: Mapping[str, Integrator],
    switching: Switching,
    start: np.ndarray,
    arguments: np.ndarray,
    longest_s: float,
) -> np.ndarray:
    """Integrate to the end of a phase; the retraction ends at its length or at its highest elevation."""
    ends = {
        "retraction": ("length", switching.retraction_length_m),
        "transition": ("elevation", float(np.radians(switching.transition_elevation_deg))),
        "traction": ("length", switching.traction_length_m),
        "turn": ("elevation", float(np.radians(switching.turn_elevation_deg or 0.0))),
    }
    target, end = ends[name]
    top = float(np.radians(switching.elevation_max_deg))
    try:
        states = integrators[target].run(start, arguments, end, longest_s)
        if name != "retraction" or states[:, 2].max() <= top + 1e-9:
            return states
    except IntegrationError as error:
        if name != "retraction":
            raise _stuck(name, error) from None
    try:
        return integrators["elevation"].run(start, arguments, top, longest_s)
    except IntegrationError as error:
        raise _stuck(name, error) from None


def _stuck(name: PhaseName, error: IntegrationError) -> CycleError:
    """Say where a phase cannot go on under its law."""
    time, length, elevation = float(error.state[0]), float(error.state[1]), float(np.degrees(error.state[2]))
    why = "it does not end" if error.reason == "too_long" else "kite and law agree on no steady state"
    return CycleError(
        name,
        f"after {time:.3g} s at {length:.4g} m of tether and {elevation:.3g} deg elevation: {why}",
        {"time_s": time, "tether_length_m": length, "elevation_deg": elevation},
        reason="endless" if error.reason == "too_long" else "domain",
    )


def _table(knots: np.ndarray, entries: np.ndarray) -> np.ndarray:
    """Pad a table to `TABLE_KNOTS`, its last value held."""
    missing = TABLE_KNOTS - knots.size
    width = max(float(knots[-1] - knots[0]), 1.0)
    padding = knots[-1] + width * np.arange(1, missing + 1)
    return np.concatenate([knots, padding, entries, np.full(missing, entries[-1])])


class LawFunctions(msgspec.Struct, frozen=True):
    """CasADi functions of a phase under a law; the arguments are the problem's parameters and the tables.

    ``rates(state, arguments)`` are the time derivatives of `STATE`, ``outputs(state, arguments)`` the quantities of
    `OUTPUTS`; the integrators end at a tether length and at an elevation.
    """

    rates: ca.Function
    outputs: ca.Function
    integrators: Mapping[str, Integrator]


@lru_cache(maxsize=32)
def law_functions(structure: Structure, name: PhaseName, quantities: tuple[str, ...]) -> LawFunctions:
    """Build (once) the functions of a phase for a set of held quantities."""
    kind, parameters = KINDS[name], parameters_of(structure)
    model = Model(parameters)
    state = ca.SX.sym("state", len(STATE))
    names = ("force_law", "length_law", *quantities)
    tables = {quantity: ca.SX.sym(quantity, 2 * TABLE_KNOTS) for quantity in names}
    length = state[1]
    progress = state[2] * (180 / np.pi) if kind.progress == "elevation" else length
    held = {quantity: _interpolated(tables[quantity], progress) for quantity in quantities}

    def moved(force: Any) -> Motion:
        """Motion at a radial ground force; an elevation that is held is not moved."""
        return motion(
            model,
            kind,
            length,
            held.get("elevation", state[2]),
            at_force(lambda *_: force),
            power_setting=held.get("power_setting"),
            course=held.get("course"),
        )

    feed_forward = _interpolated(tables["length_law"], progress)

    def gap(flight: Any) -> Any:
        """Speed of the kite less that of the winch; falls with the force."""
        speed = feed_forward + _interpolated(tables["force_law"], flight.tether_force_ground)
        speed = ca.fmin(
            ca.fmax(speed, -parameters["limits.reel_in_speed_max_m_s"]), parameters["limits.reel_out_speed_max_m_s"]
        )
        return flight.reeling_speed - speed

    everything = ca.vertcat(parameters.vector, *tables.values())
    force = ca.SX.sym("radial_ground_force")
    difference = ca.Function("gap", [force, state, everything], [gap(moved(force).flight)])
    low, high = ca.SX(0.0), FORCE_RANGE * parameters["limits.tether_force_max_N"]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        # Not a number is a force too small for any equilibrium: the root lies above it.
        above = difference(middle, state, everything) <= 0
        low, high = ca.if_else(above, low, middle), ca.if_else(above, middle, high)
    met = moved(high)
    flight = met.flight
    # The bisection also stops where the steady states end or at the largest force: no state, 0/0 there.
    agrees = ca.logic_and(ca.fabs(difference(high, state, everything)) <= AGREEMENT_M_S, length > 0)
    speed = flight.reeling_speed + ca.if_else(agrees, 0.0, np.nan)
    # The kite's controller keeps the elevation of the traction, whatever course it steers.
    rate = met.elevation_rate if kind.course is not None else ca.SX(0.0)
    outputs = outputs_of(flight)
    rates = ca.Function("rates", [state, everything], [ca.densify(ca.vertcat(1.0, speed, rate, flight.power))])
    at = ca.Function("outputs", [state, everything], [ca.densify(ca.vertcat(*(outputs[n] for n in OUTPUTS)))])
    index = {"length": STATE.index("tether_length_m"), "elevation": STATE.index("elevation_rad")}
    return LawFunctions(
        rates,
        at,
        {end: Integrator(rates, component, False, STATE_SCALES, TOLERANCE) for end, component in index.items()},
    )


def _interpolated(table: Any, value: Any) -> Any:
    """Value of a piecewise linear table (knots, then entries), constant beyond its outer knots."""
    knots, entries = table[:TABLE_KNOTS], table[TABLE_KNOTS:]
    slopes = (entries[1:] - entries[:-1]) / (knots[1:] - knots[:-1])
    return entries[0] + ca.dot(slopes, ca.fmin(ca.fmax(value, knots[:-1]), knots[1:]) - knots[:-1])
