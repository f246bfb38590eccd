"""The family of problems on which the robustness of the optimum is measured (`benchmarks.robustness`).

Three shipped kites in wind from calm to storm, and random draws of kites, tethers, winds and limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from kiteocp.errors import InputError
from kiteocp.problem import Problem, load_problem

#: The kites of the family; named, so that a problem shipped later does not change every draw.
KITES = ("moderate-wind", "strong-wind", "v3-kite")

WIND_KEY = "environment.wind.reference_speed_m_s"

#: Numbers drawn within 30 % of the shipped ones.
SPREAD = 0.3
SPREAD_KEYS = (
    "kite.mass_kg",
    "kite.projected_area_m2",
    "kite.powered.lift_coefficient",
    "kite.depowered.lift_coefficient",
    "limits.tether_force_min_N",
    "limits.tether_force_max_N",
    "tether.diameter_m",
    "environment.wind.roughness_length_m",
)
DRAG_KEYS = ("lift_to_drag", "drag_coefficient")

#: Limits drawn uniformly; the second group only in some problems.
ALWAYS = {
    "limits.reel_in_speed_max_m_s": (4.0, 15.0),
    "limits.reel_out_speed_max_m_s": (4.0, 15.0),
    "limits.reeling_acceleration_max_m_s2": (1.0, 6.0),
    "limits.height_min_m": (30.0, 120.0),
    "limits.height_max_m": (250.0, 700.0),
    "limits.elevation_max_deg": (62.0, 120.0),
    "limits.traction_duration_min_s": (10.0, 60.0),
    "limits.phase_change_time_s": (0.5, 4.0),
}
SOMETIMES = {
    "limits.generator_power_max_W": (8e3, 3e4),
    "limits.motor_power_max_W": (3e3, 1.5e4),
    "limits.stroke_min_m": (30.0, 150.0),
}


class Member(msgspec.Struct, frozen=True):
    """One problem of the family.

    Attributes
    ----------
    name
        Says where it comes from.
    problem
        The problem.
    """

    name: str
    problem: Problem


def wind_sweeps(step: float = 0.5, strongest: float = 25.0) -> Iterator[Member]:
    """Shipped kites from calm to storm, the wind at the reference height of each file scaled to that at 100 m."""
    for name in KITES:
        base = load_problem(name)
        factor = _reference_over_100_m(base)
        speeds = np.arange(step, strongest + step / 2, step)
        for speed in speeds:
            yield Member(f"{name} {speed:.1f} m/s", base.with_values({WIND_KEY: float(speed * factor)}))


def random_draws(count: int, seed: int = 1) -> Iterator[Member]:
    """Random designs, sites and limits around the shipped problems; draws that no problem file may have are redrawn."""
    random = np.random.default_rng(seed)
    shipped = [load_problem(name) for name in KITES]
    made = 0
    while made < count:
        base = shipped[int(random.integers(len(shipped)))]
        try:
            problem = base.with_values(_draw(base, random))
        except InputError:
            continue
        yield Member(f"{base.name} draw {made}", problem)
        made += 1


def _draw(base: Problem, random: np.random.Generator) -> dict[str, Any]:
    content = base.to_dict()
    keys = list(SPREAD_KEYS)
    for setting in ("powered", "depowered"):
        keys += [f"kite.{setting}.{key}" for key in DRAG_KEYS if key in content["kite"][setting]]
    values: dict[str, Any] = {key: _value(content, key) * float(random.uniform(1 - SPREAD, 1 + SPREAD)) for key in keys}
    values[WIND_KEY] = float(random.uniform(4.0, 18.0)) * _reference_over_100_m(base)
    values |= {key: float(random.uniform(*span)) for key, span in ALWAYS.items()}
    values |= {key: float(random.uniform(*span)) for key, span in SOMETIMES.items() if random.random() < 0.3}
    return values


def _value(content: dict[str, Any], key: str) -> float:
    value: Any = content
    for part in key.split("."):
        value = value[part]
    return float(value)


def _reference_over_100_m(problem: Problem) -> float:
    wind = problem.to_dict()["environment"]["wind"]
    return float(
        np.log(wind["reference_height_m"] / wind["roughness_length_m"]) / np.log(100.0 / wind["roughness_length_m"])
    )
