"""Defaults of the problem file, those that follow from other keys included."""

from __future__ import annotations

import copy
from typing import Any

from kiteocp.problem.catalogue import MISSING, Key, catalogue

#: Smallest over largest tether force where only the largest is given: what keeps a tether from going slack.
FORCE_RATIO_MIN = 0.03
#: Retraction force over largest tether force of a prescribed cycle that does not give it.
FORCE_RATIO_RETRACTION = 0.25
#: How far the prescribed turn climbs where its end is not given.
TURN_CLIMB_DEG = 15.0
#: Mesh intervals of a phase: one smooth curve of the force needs few, a schedule beside it more.
PLAIN_RETRACTION_INTERVALS, PLAIN_TRACTION_INTERVALS, RICH_INTERVALS = 3, 1, 4
#: Where the course steers the elevation, an optimum on fewer intervals dives between the points below its least one.
STEERED_INTERVALS = 8


def resolved(content: dict[str, Any]) -> dict[str, Any]:
    """Return a checked mapping with every default filled in, in the order of the catalogue.

    Parameters
    ----------
    content : dict
        The keys given, checked one by one.
    """
    filled: dict[str, Any] = _filled(catalogue(), content)
    operation, limits = filled["operation"], filled["limits"]
    traction, retraction = operation["traction"], operation["retraction"]
    largest = limits["tether_force_max_N"]
    _derive(limits, "tether_force_min_N", FORCE_RATIO_MIN * largest)
    _derive(traction, "tether_force_N", largest)
    _derive(retraction, "tether_force_N", max(FORCE_RATIO_RETRACTION * largest, limits["tether_force_min_N"]))
    _derive(operation["turn"], "tether_force_N", traction["tether_force_N"])
    _derive(operation["turn"], "elevation_deg", traction["elevation_deg"] + TURN_CLIMB_DEG)
    _derive(limits, "tether_length_min_m", operation["tether_length_min_m"])
    _derive(limits, "tether_length_max_m", operation["tether_length_max_m"])
    optimisation = filled["optimisation"]
    fixed = optimisation["power_setting"] == "fixed"
    steady = optimisation["traction_elevation"] == "constant" and fixed
    everywhere = optimisation["power_setting"] == "all"
    _derive(optimisation["mesh"], "retraction_intervals", RICH_INTERVALS if everywhere else PLAIN_RETRACTION_INTERVALS)
    rich = STEERED_INTERVALS if optimisation["traction_elevation"] == "course-coupled" else RICH_INTERVALS
    _derive(optimisation["mesh"], "traction_intervals", PLAIN_TRACTION_INTERVALS if steady else rich)
    return filled


def _derive(block: dict[str, Any], name: str, value: float) -> None:
    if block[name] is MISSING:
        block[name] = value


def _filled(key: Key, given: dict[str, Any]) -> dict[str, Any]:
    """Fill in the defaults of a block; a derived default not yet known is `MISSING`, in its place."""
    block: dict[str, Any] = {}
    for name, child in key.selected(given).children.items():
        if child.kind in ("section", "variants"):
            block[name] = _filled(child, given.get(name, {}))
        elif name in given:
            block[name] = copy.copy(given[name])
        elif child.derived or child.default is not MISSING:
            block[name] = child.default
    return block
