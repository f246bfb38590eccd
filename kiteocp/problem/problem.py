"""`Problem`: a complete, checked problem with every default filled in, and the ways to get one."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Mapping
from typing import Any, NoReturn

import msgspec
from msgspec.structs import replace

from kiteocp.errors import InputError
from kiteocp.problem.checking import Fail, checked, failing
from kiteocp.problem.consistency import check_alternatives, check_consistency, warnings_of
from kiteocp.problem.defaults import resolved
from kiteocp.problem.layout import ProblemLayout
from kiteocp.problem.overrides import with_overrides
from kiteocp.problem.reading import read_document
from kiteocp.problem.shipped import problem_path, shipped_problems
from kiteocp.problem.uncertain_keys import lost_keys


class Origin(msgspec.Struct, frozen=True):
    """Where a problem came from, kept so that values can be set anew and derived defaults follow.

    Attributes
    ----------
    label : str
        File or other origin, for messages.
    source : bytes
        The bytes read, none for a problem made from values.
    values : mapping
        The keys given in the source, with the values set over them, without defaults; `given` is a copy of them.
    lines : mapping of str to int
        Line of each key in the source.
    set_keys : frozenset of str
        Key paths of the values set over those of the source.
    sha256 : str, optional
        A digest to keep instead of computing it, for a problem restored from a summary.
    """

    label: str
    source: bytes
    values: Mapping[str, Any]
    lines: Mapping[str, int] = msgspec.field(default_factory=dict)
    set_keys: frozenset[str] = frozenset()
    sha256: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The keys given, as a copy: what is done to it leaves the problem as it is."""
        return copy.deepcopy(dict(self.values))


class Problem(ProblemLayout, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A pumping kite power system, how it is flown, and what its optimal cycle must respect.

    Get one from `load_problem` or `problem_from_dict`. The blocks (``environment``, ``kite``, ``tether``,
    ``operation``, ``limits``, ``machine``, ``optimisation``) hold the keys of the problem file under the same names and
    in the same units, every default filled in. Two problems are equal if all their values are.
    """

    origin: Origin

    def to_dict(self) -> dict[str, Any]:
        """Return the resolved problem as plain values, which load again into an equal problem.

        A limit that is absent is None; of two alternative keys only the given one is there.
        """
        content: dict[str, Any] = {
            name: msgspec.to_builtins(getattr(self, name)) for name in ProblemLayout.__struct_fields__
        }
        return content

    def with_values(self, values: Mapping[str, object]) -> Problem:
        """Return the same problem with other values, as ``--set`` does.

        Parameters
        ----------
        values : mapping of str to object
            Values by key path, such as ``{"kite.mass_kg": 20.0}``; ``path[index]`` is an entry of a list and None
            takes a key out, so that its default holds.

        Returns
        -------
        Problem
            A new problem. Defaults that follow from a key that was set follow it.

        Raises
        ------
        InputError
            If a path does not exist or the problem would not be valid.

        Notes
        -----
        Setting one of ``lift_to_drag`` and ``drag_coefficient`` removes the other, and setting
        ``environment.wind.profile`` removes the keys that the new profile does not have, each with its uncertainty.
        """
        return _built(self.origin, values)

    def warnings(self) -> list[str]:
        """Return what deserves a warning, one sentence each.

        That is a prescribed cycle outside the limits, values outside the validity of the model, and values that no kite
        has (`kiteocp.problem.plausibility`).
        """
        return warnings_of(self.to_dict())

    @property
    def sha256(self) -> str:
        """Hexadecimal SHA-256 digest of what the problem was made from: the bytes of the file and the values set."""
        if self.origin.sha256 is not None and not self.origin.set_keys:
            return self.origin.sha256
        import hashlib  # noqa: PLC0415  (loads OpenSSL)

        digest = hashlib.sha256(self.origin.source)
        if self.origin.set_keys or not self.origin.source:
            digest.update(json.dumps(self.origin.given, sort_keys=True).encode())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        """Compare all values, but not where they came from."""
        return isinstance(other, Problem) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        """Hash of the values."""
        return hash(json.dumps(self.to_dict()))

    def __repr__(self) -> str:
        """Return name and origin."""
        return f"<Problem {self.name} from {self.origin.label}>"


def load_problem(name_or_path: str | os.PathLike[str], overrides: Mapping[str, object] | None = None) -> Problem:
    """Load a shipped problem by its name, or a problem file by its path.

    Parameters
    ----------
    name_or_path : str or path-like
        A name such as ``"strong-wind"``; a text with a separator or the suffix of a problem file is a path.
    overrides : mapping of str to object, optional
        Values to set, as in `Problem.with_values`.

    Returns
    -------
    Problem
        Checked, every default filled in.

    Raises
    ------
    InputError
        In one sentence with file, key, value and remedy.
    """
    path = problem_path(name_or_path)
    shipped = str(name_or_path) if path == shipped_problems().get(str(name_or_path)) else None
    document = read_document(path, shipped)
    origin = Origin(document.label, document.source, document.content, document.lines)
    return _built(origin, overrides or {})


def problem_from_dict(content: Mapping[str, Any], label: str = "problem", *, sha256: str | None = None) -> Problem:
    """Make a problem from plain values in the layout of a problem file.

    Parameters
    ----------
    content : mapping
        The keys of a problem file.
    label : str
        Origin of the values, for messages.
    sha256 : str, optional
        Digest to keep, for a problem restored from a summary.

    Raises
    ------
    InputError
        As `load_problem`.
    """
    if not isinstance(content, Mapping):
        raise InputError("holds no keys with values; give the layout of a problem file", file=label)
    return _built(Origin(label, b"", content, sha256=sha256), {})


def _built(origin: Origin, overrides: Mapping[str, object]) -> Problem:
    """Set values over the given keys, check everything, fill in defaults, and build the structures."""
    set_keys = origin.set_keys | overrides.keys()
    fail = _failing(origin, set_keys)
    # Values are set before anything is checked, so that they can mend a file too.
    given = checked(with_overrides(origin.given, overrides, fail), fail)
    check_alternatives(given, fail)
    content = resolved(given)
    if overrides and content["uncertainty"]:
        # A number that a set value has replaced (one profile of the wind by another) takes its uncertainty along.
        for key in lost_keys(content, origin.given) - {path.removeprefix("uncertainty.") for path in overrides}:
            del given["uncertainty"][key], content["uncertainty"][key]
    check_consistency(content, given, fail)
    layout = msgspec.convert(content, ProblemLayout)
    blocks = {name: getattr(layout, name) for name in ProblemLayout.__struct_fields__}
    return Problem(**blocks, origin=replace(origin, values=given, set_keys=set_keys))


def _failing(origin: Origin, set_keys: frozenset[str]) -> Fail:
    """Return what raises `InputError`, with the line of a key in the file unless its value was set over it."""
    from_file = failing(origin.label, origin.lines)

    def fail(path: str, message: str) -> NoReturn:
        if path in set_keys:
            raise InputError(message, file=origin.label, key=path)
        for key in set_keys:
            if path.startswith((f"{key}.", f"{key}[")):
                raise InputError(message, file=f"{origin.label} with {key} set", key=path)
        from_file(path, message)

    return fail
