"""Where the result of a calculation goes, so that no result of other input is replaced without a word."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.problem import Problem

#: Characters of the part of a folder's name that says what differs from the file, before it is cut.
LONGEST = 80

#: What says nothing about the numbers of a problem.
_TEXTS = {"name", "description"}


class Place(NamedTuple):
    """A directory to write into.

    Attributes
    ----------
    directory
        Where the result goes.
    replaced
        What to say about the earlier result that it takes the place of; None where there is none.
    """

    directory: Path
    replaced: str | None = None


class Asked(NamedTuple):
    """What a result is the answer to.

    Attributes
    ----------
    verb
        Name of the verb.
    problem
        With everything that was set.
    as_it_stands
        The problem of the file, nothing set; None where that is not valid by itself.
    options
        Options of the verb that shape the result and are not at their defaults, and what else it was made from.
    spare_words
        What else tells it from another result in the same folder, as the name of a flight.
    """

    verb: str
    problem: Problem
    as_it_stands: Problem | None
    options: Mapping[str, Any]
    spare_words: Sequence[str] = ()

    def same_as(self, summary: Mapping[str, Any]) -> bool:
        """Whether a summary is the answer to the same."""
        return (
            summary.get("verb") == self.verb
            and _numbers(summary.get("input")) == _numbers(_plain(self.problem.to_dict()))
            and (summary.get("options") or {}) == _plain(dict(self.options))
        )

    @property
    def digest(self) -> str:
        """A few characters that stand for all of it."""
        import hashlib  # noqa: PLC0415  (loads OpenSSL)

        everything = [self.verb, _numbers(_plain(self.problem.to_dict())), _plain(dict(self.options))]
        return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()[:8]

    def words(self) -> list[str]:
        """Return what differs from the shipped problem of this name, or from the file, and the options."""
        from kiteocp.problem import load_problem, shipped_problems  # noqa: PLC0415  (keeps --help fast)

        shipped = self.problem.name in shipped_problems()
        reference = load_problem(self.problem.name) if shipped else self.as_it_stands
        before = {} if reference is None else _leaves(reference.origin.given)
        after = _leaves(self.problem.origin.given)
        if reference is None:
            after = {key: value for key, value in after.items() if key in self.problem.origin.set_keys}
        # A key given as what it is by default is no difference.
        resolved = {} if reference is None else _leaves(reference.to_dict())
        return _differences(before | resolved, after, gone=set(before) - set(after)) + [
            _word(name, value) for name, value in self.options.items() if not name.endswith("sha256")
        ]


def choose_place(output: str | None, asked: Asked, parent: Path, stem: str) -> Place:
    """Return where to write, and make sure that it can be written to.

    Parameters
    ----------
    output
        The directory of ``-o``, if given.
    asked
        What is asked.
    parent, stem
        Without ``-o``: the folder is ``parent / stem`` for a file as it stands, and gets a suffix for other input.

    Raises
    ------
    InputError
        The directory cannot be written to, or holds what is not an earlier result of the same verb.
    """
    from kiteocp.writing import check_writable  # noqa: PLC0415  (keeps --help fast)

    directory = Path(output) if output is not None else _folder(asked, parent, stem)
    check_writable(directory)
    return Place(directory, _replaced(directory, asked.verb, asked.same_as))


def choose_paper_place(directory: Path) -> Place:
    """Return where the validation against the paper goes, whose input is always the same; errors as `choose_place`."""
    from kiteocp.writing import check_writable  # noqa: PLC0415  (keeps --help fast)

    check_writable(directory)
    return Place(directory, _replaced(directory, "validate", lambda summary: "validation" in summary))


def _folder(asked: Asked, parent: Path, stem: str) -> Path:
    from kiteocp.result.earlier import earlier_result  # noqa: PLC0415

    words = asked.words()
    name = f"{stem}-{'_'.join(words)}" if words else stem
    earlier = earlier_result(parent / stem)
    if not words and earlier is not None and not asked.same_as(earlier.summary):
        # The file was changed, or another has its name.
        before = _leaves(_numbers(earlier.summary.get("input")) or {})
        words = _differences(before, _leaves(_plain(asked.problem.to_dict()))) or list(asked.spare_words)
        name = f"{stem}-{'_'.join(words)}"
    if len(name) > len(stem) + 1 + LONGEST:
        name = f"{name[: len(stem) + 1 + LONGEST].rstrip('._-')}-{asked.digest}"
    taken = earlier_result(parent / name)
    if taken is not None and not asked.same_as(taken.summary):
        name = f"{name}-{asked.digest}"
    return parent / name


def _replaced(directory: Path, verb: str, same: Callable[[Mapping[str, Any]], bool]) -> str | None:
    """Return what to say about the earlier result in a directory.

    Raises
    ------
    InputError
        The directory holds files under the names to be written that are not of an earlier result of the same verb.
    """
    from kiteocp.result.earlier import SUMMARY_FILE, earlier_result, files_of  # noqa: PLC0415

    earlier = earlier_result(directory)
    remedy = "choose another folder with -o, or move it away"
    if earlier is None:
        foreign = files_of(verb, directory)
        if foreign:
            raise InputError(f"{foreign[0]}: is there already, and is not of an earlier result of kiteocp; {remedy}")
        return None
    if not earlier.of_kiteocp:
        raise InputError(f"{directory / SUMMARY_FILE}: is there already, and is not one of kiteocp; {remedy}")
    if earlier.verb != verb:
        raise InputError(
            f"{directory}: holds the {earlier.verb} result of {earlier.summary.get('problem')}, which {verb} "
            f"would replace; {remedy}"
        )
    which = "the same input" if same(earlier.summary) else f"other input, {earlier.summary.get('problem')}"
    return f"replaced: the earlier {verb} result in {directory} ({which})"


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value))


def _numbers(content: Any) -> dict[str, Any] | None:
    """Return the input of a summary without its texts."""
    if not isinstance(content, Mapping):
        return None
    return {key: value for key, value in content.items() if key not in _TEXTS}


def _leaves(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested keys by their paths."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        if not prefix and key in _TEXTS:
            continue
        if isinstance(value, Mapping):
            found |= _leaves(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = _plain(value)
    return found


def _differences(before: Mapping[str, Any], after: Mapping[str, Any], gone: set[str] | None = None) -> list[str]:
    """Return ``key=value`` for each key whose value is another after, by the last part of its path if that will do."""
    changed = {key: value for key, value in after.items() if before.get(key) != value}
    changed |= dict.fromkeys(sorted(gone or ()), None)
    last = [key.rpartition(".")[2] for key in changed]
    return [
        _word(short if last.count(short) == 1 else key, value)
        for (key, value), short in zip(changed.items(), last, strict=True)
    ]


def _word(name: str, value: Any) -> str:
    """Return ``name=value`` in characters that every file system takes; an option that is on is its name alone."""
    if value is True:
        text = name
    elif value is False:
        text = f"no-{name}"
    else:
        text = f"{name}={_text(value)}"
    return re.sub(r"[^A-Za-z0-9.,=+\-_]+", "-", text).strip(".-")


def _text(value: Any) -> str:
    if value is None:
        return "default"
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    if isinstance(value, list | tuple):
        return ",".join(_text(item) for item in value)
    return str(value)
