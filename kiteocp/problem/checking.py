"""Checks of single values against the catalogue of keys, each failure one sentence with its remedy."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from numbers import Real
from typing import Any, NoReturn

from kiteocp.errors import InputError
from kiteocp.problem.catalogue import Key, catalogue
from kiteocp.problem.fields import FOREIGN_UNITS, UNIT_SUFFIXES
from kiteocp.problem.reading import describe, is_number_text, show

#: Raises the `InputError` of a key path and a message; knows file and line.
Fail = Callable[[str, str], NoReturn]

#: Bounds of a number by their names in the catalogue: words, and the test, which holds for arrays too.
BOUNDS: dict[str, tuple[str, Callable[[Any, float], Any]]] = {
    "gt": ("greater than", lambda value, bound: value > bound),
    "ge": ("at least", lambda value, bound: value >= bound),
    "lt": ("less than", lambda value, bound: value < bound),
    "le": ("at most", lambda value, bound: value <= bound),
}


def checked(content: Any, fail: Fail, key: Key | None = None) -> Any:
    """Check a value and return it with numbers of the right type, empty optional sections as ``{}``.

    Parameters
    ----------
    content : object
        Plain values, as read from a file.
    fail : callable
        Called with key path and message at the first value that is wrong.
    key : Key, optional
        The key that the value belongs to; the whole file if not given.
    """
    key = catalogue() if key is None else key
    if content is None and key.nullable:
        return None
    if content is None and key.kind == "section" and not any(child.required for child in key.children.values()):
        return {}
    if key.kind in {"number", "integer"}:
        return checked_number(content, fail, key, key.path)
    check = {"mapping": _checked_mapping, "list": _checked_list, "text": _checked_text}.get(key.kind, _checked_section)
    return check(content, fail, key)


def _checked_section(content: Any, fail: Fail, key: Key) -> dict[str, Any]:
    if not isinstance(content, Mapping):
        found = describe(content)
        fail(key.path, f"{key.path} is {found}; expected a block with {_enumeration(_own_keys(key))}")
    if key.kind == "variants":
        tag = f"{key.path}.{key.tag_field}"
        words = tuple(key.variants)
        if key.tag_field not in content:
            fail(tag, f"{tag} is missing; give one of {_enumeration(words, 'or')}")
        _check_choice(content[key.tag_field], fail, tag, words)
        key = key.selected(content)
    for name in content:
        if name not in key.children:
            _fail_unknown(name, fail, key)
    for child in key.children.values():
        if child.required and child.name not in content:
            unit = f" in {child.unit}" if child.unit not in ("", "1") else ""
            fail(child.path, f"{child.path} is missing; give {_article(child)}{unit}{_hint(child)}")
    return {name: checked(value, fail, key.children[name]) for name, value in content.items()}


def _checked_mapping(content: Any, fail: Fail, key: Key) -> dict[str, Any]:
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        fail(key.path, f"{key.path} is {describe(content)}; expected a block with key paths, such as kite.mass_kg")

    def fail_below(entry: str) -> Fail:
        # The entries share one layout, whose keys do not know which entry they are in.
        own = f"{key.path}.{entry}"

        def fail_there(path: str, message: str) -> NoReturn:
            fail(path.replace(key.path, own, 1), message.replace(key.path, own, 1))

        return fail_there

    for name in content:
        if not isinstance(name, str):
            fail(key.path, f"{key.path} holds {describe(name)} as a key; give key paths, such as kite.mass_kg")
    return {name: checked(value, fail_below(name), key.entry) for name, value in content.items()}


def _own_keys(key: Key) -> tuple[str, ...]:
    if key.kind == "variants":
        return (key.tag_field,)
    names = tuple(child.name for child in key.children.values() if child.required)
    return names or tuple(key.children)


def _article(key: Key) -> str:
    if key.kind in ("section", "variants"):
        return f"a block with {_enumeration(_own_keys(key))}"
    return {"number": "a number", "integer": "a whole number", "list": "a list of numbers"}.get(key.kind, "a text")


def _hint(key: Key) -> str:
    return f" ({key.meaning})" if key.meaning else ""


def checked_number(value: Any, fail: Fail, key: Key, path: str) -> float | int:
    """Check one number, which stands at a path of its own where it is an entry of a list."""
    unit = "" if key.unit in ("", "1") else f" {key.unit}"
    bare = f"a bare number in {key.unit}" if unit else "a bare number"
    expected = "a whole number" if key.kind == "integer" else "a number" + (f" in {key.unit}" if unit else "")
    if isinstance(value, str):
        remedy = "without quotes" if is_number_text(value) else "without text"
        instead = ", or null for no limit" if key.nullable else ""
        fail(path, f"{path} is {describe(value)}; give {bare} {remedy}{instead}")
    if value is None and not key.required:
        fail(path, f"{path} is empty; give {bare} or leave the key out")
    if isinstance(value, bool) or not isinstance(value, Real):
        fail(path, f"{path} is {describe(value)}; expected {expected}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        fail(path, f"{path} is {show(number)}; give a finite number{' in' + unit if unit else ''}")
    if key.kind == "integer" and number != int(number):
        fail(path, f"{path} is {show(number)}; expected a whole number")
    for name, bound in key.bounds.items():
        words, holds = BOUNDS[name]
        if not holds(number, bound):
            fail(path, f"{path} is {show(number)}{unit}; it must be {words} {show(bound)}{unit}{_hint(key)}")
    return int(number) if key.kind == "integer" else number


def _checked_list(value: Any, fail: Fail, key: Key) -> list[float]:
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        fail(key.path, f"{key.path} is {describe(value)}; expected a list of numbers in {key.unit}, as [1.0, 2.0]")
    entries = list(value)
    if key.min_length is not None and len(entries) < key.min_length:
        fail(key.path, f"{key.path} has too few entries ({len(entries)}); give at least {key.min_length}")
    return [checked_number(entry, fail, key, f"{key.path}[{index}]") for index, entry in enumerate(entries)]


def _checked_text(value: Any, fail: Fail, key: Key) -> str:
    if key.choices:
        return _check_choice(value, fail, key.path, key.choices)
    if not isinstance(value, str):
        fail(key.path, f"{key.path} is {describe(value)}; expected a text: put it in quotes")
    if key.pattern is not None and not re.fullmatch(key.pattern, value):
        fail(
            key.path,
            f"{key.path} is {describe(value)}; begin with a letter or digit and use only letters, digits, '.', '_' and"
            " '-', as it becomes a directory name",
        )
    if key.max_length is not None and len(value) > key.max_length:
        fail(key.path, f"{key.path} has {len(value)} characters; use at most {key.max_length}")
    return value


def _check_choice(value: Any, fail: Fail, path: str, words: tuple[str, ...]) -> str:
    if not isinstance(value, str) or value not in words:
        near = nearest(value, words) if isinstance(value, str) else None
        guess = f"did you mean {near}? It can be" if near else "it can be"
        fail(path, f"{path} is {describe(value)}; {guess} {_enumeration(words, 'or')}")
    return value


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Return the word that resembles a mistyped one most, or None if none does."""
    lower = {candidate.lower(): candidate for candidate in words}
    shortened = [candidate for candidate in lower if len(word) >= 3 and candidate.startswith(word.lower())]
    if len(shortened) == 1:
        return lower[shortened[0]]
    import difflib  # noqa: PLC0415  (for mistakes only)

    found = difflib.get_close_matches(word.lower(), list(lower), n=1, cutoff=0.6)
    return lower[found[0]] if found else None


