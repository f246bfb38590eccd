"""Pictures drawn by a copy of the process, which loads matplotlib while this one calculates."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

from kiteocp.forked import Forked, LostError, fork

if TYPE_CHECKING:
    from kiteocp.plots.pictures import Contents
    from kiteocp.result import Result
    from kiteocp.studies.protocol import Study


@contextlib.contextmanager
def drawing_apart(verb: str, suffixes: Sequence[str]) -> Iterator[Contents | None]:
    """Load what draws in another process while the block calculates.

    To be entered before NumPy is loaded, which starts threads: a process with threads cannot be copied.

    Parameters
    ----------
    verb
        Whose pictures are all drawn from its result alone.
    suffixes
        Of the files; none where there is nothing to draw.

    Yields
    ------
    callable or None
        What draws, for `kiteocp.plots.pictures.draw_study`; None where there is no other process.
    """
    forked = fork(partial(_make_ready, verb, suffixes), _drawn) if suffixes else None
    if forked is None:
        yield None
        return
    try:
        yield partial(_contents, forked)
    finally:
        forked.close()


def _make_ready(verb: str, suffixes: Sequence[str]) -> None:
    from kiteocp.plots.pictures import make_ready  # noqa: PLC0415

    make_ready(verb, suffixes)


def _drawn(result: Result, suffixes: Sequence[str]) -> Iterator[Mapping[str, bytes]]:
    from kiteocp.plots.pictures import drawn  # noqa: PLC0415
    from kiteocp.studies.protocol import ResultStudy  # noqa: PLC0415

    return drawn(ResultStudy(result), suffixes)


def _contents(forked: Forked, study: Study, suffixes: Sequence[str]) -> Iterator[Mapping[str, bytes]]:
    from kiteocp.plots.pictures import drawn  # noqa: PLC0415

    count = 0
    try:
        for files in forked.answers(study.result(), suffixes):
            count += 1
            yield files
    except LostError:
        # As if there had been no other process; if it failed, so does this one, and says why.
        yield from islice(drawn(study, suffixes), count, None)
