"""Find the pumping cycle of largest mean power within the limits of a problem file."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.output import say
from kiteocp.cli.parser import add_calculation
from kiteocp.cli.run import calculate
from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.studies.protocol import Study
    from kiteocp.studies.winch.export import WinchExport

HELP = "find the optimal cycle and compare it with the prescribed one"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem and how thoroughly its optimum is checked."""
    add_calculation(parser)
    parser.add_argument(
        "--certificate",
        choices=("full", "quick"),
        default="full",
        help="full refines the mesh until the optimal power stays the same; quick judges the mesh of the problem file",
    )
    parser.add_argument(
        "--export",
        metavar="DIR",
        help="write what a winch controller takes into DIR: set points, switching conditions, laws and what they lose",
    )


def run(arguments: argparse.Namespace) -> int:
    """Solve, save, print, draw and, where asked to, export."""
    exports: list[WinchExport] = []
    if arguments.export is not None:
        from kiteocp.writing import check_writable  # noqa: PLC0415  (keeps --help fast)

        if not arguments.export:
            raise InputError("--export: give the folder to write to")
        check_writable(Path(arguments.export))

    def compute(problem: Problem) -> Study:
        # Imported once the problem is known to be good: a mistake in it is answered without waiting for CasADi.
        from kiteocp.studies.protocol import ResultStudy  # noqa: PLC0415

        if arguments.export is None:
            from kiteocp.optimum.solve import solve  # noqa: PLC0415

            return ResultStudy(solve(problem, certificate=arguments.certificate))
        from kiteocp.optimum.refine import optimise  # noqa: PLC0415
        from kiteocp.optimum.solve import result_of  # noqa: PLC0415
        from kiteocp.studies.winch.export import winch_export  # noqa: PLC0415

        began = time.perf_counter()
        optimum = optimise(problem, certificate=arguments.certificate)
        result = result_of(optimum, time.perf_counter() - began)
        exports.append(winch_export(optimum))
        result.details["winch"] = exports[0].to_dict()
        return ResultStudy(result)

    options = {"certificate": None if arguments.certificate == "full" else arguments.certificate}
    status = calculate(arguments, "solve", compute, options)
    for export in exports:
        written = export.save(Path(arguments.export))
        if not arguments.json:
            say(f"\n{export.report}\nexported: " + ", ".join(str(path) for path in written))
    return status
