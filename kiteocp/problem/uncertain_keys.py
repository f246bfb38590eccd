"""Check of the ``uncertainty`` block against the numbers of the problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kiteocp.problem.checking import Fail, nearest
from kiteocp.problem.reading import show
from kiteocp.problem.uncertainty import WAYS

#: Blocks whose numbers may be uncertain.
UNCERTAIN_BLOCKS = ("environment", "kite", "tether", "operation", "limits", "machine")


def check_uncertainty(content: Mapping[str, Any], fail: Fail) -> None:
    """Check that every uncertain key is a number of the problem, and that its uncertainty makes sense for its value.

    Parameters
    ----------
    content : mapping
        The resolved problem.
    fail : callable
        Called with key path and message at the first contradiction.
    """
    numbers = dict(_numbers(content))
    for key, entry in content["uncertainty"].items():
        path = f"uncertainty.{key}"
        if key not in numbers:
            near = nearest(key, numbers)
            remedy = f"did you mean {near}?" if near else "give the path of a number, as in --set, such as kite.mass_kg"
            fail(path, f"{path} is not the key of a number in this problem; {remedy}")
        given = [way for way in WAYS if way in entry]
        if len(given) != 1:
            found = " and ".join(given) or "nothing"
            fail(path, f"{path} gives {found}; give exactly one of {', '.join(WAYS)}")
        value = numbers[key]
        if given[0] == "relative_standard_deviation" and value == 0.0:
            fail(path, f"{path} is relative, but {key} is 0; give standard_deviation")
        if given[0] == "range":
            ends = entry["range"]
            if len(ends) != 2 or not ends[0] < ends[1]:
                shown = ", ".join(map(show, ends))
                fail(f"{path}.range", f"{path}.range is [{shown}]; give the lowest and the highest value")
            if not ends[0] <= value <= ends[1]:
                fail(
                    f"{path}.range",
                    f"{path}.range is [{show(ends[0])}, {show(ends[1])}], which does not contain the value of {key} "
                    f"({show(value)}); widen the range or correct the value",
                )


def lost_keys(content: Mapping[str, Any], before: Mapping[str, Any]) -> set[str]:
    """Return the uncertain keys whose numbers were given before values were set, and are no longer there.

    Parameters
    ----------
    content : mapping
        The resolved problem with the values set.
    before : mapping
        The keys given without them, unchecked.
    """
    uncertain = set(content["uncertainty"])
    return (uncertain - dict(_numbers(content)).keys()) & dict(_numbers(before)).keys()


def _numbers(content: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return key path and value of every number of a problem, resolved or as given."""
    found: list[tuple[str, float]] = []

    def walk(path: str, value: Any) -> None:
        if isinstance(value, Mapping):
            for name, item in value.items():
                walk(f"{path}.{name}", item)
        elif isinstance(value, list | tuple):
            for index, item in enumerate(value):
                walk(f"{path}[{index}]", item)
        elif isinstance(value, float | int):
            found.append((path, float(value)))

    for block in UNCERTAIN_BLOCKS:
        walk(block, content.get(block))
    return found
