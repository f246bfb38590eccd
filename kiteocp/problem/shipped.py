"""Where the problems that come with kiteocp are, and what a PROBLEM argument means."""

from __future__ import annotations

import os
from pathlib import Path

from kiteocp.errors import InputError
from kiteocp.problem.checking import nearest
from kiteocp.problem.files import user_path

_PACKAGE = Path(__file__).resolve().parents[1]
_SUFFIXES = (".yaml", ".yml", ".json")


def shipped_problems() -> dict[str, Path]:
    """Return the path of every shipped problem by its name, in alphabetical order.

    A wheel carries the files inside the package, a checkout beside it.
    """
    for directory in (_PACKAGE / "problems", _PACKAGE.parent / "problems"):
        found = {path.stem: path for path in sorted(directory.glob("*.yaml"))}
        if found:
            return found
    return {}


def problem_path(name_or_path: str | os.PathLike[str]) -> Path:
    """Return the file of a PROBLEM argument: a path if it has a suffix or separator, else a shipped name.

    Raises
    ------
    InputError
        If it is neither.
    """
    if not isinstance(name_or_path, str):
        return user_path(name_or_path)
    name = name_or_path
    if "/" in name or os.sep in name or name.lower().endswith(_SUFFIXES):
        return user_path(name)
    problems = shipped_problems()
    if name in problems:
        return problems[name]
    for local in (Path(name), *(Path(name + suffix) for suffix in _SUFFIXES)):
        if name and os.path.isfile(local):  # Path.is_file raises where a name is too long or no name at all.
            raise InputError(
                f"{name!r} is not a shipped problem; for the file of that name write {os.path.join('.', str(local))}"
            )
    near = nearest(name, problems)
    guess = f"did you mean {near}?" if near else "a file of yours needs its path with the .yaml."
    raise InputError(f"{name!r} is not a shipped problem; {guess} (Shipped: {', '.join(problems)})")
