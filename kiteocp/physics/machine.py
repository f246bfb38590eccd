"""The electrical machine between the drum and the grid: a generator in reel-out, a motor in reel-in.

The paper's powers are mechanical, at the drum (eq:pc_P_general). Behind a machine of constant efficiencies each part of
the energy counts otherwise: what goes out as ``generator_efficiency`` of it, what comes in as 1 / ``motor_efficiency``.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

#: Rounding of the electrical power at zero, where generator and motor meet, W. At efficiencies of 0.9 and 0.8 it takes
#: 1.8 W off the power of a winch at rest, and a hundredth of that at 1 kW.
ROUNDING_W = 10.0


def electrical(net: Any, gross: Any, generator_efficiency: Any, motor_efficiency: Any) -> Any:
    """Electrical power (or energy) of a mechanical one.

    Parameters
    ----------
    net
        Mechanical power or energy, positive where it is generated; W or J.
    gross
        The magnitude of the power, or the energy moved in both directions together.
    generator_efficiency, motor_efficiency
        Electrical over mechanical power in reel-out, mechanical over electrical power in reel-in.
    """
    generated, consumed = generator_efficiency, 1 / motor_efficiency
    return 0.5 * (generated + consumed) * net - 0.5 * (consumed - generated) * gross


def electrical_power(power: Any, generator_efficiency: Any, motor_efficiency: Any) -> Any:
    """Electrical power of a mechanical one, W, smooth over `ROUNDING_W` where it changes its sign."""
    return electrical(power, ca.sqrt(power**2 + ROUNDING_W**2), generator_efficiency, motor_efficiency)


def energy_moved(time_s: np.ndarray, power_W: np.ndarray, energy_J: np.ndarray) -> float:
    """Return the energy moved in both directions together, J: the integral of the magnitude of the power.

    Between two samples with powers of one sign it is the difference of the energies, exactly; where the sign changes,
    the power is the parabola through both samples with that difference as its integral.

    Parameters
    ----------
    time_s, power_W, energy_J
        Samples in time, shape (n,); the energy is the integral of the power up to each of them.
    """
    steps, differences = np.diff(time_s), np.diff(energy_J)
    first, last = power_W[:-1], power_W[1:]
    moved = np.abs(differences)
    for index in np.flatnonzero((first * last < 0) & (steps > 0)):
        # In the share s of the step: first + slope s + bend s^2, its integral over the step as it is known.
        mean = differences[index] / steps[index]
        bend = 3 * (first[index] + last[index]) - 6 * mean
        slope = last[index] - first[index] - bend
        # Powers of two signs have one root within the step. Of the two ways to write a root the second is the one that
        # rounding leaves alone where there is hardly any bend.
        half = -0.5 * (slope + math.copysign(math.sqrt(max(slope**2 - 4 * bend * first[index], 0.0)), slope))
        roots = [over / under for over, under in ((half, bend), (first[index], half)) if abs(over) <= abs(under)]
        share = next((root for root in roots if root >= 0), 0.0)
        before = steps[index] * share * (first[index] + share * (slope / 2 + share * bend / 3))
        moved[index] = abs(before) + abs(differences[index] - before)
    return float(np.sum(moved))
