"""The template and the JSON Schema hold every key with its unit, and agree with what the reader accepts."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from kiteocp.errors import InputError
from kiteocp.problem import json_schema, load_problem, problem_template, shipped_problems
from kiteocp.problem.catalogue import catalogue, known_paths

SCHEMA = json_schema()


def faults(value: Any, schema: dict[str, Any], path: str = "") -> list[str]:
    """Return where a value departs from a schema: as much of JSON Schema as the problem file's uses."""
    if "$ref" in schema:
        return faults(value, SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]], path)
    if "anyOf" in schema:
        options = [faults(value, option, path) for option in schema["anyOf"]]
        return [] if any(not option for option in options) else min(options, key=len)
    if "oneOf" in schema and sum(not faults(value, {"type": "object", **option}) for option in schema["oneOf"]) != 1:
        return [f"{path}: not exactly one of the alternatives"]
    kinds = {"object": dict, "string": str, "number": int | float, "integer": int, "array": list, "null": type(None)}
    if "type" in schema and (not isinstance(value, kinds[schema["type"]]) or isinstance(value, bool)):
        return [f"{path}: not of type {schema['type']}"]
    found = [f"{path}: not one of {schema['enum']}"] if "enum" in schema and value not in schema["enum"] else []
    if isinstance(value, dict):
        found += [f"{path}.{key}: missing" for key in schema.get("required", []) if key not in value]
        for key, item in value.items():
            if key in schema.get("properties", {}):
                found += faults(item, schema["properties"][key], f"{path}.{key}")
            elif schema.get("additionalProperties") is False:
                found.append(f"{path}.{key}: unknown")
    if isinstance(value, list):
        found += [fault for item in value for fault in faults(item, schema["items"], path)]
    if isinstance(value, int | float):
        found += _faults_of_number(value, schema, path)
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        found.append(f"{path}: not of the pattern")
    return found


def _faults_of_number(value: float, schema: dict[str, Any], path: str) -> list[str]:
    low, high = -float("inf"), float("inf")
    small = value <= schema.get("exclusiveMinimum", low) or value < schema.get("minimum", low)
    large = value >= schema.get("exclusiveMaximum", high) or value > schema.get("maximum", high)
    return [f"{path}: too {word}" for word, wrong in (("small", small), ("large", large)) if wrong]


@pytest.mark.parametrize("name", list(shipped_problems()))
def test_shipped_files_and_their_resolved_form_satisfy_the_schema(name: str) -> None:
    assert faults(yaml.safe_load(shipped_problems()[name].read_text()), SCHEMA) == []
    assert faults(json.loads(json.dumps(load_problem(name).to_dict())), SCHEMA) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"kite": {**load_problem("v3-kite").to_dict()["kite"], "mass_kg": -1}}, ".kite.mass_kg: too small"),
        ({"extra": 1}, ".extra: unknown"),
        ({"limits": {}}, ".limits.tether_force_max_N: missing"),
        ({"limits": None}, ".limits: not of type object"),
        ({"operation": {"force_reference": "air"}}, ".operation.force_reference: not one of ['ground', 'kite']"),
        ({"name": "a b"}, ".name: not of the pattern"),
    ],
)
def test_the_schema_rejects_what_the_reader_rejects(change: dict[str, Any], expected: str) -> None:
    content = {**json.loads(json.dumps(load_problem("v3-kite").to_dict())), **change}
    assert expected in faults(content, SCHEMA)


def test_blocks_with_defaults_may_be_empty_in_schema_and_reader(tmp_path: Path) -> None:
    text = shipped_problems()["v3-kite"].read_text() + "machine:\noptimisation: {mesh: }\n"
    (tmp_path / "empty.yaml").write_text(text)
    assert faults(yaml.safe_load(text), SCHEMA) == []
    assert load_problem(tmp_path / "empty.yaml") == load_problem("v3-kite")


def test_every_object_is_closed_and_every_number_has_unit_and_meaning() -> None:
    for definition in [SCHEMA, *SCHEMA["$defs"].values()]:
        assert definition["additionalProperties"] is False
        for name, entry in definition["properties"].items():
            options = [entry, *entry.get("anyOf", []), entry.get("items", {})]
            if any(option.get("type") in ("number", "integer") for option in options):
                assert any("unit" in option and option["description"] for option in options), name


def test_the_schema_handed_out_is_the_callers_own() -> None:
    json_schema()["properties"].clear()
    assert json_schema() == SCHEMA


def test_the_template_loads_and_has_every_key_with_its_unit(tmp_path: Path) -> None:
    text = problem_template("my-kite")
    path = tmp_path / "my-kite.yaml"
    path.write_text(text)
    problem = load_problem(path)
    assert (problem.name, problem.warnings()) == ("my-kite", [])
    assert len(known_paths()) > 60
    for key in (key for key in catalogue().walk() if key.path):
        line = re.search(rf"^\s*(# )?{re.escape(key.name)}:.*$", text, re.MULTILINE)
        assert line, key.path
        if key.unit not in ("", "1"):
            assert re.search(rf"\b{re.escape(key.name)}:.*\[{re.escape(key.unit)}\]", text), key.path


def test_the_values_commented_out_in_the_template_are_the_defaults(tmp_path: Path) -> None:
    plain, given = tmp_path / "plain.yaml", tmp_path / "given.yaml"
    text = problem_template("twin")
    plain.write_text(text)
    # Uncomment what has a default; alternatives and the strength of the tether have none.
    start = text.index("  air:")
    body = re.sub(r"^( +)# (?!or:|drag_coefficient|breaking)(\w+: )", r"\1\2", text[start:], flags=re.MULTILINE)
    given.write_text(text[:start] + body)
    assert body != text[start:]
    assert load_problem(given) == load_problem(plain)


@pytest.mark.parametrize("name", ["12", "true", "1e3", "null-ish"])
def test_a_template_name_that_reads_like_a_value_stays_a_text(tmp_path: Path, name: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(problem_template(name))
    assert load_problem(path).name == name


@pytest.mark.parametrize("name", ["", "a b", "../x", ".hidden", "x" * 101, 'a"b', "a\n"])
def test_a_template_name_that_cannot_be_one_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="cannot name a problem"):
        problem_template(name)
