"""How a key of the problem file is declared: unit, meaning, bounds, and where its default comes from.

The modules that declare keys do without ``from __future__ import annotations``: msgspec would compile the texts of some
200 annotations at the first reading, three times each, which takes longer than all the rest of it.
"""

from __future__ import annotations

from typing import Any, Literal

from msgspec import Meta

#: Suffixes of key names that are units, the longest first so that ``_m_s`` is not taken for ``_s``.
UNIT_SUFFIXES = ("_kg_m3", "_m_s2", "_deg_s", "_m_s", "_deg", "_kg", "_m2", "_N", "_W", "_m", "_s")

#: Where a tether force acts.
ForcePlace = Literal["kite", "ground"]

_FOREIGN_UNITS_TEXT = (
    "mm cm km m ft in g t lb kg rad deg n kn dan lbf kgf w kw mw s ms min h m_s km_h kmh knots kts mph m2 cm2 mm2 ft2 "
    "kg_m3 g_cm3 kg_m m_s2 rad_s deg_s percent pct"
)
#: Units that people write in a key name where another one is expected.
FOREIGN_UNITS = frozenset(_FOREIGN_UNITS_TEXT.split())


def quantity(
    unit: str, meaning: str, *, derived: str | None = None, limit: Any = None, example: Any = None, **bounds: Any
) -> Meta:
    """Describe a number of the problem file.

    Parameters
    ----------
    unit : str
        Unit as a person writes it, ``1`` for a ratio.
    meaning : str
        What the number is, in a phrase.
    derived : str, optional
        How the default follows from other keys; a key without this and without a default is mandatory.
    limit : LimitRow, optional
        What a limit bounds (`kiteocp.problem.limits`).
    example : number or list of numbers, optional
        A value for the template.
    **bounds
        ``gt``, ``ge``, ``lt``, ``le`` of `msgspec.Meta`.
    """
    return _meta(meaning, derived, {"unit": unit}, bounds, limit=limit, example=example)


def text(meaning: str, **bounds: Any) -> Meta:
    """Describe a text or a choice of the problem file; ``bounds`` as in `msgspec.Meta` (pattern, max_length)."""
    return _meta(meaning, None, {}, bounds)


def section(meaning: str, *, derived: str | None = None) -> Meta:
    """Describe a block of the problem file."""
    return _meta(meaning, derived, {}, {})


def _meta(meaning: str, derived: str | None, schema: dict[str, Any], bounds: dict[str, Any], **extra: Any) -> Meta:
    return Meta(description=meaning, extra_json_schema=schema, extra={"derived": derived, **extra}, **bounds)
