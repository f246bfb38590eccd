"""Checks between keys: what makes a problem contradictory, and what only deserves a warning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from kiteocp.problem.catalogue import limit_keys
from kiteocp.problem.checking import Fail
from kiteocp.problem.plausibility import implausible_values
from kiteocp.problem.reading import show
from kiteocp.problem.uncertain_keys import check_uncertainty
from kiteocp.problem.wind import Wind

Block = Mapping[str, Any]


def check_alternatives(content: Block, fail: Fail) -> None:
    """Check that each power setting gives exactly one of lift-to-drag ratio and drag coefficient."""
    for setting in ("powered", "depowered"):
        path = f"kite.{setting}"
        given = [name for name in ("lift_to_drag", "drag_coefficient") if name in content["kite"][setting]]
        if len(given) == 2:
            values = " and ".join(f"{name} {show(content['kite'][setting][name])}" for name in given)
            fail(f"{path}.drag_coefficient", f"{path} gives both {values}; remove one, the other follows from it")
        if not given:
            fail(path, f"{path} gives neither lift_to_drag nor drag_coefficient; add one of them")


class _Comparison:
    """Order of two keys of a resolved problem, worded with where a default came from."""

    def __init__(self, content: Block, given: Block, fail: Fail) -> None:
        self.content, self.given, self.fail = content, given, fail

    def value(self, path: str) -> float:
        return float(self._found(path))

    def absent(self, path: str) -> bool:
        """Whether a limit is null."""
        return self._found(path) is None

    def _found(self, path: str) -> Any:
        block: Any = self.content
        for part in path.split("."):
            block = block[part]
        return block

    def named(self, path: str) -> str:
        block: Any = self.given
        for part in path.split("."):
            block = block.get(part) if isinstance(block, Mapping) else None
        return f"{path} ({show(self.value(path))}{', its default' if block is None else ''})"

    def ordered(self, low: str, high: str, *, equal: bool = False) -> None:
        """Demand that one key is less than another, or not greater where `equal` bounds fix the quantity between."""
        if self.value(low) < self.value(high) or (equal and self.value(low) == self.value(high)):
            return
        place = low if self._is_given(low) else high
        word = "greater than" if equal else "not less than"
        self.fail(place, f"{self.named(low)} is {word} {self.named(high)}; change one of them")

    def _is_given(self, path: str) -> bool:
        return not self.named(path).endswith("default)")


def check_consistency(content: Block, given: Block, fail: Fail) -> None:
    """Check the keys of a resolved problem against each other.

    Parameters
    ----------
    content : mapping
        The resolved problem.
    given : mapping
        The keys as they were given, to tell a default from a value of the user.
    fail : callable
        Called with key path and message at the first contradiction.
    """
    comparison = _Comparison(content, given, fail)
    for low, high in (
        ("operation.tether_length_min_m", "operation.tether_length_max_m"),
        ("operation.retraction.tether_force_N", "operation.traction.tether_force_N"),
        # A cycle needs a stroke.
        ("limits.tether_length_min_m", "limits.tether_length_max_m"),
    ):
        comparison.ordered(low, high)
    if content["optimisation"]["turn"] == "flown":
        comparison.ordered("operation.traction.elevation_deg", "operation.turn.elevation_deg")
    for low, high in _ranges():
        if not (comparison.absent(low) or comparison.absent(high)):
            comparison.ordered(low, high, equal=True)
    _check_reach(content["limits"], fail)
    for key, message in msgspec.convert(content["environment"]["wind"], Wind).mistakes(*flight_altitudes(content)):
        fail(key, message)
    check_uncertainty(content, fail)


def _ranges() -> list[tuple[str, str]]:
    """Return each two limits between which a quantity must have room."""
    rows = {path: key.limit for path, key in limit_keys().items() if key.limit is not None and key.limit.quantity}
    lower = {path: row for path, row in rows.items() if "_min_" in f"{path}_"}
    return [
        (low, high)
        for low, row in lower.items()
        for high, other in rows.items()
        if high not in lower and (other.quantity, other.measure) == (row.quantity, row.measure)
    ]


def _check_reach(limits: Block, fail: Fail) -> None:
    """Check that tether lengths, elevations and altitudes have something in common."""
    shortest, longest = limits["tether_length_min_m"], limits["tether_length_max_m"]
    stroke = limits["stroke_min_m"]
    if stroke is not None and stroke > longest - shortest:
        fail(
            "limits.stroke_min_m",
            f"limits.stroke_min_m is {show(stroke)} m, but the tether lengths in limits leave only "
            f"{show(longest - shortest)} m; lower it or widen limits.tether_length_min_m to tether_length_max_m",
        )
    steepest = min(limits["traction_elevation_max_deg"], limits["elevation_max_deg"])
    highest = longest * math.sin(math.radians(steepest))
    if limits["height_min_m"] >= highest:
        fail(
            "limits.height_min_m",
            f"limits.height_min_m is {show(limits['height_min_m'])} m, but in traction the longest tether "
            f"({show(longest)} m) at the highest elevation ({show(steepest)} deg) reaches only {highest:.5g} m; lower "
            "it, or raise limits.tether_length_max_m or the elevation limits",
        )
    lowest = shortest * math.sin(math.radians(limits["traction_elevation_min_deg"]))
    if limits["height_max_m"] <= lowest:
        fail(
            "limits.height_max_m",
            f"limits.height_max_m is {show(limits['height_max_m'])} m, but in traction the shortest tether "
            f"({show(shortest)} m) at the lowest elevation ({show(limits['traction_elevation_min_deg'])} deg) is "
            f"already at {lowest:.5g} m; raise it, or lower limits.tether_length_min_m or "
            "limits.traction_elevation_min_deg",
        )


def flight_altitudes(content: Block) -> tuple[float, float]:
    """Return the lowest and highest altitude in m that the prescribed cycle and the limits allow."""
    operation, limits = content["operation"], content["limits"]
    elevation = math.radians(operation["traction"]["elevation_deg"])
    low = min(operation["tether_length_min_m"] * math.sin(elevation), limits["height_min_m"])
    longest = max(operation["tether_length_max_m"], limits["tether_length_max_m"])
    return low, min(limits["height_max_m"], longest)


def warnings_of(content: Block) -> list[str]:
    """Return what of a resolved problem deserves a warning, one sentence each."""
    implausible = implausible_values(content, flight_altitudes(content))
    return [*implausible, *_limit_warnings(content), *_strength_warnings(content)]


def _limit_warnings(content: Block) -> list[str]:
    """Report a prescribed cycle outside the limits of the same problem."""
    operation, limits = content["operation"], content["limits"]
    traction, retraction = operation["traction"], operation["retraction"]
    shortest, longest = operation["tether_length_min_m"], operation["tether_length_max_m"]
    sine = math.sin(math.radians(traction["elevation_deg"]))
    found = []
    for what, value, quantity, side in (
        ("operation.tether_length_min_m", shortest, "tether_length", "_min_"),
        ("operation.tether_length_max_m", longest, "tether_length", "_max_"),
        ("operation.retraction.tether_force_N", retraction["tether_force_N"], "tether_force", "_min_"),
        ("operation.traction.tether_force_N", traction["tether_force_N"], "tether_force", "_max_"),
        ("operation.traction.elevation_deg", traction["elevation_deg"], "elevation", "_min_"),
        ("operation.traction.elevation_deg", traction["elevation_deg"], "elevation", "_max_"),
        ("the prescribed altitude in m at the start of traction", shortest * sine, "height", "_min_"),
        ("the prescribed altitude in m at the end of traction", longest * sine, "height", "_max_"),
        ("the prescribed stroke in m", longest - shortest, "stroke", "_min_"),
    ):
        for path, key in limit_keys().items():
            row = key.limit
            if row is None or row.quantity != quantity or side not in path or "traction" not in row.phases:
                continue
            limit, sign = limits[key.name], 1.0 if side == "_min_" else -1.0
            if limit is not None and sign * (limit - value) > 0:
                word = "below" if side == "_min_" else "above"
                found.append(
                    f"{what} ({value:.6g}) is {word} {path} ({show(limit)}); the prescribed cycle lies outside the "
                    "limits of the optimal one"
                )
    return found


def _strength_warnings(content: Block) -> list[str]:
    """Report forces beyond the strength of the tether."""
    limits, tether = content["limits"], content["tether"]
    found = []
    strength = tether["breaking_force_N"]
    if strength is not None:
        traction_force = content["operation"]["traction"]["tether_force_N"]
        for path, force in (
            ("limits.tether_force_max_N", limits["tether_force_max_N"]),
            ("operation.traction.tether_force_N", traction_force),
        ):
            if force > strength:
                found.append(
                    f"{path} ({show(force)}) is beyond tether.breaking_force_N ({show(strength)}), where the tether "
                    "breaks"
                )
    return found
