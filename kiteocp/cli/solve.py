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
    """Add the problem."""
    add_calculation(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve, save, print and draw."""
    return calculate(arguments, NAME, _solve)


def _solve(problem: Problem) -> Result:
    # Imported once the problem is known to be good: a mistake in it is answered without waiting for CasADi.
    from kiteocp.ocp import solve  # noqa: PLC0415

    return solve(problem)
