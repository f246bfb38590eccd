"""Derivative of the prescribed cycle along changes of its parameters, as it was flown.

Along the accepted steps of the adaptive integrator the variational equations are stepped by a Runge-Kutta method. Step
sizes are free choices, and kinks too as the rates are continuous there: to first order the cycle does not depend on
them, so that they are held. Ends of phases move. (`kiteocp.cycle.fast.cycle_function` has derivatives as well, but
with the error of its few steps in them, and none where a branch of the transition is empty.)
"""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from kiteocp.cycle.laws import ELEVATION, ENERGY, PHASE_ENDS, STATE, TIME, phase_functions
from kiteocp.cycle.phases import PHASES, PhaseName
from kiteocp.cycle.simulation import fly
from kiteocp.cycle.transition import transition_branches
from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.numerics.tableaus import DORMAND_PRINCE_8
from kiteocp.physics.parameters import Parameters, ParameterValues, Structure, parameters_of

#: What is differentiated: of each phase and of the cycle, named as in the summary, ``traction.mean_power_W``.
QUANTITIES = tuple(
    f"{part}.{quantity}" for part in (*PHASES, "cycle") for quantity in ("duration_s", "energy_J", "mean_power_W")
)

#: The integrator oversteps a kink by less than this share of its step.
OVERSTEP = 0.01


def cycle_and_tangent(values: ParameterValues, directions: np.ndarray) -> tuple[list[float], np.ndarray]:
    """Fly the prescribed cycle and differentiate it.

    Parameters
    ----------
    values
        The numbers of the problem. Where gravity is 0 it has no influence, and neither have masses.
    directions
        Changes of the parameter vector, in the units of the file, shape (parameters, k).

    Returns
    -------
    list of float
        `QUANTITIES`.
    ndarray, shape (quantities, k)
        Their derivatives along the directions.

    Raises
    ------
    CycleError
        As `kiteocp.cycle.simulation.fly`.

    Notes
    -----
    Forward sensitivity along a fixed sequence of steps, "internal numerical differentiation": Bock, *Numerical
    treatment of inverse problems in chemical reaction kinetics*, 1981.
    """
    row = {key: directions[index] for index, key in enumerate(values.structure.keys)}
    # How the ends of the phases move.
    ends = {name: row[end.key] * end.factor for name, end in PHASE_ENDS.items()}
    nothing = np.zeros(directions.shape[1])
    tangent = np.array([nothing, ends["traction"], ends["transition"], nothing])
    parts: list[tuple[float, float, np.ndarray, np.ndarray]] = []
    weightless = values["environment.gravity_m_s2"] == 0.0
    for phase in fly(values):
        end, target = ends[phase.name], PHASE_ENDS[phase.name].component
        tangent[[TIME, ENERGY]] = 0.0
        states, branches = phase.states, [0] * len(phase.states)
        if phase.name == "transition":
            states, branches = _from_kink_to_kink(values, states, weightless)
        last = len(states) - 2
        for number, (state, after) in enumerate(itertools.pairwise(states)):
            # Where all steps of a phase are steps in the component that ends it, so are those of the tangent.
            independent = target if PHASE_ENDS[phase.name].monotone or number == last else TIME
            moving = end - tangent[target] if number == last else nothing
            step = after[independent] - state[independent]
            system = _linearised(values.structure, phase.name, branches[number], weightless)
            tangent = _stepped(system, values.vector, directions, state, tangent, step, moving, independent)
        parts.append((phase.duration_s, phase.energy_J, tangent[TIME].copy(), tangent[ENERGY].copy()))
    durations, energies, duration_tangents, energy_tangents = zip(*parts, strict=True)
    parts.append((sum(durations), sum(energies), np.sum(duration_tangents, axis=0), np.sum(energy_tangents, axis=0)))
    numbers: list[float] = []
    gradients: list[np.ndarray] = []
    for duration, energy, of_duration, of_energy in parts:
        power = energy / duration
        numbers += [duration, energy, power]
        gradients += [of_duration, of_energy, (of_energy - power * of_duration) / duration]
    return numbers, np.array(gradients)


