"""A whole prescribed cycle as one CasADi function of the parameters: fixed numbers of steps, no loop, differentiable.

Its accuracy is that of a few steps of high order, laid where the rates are smooth. The retraction takes steps in
time, whose sizes follow the kite's acceleration, and a last one in the tether length, which ends it exactly (Henon).
The transition goes from kink to kink of its law: reeling in at the lower force, at rest (tether length constant: a
quadrature over the elevation), reeling out at the upper force; any of the three may be empty. The traction, at constant
elevation, is a quadrature over the tether length. Estimates of the error and of the order of the branches tell where a
cycle needs the adaptive integrator instead.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.cycle.laws import ELEVATION, ENERGY, LENGTH, TIME, phase_functions
from kiteocp.cycle.phases import PHASES
from kiteocp.cycle.transition import TransitionFunctions, transition_functions
from kiteocp.numerics.tableaus import DORMAND_PRINCE_5, DORMAND_PRINCE_8, Tableau
from kiteocp.physics.parameters import Structure, parameters_of


class FixedSteps(msgspec.Struct, frozen=True):
    """How finely a cycle is stepped.

    Attributes
    ----------
    retraction_shares
        Shares of the estimated remaining duration of the retraction that its steps in time take.
    reeling_steps
        Steps at each of the two forces of the transition.
    rest_nodes, traction_nodes
        Nodes of the quadratures over the rest in the transition and over the traction.
    """

    retraction_shares: tuple[float, ...]
    reeling_steps: int
    rest_nodes: int
    traction_nodes: int


#: Two meshes, for nearly all problems and for most of the others; the finer one costs half as much again.
COARSE = FixedSteps((0.6,), 1, 3, 5)
FINE = FixedSteps((0.3, 0.4, 0.5), 2, 4, 9)

#: Share of its own estimate by which the quadrature over the traction is off at most, as measured.
QUADRATURE_ERROR = 0.2

#: Margin by which forces and speeds may miss a branch at its inner points, where kinks are located to some 1e-3.
BRANCH_MARGIN = 0.02

#: Share of its change over the interval up to which a function may miss zero before the last step to its crossing.
CROSSING_MARGIN = 0.1

#: Quantities of each phase and of the cycle; the outputs are named ``retraction_duration_s`` and so on.
QUANTITIES = ("duration_s", "energy_J", "mean_power_W")
OUTPUT_NAMES = (
    *(f"{part}_{quantity}" for part in (*PHASES, "cycle") for quantity in QUANTITIES),
    "error_estimate",
    "branches_in_order",
)

Rates = Callable[[Any], Any]


@lru_cache(maxsize=32)
def cycle_function(structure: Structure, mesh: FixedSteps = COARSE) -> ca.Function:
    """Build (once) ``parameters -> outputs`` of `OUTPUT_NAMES`, all scalars.

    ``error_estimate`` is relative, of durations and energies, and a hundred times too high where it is small;
    ``branches_in_order`` is 1 where the transition reels in, rests and reels out in this order, each at most once, as
    assumed. Where a state does not exist, outputs are not
    numbers. Derivatives are those of the cycle but for the error of the steps.
    """
    p = parameters_of(structure)
    shortest, longest = p["operation.tether_length_min_m"], p["operation.tether_length_max_m"]
    low_elevation = p["operation.traction.elevation_deg"] * (np.pi / 180)

    retraction, error = _retraction(
        lambda state: phase_functions(structure, "retraction").rates(state, p.vector),
        ca.vertcat(0.0, longest, low_elevation, 0.0),
        shortest,
        mesh,
    )
    start = ca.vertcat(0.0, retraction[LENGTH], retraction[ELEVATION], 0.0)
    transition, in_order = _transition(transition_functions(structure), p.vector, start, low_elevation, mesh)
    traction, traction_error = _traction(
        lambda state: phase_functions(structure, "traction").rates(state, p.vector),
        ca.vertcat(0.0, transition[LENGTH], low_elevation, 0.0),
        longest,
        mesh,
    )
    ends = [retraction, transition, traction]
    parts = [(end[TIME], end[ENERGY]) for end in ends]
    parts.append((sum(time for time, _ in parts), sum(energy for _, energy in parts)))
    outputs = [value for time, energy in parts for value in (time, energy, energy / time)]
    # A transition that would fly up, or a traction that would reel in, is none.
    flown = ca.logic_and(retraction[ELEVATION] > low_elevation, transition[LENGTH] < longest)
    in_order = ca.logic_and(in_order, flown)
    results = ca.cse([*outputs, ca.fmax(error, QUADRATURE_ERROR * traction_error), in_order])
    return ca.Function("cycle", [p.vector], results, ["parameters"], list(OUTPUT_NAMES))


def _step(rates: Rates, state: Any, step: Any, independent: int, tableau: Tableau) -> tuple[Any, Any]:
    """Take a step in one component of the state; return the new state and an estimate of its error."""
    slopes: list[Any] = []

    def moved(weights: tuple[float, ...]) -> Any:
        return step * sum(weight * slope for weight, slope in zip(weights, slopes, strict=False) if weight)

    for row in tableau.stages:
        slope = rates(state + moved(row) if row else state)
        slopes.append(slope if independent == TIME else slope / slope[independent])
    errors = [moved(weights) for weights in tableau.errors]
    # As in `kiteocp.numerics.integrator`, of two estimates the finer counts, less so where it is not much smaller.
    error = errors[0] ** 2 / ca.sqrt(errors[0] ** 2 + 0.01 * errors[1] ** 2 + 1e-60) if errors[1:] else errors[0]
    return state + moved(tableau.weights), error


def _constant(value: Any) -> Any:
    """Return the value rounded in its last digits, so that CasADi takes it for a constant in derivatives.

    Step sizes and kinks are free choices: the cycle does not depend on them, to first order, and its derivatives need
    not pass through them.
    """
    return ca.floor(value * 2.0**30) / 2.0**30


def _relative(error: Any, state: Any, start: Any, stroke: Any) -> Any:
    """Return the error of a step in relation to the phase so far; the transition has to fly down what it has risen."""
    return (
        ca.fabs(error[TIME] / state[TIME])
        + ca.fabs(error[ENERGY] / state[ENERGY])
        + ca.fabs(error[LENGTH] / stroke)
        + ca.fabs(error[ELEVATION] / (state[ELEVATION] - start[ELEVATION]))
    )


def _retraction(rates: Rates, start: Any, shortest: Any, mesh: FixedSteps) -> tuple[Any, Any]:
    """Return the state at the shortest tether length, and an estimate of its relative error."""
    stroke = start[LENGTH] - shortest
    slope = rates(start)
    # A first look at the acceleration, up to where the elevation has risen by 0.3 rad or half of the stroke is done.
    ahead = ca.fmin(0.3 / ca.fabs(slope[ELEVATION]), 0.5 * stroke / ca.fmax(ca.fabs(slope[LENGTH]), 1.0))
    later = rates(start + ahead * slope)
    state, error = start, 0.0
    for share in mesh.retraction_shares:
        acceleration = ca.fmax((slope[LENGTH] - later[LENGTH]) / ahead, 1e-9)
        speed = -rates(state)[LENGTH]
        left = state[LENGTH] - shortest
        # Time to reel in what is left at constant acceleration.
        remaining = 2 * left / (speed + ca.sqrt(speed**2 + 2 * acceleration * ca.fmax(left, 0.0)))
        ahead = _constant(share * remaining)
        slope = rates(state)
        state, missed = _step(rates, state, ahead, TIME, DORMAND_PRINCE_8)
        later = rates(state)
        error = error + _relative(missed, state, start, stroke)
    state, missed = _step(rates, state, shortest - state[LENGTH], LENGTH, DORMAND_PRINCE_8)
    return state, error + _relative(missed, state, start, stroke)


def _transition(functions: TransitionFunctions, p: Any, start: Any, end: Any, mesh: FixedSteps) -> tuple[Any, Any]:
    """Return the state at the elevation of the traction, and whether the branches come in order."""
    at_rest, low, high = range(3)

    def forces(length: Any, elevation: Any) -> list[Any]:
        held: list[Any] = ca.vertsplit(functions.forces(ca.vertcat(0.0, length, elevation, 0.0), p))
        return held

    def rates(state: Any, branch: int, holds: Any) -> Any:
        held = forces(state[LENGTH], state[ELEVATION])
        # A branch that is empty may have no states: its place is taken by what can always be held, reeling in fast.
        force = held[high] if branch == high else ca.if_else(holds, held[branch], held[high])
        return functions.rates(state, force, p)

    def reeling_speed(branch: int, length: Any) -> Callable[[Any], Any]:
        return lambda elevation: rates(ca.vertcat(0.0, length, elevation, 0.0), branch, 1)[LENGTH]

    def reeled(state: Any, branch: int, to: Any, tableau: Tableau) -> Any:
        step = (to - state[ELEVATION]) / mesh.reeling_steps
        for _ in range(mesh.reeling_steps):
            state, _ = _step(lambda point: rates(point, branch, step < 0), state, step, ELEVATION, tableau)
        return state

    rest, in_order = _crossing(reeling_speed(low, start[LENGTH]), start[ELEVATION], end)
    state = reeled(start, low, rest, DORMAND_PRINCE_5)
    reel_out, well = _crossing(reeling_speed(high, state[LENGTH]), rest, end)
    in_order, rests = ca.logic_and(in_order, well), reel_out < rest
    time = 0.0
    for node, weight in _gauss(mesh.rest_nodes):
        elevation = rest + (reel_out - rest) * node
        held = forces(state[LENGTH], elevation)
        within = ca.logic_and(
            held[at_rest] > held[low] * (1 - BRANCH_MARGIN), held[at_rest] < held[high] * (1 + BRANCH_MARGIN)
        )
        in_order = ca.logic_and(in_order, ca.logic_or(ca.logic_not(rests), within))
        point = ca.vertcat(0.0, state[LENGTH], elevation, 0.0)
        time = time + weight * (reel_out - rest) / rates(point, at_rest, rests)[ELEVATION]
    state = ca.vertcat(state[TIME] + time, state[LENGTH], reel_out, state[ENERGY])
    return reeled(state, high, end, DORMAND_PRINCE_8), in_order


def _crossing(function: Callable[[Any], Any], start: Any, end: Any) -> tuple[Any, Any]:
    """Return where a function first turns positive from start to end, and whether it does so as supposed.

    The start if it is positive all the way, the end if it nowhere is; not a number counts as positive. Four evaluations
    locate a crossing to some 1e-3 of the interval.
    """
    at_start, at_end = function(start), function(end)
    # A force too small for any equilibrium is one at which the kite would reel out.
    at_end = ca.if_else(ca.logic_or(at_end < 0, at_end >= 0), at_end, ca.fabs(at_start))
    starts_below, ends_below = at_start < 0, at_end < 0
    crosses = ca.logic_and(starts_below, ca.logic_not(ends_below))
    span = end - start
    x1 = ca.if_else(crosses, at_start / (at_start - at_end), 0.5)
    at_1 = function(start + x1 * span)
    # Inverse quadratic interpolation through the three, then the secant.
    x2 = x1 * (at_start * at_end) / ((at_1 - at_start) * (at_1 - at_end)) + at_start * at_1 / (
        (at_end - at_start) * (at_end - at_1)
    )
    x2 = ca.fmin(ca.fmax(ca.if_else(crosses, x2, 0.5), 0.0), 1.0)
    at_2 = function(start + x2 * span)
    difference = at_2 - at_1
    x3 = x2 - ca.if_else(difference == 0, 0.0, at_2 * (x2 - x1) / difference)
    place = start + span * _constant(ca.fmin(ca.fmax(x3, 0.0), 1.0))
    found = ca.if_else(crosses, place, ca.if_else(starts_below, end, start))
    settled = ca.fabs(at_2) < CROSSING_MARGIN * (at_end - at_start)
    alike = ca.logic_and((at_1 < 0) == starts_below, ends_below == starts_below)
    return found, ca.if_else(crosses, settled, ca.logic_or(alike, span == 0))


def _traction(rates: Rates, start: Any, longest: Any, mesh: FixedSteps) -> tuple[Any, Any]:
    """Return the state at the longest tether, and an estimate of its relative error."""
    stroke = longest - start[LENGTH]
    nodes = _gauss(mesh.traction_nodes)
    # The rule of every other node, which is of lower order, estimates the error.
    coarse = np.zeros(mesh.traction_nodes)
    places = np.array([node for node, _ in nodes[::2]])
    powers = np.arange(places.size)
    coarse[::2] = np.linalg.solve(places[None, :] ** powers[:, None], 1 / (powers + 1))
    total, rough = ca.SX.zeros(2), ca.SX.zeros(2)
    for (node, weight), coarse_weight in zip(nodes, coarse, strict=True):
        slope = rates(ca.vertcat(0.0, start[LENGTH] + stroke * node, start[ELEVATION], 0.0))
        speed = slope[LENGTH] + ca.if_else(slope[LENGTH] > 0, 0.0, np.nan)
        share = stroke * ca.vertcat(1.0, slope[ENERGY]) / speed
        total, rough = total + weight * share, rough + coarse_weight * share
    # At the end the kite must still reel out.
    speed = rates(ca.vertcat(0.0, longest, start[ELEVATION], 0.0))[LENGTH]
    total = total + ca.if_else(speed > 0, 0.0, np.nan)
    error = ca.sum1(ca.fabs(rough - total) / ca.fabs(total))
    return ca.vertcat(total[0], longest, start[ELEVATION], total[1]), error


def _gauss(count: int) -> list[tuple[float, float]]:
    """Nodes and weights of Gauss and Legendre on the unit interval."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return [(float(0.5 + 0.5 * x), float(0.5 * w)) for x, w in zip(nodes, weights, strict=True)]
