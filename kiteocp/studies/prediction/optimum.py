"""The best cycle of a machine in the wind it flew in, under the limits it flew with, and what makes it better.

From flown to optimal in steps that each change one thing: the flown cycle; the model's three-phase cycle with the flown
means, in a wind matched so that its traction reels out as fast as measured (what then remains is what the model leaves
out); that cycle with one ingredient after the other taken from the optimum; the optimum, whose forces vary
within the phases. The order of the ingredients would matter, so that each gets its mean over all orders (the Shapley
value); the shares add up to the whole gain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from scipy.optimize import brentq

from kiteocp.cycle import simulate
from kiteocp.errors import CycleError, InputError, NoEquilibriumError, SolveError
from kiteocp.optimum.solve import solve
from kiteocp.problem import Problem
from kiteocp.recording.data import FlightData
from kiteocp.result import Result
from kiteocp.studies.estimation.wind import WindEstimate
from kiteocp.studies.prediction.limits import flown_limits, widened
from kiteocp.studies.prediction.measured import MeasuredCycle
from kiteocp.studies.prediction.prescribed import operation_of

#: What separates the flown cycle from the model's with the same means: its errors, and manoeuvres it does not have; and
#: the optimum from the prescribed cycle that comes nearest to it.
LEFT_OUT, VARYING = "what the model leaves out", "forces that vary within the phases"

#: What of the prescribed cycle is taken from the optimum, one after the other.
INGREDIENTS: Mapping[str, tuple[str, ...]] = {
    "traction force": ("operation.traction.tether_force_N",),
    "retraction force": ("operation.retraction.tether_force_N",),
    "traction elevation": ("operation.traction.elevation_deg",),
    "tether lengths": ("operation.tether_length_min_m", "operation.tether_length_max_m"),
}

#: Forces are limited where they were measured.
FORCE_LIMITS = {"limits.tether_force_max_at": "ground", "limits.tether_force_min_at": "ground"}

#: A wind whose relative error is less is that of data without noise.
MIN_WIND_ERROR_SHARE = 1e-4

#: A limit that is this share wider than what the flight kept to is told.
NOTICED = 0.01

#: Factors on the estimated wind between which the matched one is looked for.
MATCH = (0.7, 1.5)


class OptimumStudy(msgspec.Struct, frozen=True):
    """The optimum beside the flown cycles.

    Attributes
    ----------
    limits
        ``limits`` of the problem as taken from the flight, wider where the model with the flown means needs it: the
        optimum may do whatever that cycle does.
    widened
        Limits that are wider than the flight kept to, each with what the flight kept to.
    problem
        What was solved: the estimated kite, the matched wind, the flown operation and limits.
    flown_power_W, prescribed_power_W, optimal_power_W
        Mean cycle powers: measured, of the model with the flown means (None if it cannot be flown), and optimal.
    optimal_band_W
        Optimal power with the wind a standard error weaker and stronger (None where there is no cycle).
    wind_factor, wind_sigmas
        Matched wind over estimated wind, and how many standard errors of the estimate that is.
    best
        The operation that comes nearest to the optimum (`optimal_operation`).
    contributions
        Part of the gain in W by what brings it, in the order of size; they add up to optimal less flown.
    result
        The optimum itself.
    message
        Why something is missing, empty otherwise.
    """

    limits: Mapping[str, float]
    widened: Mapping[str, float]
    problem: Problem
    flown_power_W: float
    prescribed_power_W: float | None
    optimal_power_W: float
    optimal_band_W: tuple[float | None, float | None]
    wind_factor: float
    wind_sigmas: float | None
    best: Mapping[str, float]
    contributions: Mapping[str, float]
    result: Result
    message: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {
            "status": self.result.status,
            "limits": dict(self.limits),
            "limits_kept_in_flight": dict(self.widened),
            "flown_mean_power_W": self.flown_power_W,
            "prescribed_mean_power_W": self.prescribed_power_W,
            "optimal_mean_power_W": self.optimal_power_W,
            "optimal_mean_power_band_W": list(self.optimal_band_W),
            "wind_factor": self.wind_factor,
            "wind_factor_sigmas": self.wind_sigmas,
            "operation": dict(self.best),
            "contributions_W": dict(self.contributions),
            "phases": self.result.phases,
            "cycle": self.result.cycle,
            "message": self.message,
        }


def mean_operation(cycles: Sequence[MeasuredCycle]) -> dict[str, float | str]:
    """Return the ``operation`` keys that prescribe the mean of several flown cycles."""
    operations = [operation_of(cycle) for cycle in cycles]
    return {
        key: value if isinstance(value, str) else float(np.mean([operation[key] for operation in operations]))
        for key, value in operations[0].items()
    }


def study_optimum(
    flight: FlightData, cycles: Sequence[MeasuredCycle], base: Problem, wind: WindEstimate
) -> OptimumStudy:
    """Find the optimum of the machine and say what it gains.

    Parameters
    ----------
    flight
        The whole flight in the frame of the wind, for the limits.
    cycles
        The flown cycles to compare with.
    base
        Problem with the estimated coefficients, its wind the one that `wind` is a factor on.
    wind
        Wind of those cycles.

    Raises
    ------
    InputError
        The limits of the flight contradict each other.
    SolveError
        There is no optimal cycle under them.
    """
    kept = flown_limits(flight)
    given = base.with_values({**mean_operation(cycles), **kept, **FORCE_LIMITS})
    factor, message = _matched(given, cycles, wind)
    problem, limits = widened(wind_of(given, wind.scale * factor), kept, cycles)
    given = given.with_values(limits)
    pause = problem.limits.phase_change_time_s
    optimum = solve(problem)
    flown = sum(c.mean_power_W * c.duration_s for c in cycles) / sum(c.duration_s for c in cycles)
    prescribed = _power(problem, pause)
    optimal = _mean_power(optimum)
    error, least = wind.scale_standard_error, MIN_WIND_ERROR_SHARE * wind.scale

    def in_other_wind(errors: float) -> float | None:
        return _optimal(given, (wind.scale + errors * (error or 0.0)) * factor)

    contributions: dict[str, float] = {"schedule": optimal - flown}
    if prescribed is None:
        message = message or "the model cannot fly the cycle with the flown means, so that the gain stays in one piece"
    else:
        contributions = _contributions(problem, optimum, pause, flown, prescribed, optimal)
    return OptimumStudy(
        limits=limits,
        widened={key: value for key, value in kept.items() if abs(limits[key] - value) > NOTICED * abs(value)},
        problem=problem,
        flown_power_W=flown,
        prescribed_power_W=prescribed,
        optimal_power_W=optimal,
        optimal_band_W=(in_other_wind(-1.0), in_other_wind(1.0)),
        wind_factor=factor,
        wind_sigmas=abs(factor - 1.0) * wind.scale / error if error and error > least else None,
        best=optimal_operation(optimum),
        contributions=dict(sorted(contributions.items(), key=lambda item: -abs(item[1]))),
        result=optimum,
        message=message,
    )


def wind_of(problem: Problem, scale: float) -> Problem:
    """Return a problem with its wind times a factor."""
    return WindEstimate("factor", scale).applied(problem)


def _matched(problem: Problem, cycles: Sequence[MeasuredCycle], wind: WindEstimate) -> tuple[float, str]:
    """Return the factor on the wind with which the model's traction reels out as fast as measured, and any trouble."""
    tractions = [cycle.phases["traction"] for cycle in cycles]
    measured = sum(p.reeled_length_m for p in tractions) / sum(p.duration_s for p in tractions)

    def excess(factor: float) -> float:
        try:
            phase = simulate(wind_of(problem, wind.scale * factor)).phases["traction"]
        except (CycleError, NoEquilibriumError):
            # Too little wind to reel out at this force.
            return -measured
        return (phase["tether_length_end_m"] - phase["tether_length_start_m"]) / phase["duration_s"] - measured

    if excess(MATCH[0]) > 0 or excess(MATCH[1]) < 0:
        return 1.0, "no wind near the estimated one lets the model's traction reel out as fast as measured"
    return float(brentq(excess, *MATCH, xtol=1e-5)), ""