def _from_kink_to_kink(values: ParameterValues, states: np.ndarray, weightless: bool) -> tuple[np.ndarray, list[int]]:
    """Return the states of a transition, those just beyond a kink moved back to it, and the branch from each on."""
    kinks = _kinks(values.structure, weightless)
    moved, branches = states.copy(), [0] * len(states)
    for number, state in enumerate(states):
        thresholds, slopes = kinks.call(state, values.vector)
        branches[number] = branch = int(np.count_nonzero(thresholds > 0))
        before = branches[number - 1]
        if number in (0, len(states) - 1) or branch == before:
            continue
        crossed = min(branch, before)
        beyond = thresholds[crossed] / slopes[crossed]
        if abs(beyond) < OVERSTEP * abs(state[ELEVATION] - states[number - 1][ELEVATION]):
            rates = _linearised(values.structure, "transition", branch, weightless)(state, values.vector)
            moved[number] -= beyond * rates / rates[ELEVATION]
    return moved, branches


@lru_cache(maxsize=32)
def _kinks(structure: Structure, weightless: bool) -> BufferedFunction:
    """Build (once) ``(state, parameters) -> thresholds of the transition, their slopes by elevation as flown``."""
    branches, p, state = transition_branches(structure), parameters_of(structure), ca.SX.sym("state", len(STATE))
    # At a kink the rates of both branches agree; the kite at rest is on one side of each.
    rates, thresholds = _simplified(
        p, [branches.rates[1](state, p.vector), branches.thresholds(state, p.vector)], weightless
    )
    slopes = ca.jtimes(thresholds, state, rates / rates[ELEVATION])
    return _buffered([state, p.vector], [thresholds, slopes])


@lru_cache(maxsize=64)
def _linearised(structure: Structure, name: PhaseName, branch: int, weightless: bool) -> BufferedFunction:
    """Build (once) ``(state, parameters) -> rates, derivatives to state and parameters`` of a phase."""
    p, state = parameters_of(structure), ca.SX.sym("state", len(STATE))
    kinked = name == "transition"
    law = transition_branches(structure).rates[branch] if kinked else phase_functions(structure, name).rates
    (rates,) = _simplified(p, [law(state, p.vector)], weightless)
    return _buffered([state, p.vector], [rates, ca.jacobian(rates, ca.vertcat(state, p.vector))])


def _simplified(p: Parameters, expressions: list[Any], weightless: bool) -> list[Any]:
    """Set gravity to zero before differentiating where it is: masses then have no influence, exactly."""
    if not weightless:
        return expressions
    simplified: list[Any] = ca.substitute(expressions, [p["environment.gravity_m_s2"]], [ca.SX(0.0)])
    return simplified


def _buffered(arguments: list[Any], results: list[Any]) -> BufferedFunction:
    return BufferedFunction(ca.Function("linearised", arguments, ca.cse([ca.densify(result) for result in results])))


def _stepped(
    system: BufferedFunction,
    parameters: np.ndarray,
    directions: np.ndarray,
    state: np.ndarray,
    tangent: np.ndarray,
    step: float,
    moving: np.ndarray,
    independent: int,
) -> np.ndarray:
    """Carry a tangent (components, k) over a Runge-Kutta step in one component, whose size changes as `moving`."""
    tableau = DORMAND_PRINCE_8
    slopes = np.zeros((len(tableau.stages), state.size))
    tangents = np.zeros((len(tableau.stages), *tangent.shape))

    def moved(weights: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        w, count = np.array(weights), len(weights)
        slope = w @ slopes[:count]
        return step * slope, tangent + step * np.tensordot(w, tangents[:count], 1) + np.outer(slope, moving)

    for stage, row in enumerate(tableau.stages):
        change, point_tangent = moved(row) if row else (0.0, tangent)
        rates, flat = system.call(state + change, parameters)
        jacobian = flat.reshape(-1, state.size).T
        rate_tangents = jacobian[:, : state.size] @ point_tangent + jacobian[:, state.size :] @ directions
        if independent == TIME:
            slopes[stage], tangents[stage] = rates, rate_tangents
        else:
            # Rates per unit of the independent component, by the rule of the quotient.
            pace = rates[independent]
            slopes[stage] = rates / pace
            tangents[stage] = (rate_tangents - np.outer(slopes[stage], rate_tangents[independent])) / pace
    return moved(tableau.weights)[1]
