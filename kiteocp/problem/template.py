"""A commented problem file to start from, written from the catalogue of keys."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from kiteocp.errors import InputError
from kiteocp.problem.catalogue import MISSING, Key, catalogue
from kiteocp.problem.layout import NAME_PATTERN
from kiteocp.problem.reading import show

#: Values of the mandatory keys that carry no example of their own: a leading-edge-inflatable
#: kite of 25 m2 wing area, about that of v3-kite.yaml.
_EXAMPLE: dict[str, Any] = {
    "environment.wind.profile": "logarithmic",
    "kite.projected_area_m2": 20.0,
    "kite.mass_kg": 23.0,
    "kite.powered.lift_coefficient": 0.9,
    "kite.powered.lift_to_drag": 4.5,
    "kite.powered.drag_coefficient": 0.2,
    "kite.depowered.lift_coefficient": 0.2,
    "kite.depowered.lift_to_drag": 2.0,
    "kite.depowered.drag_coefficient": 0.1,
    "tether.diameter_m": 0.004,
    "tether.density_kg_m3": 724.0,
    "tether.drag_coefficient": 1.1,
    "tether.breaking_force_N": 10000.0,
    "limits.tether_force_max_N": 5000.0,
}
_COMMENT_COLUMN = 44


def problem_template(name: str) -> str:
    """Return a problem file with every key, its unit and its meaning, which loads as it is.

    Keys with a default are commented out, and so are the alternatives to what is given.

    Parameters
    ----------
    name : str
        Name of the problem.

    Raises
    ------
    InputError
        If the name cannot be one.
    """
    if not re.fullmatch(NAME_PATTERN, name) or len(name) > 100:
        raise InputError(
            f"{name!r} cannot name a problem; begin with a letter or digit and use at most 100 letters, digits, '.', "
            "'_' and '-'"
        )
    head = [
        f"# {name}: a problem file of kiteocp. Units are in the names of the keys.",
        "# A key commented out has the default shown; its value here only shows how it is written.",
        "",
        # Quotes keep a name that reads like a number or a truth value a text.
        f'name: "{name}"',
        'description: ""',
        'source: ""',
    ]
    body: list[str] = []
    for key in catalogue().children.values():
        if key.kind == "mapping":
            body += ["", _commented(f"{key.name}:", key.meaning), *_UNCERTAINTY_EXAMPLES]
        elif key.kind in ("section", "variants"):
            body += ["", *_block(key, 0)]
    return "\n".join([*head, *body]) + "\n"


def _block(key: Key, depth: int) -> Iterator[str]:
    indent = "  " * depth
    yield _commented(f"{indent}{key.name}:", key.meaning)
    if key.kind == "section":
        for child in key.children.values():
            yield from _entry(child, depth + 1)
        return
    chosen = _EXAMPLE[f"{key.path}.{key.tag_field}"]
    for child in key.variants[chosen].children.values():
        yield from _entry(child, depth + 1)
    for tag, variant in key.variants.items():
        if tag != chosen:
            yield f"{indent}  # or: {variant.meaning}"
            for child in variant.children.values():
                value = tag if child.name == key.tag_field else _shown(child)
                yield _commented(f"{indent}  # {child.name}: {value}", _about(child))


def _entry(key: Key, depth: int) -> Iterator[str]:
    if key.kind in ("section", "variants"):
        yield from _block(key, depth)
        return
    # Of two alternative keys the example gives the lift-to-drag ratio.
    active = key.required or key.name == "lift_to_drag"
    yield _commented(f"{'  ' * depth}{'' if active else '# '}{key.name}: {_shown(key)}", _about(key))


def _shown(key: Key) -> str:
    """Return the value to write: the default, what a derived default comes to, or the example."""
    if key.default is not MISSING and key.default is not None:
        return show(key.default)
    example = _EXAMPLE.get(key.path, key.example)
    if example is not None:
        return show(example)
    return "null" if key.nullable else _DERIVED[key.path]


def _about(key: Key) -> str:
    unit = f"[{key.unit}] " if key.unit not in ("", "1") else ""
    choices = f": {' | '.join(key.choices)}" if key.choices else ""
    derived = f"; default: {key.derived}" if key.derived else ""
    optional = "; optional" if key.nullable and "null" not in key.meaning else ""
    instead = "; instead of lift_to_drag" if key.name == "drag_coefficient" and key.path.startswith("kite") else ""
    return f"{unit}{key.meaning}{choices}{derived}{optional}{instead}"


def _commented(line: str, comment: str) -> str:
    return f"{line:{_COMMENT_COLUMN}} # {comment}" if comment else line


_UNCERTAINTY_EXAMPLES = (
    "  # environment.wind.reference_speed_m_s: {standard_deviation: 0.5}       # in the unit of the key",
    "  # kite.powered.lift_coefficient: {relative_standard_deviation: 0.05}    # 5 %",
    "  # tether.drag_coefficient: {range: [1.0, 1.2]}                          # lowest and highest value",
)

#: What the derived defaults come to with the values of the example.
_DERIVED = {
    "operation.traction.tether_force_N": "5000",
    "operation.retraction.tether_force_N": "1250",
    "operation.turn.tether_force_N": "5000",
    "operation.turn.elevation_deg": "42.0",
    "limits.tether_force_min_N": "150",
    "limits.tether_length_min_m": "200",
    "limits.tether_length_max_m": "400",
    "optimisation.mesh.retraction_intervals": "3",
    "optimisation.mesh.traction_intervals": "1",
}
