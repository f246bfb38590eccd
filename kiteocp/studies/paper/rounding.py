"""How far the rounding of published inputs may have moved each number of the prescribed cycle.

To first order the band is that of `kiteocp.studies.sensitivity.forward.rounding_band`. Some numbers bend over it (the
weightless retraction of the strong case takes up to 17 % longer or 13 % less), so that the two corners, all inputs
moved by their half units with or against the number, are flown again: their values are the band.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from kiteocp.cycle.fast.tangent import QUANTITIES
from kiteocp.cycle.phases import PHASES
from kiteocp.cycle.simulation import fly
from kiteocp.ocp.collocation import FloatArray
from kiteocp.physics.parameters import ParameterValues
from kiteocp.studies.sensitivity.forward import ForwardSensitivity

#: Numbers beside `QUANTITIES`: what the winch takes per metre of stroke, and what it gives after the retraction.
RETRACTION_FORCE = "retraction.mean_force_N"
REEL_OUT_ENERGY = "transition_and_traction.energy_J"

SHORTEST, LONGEST = "operation.tether_length_min_m", "operation.tether_length_max_m"


class Band(msgspec.Struct, frozen=True):
    """Where rounding of the inputs may have moved a number.

    Attributes
    ----------
    low, high
        The number flown again at the two worst corners of the rounded inputs.
    worst, root
        To first order: all roundings in one direction, and the root of the sum of squares of their effects; the latter
        over the root of 3 is the standard deviation, rounding errors being uniform.
    """

    low: float
    high: float
    worst: float
    root: float


def flown_numbers(values: ParameterValues, time_step: float | None = None) -> dict[str, float]:
    """Fly the prescribed cycle and return `QUANTITIES`, `RETRACTION_FORCE` and `REEL_OUT_ENERGY`.

    Parameters
    ----------
    values
        The numbers of the problem.
    time_step
        Nondimensional time step of the paper's scheme; without it the cycle is integrated adaptively.

    Raises
    ------
    CycleError
        As `kiteocp.simulate`.
    """
    flown = fly(values, time_step=time_step)
    numbers: dict[str, float] = {}
    for phase in flown:
        numbers |= _of_part(phase.name, phase.duration_s, phase.energy_J)
    numbers |= _of_part("cycle", sum(phase.duration_s for phase in flown), sum(phase.energy_J for phase in flown))
    numbers[RETRACTION_FORCE] = -numbers["retraction.energy_J"] / (values[LONGEST] - values[SHORTEST])
    numbers[REEL_OUT_ENERGY] = numbers["transition.energy_J"] + numbers["traction.energy_J"]
    return numbers


def _of_part(part: str, duration: float, energy: float) -> dict[str, float]:
    return {
        f"{part}.duration_s": duration,
        f"{part}.energy_J": energy,
        f"{part}.mean_power_W": energy / duration,
    }


def rounding_bands(
    values: ParameterValues, study: ForwardSensitivity, half_units: Mapping[str, float]
) -> dict[str, Band]:
    """Return the band of every number of `flown_numbers`.

    Parameters
    ----------
    values
        The numbers of the problem, with or without gravity.
    study
        The derivatives of the same.
    half_units
        By key path how far rounding may have moved it, in the unit of the key.

    Raises
    ------
    CycleError
        A corner of the rounded inputs cannot be flown.
    """
    halves = np.array([half_units.get(key, 0.0) for key in study.keys])
    bands = {}
    for name, slopes in _slopes(values, study).items():
        ends = [_extreme(values, name, side * np.sign(slopes) * halves, side) for side in (-1.0, 1.0)]
        effects = np.abs(slopes * halves)
        bands[name] = Band(min(ends), max(ends), float(effects.sum()), math.sqrt(float((effects**2).sum())))
    return bands


def _extreme(values: ParameterValues, name: str, corner: FloatArray, side: float) -> float:
    """Return the least (side -1) or the greatest (+1) of a number over the corners of the rounded inputs.

    Parameters
    ----------
    values, name
        The numbers of the problem, and which number of `flown_numbers`.
    corner
        Changes of the inputs to begin with, shape (keys,): those of the derivatives, which are not the same everywhere.
        From there single inputs are turned over as long as that leads farther.
    side
        Which end.
    """

    def flown(shift: FloatArray) -> float:
        return flown_numbers(ParameterValues(values.structure, values.vector + shift))[name]

    best, turned = flown(corner), True
    while turned:
        turned = False
        for index in np.flatnonzero(corner):
            other = corner.copy()
            other[index] *= -1.0
            number = flown(other)
            if side * (number - best) > 0.0:
                best, corner, turned = number, other, True
    return best


def _slopes(values: ParameterValues, study: ForwardSensitivity) -> dict[str, FloatArray]:
    """Return the derivative of every number of `flown_numbers` with respect to each key, shape (keys,)."""
    slopes = dict(zip(QUANTITIES, study.jacobian, strict=True))
    stroke = np.array([(key == LONGEST) - (key == SHORTEST) for key in study.keys], dtype=float)
    reeled = values[LONGEST] - values[SHORTEST]
    force = -study.quantities["retraction.energy_J"] / reeled
    slopes[RETRACTION_FORCE] = -(slopes["retraction.energy_J"] + force * stroke) / reeled
    slopes[REEL_OUT_ENERGY] = sum(slopes[f"{phase}.energy_J"] for phase in PHASES[1:])
    return slopes
