"""The exceptions a user of kiteocp can meet, each carrying the facts it reports.

``str()`` of every one is a single sentence fit for a terminal; ``exit_status`` is what the command line ends with.
"""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

#: A word longer than this is cut in a message: longer than any path or key that a person would read.
WORD_LENGTH_MAX = 240
#: A message longer than this is cut in its middle; its beginning names the place, its end the remedy.
SENTENCE_LENGTH_MAX = 2000
#: Unicode categories of characters that a terminal obeys, reorders by or cannot show: controls, formats, surrogates,
#: and the separators of lines and paragraphs.
_UNPRINTABLE = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))


def printable(text: str, *, keep: str = "") -> str:
    r"""Return a text that is safe to print: control and format characters as escapes, such as ``\u001b``.

    Text may come from a file that somebody else has written; an escape sequence in it could rewrite the terminal. The
    escapes are those of JSON, so that JSON stays what it was.

    Parameters
    ----------
    text : str
        Any text.
    keep : str
        Control characters to leave, such as line breaks.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        json.dumps(character)[1:-1]
        if unicodedata.category(character) in _UNPRINTABLE and character not in keep
        else character
        for character in text
    )


def shortened(text: str, length: int) -> str:
    """Return a text of at most ``length`` characters, longer ones cut in the middle, with the marks ``...`` there."""
    if len(text) <= length:
        return text
    end = (length - 3) // 3
    return f"{text[: length - 3 - end]}...{text[len(text) - end :]}"


def one_sentence(text: str) -> str:
    """Return a message in one printable line of sensible length, whatever it echoes."""
    text = " ".join(shortened(word, WORD_LENGTH_MAX) for word in text.split())
    return printable(shortened(text, SENTENCE_LENGTH_MAX))


class KiteocpError(Exception):
    """Base of all errors that kiteocp raises on purpose.

    Attributes
    ----------
    exit_status : int
        Exit status of the command line: 1, the calculation did not succeed; 2, bad input.
    """

    exit_status: int = 1

    def __str__(self) -> str:
        """Return the message in one line that can be printed, whatever the user gave."""
        return one_sentence(self._text())

    def _text(self) -> str:
        return super().__str__()


class InputError(KiteocpError):
    """Something the user gave is wrong: a problem file, an override, an option or a path.

    Parameters
    ----------
    message : str
        What is wrong, with the value found and the remedy.
    file : str, optional
        File or other origin of the value; put before the message.
    line : int, optional
        Line in the file, counted from 1.
    key : str, optional
        Key path in the problem file, such as ``kite.mass_kg``.
    """

    exit_status = 2

    def __init__(
        self, message: str, *, file: str | None = None, line: int | None = None, key: str | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.file = file
        self.line = line
        self.key = key

    def _text(self) -> str:
        """Return ``file:line: message`` with the parts that are known."""
        if self.file is None:
            return self.message
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.message}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle with the facts, so that the error survives a process pool."""
        return _restored, (type(self), self.args, dict(self.__dict__))


class _CalculationError(KiteocpError):
    """A calculation that ended without an answer: its cause in words, its facts in numbers, a word for its reason.

    Attributes
    ----------
    explanation : mapping
        What was found out about the failure beyond that, for the summary; empty unless somebody looked into it.
    """

    explanation: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, cause: str, facts: Mapping[str, float] | None = None, *, reason: str = "") -> None:
        super().__init__(cause)
        self.cause = cause
        self.facts = dict(facts or {})
        self.reason = reason

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle with the facts, so that the error survives a process pool."""
        return _restored, (type(self), self.args, dict(self.__dict__))


class NoEquilibriumError(_CalculationError):
    """A flight state that has no equilibrium of forces.

    Parameters
    ----------
    cause : str
        Where there is none and why, in words.
    facts : mapping of str to float, optional
        The state and what decides, by name with the unit, such as ``{"elevation_deg": 70.0}``.
    reason : str, optional
        One of ``force_below_sag``, ``slack``, ``reeling_too_fast``, ``crosswind``, ``too_heavy``, ``falling``.
    """

    def _text(self) -> str:
        """Return one sentence with the cause."""
        return f"no equilibrium of forces {self.cause}"


class CycleError(_CalculationError):
    """The forward simulation could not complete a cycle.

    Parameters
    ----------
    phase : str
        Phase in which it ended: retraction, transition or traction.
    cause : str
        Why, in words.
    facts : mapping of str to float, optional
        Where it ended, by name with the unit.
    reason : str, optional
        That of the `NoEquilibriumError` behind it, or ``force_too_high``, ``endless``, ``domain``.
    """

    def __init__(self, phase: str, cause: str, facts: Mapping[str, float] | None = None, *, reason: str = "") -> None:
        super().__init__(cause, facts, reason=reason)
        self.phase = phase
        self.sentence: str | None = None

    def explain(self, sentence: str, explanation: Mapping[str, Any]) -> None:
        """Add what would make the cycle fly: a longer sentence, and the same in numbers."""
        self.sentence, self.explanation = sentence, dict(explanation)

    def _text(self) -> str:
        """Return one sentence with the phase and the cause."""
        return self.sentence or f"the prescribed cycle cannot be flown, its {self.phase} ends {self.cause}"


class SolveError(_CalculationError):
    """The optimal control problem could not be solved, which says nothing about whether a cycle exists.

    Parameters
    ----------
    cause : str
        Why, in words.
    facts : mapping of str to float, optional
        What was reached, by name with the unit.
    """

    def _text(self) -> str:
        """Return one sentence with the cause."""
        return f"no optimal cycle found: {self.cause}"


class InfeasibleError(SolveError):
    """No cycle exists within the limits, as far as an elastic program can tell.

    Parameters
    ----------
    sentence : str
        Which limits are in conflict and how far each would have to move, as one sentence.
    explanation : mapping
        The same in numbers.
    """

    def __init__(self, sentence: str, explanation: Mapping[str, Any]) -> None:
        super().__init__(sentence, reason="infeasible")
        self.explanation = dict(explanation)

    def _text(self) -> str:
        """Return the sentence."""
        return self.cause


def check_word(name: str, value: object, words: Collection[str]) -> None:
    """Check that an argument of a function is one of its words.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : object
        What was given.
    words : collection of str
        What may be given.

    Raises
    ------
    InputError
        If it is none of them.
    """
    if not isinstance(value, str) or value not in words:
        *first, last = (repr(word) for word in words)
        raise InputError(f"{name} is {shortened(repr(value), 60)}; it must be {', '.join(first)} or {last}", key=name)


def _restored(kind: type[KiteocpError], args: tuple[Any, ...], state: dict[str, Any]) -> KiteocpError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(state)
    return error
