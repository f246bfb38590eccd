"""A copy of this process that makes ready for a task while this one calculates, and then does it.

What takes long to load and is wanted only at the end, as what draws, is loaded meanwhile. There may be no copy, and one
may be lost; whoever asks must be able to do the task without.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, BinaryIO, NoReturn

from kiteocp.execution import uninterrupted

#: Seconds in which a copy that is told to end has to clear up, and between looks whether it has ended.
ENDING_S, LOOK_S = 1.0, 0.002


class LostError(Exception):
    """The copy does not answer: it failed, or was ended from outside."""


class Forked:
    """A copy of this process, to be closed; see `fork`."""

    def __init__(self, process: int, tasks: int, answers: int) -> None:
        self._process = process
        self._tasks, self._answers = os.fdopen(tasks, "wb"), os.fdopen(answers, "rb")

    def answers(self, *task: Any) -> Iterator[Any]:
        """Send a task, once, and yield what `work` yields for it.

        Raises
        ------
        LostError
            There are no more answers, though the task is not done.
        """
        import pickle  # noqa: PLC0415  (as late as NumPy, which loads it)

        try:
            pickle.dump(task, self._tasks)
            self._tasks.flush()
        except (OSError, AttributeError, TypeError, pickle.PickleError) as error:
            raise LostError from error
        while True:
            try:
                answer = pickle.load(self._answers)
            except (OSError, EOFError, pickle.PickleError) as error:
                raise LostError from error
            if not answer:
                return
            yield answer[0]

    def close(self) -> None:
        """End the copy, whatever it does, and wait for its end."""
        with uninterrupted():
            for stream in (self._tasks, self._answers):
                with contextlib.suppress(OSError):
                    stream.close()
            until = time.monotonic() + ENDING_S
            number = signal.SIGTERM
            # Where the system collects ended processes by itself, there is none to wait for.
            with contextlib.suppress(ChildProcessError):
                while os.waitpid(self._process, os.WNOHANG) == (0, 0):
                    if number == signal.SIGTERM or time.monotonic() > until:
                        os.kill(self._process, number)
                        number = signal.SIGKILL
                    time.sleep(LOOK_S)


def fork(make_ready: Callable[[], None], work: Callable[..., Iterable[Any]]) -> Forked | None:
    """Copy this process, and let the copy make ready for a task and wait for it.

    Parameters
    ----------
    make_ready
        Called in the copy at once.
    work
        Called in the copy with the task; yields the answers.

    Returns
    -------
    Forked or None
        None where a copy is not safe: on other systems than Linux, and where this process has several threads, as a
        lock that one of them holds stays locked in the copy for ever. None too where the system gives no process more.
    """
    if not _is_safe():
        return None
    ends: list[int] = []
    # Else a signal could reach the copy while it has the handlers of this process.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        ends += os.pipe()
        ends += os.pipe()
        process = os.fork()
    except OSError:
        for end in ends:
            os.close(end)
        return None
    else:
        task_out, task_in, answer_out, answer_in = ends
        if process == 0:
            _serve(task_out, answer_in, {task_in, answer_out}, before, make_ready, work)
        os.close(task_out)
        os.close(answer_in)
        return Forked(process, task_in, answer_out)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _is_safe() -> bool:
    try:
        return sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


def _serve(
    tasks: int,
    answers: int,
    foreign: Iterable[int],
    signals: Iterable[int],
    make_ready: Callable[[], None],
    work: Callable[..., Iterable[Any]],
) -> NoReturn:
    """Be the copy: nothing of what this process has open or would still do is its affair."""
    try:
        # A key of the terminal is heard by the process that calculates, which ends this one.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, _leave)
        signal.pthread_sigmask(signal.SIG_SETMASK, signals)
        for end in foreign:
            os.close(end)
        make_ready()
        with os.fdopen(tasks, "rb") as asked, os.fdopen(answers, "wb") as told:
            _answer(asked, told, work)
    finally:
        # Also after an error: whoever asked does the task then, and says what is wrong.
        os._exit(0)


def _answer(asked: BinaryIO, told: BinaryIO, work: Callable[..., Iterable[Any]]) -> None:
    import pickle  # noqa: PLC0415

    for answer in work(*pickle.load(asked)):
        pickle.dump((answer,), told)
        told.flush()
    pickle.dump((), told)


def _leave(_number: int, _frame: Any) -> NoReturn:
    # By an exception, so that a lock on a file of matplotlib's cache is taken away; in what dies meanwhile it would be
    # printed.
    sys.unraisablehook = lambda _: None
    raise SystemExit
