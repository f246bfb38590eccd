"""Printing that survives a reader who has gone, a full device and a terminal without Unicode."""

from __future__ import annotations

import contextlib
import io
import os
import sys

from kiteocp.errors import InputError, one_sentence, printable


def prepare_streams() -> None:
    """Let no character of a problem file fail on a terminal that cannot show it."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            with contextlib.suppress(ValueError):
                stream.reconfigure(errors="replace")


def say(text: str) -> None:
    """Print text to standard output, without the control characters that a file of somebody else may hold.

    A closed pipe (``kiteocp list | head -1``) is not an error: the reader has what it wanted, and the verb goes on.

    Raises
    ------
    InputError
        If standard output cannot be written to, as on a full disk.
    """
    try:
        print(printable(text, keep="\n\t"), flush=True)
    except BrokenPipeError:
        _discard_stdout()
    except OSError as error:
        _discard_stdout()
        raise InputError(f"standard output: cannot be written ({error.strerror})") from None


def complain(text: str) -> None:
    """Print one sentence to standard error, with the name of the program before it."""
    with contextlib.suppress(OSError):
        print(f"kiteocp: {one_sentence(text)}", file=sys.stderr, flush=True)


def _discard_stdout() -> None:
    """Send the rest of standard output nowhere, so that the interpreter does not fail on it when it ends."""
    with contextlib.suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
