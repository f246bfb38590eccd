"""Whether the wind can carry kite and tether at all: a condition that every cycle meets, known without looking for one.

Every cycle has a retraction, in which the kite flies up in the plane of the wind. Where no place that the limits allow
has a steady state with the tether under tension, reeled in as fast as the limits allow, there is no cycle. The
converse does not hold: a weight that can be carried says nothing of the other limits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import asdict

from kiteocp.cycle.phases import RETRACTION
from kiteocp.physics.equilibrium import weight_share_flying_up
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameters_of
from kiteocp.physics.tether import tether_mass
from kiteocp.physics.wind import in_wind, wind_text
from kiteocp.report.words import rounded

#: Points over height, tether length, angle of the force, and power setting where that is free. The share is smooth in
#: each; twice as many change its maximum by less than 1 %.
HEIGHTS, LENGTHS, ANGLES, SETTINGS = 25, 13, 33, 11

#: Below this share the weight counts as not carried: the rest of the grid, and what a certificate allows of a limit.
CARRIED = 0.95

#: Highest elevation looked at: straight above, weight across the tether and wind along it vanish together.
STEEPEST_DEG = 89.9

#: Farthest factor of the wind or the reel-in speed that is looked for, and how near it is located.
FARTHEST, ACCURACY = 100.0, 1e-3

REEL_IN = "limits.reel_in_speed_max_m_s"


class UncarriedWeight(msgspec.Struct, frozen=True):
    """Why a kite is too heavy for its wind.

    Attributes
    ----------
    sentence
        For an operator.
    carried_share
        Largest share of the weight across the tether that is carried anywhere within the limits.
    wind_factor_at_least
        Factor of the wind speed below which no cycle exists; None if it is beyond all reason.
    reel_in_speed_at_least_m_s
        Largest reel-in speed below which no cycle exists in this wind; None likewise.
    """

    sentence: str
    carried_share: float
    wind_factor_at_least: float | None
    reel_in_speed_at_least_m_s: float | None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for the summary."""
        return asdict(self)


def uncarried_weight(values: ParameterValues, power_setting: str) -> UncarriedWeight | None:
    """Say why kite and tether cannot be carried in the retraction; None where they can, or may.

    Parameters
    ----------
    values
        The problem's numbers.
    power_setting
        What is free of it: ``all`` includes that of the retraction.
    """
    free = power_setting == "all"
    share = carried_share(values, free=free)
    if share >= CARRIED:
        return None
    speed = values[REEL_IN]
    wind = _least(lambda factor: carried_share(in_wind(values, factor), free=free))
    faster = _least(lambda factor: carried_share(values.replaced({REEL_IN: factor * speed}), free=free))
    reel_in = None if faster is None else faster * speed
    mass, area = values["kite.mass_kg"], values["kite.projected_area_m2"]
    tether = float(
        tether_mass(values["limits.tether_length_min_m"], values["tether.diameter_m"], values["tether.density_kg_m3"])
    )
    heavy = f"the kite is too heavy ({mass:g} kg, {mass / area:.3g} kg/m2)"
    if tether > mass:
        heavy = f"the tether is too heavy ({tether:.3g} kg at its shortest, the kite {mass:g} kg)"
    needs = [] if wind is None else [wind_text(values, wind)]
    needs += [] if reel_in is None else [f"{REEL_IN} of {rounded(reel_in, up=True)}"]
    takes = f"; to carry it, and more to fly a cycle, takes {', or '.join(needs)}" if needs else ""
    how = "at any power setting" if free else "depowered"
    return UncarriedWeight(
        f"no cycle can be flown: with {wind_text(values, 1.0)} {heavy}: in the retraction, {how} and reeled in at "
        f"{speed:g} m/s, the air carries at most {100 * share:.2g} % of the weight of kite and tether, at any height "
        f"and tether length within the limits{takes}",
        share,
        wind,
        reel_in,
    )


def carried_share(values: ParameterValues, *, free: bool = False) -> float:
    """Largest share of the weight across the tether that the air carries in the retraction, anywhere in the limits.

    Parameters
    ----------
    values
        The problem's numbers.
    free
        The power setting may be any; otherwise the kite is depowered.
    """
    if values["environment.gravity_m_s2"] == 0:
        return np.inf
    shortest, longest = values["limits.tether_length_min_m"], values["limits.tether_length_max_m"]
    lowest, highest = values["limits.height_min_m"], min(values["limits.height_max_m"], longest)
    steepest = np.sin(np.radians(min(values["limits.elevation_max_deg"], STEEPEST_DEG)))
    # Between the entries of a table the wind is nowhere stronger than at one of them.
    table = [values[key] for key in values.structure.keys if key.startswith("environment.wind.heights_m[")]
    within = [height for height in table if lowest < height < highest]
    heights = np.concatenate([np.linspace(lowest, min(highest, longest * steepest), HEIGHTS), within])
    least = np.maximum(heights / steepest, shortest)
    lengths = least[:, None] + np.linspace(0.0, 1.0, LENGTHS) * np.maximum(longest - least, 0.0)[:, None]
    elevations = np.arcsin(np.minimum(heights[:, None] / lengths, steepest))
    settings = np.linspace(0.0, 1.0, SETTINGS) if free else np.zeros(1)
    grid = [np.repeat(part.ravel(), settings.size) for part in (lengths, elevations)]
    grid.append(np.tile(settings, lengths.size))
    shares = _share_function(values.structure).map(grid[0].size)(*(part[None, :] for part in grid), values.vector)
    return float(np.max(np.asarray(shares)))


@lru_cache(maxsize=16)
def _share_function(structure: Structure) -> ca.Function:
    """Build (once) the largest share, over the angles of the force, at a tether length, elevation and power setting."""
    parameters = parameters_of(structure)
    model = Model(parameters)
    length, elevation, setting = (ca.SX.sym(name) for name in ("length", "elevation", "setting"))
    around = model.conditions(RETRACTION.position(model, length, elevation), model.coefficients(setting))
    radial_wind = ca.fmax(around.wind.radial + parameters[REEL_IN], 0.0)
    angles = np.linspace(0.0, 1.0, ANGLES)[1:]
    shares = [weight_share_flying_up(model, around, radial_wind, angle) for angle in angles]
    largest = ca.mmax(ca.vertcat(*shares))
    return ca.Function("weight_share", [length, elevation, setting, parameters.vector], [largest])


def _least(share: Callable[[float], float]) -> float | None:
    """Least factor at which the weight is carried, from one where it is not; the share grows with it."""
    failing, carrying = 1.0, FARTHEST
    if share(carrying) < CARRIED:
        return None
    while carrying > (1 + ACCURACY) * failing:
        middle = float(np.sqrt(failing * carrying))
        failing, carrying = (failing, middle) if share(middle) >= CARRIED else (middle, carrying)
    return carrying
