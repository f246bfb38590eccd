"""A phase flown by a schedule: the independent forward integration by which an optimum is checked.

The schedule is piecewise polynomial in time. What it gives is what a controller holds (radial tether force at the
ground, power setting, and in the traction the rate of the mean elevation or the mean course); where the kite goes
follows from the closed form of the equilibrium and the adaptive integrator, which share nothing with the collocation.
The winch saturates: a scheduled force beyond the tether force limits is held at the limit; and so does the power
setting, at fully powered and depowered.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.cycle.laws import STATE
from kiteocp.cycle.motion import at_force, motion
from kiteocp.cycle.phases import KINDS, FlownPhase, PhaseName
from kiteocp.cycle.simulation import STATE_SCALES, cycle_error
from kiteocp.cycle.summary import PhaseRecord, electrical_energy_J
from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.numerics.integrator import IntegrationError, Integrator
from kiteocp.physics.equilibrium import OUTPUTS, outputs_of
from kiteocp.physics.model import LocalConditions, Model
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure
from kiteocp.physics.wind import prepared, prepared_parameters

#: What a schedule may give; the first is always given, the others where the phase does not prescribe them.
FORCE = "radial_ground_force"
SCHEDULED = (FORCE, "power_setting", "elevation_rate", "course")

#: Highest polynomial degree of a piece plus one: a continuous control has the degree of the mesh, nine at most.
COEFFICIENTS = 10

#: What the kite's controller commands, with the keys of its range and their unit. Between the points of a mesh it holds
#: these limits, as the winch holds those of the force.
COMMANDED: Mapping[str, tuple[str, float]] = {
    "power_setting": ("limits.power_setting_{}", 1.0),
    "course": ("limits.traction_course_{}_deg", np.pi / 180),
}


def commanded_range(quantity: str, values: Parameters | ParameterValues) -> tuple[Any, Any]:
    """Least and greatest of a commanded quantity in SI units, symbolic or numeric."""
    key, unit = COMMANDED[quantity]
    return unit * values[key.format("min")], unit * values[key.format("max")]


class Schedule(msgspec.Struct, frozen=True):
    """Polynomials of time for one phase.

    Attributes
    ----------
    name
        The phase.
    borders_s
        Ends of the pieces, from 0 to the duration of the phase, shape (pieces + 1,).
    coefficients
        For each scheduled quantity the polynomial coefficients, lowest first, in the time since the start of the piece
        over its width, shape (pieces, at most COEFFICIENTS).
    """

    name: PhaseName
    borders_s: np.ndarray
    coefficients: Mapping[str, np.ndarray]

    @property
    def quantities(self) -> tuple[str, ...]:
        """The scheduled quantities, in the order of `SCHEDULED`."""
        return tuple(name for name in SCHEDULED if name in self.coefficients)

    def piece(self, index: int) -> np.ndarray:
        """Return the numbers of one piece as the functions take them: start, width, coefficients."""
        start, end = self.borders_s[index], self.borders_s[index + 1]
        rows = []
        for name in self.quantities:
            row = np.zeros(COEFFICIENTS)
            given = self.coefficients[name][index]
            row[: given.size] = given
            rows.append(row)
        return np.concatenate([[start, end - start], *rows])

    def value(self, name: str, time_s: np.ndarray) -> np.ndarray:
        """Return a scheduled quantity at times within the phase, shape as ``time_s``."""
        index = np.clip(np.searchsorted(self.borders_s, time_s, side="right") - 1, 0, self.borders_s.size - 2)
        s = (time_s - self.borders_s[index]) / np.diff(self.borders_s)[index]
        *lower, values = self.coefficients[name][index].T
        for coefficient in reversed(lower):
            values = values * s + coefficient
        return np.asarray(values, dtype=np.float64)


class ScheduleFunctions(msgspec.Struct, frozen=True):
    """CasADi functions of a phase flown by a schedule; p are the prepared numbers (`kiteocp.physics.wind.prepared`).

    ``rates(state, p and one piece)``; ``outputs(tether length, elevation, scheduled quantities, p)``.
    """

    rates: ca.Function
    outputs: ca.Function


@lru_cache(maxsize=64)
def schedule_functions(structure: Structure, name: PhaseName, quantities: tuple[str, ...]) -> ScheduleFunctions:
    """Build (once) the functions of a phase for a set of scheduled quantities."""
    kind, (parameters, everything) = KINDS[name], prepared_parameters(structure)
    model = Model(parameters)
    length, elevation = ca.SX.sym("tether_length"), ca.SX.sym("elevation")
    scheduled = {quantity: ca.SX.sym(quantity) for quantity in quantities}
    values = ca.vertcat(*scheduled.values())
    for quantity in COMMANDED.keys() & scheduled.keys():
        low, high = commanded_range(quantity, parameters)
        scheduled[quantity] = ca.fmin(ca.fmax(scheduled[quantity], low), high)
    moved = motion(
        model,
        kind,
        length,
        elevation,
        at_force(lambda model, around: _saturated(model, around, scheduled[FORCE])),
        power_setting=scheduled.get("power_setting"),
        course=scheduled.get("course"),
        elevation_rate=scheduled.get("elevation_rate"),
    )
    flight, rate = moved.flight, moved.elevation_rate
    outputs = outputs_of(flight)
    point = ca.Function(
        "point",
        [length, elevation, values, everything],
        [
            ca.densify(ca.vertcat(flight.reeling_speed, rate, flight.power)),
            ca.densify(ca.vertcat(*(outputs[output] for output in OUTPUTS))),
        ],
    )
    state = ca.SX.sym("state", len(STATE))
    piece = ca.SX.sym("piece", 2 + COEFFICIENTS * len(quantities))
    s = (state[0] - piece[0]) / piece[1]
    powers = ca.vertcat(*(s**k for k in range(COEFFICIENTS)))
    table = ca.reshape(piece[2:], COEFFICIENTS, len(quantities))
    movement, _ = point(state[1], state[2], table.T @ powers, everything)
    arguments = ca.vertcat(everything, piece)
    rates = ca.Function("rates", [state, arguments], [ca.densify(ca.vertcat(1.0, movement))])
    at = ca.Function(
        "outputs",
        [length, elevation, values, everything],
        [point(length, elevation, values, everything)[1]],
    )
    return ScheduleFunctions(rates, at)


def _saturated(model: Model, around: LocalConditions, force: Any) -> Any:
    """Keep a scheduled radial force within the tether force limits, as a winch does."""
    p = model.parameters
    low, high = (
        model.radial_ground_force(
            around,
            p[f"limits.tether_force_{side}_N"],
            model.structure.choice(f"limits.tether_force_{side}_at"),
        )
        for side in ("min", "max")
    )
    return ca.fmin(ca.fmax(force, low), high)


@lru_cache(maxsize=64)
def _integrator(structure: Structure, name: PhaseName, quantities: tuple[str, ...]) -> Integrator:
    return Integrator(schedule_functions(structure, name, quantities).rates, 0, True, STATE_SCALES)


def fly_schedule(
    values: ParameterValues, schedule: Schedule, tether_length_m: float, elevation_rad: float
) -> FlownPhase:
    """Integrate a phase under its schedule, from a given place.

    Raises
    ------
    CycleError
        A state on the way does not exist.
    """
    integrator = _integrator(values.structure, schedule.name, schedule.quantities)
    state = np.array([0.0, tether_length_m, elevation_rad, 0.0])
    states, numbers = [state[None, :]], prepared(values)
    for index in range(schedule.borders_s.size - 1):
        arguments = np.concatenate([numbers, schedule.piece(index)])
        try:
            end = float(schedule.borders_s[index + 1])
            flown = integrator.run(state, arguments, end, end)
        except IntegrationError as error:
            raise cycle_error(values, schedule.name, error.state, error.reason) from None
        states.append(flown[1:])
        state = flown[-1]
    return FlownPhase(schedule.name, np.concatenate(states))


@lru_cache(maxsize=256)
def _outputs_at(structure: Structure, name: PhaseName, quantities: tuple[str, ...], count: int) -> BufferedFunction:
    """Build (once) the outputs at so many points; the parameters are those of all."""
    outputs = schedule_functions(structure, name, quantities).outputs
    return BufferedFunction(outputs.map("outputs", "serial", count, [3], []))


def outputs_on_schedule(
    values: ParameterValues,
    schedule: Schedule,
    time_s: np.ndarray,
    tether_length_m: np.ndarray,
    elevation_rad: np.ndarray,
) -> np.ndarray:
    """Evaluate the quantities of `OUTPUTS` along a phase, shape (len(OUTPUTS), n), from the place and the schedule."""
    scheduled = np.column_stack([schedule.value(name, time_s) for name in schedule.quantities])
    mapped = _outputs_at(values.structure, schedule.name, schedule.quantities, time_s.size)
    found = mapped(tether_length_m, elevation_rad, scheduled.ravel(), prepared(values))
    return found.reshape(time_s.size, len(OUTPUTS)).T.copy()


def record_on_schedule(
    values: ParameterValues,
    schedule: Schedule,
    time_s: np.ndarray,
    places: tuple[np.ndarray, np.ndarray],
    energies_J: tuple[float, float],
) -> PhaseRecord:
    """Put samples of a scheduled phase into a record.

    Parameters
    ----------
    values, schedule
        The problem's numbers and what was held.
    time_s, places
        Samples of the time in the phase, tether length (m) and elevation (rad), shape (n,) each.
    energies_J
        Mechanical and electrical energy delivered over the phase.
    """
    outputs = outputs_on_schedule(values, schedule, time_s, *places)
    steered = {name: schedule.value(name, time_s) for name in schedule.quantities if name != FORCE}
    for name in COMMANDED.keys() & steered.keys():
        steered[name] = np.clip(steered[name], *commanded_range(name, values))
    return PhaseRecord(schedule.name, time_s, *places, outputs, *energies_J, steered)


def record_of_flight(values: ParameterValues, schedule: Schedule, flown: FlownPhase) -> PhaseRecord:
    """Put a phase flown by a schedule into a record, sampled at the steps of the integrator."""
    time, length, elevation, _ = flown.states.T
    record = record_on_schedule(values, schedule, time, (length, elevation), (flown.energy_J, np.nan))
    electrical = electrical_energy_J(values, flown.states, record.output("power"))
    return replace(record, electrical_energy_J=electrical)
