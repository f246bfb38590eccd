"""Whole processes as a user starts them: wall time, time of imports, peak memory."""

from __future__ import annotations

import sys
import tempfile

from benchmarks.timing import Line, peak_memory, run_process, time_processes

KITEOCP = (sys.executable, "-m", "kiteocp")
NOTHING = (sys.executable, "-c", "pass")
COMMANDS = {
    "python -c pass": NOTHING,
    "kiteocp --help": (*KITEOCP, "--help"),
    "kiteocp check strong-wind": (*KITEOCP, "check", "strong-wind"),
    "kiteocp simulate strong-wind --no-plot": (*KITEOCP, "simulate", "strong-wind", "--no-plot"),
    "kiteocp solve strong-wind --no-plot --certificate quick": (
        *(*KITEOCP, "solve", "strong-wind", "--no-plot", "--certificate", "quick"),
    ),
    "kiteocp solve strong-wind --no-plot": (*KITEOCP, "solve", "strong-wind", "--no-plot"),
    "kiteocp solve strong-wind": (*KITEOCP, "solve", "strong-wind"),
}
STUDIES = {
    **{
        f"kiteocp sensitivity {name} {options}".strip(): (*KITEOCP, "sensitivity", name, *options.split())
        for name in ("strong-wind", "moderate-wind", "v3-kite")
        for options in ("--no-plot --no-intervals", "")
    },
    "kiteocp crosswind strong-wind": (*KITEOCP, "crosswind", "strong-wind"),
    "kiteocp validate": (*KITEOCP, "validate"),
}
TARGETS_S = {
    "kiteocp --help": 0.3,
    "kiteocp solve strong-wind --no-plot --certificate quick": 0.3,
    "kiteocp solve strong-wind": 1.5,
    **{name: 1.0 if "--no-intervals" in name else 5.0 for name in STUDIES if "sensitivity" in name},
    "kiteocp validate": 20.0,
}
IMPORTS = ("kiteocp", "kiteocp.cli.main", "numpy", "casadi", "kiteocp.ocp", "kiteocp.plots")
IN_MEMORY = ("python -c pass", "kiteocp simulate strong-wind --no-plot", "kiteocp solve strong-wind")


def lines(repeats: int) -> list[Line]:
    """Measure the commands of the shipped problem strong-wind, and studies of all that have a target."""
    # A study takes seconds, and as many repeats of it tell little more.
    times = time_processes(COMMANDS, repeats) | time_processes(STUDIES, min(repeats, 3))
    return [Line("whole process", name, values, target=TARGETS_S.get(name)) for name, values in times.items()]


def import_lines(repeats: int) -> list[Line]:
    """Measure imports, each in a process of its own and without the start of the interpreter."""
    measured = []
    with tempfile.TemporaryDirectory() as directory:
        for name in IMPORTS:
            code = f"import time\nt = time.perf_counter()\nimport {name}\nprint(time.perf_counter() - t)"
            times = [float(run_process((sys.executable, "-c", code), directory)) for _ in range(repeats + 1)]
            # The first import compiles.
            measured.append(Line("import", name, tuple(times[1:])))
    return measured


def memory_lines(repeats: int) -> list[Line]:
    """Measure peak memory; two repeats tell enough, memory hardly varies."""
    peaks = {name: peak_memory(COMMANDS[name], min(repeats, 2)) for name in IN_MEMORY}
    return [Line("peak memory", name, values, unit="B") for name, values in peaks.items() if values]
