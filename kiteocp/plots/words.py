"""Keys of the problem file in plain words, for axes."""

from __future__ import annotations

from kiteocp.result.channels import DIMENSIONLESS, unit_of

#: What a block of the problem file is called in a picture.
_BLOCKS = {
    "environment": "environment",
    "environment.wind": "wind",
    "environment.air": "air",
    "kite.powered": "powered kite",
    "kite.depowered": "depowered kite",
    "operation": "prescribed",
    "operation.traction": "prescribed traction",
    "operation.retraction": "prescribed retraction",
    "limits": "limit",
}


def words_of(key: str) -> str:
    """Return a key path in words, without its unit: ``limits.tether_force_max_N`` is *limit: maximum tether force*."""
    block, _, name = key.rpartition(".")
    return f"{_BLOCKS.get(block, block)}: {name_words(name)}"


def name_words(name: str) -> str:
    """Return the last part of a key path in words, without its unit."""
    bare, bracket, index = name.partition("[")
    unit = unit_of(bare)
    words = bare.removesuffix("" if unit == DIMENSIONLESS else "_" + unit.replace("/", "_")).split("_")
    for short, word in (("min", "minimum"), ("max", "maximum")):
        if short in words:
            words.remove(short)
            words.insert(0, word)
    return " ".join(words).replace("lift to drag", "lift-to-drag ratio") + bracket + index


def label_of(key: str) -> str:
    """Return a key path in words with its unit in brackets, as the label of an axis."""
    unit = unit_of(key.partition("[")[0])
    return words_of(key) + ("" if unit == DIMENSIONLESS else f" ({unit})")
