"""Every key of the problem file with its kind, unit, bounds and default, read off the structures.

The structures of `kiteocp.problem.layout` are the only place where keys are declared; checks, messages, template and
overrides ask this catalogue.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Literal

import msgspec
from msgspec import inspect

from kiteocp.problem.layout import ProblemLayout
from kiteocp.problem.limits import LimitRow

Kind = Literal["section", "variants", "mapping", "number", "integer", "text", "list"]

#: Stands for "no default" where None is one.
MISSING: Any = msgspec.NODEFAULT


class Key(msgspec.Struct, frozen=True):
    """One key of the problem file.

    Attributes
    ----------
    path : str
        Dotted path, empty for the file itself.
    kind : str
        ``section`` has `children`; ``variants`` has `variants`, sections by the value of `tag_field`; ``list`` is a
        list of numbers; ``mapping`` holds blocks of one layout, `entry`, by key paths.
    unit, meaning : str
        For people.
    required : bool
        No default of any kind.
    default : object
        The default, or `MISSING`.
    derived : str, optional
        How the default follows from other keys.
    nullable : bool
        Whether null is a value (a limit that is absent).
    bounds : mapping of str to float
        ``gt``, ``ge``, ``lt``, ``le``; of the entries for a list.
    choices : tuple of str
        The allowed words, where a text is a choice.
    limit : LimitRow, optional
        What a number of ``limits`` bounds.
    example : number or list of numbers, optional
        A value for the template.
    """

    path: str
    kind: Kind
    meaning: str = ""
    unit: str = ""
    required: bool = True
    default: Any = msgspec.field(default_factory=lambda: MISSING)
    derived: str | None = None
    nullable: bool = False
    bounds: Mapping[str, float] = msgspec.field(default_factory=dict)
    choices: tuple[str, ...] = ()
    pattern: str | None = None
    max_length: int | None = None
    min_length: int | None = None
    children: Mapping[str, Key] = msgspec.field(default_factory=dict)
    tag_field: str = ""
    variants: Mapping[str, Key] = msgspec.field(default_factory=dict)
    entry: Key | None = None
    limit: LimitRow | None = None
    example: Any = None

    @property
    def name(self) -> str:
        """Last part of the path."""
        return self.path.rpartition(".")[2]

    def selected(self, value: Mapping[Any, Any]) -> Key:
        """Return the section that applies to a mapping: of ``variants`` the one its tag names."""
        if self.kind == "variants":
            return self.variants[value[self.tag_field]]
        return self

    def walk(self) -> Iterator[Key]:
        """Yield this key and all below it, those of every variant included."""
        yield self
        for child in self.children.values():
            yield from child.walk()
        for variant in self.variants.values():
            for child in variant.children.values():
                yield from child.walk()


@cache
def catalogue() -> Key:
    """Return the key of the whole file, built once."""
    return _key("", inspect.type_info(ProblemLayout), required=True)


@cache
def limit_keys() -> dict[str, Key]:
    """Return the numbers of ``limits`` by key path, in the order of the file."""
    return {key.path: key for key in catalogue().walk() if key.limit is not None}


@cache
def known_paths() -> tuple[str, ...]:
    """Return the path of every key, each once, in the order of the file."""
    return tuple(dict.fromkeys(key.path for key in catalogue().walk() if key.path))


def _key(path: str, kind: inspect.Type, **facts: Any) -> Key:
    while True:
        if isinstance(kind, inspect.Metadata):
            schema, extra = kind.extra_json_schema or {}, kind.extra or {}
            facts.setdefault("meaning", schema.get("description", ""))
            facts.setdefault("unit", schema.get("unit", ""))
            facts.setdefault("derived", extra.get("derived"))
            facts.setdefault("limit", extra.get("limit"))
            facts.setdefault("example", extra.get("example"))
            kind = kind.type
        elif isinstance(kind, inspect.UnionType) and not _is_struct_union(kind):
            facts["nullable"] = True
            (kind,) = (option for option in kind.types if not isinstance(option, inspect.NoneType))
        else:
            break
    if facts.get("derived"):
        facts["required"] = False
    if isinstance(kind, inspect.StructType):
        return Key(path, "section", children=_children(path, kind), **facts)
    if isinstance(kind, inspect.DictType):
        return Key(path, "mapping", entry=_key(path, kind.value_type, required=True), **facts)
    if isinstance(kind, inspect.UnionType):
        return _variants(path, kind, facts)
    if isinstance(kind, inspect.FloatType | inspect.IntType):
        return Key(path, "number" if isinstance(kind, inspect.FloatType) else "integer", bounds=_bounds(kind), **facts)
    if isinstance(kind, inspect.VarTupleType):
        entry = _key(path, kind.item_type)
        return Key(path, "list", bounds=entry.bounds, min_length=kind.min_length, **facts)
    if isinstance(kind, inspect.LiteralType | inspect.StrType):
        return _text(path, kind, facts)
    raise TypeError(f"{path}: the problem file has no notation for {kind}")


def _text(path: str, kind: inspect.LiteralType | inspect.StrType, facts: dict[str, Any]) -> Key:
    if isinstance(kind, inspect.StrType):
        return Key(path, "text", pattern=kind.pattern, max_length=kind.max_length, **facts)
    # msgspec sorts the words; the default is the one to read first.
    words = sorted(map(str, kind.values), key=lambda word: (word != facts.get("default"), word))
    return Key(path, "text", choices=tuple(words), **facts)


def _is_struct_union(kind: inspect.UnionType) -> bool:
    return all(isinstance(option, inspect.StructType) for option in kind.types)


def _children(path: str, kind: inspect.StructType) -> dict[str, Key]:
    prefix = f"{path}." if path else ""
    children: dict[str, Key] = {}
    for item in kind.fields:
        default = item.default
        if item.default_factory is not MISSING:
            default = msgspec.to_builtins(item.default_factory())
        children[item.encode_name] = _key(prefix + item.encode_name, item.type, required=item.required, default=default)
    return children


def _variants(path: str, kind: inspect.UnionType, facts: dict[str, Any]) -> Key:
    options = [option for option in kind.types if isinstance(option, inspect.StructType)]
    tag_field = str(options[0].tag_field)
    tag = Key(f"{path}.{tag_field}", "text", "which law gives the values", choices=tuple(str(o.tag) for o in options))
    variants = {
        str(option.tag): Key(
            path,
            "section",
            meaning=(option.cls.__doc__ or "").strip(),
            children={tag_field: tag, **_children(path, option)},
        )
        for option in options
    }
    return Key(path, "variants", tag_field=tag_field, variants=variants, **facts)


def _bounds(kind: inspect.FloatType | inspect.IntType) -> dict[str, float]:
    bounds = {name: getattr(kind, name) for name in ("gt", "ge", "lt", "le")}
    return {name: bound for name, bound in bounds.items() if bound is not None}
