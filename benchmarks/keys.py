"""The keys of the problem file as a table of README, read off the structures that check the files."""

from __future__ import annotations

from kiteocp.problem.catalogue import MISSING, Key, catalogue


def key_table(section: str) -> str:
    """Return the keys of a section as a Markdown table, those of its sections below them.

    Parameters
    ----------
    section
        Key of the file, such as ``limits``.
    """
    below = [key for key in catalogue().children[section].walk() if key.kind in {"number", "integer", "text", "list"}]
    rows = [("key", "unit", "default", "meaning"), ("---",) * 4]
    rows += [(f"`{key.path.removeprefix(section + '.')}`", _unit(key), _default(key), _meaning(key)) for key in below]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _unit(key: Key) -> str:
    return "" if key.unit == "1" else key.unit


def _default(key: Key) -> str:
    if key.derived:
        return key.derived
    if key.default is MISSING:
        return "(required)"
    if key.default is None:
        return "none"
    return f"{key.default:g}" if isinstance(key.default, int | float) else str(key.default)


def _meaning(key: Key) -> str:
    meaning = key.meaning.removesuffix("; null is no limit")
    return f"{meaning}: {', '.join(f'`{word}`' for word in key.choices)}" if key.choices else meaning
