"""Values set over those of a problem file, from the command line or from Python."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from typing import Any

from kiteocp.errors import InputError, shortened
from kiteocp.problem.catalogue import catalogue, known_paths
from kiteocp.problem.checking import Fail, nearest, suggestion
from kiteocp.problem.reading import describe, parse

#: Keys of one block of which a file gives exactly one: setting one removes the other.
ALTERNATIVES = {"lift_to_drag": "drag_coefficient", "drag_coefficient": "lift_to_drag"}

#: Before the key path that an entry of the ``uncertainty`` block belongs to.
UNCERTAINTY = "uncertainty."

_ENTRY = re.compile(r"^(?P<path>.*)\[(?P<index>\d+)\]$")


def parse_override(text: str) -> tuple[str, Any]:
    """Split ``key.path=value`` and read the value as YAML (a scalar, or a list or block in brackets).

    Parameters
    ----------
    text : str
        Such as ``environment.wind.reference_speed_m_s=8`` or ``environment.wind.heights_m=[0, 200, 600]``.

    Returns
    -------
    tuple of str and object
        Key path and value; ``null`` takes the key out, so that its default holds.

    Raises
    ------
    InputError
        If there is no ``=``, no key, no value, or the value is not YAML.
    """
    path, equals, value_text = text.partition("=")
    path = path.strip()
    if not equals or not path or not value_text.strip():
        raise InputError(
            f"--set {shortened(text, 80)}: expected key=value, such as environment.wind.reference_speed_m_s=8",
            key=path or None,
        )
    value, _ = parse(value_text, f"--set {shortened(text, 80)}")
    return path, value


def with_overrides(given: Mapping[str, Any], overrides: Mapping[str, Any], fail: Fail) -> dict[str, Any]:
    """Return a copy of the given keys with others set.

    Setting one of a pair of alternative keys removes the other; setting ``environment.wind.profile`` removes the keys
    that the new profile does not have; None removes a key, so that its default holds.

    Parameters
    ----------
    given : mapping
        The keys as given in the file, checked.
    overrides : mapping of str to object
        Values by key path; ``path[index]`` is an entry of a list.
    fail : callable
        Called with key path and message for a path that does not exist.
    """
    content: dict[str, Any] = copy.deepcopy(dict(given))
    for path in overrides:
        if not isinstance(path, str):
            fail(str(path), f"the key to set is {describe(path)}; give its path as a text, such as kite.mass_kg")
        _check_path(path, fail)
    # A choice of profile decides which keys there are, so blocks come before their keys and tags before values.
    for path in sorted(overrides, key=lambda path: (path.count("."), not path.endswith(".profile"))):
        _set(content, path, copy.deepcopy(overrides[path]), overrides, fail)
    return content


def _check_path(path: str, fail: Fail) -> None:
    if path.startswith(UNCERTAINTY):
        return
    entry = _ENTRY.match(path)
    bare = entry["path"] if entry else path
    keys = {key.path: key for key in catalogue().walk() if key.path}
    if bare not in keys:
        parent, _, name = bare.rpartition(".")
        if parent in keys and keys[parent].kind == "section":
            fail(path, f"{path} is not a known key; {suggestion(name, keys[parent])}")
        same_name = [known for known in known_paths() if known.rpartition(".")[2] == name]
        guess = nearest(bare, same_name) or nearest(bare, known_paths()) or (same_name[0] if same_name else None)
        remedy = f"did you mean {guess}?" if guess else "`kiteocp new NAME` writes a file with every key"
        fail(path, f"{path} is not a known key; {remedy}")
    if entry and keys[bare].kind != "list":
        fail(path, f"{path} has an index, but {bare} is not a list; set {bare} itself")


def _set(content: dict[str, Any], path: str, value: Any, overrides: Mapping[str, Any], fail: Fail) -> None:
    if path.startswith(UNCERTAINTY):
        # Its keys are key paths themselves; whether they exist is checked with the rest of the block.
        uncertain = content["uncertainty"] = dict(content.get("uncertainty") or {})
        if value is None:
            uncertain.pop(path.removeprefix(UNCERTAINTY), None)
        else:
            uncertain[path.removeprefix(UNCERTAINTY)] = value
        return
    entry = _ENTRY.match(path)
    *above, name = (entry["path"] if entry else path).split(".")
    block = content
    for part in above:
        if not isinstance(block.get(part), dict):
            block[part] = {}
        block = block[part]
    if entry:
        entries = block.get(name)
        length = len(entries) if isinstance(entries, list) else 0
        # Python converts at most 4300 digits.
        index = int(entry["index"]) if len(entry["index"]) <= 9 else length
        if not isinstance(entries, list) or index >= length:
            fail(path, f"{path} does not exist, as {entry['path']} has {length} entries; set the whole list")
        entries[index] = value
        return
    if value is None:
        block.pop(name, None)
        return
    block[name] = value
    other = ALTERNATIVES.get(name)
    if other is not None and overrides.get(".".join([*above, other])) is None:
        block.pop(other, None)
    if above == ["environment", "wind"] and name == "profile":
        variants = next(key for key in catalogue().walk() if key.path == "environment.wind").variants
        if isinstance(value, str) and value in variants:
            for key in set(block) - set(variants[value].children):
                del block[key]
