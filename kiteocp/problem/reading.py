"""YAML text to plain values, with the line of every key and without the traps of YAML 1.1.

PyYAML reads YAML 1.1: ``5e-3`` is a text, ``010`` is eight, ``no`` is a truth value, ``12:30`` a sexagesimal number,
and the second of two equal keys wins silently. Here scalars follow the core schema of YAML 1.2 (section 10.3.2 of
its specification), and a duplicate key is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import msgspec
import yaml

from kiteocp.errors import InputError, shortened
from kiteocp.problem.files import path_label, read_source

#: A problem file is a few kilobytes; anything larger is something else, and not worth parsing.
SIZE_LIMIT_BYTES = 1_000_000
#: The layout has four levels; the rest is room for what deserves a better message than this one.
DEPTH_LIMIT = 50
#: Values of a file, those behind aliases counted as often as they are named. Anchors and aliases are allowed, as they
#: save writing a block twice, but a few lines of aliases of aliases can stand for more values than fit in memory.
#: A wind table of thousands of heights stays far below.
VALUE_LIMIT = 100_000

_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Base):  # type: ignore[misc]
    """The fast safe loader with the scalars of YAML 1.2."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012
    # No tags beyond the core schema: dates, sets and binaries have no place in a problem file.
    yaml_constructors = {  # noqa: RUF012
        tag: constructor
        for tag, constructor in _Base.yaml_constructors.items()
        if tag is None or tag.rpartition(":")[2] in ("map", "seq", "str", "null")
    }


def _integer(loader: Any, node: yaml.ScalarNode) -> int | float:
    digits = loader.construct_scalar(node)
    if digits[:2] in ("0x", "0o"):
        return int(digits, 0)
    # Python converts at most 4300 digits; such a number is infinite for all purposes here.
    return int(digits) if len(digits) < 4000 else float("inf")


def _truth(loader: Any, node: yaml.ScalarNode) -> bool:
    word = loader.construct_scalar(node).lower()
    if word not in ("true", "false"):
        raise ValueError(f"{word!r} is not true or false")
    return bool(word == "true")


def _float(loader: Any, node: yaml.ScalarNode) -> float:
    return float(loader.construct_scalar(node).lower().replace(".inf", "inf").replace(".nan", "nan"))


_SCALARS: tuple[tuple[str, str, list[str]], ...] = (
    ("null", r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    ("int", r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$", list("-+0123456789")),
    (
        "float",
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
        list("-+0123456789."),
    ),
    ("merge", r"^(?:<<)$", ["<"]),
)
for _tag, _pattern, _first in _SCALARS:
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(_pattern), _first)
_Loader.add_constructor("tag:yaml.org,2002:bool", _truth)
_Loader.add_constructor("tag:yaml.org,2002:int", _integer)
_Loader.add_constructor("tag:yaml.org,2002:float", _float)


class Document(msgspec.Struct, frozen=True):
    """What a file holds.

    Attributes
    ----------
    label : str
        The file as the user named it, for messages.
    content : dict
        The mapping as given, unchecked.
    lines : mapping of str to int
        Line of each key by its path, counted from 1.
    source : bytes
        The bytes of the file.
    """

    label: str
    content: dict[Any, Any]
    lines: Mapping[str, int]
    source: bytes


def read_document(path: Path, label: str | None = None) -> Document:
    """Read a problem file.

    Parameters
    ----------
    path : pathlib.Path
        A YAML file (JSON is YAML too).
    label : str, optional
        What messages call it, the path if not given.

    Raises
    ------
    InputError
        If it is missing, unreadable, no text, no YAML, empty, or not a mapping of keys to values.
    """
    if label is None:
        label = path_label(path)
    source = read_source(path, label, SIZE_LIMIT_BYTES)
    if len(source) > SIZE_LIMIT_BYTES:
        raise InputError("is larger than 1 MB and cannot be a problem file; check the path", file=label)
    try:
        decoded = source.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = source[: error.start].count(b"\n") + 1
        raise InputError("is not UTF-8 text; save the file as UTF-8", file=label, line=line) from None
    content, lines = parse(decoded, label)
    if content is None:
        raise InputError("is empty; `kiteocp new NAME` writes a template to start from", file=label)
    if not isinstance(content, dict):
        raise InputError(
            f"holds {describe(content)}, not keys with values; `kiteocp new NAME` writes a template to start from",
            file=label,
        )
    return Document(label, content, lines, source)


def parse(text: str, label: str) -> tuple[Any, dict[str, int]]:
    """Parse YAML text into plain values and the line of each key path.

    Raises
    ------
    InputError
        If the text is not YAML or repeats a key.
    """
    try:
        _check_extent(text, label)
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            lines: dict[str, int] = {}
            if node is not None:
                _note_lines(node, "", lines, label, ())
            return (None if node is None else loader.construct_document(node)), lines
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = " ".join(f"{error.context or ''} {error.problem or ''}".split())
        raise InputError(
            f"is not valid YAML ({reason}); check indentation, colons and quotes there",
            file=label,
            line=None if mark is None else mark.line + 1,
        ) from None
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"is not valid YAML ({reason}); save it as plain text", file=label) from None
    except ValueError as error:
        raise InputError(f"holds a value that cannot be read ({error}); correct it", file=label) from None


