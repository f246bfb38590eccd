"""How a calculation runs: one at a time in a process, and ended by Ctrl-C where that does no harm.

CasADi's functions and IPOPT keep memory of their own between and during calls, and let other threads of Python run
meanwhile. Two threads in one of them at a time give wrong numbers or crash the interpreter, so calculations take turns.

A KeyboardInterrupt raised inside CasADi is printed as a raw warning and taken for a failed evaluation. So the handler
of the signal waits until no code of CasADi is running, a few milliseconds at most but for long solutions by IPOPT,
which ask `interrupted` now and then.
"""

from __future__ import annotations

import _thread
import contextlib
import functools
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import Any, ParamSpec, TypeVar

#: Seconds until the handler looks again whether it may raise, and in which a second signal counts as the same: a key
#: bounces, and a terminal and a wrapper may both send one.
AGAIN_S, SAME_S = 0.005, 0.5

_P = ParamSpec("_P")
_R = TypeVar("_R")

_turn = threading.RLock()


def _renew_turn() -> None:
    """Free the turn in a forked process: the thread that had it is not there."""
    global _turn  # noqa: PLW0603  (a lock cannot be released by another thread)
    _turn = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_turn)


class Terminated(KeyboardInterrupt):
    """The process was asked to end by SIGTERM."""


class _Handler:
    """The handler of a signal that waits for a safe place, and then does what the handler before would have done."""

    def __init__(self, then: Callable[[int, FrameType | None], Any]) -> None:
        self.then = then
        self.pending: int | None = None
        self.delivered = False
        self._told_at = -SAME_S
        self._again = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        again, self._again = self._again, False
        if again and self.pending is None:
            return
        if not again and time.monotonic() - self._told_at < SAME_S:
            return
        if _held or not _is_safe(frame):
            self.pending = number
            # Not a `threading.Timer`: its start takes locks that the interrupted code may hold.
            _thread.start_new_thread(self._look_again, (number,))
            return
        self.deliver(number, frame)

    def deliver(self, number: int, frame: FrameType | None = None) -> None:
        """Do what the handler before would have done."""
        self.pending = None
        self.delivered = True
        self._told_at = time.monotonic()
        self.then(number, frame)

    def _look_again(self, number: int) -> None:
        time.sleep(AGAIN_S)
        if self.pending is not None:
            self._again = True
            _thread.interrupt_main(signal.Signals(number))


#: The handlers now installed by `interruptible`, and how many `uninterrupted` blocks are open (main thread only).
_handlers: list[_Handler] = []
_held = 0


def _is_safe(frame: FrameType | None) -> bool:
    """Whether an exception raised here would reach the code that waits for it.

    It would be printed or lost in CasADi, in the start of an extension module, and in what Python calls by itself when
    an object dies.
    """
    while frame is not None:
        module = frame.f_globals.get("__name__") or ""
        if module.partition(".")[0] == "casadi" or module in {"weakref", "_weakrefset"}:
            return False
        if frame.f_code.co_name == "__del__":
            return False
        # Python ends by the signal itself, whatever is caught, once it has interrupted the text of an `exec`, as there
        # is in the making of a dataclass; that of ``python -c`` is the program.
        if (frame.f_code.co_filename, frame.f_code.co_name) == ("<string>", "<module>") and module != "__main__":
            return False
        if module == "importlib._bootstrap_external" and isinstance(frame.f_locals.get("self"), ExtensionFileLoader):
            return False
        frame = frame.f_back
    return True


def interrupted() -> bool:
    """Whether a signal waits for the running code to come to a safe place."""
    return any(handler.pending is not None for handler in _handlers)


def was_interrupted() -> bool:
    """Whether an interruption was raised: an error that follows is of a library that lost the exception."""
    return any(handler.delivered for handler in _handlers)


def leave_if_interrupted() -> None:
    """Raise what a waiting signal is to raise; called where that is safe.

    Raises
    ------
    KeyboardInterrupt
        A signal waits, and this is the main thread.
    """
    if _held or threading.current_thread() is not threading.main_thread():
        return
    for handler in _handlers:
        if handler.pending is not None:
            handler.deliver(handler.pending)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Let no signal that `interruptible` handles interrupt this block; it is heard afterwards."""
    global _held  # noqa: PLW0603  (signals are of the process)
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _held += 1
    try:
        yield
    finally:
        _held -= 1


@contextlib.contextmanager
def interruptible(*, termination: bool = False) -> Iterator[None]:
    """Hear Ctrl-C where it is safe in this block; in other threads than the main one, and inside itself, do nothing.

    Parameters
    ----------
    termination
        Also let SIGTERM raise `Terminated` instead of ending the process at once.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C was pressed; or whatever a handler installed before does.
    """
    if threading.current_thread() is not threading.main_thread() or _handlers:
        yield
        return
    before: dict[signal.Signals, Any] = {}
    for number in (signal.SIGINT, signal.SIGTERM) if termination else (signal.SIGINT,):
        then = signal.getsignal(number)
        if number == signal.SIGTERM and then == signal.SIG_DFL:
            before[number], handler = then, _Handler(_terminate)
        elif callable(then):
            before[number], handler = then, _Handler(then)
        else:
            continue
        _handlers.append(handler)
        signal.signal(number, handler)
    try:
        yield
    finally:
        waiting = [handler for handler in _handlers if handler.pending is not None]
        for number, then in before.items():
            signal.signal(number, then)
        _handlers.clear()
        for handler in waiting:
            if handler.pending is not None:
                handler.deliver(handler.pending)


def _terminate(_number: int, _frame: FrameType | None) -> None:
    raise Terminated


def one_at_a_time(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let calls of all functions with this decorator take turns, and be interrupted safely.

    A function may call others: a thread waits for other threads only.
    """

    @functools.wraps(function)
    def in_turn(*args: _P.args, **options: _P.kwargs) -> _R:
        with _turn, interruptible():
            return function(*args, **options)

    return in_turn
