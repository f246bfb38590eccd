"""The JSON Schema of the problem file, for editors that complete and check."""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import msgspec

from kiteocp.problem.catalogue import MISSING, Key, catalogue
from kiteocp.problem.layout import ProblemLayout
from kiteocp.problem.overrides import ALTERNATIVES
from kiteocp.problem.uncertainty import WAYS

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the problem file.

    It is derived from the structures that check the file, with the description and the unit of every key.
    Relations between keys, such as the order of two lengths, are beyond it; `load_problem` checks them.
    """
    return copy.deepcopy(_schema())


@cache
def _schema() -> dict[str, Any]:
    schema = msgspec.json.schema(ProblemLayout)
    definitions: dict[str, dict[str, Any]] = schema.pop("$defs")
    root = definitions.pop(ProblemLayout.__name__)
    _complete(root, catalogue(), definitions)
    for definition in definitions.values():
        pair = sorted(set(ALTERNATIVES) & set(definition["properties"]))
        if len(pair) == 2:
            definition["oneOf"] = [{"required": [name]} for name in pair]
    title = {"$schema": DIALECT, "title": "kiteocp problem"}
    return {**root, **title, "$defs": definitions}


def _complete(definition: dict[str, Any], key: Key, definitions: dict[str, dict[str, Any]]) -> None:
    """Add to an object what msgspec does not know: derived defaults, and blocks that may be left empty."""
    definition["required"] = [name for name in definition["required"] if _is_required(key, name)]
    for name, child in key.children.items():
        entry = definition["properties"][name]
        if child.derived:
            entry["description"] = f"{child.meaning} (default: {child.derived})"
        if child.kind == "mapping":
            reference = entry.pop("additionalProperties")
            definitions[reference["$ref"].rpartition("/")[2]]["oneOf"] = [{"required": [way]} for way in WAYS]
            entry.pop("type")
            entry["anyOf"] = [{"type": "object", "additionalProperties": reference}, {"type": "null"}]
        if child.kind == "section":
            reference = entry.pop("$ref")
            _complete(definitions[reference.rpartition("/")[2]], child, definitions)
            empty = [] if any(grandchild.required for grandchild in child.children.values()) else [{"type": "null"}]
            if empty:
                entry["anyOf"] = [{"$ref": reference}, *empty]
            else:
                entry["$ref"] = reference


def _is_required(key: Key, name: str) -> bool:
    child = key.children[name]
    return child.required and child.default is MISSING
