"""Find the pumping cycle of largest mean power within the limits of a problem file."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from kiteocp.cli.calculation import calculate
from kiteocp.cli.parser import add_calculation

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.result import Result

NAME = "solve"
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


def run(arguments: argparse.Namespace) -> int:
    """Solve, save, print and draw."""

    def compute(problem: Problem) -> Result:
        # Imported once the problem is known to be good: a mistake in it is answered without waiting for CasADi.
        from kiteocp.ocp import solve  # noqa: PLC0415

        return solve(problem, certificate=arguments.certificate)

    return calculate(arguments, NAME, compute)
