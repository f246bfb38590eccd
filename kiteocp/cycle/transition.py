"""The transition's law by its branches: reeling in at the lower force, at rest, reeling out at the upper force.

`kiteocp.cycle.laws` writes the law as a clipped force, whose rates have a kink where the winch starts or stops. Between
the kinks they are smooth; who steps from kink to kink needs a tenth of the steps.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import msgspec
import numpy as np

from kiteocp.cycle.laws import STATE
from kiteocp.cycle.motion import at_force, motion
from kiteocp.cycle.phases import TRANSITION
from kiteocp.numerics.integrator import Branches
from kiteocp.physics.equilibrium import radial_ground_force_flying_down
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import Structure, parameters_of


class TransitionFunctions(msgspec.Struct, frozen=True):
    """CasADi functions of the transition.

    ``forces(state, p)``: radial ground forces (N) at rest (minus infinity where slack), lower and upper one;
    ``rates(state, force, p)``: time derivatives of `STATE` at a radial ground force (N), not numbers where there is no
    equilibrium.
    """

    forces: ca.Function
    rates: ca.Function


@lru_cache(maxsize=32)
def transition_functions(structure: Structure) -> TransitionFunctions:
    """Build (once) the functions of the transition."""
    p = parameters_of(structure)
    model, reference = Model(p), structure.choice("operation.force_reference")
    state, force = ca.SX.sym("state", len(STATE)), ca.SX.sym("radial_ground_force")
    # As in the law: a force too small to lift the tether is no state.
    held = force + ca.if_else(force < 0, np.nan, 0.0)
    moved = motion(model, TRANSITION, state[1], state[2], at_force(lambda *_: held))
    flight, around = moved.flight, moved.flight.conditions
    low, high = (
        model.radial_ground_force(around, p[f"operation.{phase}.tether_force_N"], reference)
        for phase in ("retraction", "traction")
    )
    forces = ca.vertcat(radial_ground_force_flying_down(model, around, 0.0), low, high)
    rates = ca.vertcat(1.0, flight.reeling_speed, moved.elevation_rate, flight.power)
    return TransitionFunctions(
        ca.Function("forces", [state, p.vector], ca.cse([ca.densify(forces)])),
        ca.Function("rates", [state, force, p.vector], ca.cse([ca.densify(rates)])),
    )


@lru_cache(maxsize=32)
def transition_branches(structure: Structure) -> Branches:
    """Build (once) the branches of the law, in the order of rising force at rest."""
    functions, p = transition_functions(structure), parameters_of(structure)
    state = ca.SX.sym("state", len(STATE))
    forces = functions.forces(state, p.vector)
    at_rest, low, high = ca.vertsplit(forces)
    arguments = [state, p.vector]
    return Branches(
        rates=tuple(
            ca.Function("rates", arguments, [functions.rates(state, force, p.vector)]) for force in (low, at_rest, high)
        ),
        thresholds=ca.Function("thresholds", arguments, [ca.vertcat(at_rest - low, at_rest - high)]),
    )
