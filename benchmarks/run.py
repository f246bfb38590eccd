"""The command: measure the groups, print the table, write the JSON."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks import cycles, optimum, processes, states
from benchmarks.report import Report
from benchmarks.timing import Line

#: Every group by its name on the command line; it takes the number of repeats and returns its lines.
GROUPS: dict[str, Callable[[int], list[Line]]] = {
    "state": states.lines,
    "cycle": cycles.lines,
    "optimum": optimum.lines,
    "process": processes.lines,
    "import": processes.import_lines,
    "memory": processes.memory_lines,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark.

    Parameters
    ----------
    argv
        The arguments; those of the process where left out.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure what kiteocp costs here.")
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}; all where left out")
    parser.add_argument("--repeats", type=int, default=7, help="measurements of each line (default 7)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here as well")
    arguments = parser.parse_args(argv)
    for name in arguments.groups:
        if name not in GROUPS:
            parser.error(f"there is no group '{name}'; choose from {', '.join(GROUPS)}")
    if arguments.repeats < 1:
        parser.error(f"--repeats must be at least 1, not {arguments.repeats}")
    measured: list[Line] = []
    for name in arguments.groups or GROUPS:
        print(f"measuring: {name} ...", file=sys.stderr, flush=True)
        measured += GROUPS[name](arguments.repeats)
    report = Report.of(measured)
    print(report)
    if arguments.json is not None:
        try:
            report.write(arguments.json)
        except OSError as error:
            parser.error(f"--json {arguments.json}: cannot be written ({error.strerror}); name a file that can")
    return 0
