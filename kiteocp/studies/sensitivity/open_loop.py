"""The nominal schedule flown open loop while the numbers of the problem change.

Forces, power settings and rates of the optimum are functions of time. On other numbers the kite reels at another speed,
so that the same times would end elsewhere and the cycle would not close. The comparison with a re-optimised cycle is
made fair by what real winch controllers do: each phase is stretched in time, its schedule with it, until it ends where
the nominal one does - the retraction and the traction at their tether length, the transition at its elevation. A mean
course that steers the elevation in the traction is trimmed by a constant, so that the elevation ends where it did.
Every cycle compared is thus periodic and includes the same pauses; its tether forces are held within the limits as
`kiteocp.cycle.schedule` does, and where another limit is exceeded that is reported beside the power.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.cycle.objective import mean_power
from kiteocp.cycle.phases import FlownPhase, PhaseName
from kiteocp.cycle.schedule import Schedule, fly_schedule, record_of_flight
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.errors import CycleError
from kiteocp.optimum.certificate import ELEVATION_TOLERANCE_DEG, MARGIN_TOLERANCE
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.physics.parameters import ParameterValues

#: How near a phase must come to its end, as a share of its way; the energy of the cycle is then good to as much.
END_TOLERANCE = 1e-6

#: Secant steps to the stretch of a phase, and the stretches beyond which it counts as another manoeuvre.
SECANT_STEPS = 20
STRETCHES = (0.1, 10.0)

#: Trim of the course that is tried first, and the largest that is no other manoeuvre.
FIRST_TRIM_RAD, LARGEST_TRIM_RAD = 1e-3, 0.3

#: Cycles flown until the elevation repeats; one is enough where the traction has a constant elevation.
PASSES = 8

OpenLoopStatus = Literal["flown", "not_flown", "not_closed"]


class OpenLoopCycle(msgspec.Struct, frozen=True):
    """A nominal schedule flown on other numbers.

    Attributes
    ----------
    status
        ``flown``; ``not_flown`` where a state on the way does not exist; ``not_closed`` where a phase does not reach
        its end or the elevation does not repeat.
    mean_power_W
        Of the objective, pauses included; None unless flown.
    exceeded
        Key paths of the limits exceeded by more than the certificate of an optimum allows. The acceleration of the
        winch is not among them.
    """

    status: OpenLoopStatus
    mean_power_W: float | None = None
    exceeded: tuple[str, ...] = ()


class _NotClosedError(Exception):
    """A phase does not reach its end."""


def fly_open_loop(nominal: OptimalCycle, values: ParameterValues, objective: str) -> OpenLoopCycle:
    """Fly the schedule of an optimum on other numbers, phases stretched to end where the nominal ones do.

    Parameters
    ----------
    nominal
        The optimum whose schedule is flown.
    values
        The numbers that hold in flight, of the same structure.
    objective
        ``mechanical`` or ``electrical`` mean power.
    """
    try:
        schedules, flown = _closed_cycle(nominal, values)
    except CycleError:
        return OpenLoopCycle("not_flown")
    except _NotClosedError:
        return OpenLoopCycle("not_closed")
    records = [record_of_flight(values, *pair) for pair in zip(schedules, flown, strict=True)]
    power = mean_power(records, values, objective)
    return OpenLoopCycle("flown", power, _exceeded(nominal, values, records))


def _closed_cycle(nominal: OptimalCycle, values: ParameterValues) -> tuple[list[Schedule], list[FlownPhase]]:
    first = nominal.records[0]
    length, elevation = float(first.tether_length_m[0]), float(first.elevation_rad[0])
    ends: Mapping[PhaseName, tuple[int, float]] = {
        "retraction": (1, float(first.tether_length_m[-1])),
        "transition": (2, float(nominal.record("transition").elevation_rad[-1])),
        "traction": (1, float(nominal.record("traction").tether_length_m[-1])),
        "turn": (2, elevation),
    }
    for _ in range(PASSES):
        began = elevation
        place, pairs = (length, began), []
        for schedule in nominal.schedules:
            steered = "course" in schedule.coefficients
            aimed = nominal.record("traction").elevation_rad[-1] if steered else None
            pairs.append(_trimmed(values, schedule, place, ends[schedule.name], aimed))
            place = (float(pairs[-1][1].states[-1, 1]), float(pairs[-1][1].states[-1, 2]))
        elevation = place[1]
        if abs(np.degrees(elevation - began)) <= ELEVATION_TOLERANCE_DEG:
            return [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    raise _NotClosedError


def _trimmed(
    values: ParameterValues,
    schedule: Schedule,
    place: tuple[float, float],
    end: tuple[int, float],
    elevation_rad: float | None,
) -> tuple[Schedule, FlownPhase]:
    """Fly a phase to its end; trim its course, where it steers, until that is at an elevation (secant method)."""
    pair = _to_its_end(values, schedule, place, *end)
    if elevation_rad is None:
        return pair
    trim, known = FIRST_TRIM_RAD, (0.0, float(pair[1].states[-1, 2]) - elevation_rad)
    for _ in range(SECANT_STEPS):
        if abs(np.degrees(known[1])) <= 0.1 * ELEVATION_TOLERANCE_DEG:
            return pair
        courses = schedule.coefficients["course"].copy()
        courses[:, 0] += trim
        turned = replace(schedule, coefficients={**schedule.coefficients, "course": courses})
        pair = _to_its_end(values, turned, place, *end)
        miss = float(pair[1].states[-1, 2]) - elevation_rad
        slope = (miss - known[1]) / (trim - known[0])
        known = (trim, miss)
        if slope == 0.0:
            break
        trim -= miss / slope
        if not abs(trim) <= LARGEST_TRIM_RAD:
            break
    raise _NotClosedError


def _to_its_end(
    values: ParameterValues, schedule: Schedule, place: tuple[float, float], component: int, end: float
) -> tuple[Schedule, FlownPhase]:
    """Stretch a phase until a component of the state has its end value, by the secant method."""
    way = end - place[component - 1]
    stretch, known = 1.0, (0.0, -1.0)  # a phase of no duration misses by the whole way
    for _ in range(SECANT_STEPS):
        stretched = _stretched(schedule, stretch)
        flown = fly_schedule(values, stretched, *place)
        # In shares of the way: -1 at the start, 0 at the end.
        miss = (float(flown.states[-1, component]) - end) / abs(way) * np.sign(way) if way else 0.0
        if abs(miss) <= END_TOLERANCE:
            return stretched, flown
        slope = (miss - known[1]) / (stretch - known[0])
        known = (stretch, miss)
        if not slope > 0.0:
            break
        stretch -= miss / slope
        if not STRETCHES[0] <= stretch <= STRETCHES[1]:
            break
    raise _NotClosedError


def _stretched(schedule: Schedule, stretch: float) -> Schedule:
    coefficients = dict(schedule.coefficients)
    if "elevation_rate" in coefficients:
        # The same change of elevation over the phase.
        coefficients["elevation_rate"] = coefficients["elevation_rate"] / stretch
    return replace(schedule, borders_s=schedule.borders_s * stretch, coefficients=coefficients)


def _exceeded(nominal: OptimalCycle, values: ParameterValues, records: list[PhaseRecord]) -> tuple[str, ...]:
    return tuple(
        limit.key
        for limit in nominal.limits
        if any((limit.margin(record, values) or 0.0) < -MARGIN_TOLERANCE for record in records)
    )
