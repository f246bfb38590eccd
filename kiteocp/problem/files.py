"""Paths and files that a user names: read whole, of bounded size, without waiting for what never comes."""

from __future__ import annotations

import os
import select
import stat
from pathlib import Path

from kiteocp.errors import InputError

#: Longest wait for the next bytes of a pipe (s); ``<(...)`` of a shell takes a moment, a forgotten FIFO for ever.
PIPE_WAIT_S = 5.0


def user_path(path: str | os.PathLike[str]) -> Path:
    """Return a path with a leading ``~`` replaced; one of a user who is not known stays as it is."""
    # Path.expanduser raises RuntimeError there.
    return Path(os.path.expanduser(os.fspath(path)))


def path_label(path: str | os.PathLike[str]) -> str:
    """Return what messages call a path; it may hold characters that a terminal cannot print."""
    text = os.fspath(path)
    return text if text.isprintable() else repr(text)


def check_readable_kind(path: Path, label: str | None = None) -> None:
    """Reject a pipe or device, which could be waited for without end, before it is opened.

    Raises
    ------
    InputError
        If there is something under the path that is neither a file nor a directory.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return  # Opening it says why.
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError("is a pipe or a device; save its content to a file and name that", file=label or str(path))


def read_source(path: Path, label: str, limit: int) -> bytes:
    """Read a file, or what a pipe gives, up to one byte more than a limit.

    Raises
    ------
    InputError
        If it is missing, cannot be read, is a device, or is a pipe to which nobody writes.
    """
    if "\0" in os.fspath(path):
        raise InputError("cannot be read (its name holds a NUL character); check the path", file=label)
    try:
        if stat.S_ISFIFO(path.stat().st_mode):
            return _read_pipe(path, label, limit)
        check_readable_kind(path, label)
        with path.open("rb") as stream:
            return stream.read(limit + 1)
    except FileNotFoundError:
        raise InputError("there is no such file; check the path, or see `kiteocp list`", file=label) from None
    except IsADirectoryError:
        raise InputError("is a directory; name the file in it", file=label) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read ({reason}); check the path and its permissions", file=label) from None


def _read_pipe(path: Path, label: str, limit: int) -> bytes:
    """Read a pipe to its end; without ``O_NONBLOCK`` opening it waits until somebody writes."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    content = b""
    try:
        while len(content) <= limit and select.select([descriptor], [], [], PIPE_WAIT_S)[0]:
            part = os.read(descriptor, limit + 1)
            if not part:
                return content
            content += part
    finally:
        os.close(descriptor)
    if len(content) <= limit:
        raise InputError(
            f"is a pipe to which nothing was written for {PIPE_WAIT_S:g} s; save its content to a file and name that",
            file=label,
        )
    return content