def _check_extent(text: str, label: str) -> None:
    """Reject deep nesting and aliases that multiply, on the stream of events, before anything is built from them.

    The composer recurses in C and would overflow the stack; what follows it walks through every alias.
    """
    open_sizes: list[tuple[str | None, int]] = []
    sizes: dict[str, int] = {}
    total = 0
    try:
        for event in yaml.parse(text, Loader=_Loader):
            size = 0
            if isinstance(event, yaml.CollectionStartEvent):
                open_sizes.append((event.anchor, total))
                if len(open_sizes) > DEPTH_LIMIT:
                    raise _nested_too_deeply(label)
                size = 1
            elif isinstance(event, yaml.CollectionEndEvent):
                anchor, before = open_sizes.pop()
                if anchor is not None:
                    sizes[anchor] = total - before
            elif isinstance(event, yaml.ScalarEvent):
                size = 1
                if event.anchor is not None:
                    sizes[event.anchor] = 1
            elif isinstance(event, yaml.AliasEvent):
                # One that is not known, or not complete, gets its own message from the composer.
                size = sizes.get(str(event.anchor), 1)
            total += size
            if total > VALUE_LIMIT:
                raise InputError(
                    f"holds more than {VALUE_LIMIT} values, those behind aliases counted each time; write out the few "
                    "that a file needs",
                    file=label,
                    line=None if event.start_mark is None else event.start_mark.line + 1,
                )
    except yaml.MarkedYAMLError:
        # The parser looks far ahead of its events, and its newer versions have a limit of their own there.
        if _bracket_depth(text) > DEPTH_LIMIT:
            raise _nested_too_deeply(label) from None
        raise


def _nested_too_deeply(label: str) -> InputError:
    return InputError("is nested too deeply for a problem file; check the brackets", file=label)


def _bracket_depth(text: str) -> int:
    """Return how deep the brackets of a text are nested, outside quotes and comments."""
    bare = re.sub(r"'[^'\n]*'|\"[^\"\n]*\"|(?:^|\s)#[^\n]*", "", text)
    deepest = depth = 0
    for bracket in re.findall(r"[][{}]", bare):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def _note_lines(node: yaml.Node, path: str, lines: dict[str, int], label: str, above: tuple[int, ...]) -> None:
    """Record the line of every key of a mapping, and reject a key given twice."""
    if id(node) in above:
        line = node.start_mark.line + 1
        raise InputError("holds an alias that contains itself; write the values out", file=label, line=line)
    above = (*above, id(node))
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            lines[f"{path}[{index}]"] = item.start_mark.line + 1
            _note_lines(item, f"{path}[{index}]", lines, label, above)
    if not isinstance(node, yaml.MappingNode):
        return
    seen: dict[str, int] = {}
    for key, value in node.value:
        # A key may be a list or a block, which the check of the keys refuses.
        plain = isinstance(key, yaml.ScalarNode)
        name = str(key.value) if plain else f"{key.tag} {key.start_mark.index}"
        line = key.start_mark.line + 1
        child = f"{path}.{name}" if path else name
        if name in seen:
            raise InputError(
                f"{child} is given twice, in lines {seen[name]} and {line}; remove one of them",
                file=label,
                line=line,
                key=child,
            )
        seen[name] = line
        lines[child] = line
        _note_lines(value, child, lines, label, above)


def describe(value: object) -> str:
    """Return a value as a person would name it: ``the text '3 kN'``, ``a list``, ``empty``."""
    match value:
        case None:
            words = "empty"
        case bool():
            words = f"the truth value {str(value).lower()}"
        case str():
            words = f"the text {shortened(value, 60)!r}"
        case Real():
            words = f"the number {show(value)}"
        case Mapping():
            words = "a block of keys"
        case list() | tuple():
            words = "a list"
        case _:
            words = f"a {type(value).__name__}"
    return words


def is_number_text(value: str) -> bool:
    """Return whether a text would be a finite number without its quotes."""
    return any(re.match(pattern, value) for _, pattern, _ in _SCALARS[2:4])


def show(value: object) -> str:
    """Return a number as it would be written in the file, and anything else as it is."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return str(value)
    try:
        return f"{float(value):.10g}"
    except OverflowError:
        return "inf"