def _power(problem: Problem, pause_s: float) -> float | None:
    try:
        return _mean_power(simulate(problem, phase_change_time_s=pause_s))
    except (CycleError, NoEquilibriumError):
        return None


def _mean_power(result: Result) -> float:
    power = result.cycle["mean_power_W"]
    return math.nan if power is None else power


def _optimal(problem: Problem, scale: float) -> float | None:
    """Return the optimal power in another wind, None where there is no cycle."""
    try:
        return _mean_power(solve(wind_of(problem, scale), certificate="quick"))
    except (SolveError, InputError):
        return None


def optimal_operation(optimum: Result) -> dict[str, float]:
    """Return the operation that comes nearest to an optimum: its lengths, its mean forces and its mean elevation."""

    def mean(channel: str, phase: str) -> float:
        time = optimum.channel("time_s", phase)
        return float(np.trapezoid(optimum.channel(channel, phase), time) / (time[-1] - time[0]))

    length = optimum["tether_length_m"]
    return {
        "operation.traction.tether_force_N": mean("tether_force_ground_N", "traction"),
        "operation.retraction.tether_force_N": mean("tether_force_ground_N", "retraction"),
        "operation.traction.elevation_deg": mean("elevation_deg", "traction"),
        "operation.tether_length_min_m": float(np.min(length)),
        "operation.tether_length_max_m": float(np.max(length)),
    }


def _contributions(
    problem: Problem, optimum: Result, pause_s: float, flown: float, prescribed: float, optimal: float
) -> dict[str, float]:
    """Return what each ingredient brings, with what the model leaves out and forces that vary within the phases."""
    best = optimal_operation(optimum)
    powers: dict[frozenset[str], float | None] = {frozenset(): prescribed}
    for count in range(1, len(INGREDIENTS) + 1):
        for chosen in itertools.combinations(INGREDIENTS, count):
            keys = [key for name in chosen for key in INGREDIENTS[name]]
            try:
                powers[frozenset(chosen)] = _power(problem.with_values({key: best[key] for key in keys}), pause_s)
            except InputError:
                # As a retraction force above the traction force.
                powers[frozenset(chosen)] = None
    everything = powers[frozenset(INGREDIENTS)]
    if everything is None:
        return {LEFT_OUT: prescribed - flown, "schedule": optimal - prescribed}
    shares = dict.fromkeys(INGREDIENTS, 0.0)
    orders = 0
    for order in itertools.permutations(INGREDIENTS):
        steps = [powers[frozenset(order[:count])] for count in range(len(order) + 1)]
        if any(power is None for power in steps):
            continue
        orders += 1
        for name, (before, after) in zip(order, itertools.pairwise(steps), strict=True):
            shares[name] += (after or 0.0) - (before or 0.0)
    found = (
        {name: share / orders for name, share in shares.items()} if orders else {"schedule": everything - prescribed}
    )
    return {LEFT_OUT: prescribed - flown, **found, VARYING: optimal - everything}


def largest(contributions: Mapping[str, float], gain: float) -> str:
    """Return what brings the largest part of a gain (or takes the largest part of a loss)."""
    sign = math.copysign(1.0, gain)
    return max(contributions, key=lambda name: sign * contributions[name])
