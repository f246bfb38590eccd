"""Measuring: repeats of calls, processes and their memory, each a `Line` of the report."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from statistics import median, quantiles

import msgspec

#: A repeat calls a fast function so many times that it lasts at least this long, s: far above the clock's resolution.
REPEAT_TIME_S = 0.02

# A process counts the memory of the one it was split off from until it starts its own program, so that a small one
# has to start it.
_LAUNCHER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


class Line(msgspec.Struct, frozen=True):
    """One measured quantity.

    Attributes
    ----------
    group, name
        Where it stands in the report; the name is unique in its group.
    values
        One number for each repeat, in `unit`.
    unit
        ``s`` or ``B``.
    target
        What it should be at most, where one is set.
    relative_to
        Name of the line of the same group that it is compared with, measured in turns with it.
    """

    group: str
    name: str
    values: tuple[float, ...]
    unit: str = "s"
    target: float | None = None
    relative_to: str | None = None

    @property
    def median(self) -> float:
        """Median of the repeats."""
        return median(self.values)

    @property
    def quartiles(self) -> tuple[float, float]:
        """First and third quartile of the repeats."""
        if len(self.values) == 1:
            return self.values[0], self.values[0]
        low, _, high = quantiles(self.values, n=4, method="inclusive")
        return low, high


def time_call(function: Callable[[], object]) -> float:
    """Return the duration of one call, s."""
    began = time.perf_counter()
    function()
    return time.perf_counter() - began


def time_calls(functions: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, tuple[float, ...]]:
    """Time functions in turns, so that what else the machine does meets all of them alike.

    Parameters
    ----------
    functions
        By name. Each is called once before it counts.
    repeats
        Measurements of each.

    Returns
    -------
    dict
        Time of one call for each repeat, s, by name.
    """
    counts = {}
    for name, function in functions.items():
        function()
        counts[name] = max(1, round(REPEAT_TIME_S / max(time_call(function), 1e-9)))
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            began = time.perf_counter()
            for _ in range(counts[name]):
                function()
            times[name].append((time.perf_counter() - began) / counts[name])
    return {name: tuple(values) for name, values in times.items()}


def time_processes(commands: Mapping[str, Sequence[str]], repeats: int) -> dict[str, tuple[float, ...]]:
    """Time whole processes in turns, from the start to the exit, s.

    The files they write go to a directory that is removed.

    Raises
    ------
    RuntimeError
        A command did not succeed.
    """
    times: dict[str, list[float]] = {name: [] for name in commands}
    with tempfile.TemporaryDirectory() as directory:
        for repeat in range(repeats + 1):
            for name, command in commands.items():
                duration = time_call(partial(run_process, command, directory))
                # The first time fills the caches of byte code and files.
                if repeat > 0:
                    times[name].append(duration)
    return {name: tuple(values) for name, values in times.items()}


def peak_memory(command: Sequence[str], repeats: int) -> tuple[float, ...]:
    """Return the largest resident memory of a process for each repeat, B; none where the system does not tell.

    Raises
    ------
    RuntimeError
        The command did not succeed.
    """
    if importlib.util.find_spec("resource") is None:
        return ()
    scale = 1 if sys.platform == "darwin" else 1024
    with tempfile.TemporaryDirectory() as directory:
        launcher = (sys.executable, "-c", _LAUNCHER, *command)
        return tuple(scale * float(run_process(launcher, directory)) for _ in range(repeats))


def run_process(command: Sequence[str], directory: str) -> str:
    """Run a command to its end and return what it printed.

    Raises
    ------
    RuntimeError
        It did not succeed.
    """
    done = subprocess.run(command, cwd=directory, env=environment(), capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with status {done.returncode}: {done.stderr.strip()}")
    return done.stdout


@cache
def _byte_code() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


def environment() -> dict[str, str]:
    """Return the environment of the measured processes: with cached byte code, as an installed package has it."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPYCACHEPREFIX": _byte_code().name}
