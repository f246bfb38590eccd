"""Find the pumping cycle of largest mean power within the limits of a problem file."""

from __future__ import annotations

import argparse

from kiteocp.cli.calculation import calculate
from kiteocp.cli.parser import add_calculation

NAME = "solve"
HELP = "find the optimal cycle and compare it with the prescribed one"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem."""
    add_calculation(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve, save, print and draw."""
    from kiteocp.ocp import solve  # noqa: PLC0415  (CasADi only where it is needed)

    return calculate(arguments, NAME, solve)
