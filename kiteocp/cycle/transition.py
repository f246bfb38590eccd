"""The transition's law by its branches: reeling in at the lower force, at rest, reeling out at the upper force.

`kiteocp.cycle.laws` writes the law as a clipped force, whose rates have a kink where the winch starts or stops. Between
the kinks they are smooth; who steps from kink to kink needs a tenth of the steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from kiteocp.cycle.integrator import Branches
from kiteocp.cycle.laws import STATE
from kiteocp.cycle.phases import TRANSITION
from kiteocp.physics import kinematics
from kiteocp.physics.equilibrium import explicit_state, radial_ground_force_flying_down
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import Structure, parameters_of


@dataclass(frozen=True)
class TransitionForces:
    """Radial ground forces (N) at a place: at rest (minus infinity where slack), and the two that the winch holds."""

    at_rest: Any
    low: Any
    high: Any


def transition_forces(model: Model, tether_length: Any, elevation: Any) -> TransitionForces:
    """Return the forces that decide what the winch does, at a tether length (m) and an elevation (rad)."""
    p, reference = model.parameters, model.structure.choice("operation.force_reference")
    position = TRANSITION.position(model, tether_length, elevation)
    around = model.surroundings(position, model.coefficients(TRANSITION.setting))
    low, high = (
        model.radial_ground_force(around, p[f"operation.{phase}.tether_force_N"], reference)
        for phase in ("retraction", "traction")
    )
    return TransitionForces(radial_ground_force_flying_down(model, around, 0.0), low, high)


def transition_rates(model: Model, tether_length: Any, elevation: Any, force: Any) -> Any:
    """Return the time derivatives of `STATE` at a radial ground force (N); not a number without an equilibrium."""
    position = TRANSITION.position(model, tether_length, elevation)
    around = model.surroundings(position, model.coefficients(TRANSITION.setting))
    # As in the law: a force too small to lift the tether is no state.
    flight = explicit_state(model, position, around, force + ca.if_else(force < 0, np.nan, 0.0))
    rate = kinematics.elevation_rate(flight.tangential_speed, position.course, tether_length)
    return ca.densify(ca.vertcat(1.0, flight.reeling_speed, rate, flight.power))


@lru_cache(maxsize=32)
def transition_branches(structure: Structure) -> Branches:
    """Build (once) the branches of the law, in the order of rising force at rest."""
    parameters = parameters_of(structure)
    model = Model(parameters)
    state = ca.SX.sym("state", len(STATE))
    forces = transition_forces(model, state[1], state[2])
    arguments = [state, parameters.vector]
    return Branches(
        rates=tuple(
            ca.Function("rates", arguments, [transition_rates(model, state[1], state[2], force)])
            for force in (forces.low, forces.at_rest, forces.high)
        ),
        thresholds=ca.Function(
            "thresholds", arguments, [ca.vertcat(forces.at_rest - forces.low, forces.at_rest - forces.high)]
        ),
    )
