"""Progress of long calculations on standard error, and how many of something to do."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from types import TracebackType

#: Seconds before the first line of progress, and between lines: less is not worth reading.
FIRST_S, EVERY_S = 1.0, 1.0
EVERY_LOGGED_S = 10.0

#: The largest number of samples or processes; more would take years.
LARGEST = 10_000_000

#: Things done after the first ones before the time left is estimated.
FEWEST = 3


class Progress:
    """Tell how many of a number of things are done: on a terminal in one line, else in a line now and then.

    Used as a context, which takes the line of a terminal away at its end; called with what is done and the total.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._began = time.monotonic()
        self._next = self._began + FIRST_S
        self._terminal = sys.stderr.isatty()
        self._shown = False
        # What was done at the first call, and when: that includes what is done once only, as building the solver.
        self._first: tuple[int, float] | None = None

    def __call__(self, done: int, total: int) -> None:
        """Tell, unless it was told a moment ago."""
        now = time.monotonic()
        if self._first is None and done > 0:
            self._first = done, now
        if now < self._next:
            return
        self._next = now + (EVERY_S if self._terminal else EVERY_LOGGED_S)
        line = f"{done} of {total} {self._what}"
        if self._first is not None and done - self._first[0] >= FEWEST:
            left = (now - self._first[1]) * (total - done) / (done - self._first[0])
            line += f", about {left:.0f} s left"
        self._write(f"\r{line:<60}" if self._terminal else f"{line}\n")
        self._shown = True

    def __enter__(self) -> Progress:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear the line of a terminal."""
        if self._terminal and self._shown:
            self._write(f"\r{'':<60}\r")

    @staticmethod
    def _write(text: str) -> None:
        # Nobody needs progress so much that a closed stream should end the calculation.
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.write(text)
            sys.stderr.flush()


def positive_integer(text: str) -> int:
    """Return a whole number above zero; for ``type=``."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if not 1 <= value <= LARGEST:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number above 0, {LARGEST} at most")
    return value