def _enumeration(words: Iterable[str], conjunction: str = "and") -> str:
    *first, last = words
    return f"{', '.join(first)} {conjunction} {last}" if first else last


def _fail_unknown(name: Any, fail: Fail, key: Key) -> NoReturn:
    """Report a key that the section does not have, with what was probably meant."""
    path = f"{key.path}.{name}" if key.path else str(name)
    fail(path, f"{path} is not a known key; {suggestion(str(name), key)}")


def suggestion(name: str, key: Key) -> str:
    """Return what to do about a key name that a section does not have."""
    for child in key.children.values():
        stem = _stem(child.name)
        head, _, unit = name.lower().partition(f"{stem.lower()}_")
        if stem != child.name and (name.lower() == stem.lower() or (not head and unit in FOREIGN_UNITS)):
            return f"give it in {child.unit}, as {child.name}"
    owners = _owners(name, key)
    if owners:
        return f"it belongs where {owners}"
    near = nearest(name, key.children)
    if near is not None:
        return f"did you mean {key.path}.{near}?" if key.path else f"did you mean {near}?"
    elsewhere = [other.path for other in catalogue().walk() if other.path and other.name == name]
    if elsewhere:
        return f"it belongs to {elsewhere[0]}"
    place = f"{key.path} has" if key.path else "the file has"
    return f"{place} the keys {_enumeration(key.children)}"


def _owners(name: str, key: Key) -> str:
    """Return of which sibling variants a key is, in words, or nothing."""
    for parent in catalogue().walk():
        if parent.kind == "variants" and parent.path == key.path:
            tags = [tag for tag, variant in parent.variants.items() if name in variant.children]
            return f"{parent.tag_field} is {_enumeration(tags, 'or')}" if tags else ""
    return ""


def _stem(name: str) -> str:
    for suffix in UNIT_SUFFIXES:
        if name.endswith(suffix):
            return name.removesuffix(suffix)
    return name


def failing(file: str | None, lines: Mapping[str, int]) -> Fail:
    """Return the function that raises `InputError` with file, line and key."""

    def fail(path: str, message: str) -> NoReturn:
        raise InputError(message, file=file, line=_line(path, lines), key=path)

    return fail


def _line(path: str, lines: Mapping[str, int]) -> int | None:
    """Return the line of a key, of the block it is missing from, or None."""
    while path and path not in lines:
        path = re.sub(r"(\[\d+\]|\.?[^.\[\]]*)$", "", path)
    return lines.get(path)
