"""Calculations shared among processes: started afresh, ended by Ctrl-C, told apart from errors of the calculation."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any

from kiteocp.errors import SolveError

#: Threads of linear algebra would fight for the cores that the processes use already.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def _ignoring_interruption(start: Callable[..., None], *arguments: Any) -> None:
    # The process that waits for this one hears Ctrl-C and ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    start(*arguments)


class Processes:
    """A pool of processes, to be used in a ``with`` statement; nothing is left running when it is interrupted.

    Parameters
    ----------
    jobs
        How many. The main module must be one that can be imported (``if __name__ == "__main__"``).
    start, arguments
        Called once in each process before its first task.
    """

    def __init__(self, jobs: int, start: Callable[..., None], *arguments: Any) -> None:
        self._others = set(active_children())
        self._workers: set[BaseProcess] = set()
        # Fresh processes: a fork copies whatever threads hold.
        self._pool = ProcessPoolExecutor(
            jobs, get_context("spawn"), initializer=_ignoring_interruption, initargs=(start, *arguments)
        )

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt):
            # Those in the middle of a task would go on for seconds.
            for worker in self._workers or set(active_children()) - self._others:
                worker.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def run(self, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """Call a function with the arguments of each task; yield the place of a task and its result, first come first.

        Raises
        ------
        SolveError
            A process was ended from outside.
        """
        places: dict[Future[Any], int] = {}
        try:
            with _interruption_not_inherited(), _one_thread():
                for place, task in enumerate(tasks):
                    places[self._pool.submit(function, *task)] = place
            self._workers = set(active_children()) - self._others
            for done in as_completed(places):
                yield places[done], done.result()
        except BrokenProcessPool:
            raise SolveError(
                "a process that solved some of the problems was ended from outside (out of memory?); use fewer jobs"
            ) from None


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes that are started here use one thread each, unless the user says otherwise."""
    added = [name for name in ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@contextlib.contextmanager
def _interruption_not_inherited() -> Iterator[None]:
    """Start processes that do not hear Ctrl-C: they would print tracebacks; the one that waits for them stops them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Blocked and not ignored: a signal that comes now is heard afterwards.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
