"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from kiteocp.errors import InputError
from kiteocp.execution import uninterrupted


def write_atomically(contents: Mapping[Path, bytes], remove: Iterable[Path] = ()) -> None:
    """Write several files so that each is there whole or not at all.

    All of them are first written under temporary names beside their targets; only when every byte is on disk are
    they renamed, so that a full disk leaves what was there.

    Parameters
    ----------
    contents : mapping of pathlib.Path to bytes
        Target to content; directories are made where they do not exist.
    remove : iterable of pathlib.Path
        Files to take away once all bytes are on disk; one that cannot be removed is left.

    Raises
    ------
    InputError
        If a directory or file cannot be written, in one sentence with its path and the reason.

    """
    temporary: dict[Path, str] = {}
    target = Path()
    try:
        for target, content in contents.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
            temporary[target] = name
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            # mkstemp makes private files; give them the permissions any other new file would have.
            os.chmod(name, 0o666 & ~_umask())
        for target in contents:
            if target.is_dir():
                raise IsADirectoryError(0, "a directory has this name")
        # A signal between two renames would leave new files beside old ones.
        with uninterrupted():
            for path in remove:
                with contextlib.suppress(OSError):
                    path.unlink(missing_ok=True)
            for target in contents:
                os.replace(temporary[target], target)
                del temporary[target]
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{target}: cannot be written ({reason}); choose a place that can be written to") from error
    finally:
        for name in temporary.values():
            with contextlib.suppress(OSError):
                os.unlink(name)


def check_writable(directory: Path) -> None:
    """Make sure that files can be written into a directory, which need not exist; nothing is left behind.

    Raises
    ------
    InputError
        They cannot, in one sentence with the path and the reason.
    """
    made: list[Path] = []
    try:
        missing = [path for path in (directory, *directory.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir()
            made.append(path)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{directory}: cannot be written ({reason}); choose a place that can be written to") from None
    finally:
        for path in reversed(made):
            with contextlib.suppress(OSError):
                path.rmdir()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
