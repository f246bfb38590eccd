"""Simulate the pumping cycle that a problem file prescribes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from kiteocp.cli.parser import add_calculation, positive_number
from kiteocp.cli.run import calculate
from kiteocp.errors import CycleError

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.studies.protocol import Study

HELP = "simulate the prescribed cycle"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem and how to integrate it."""
    add_calculation(parser)
    parser.add_argument(
        "--no-gravity", dest="gravity", action="store_false", help="leave out the weight of kite and tether"
    )
    parser.add_argument(
        "--time-step",
        type=positive_number,
        metavar="DT",
        help="use the finite differences of the paper with this dimensionless time step, as 0.01",
    )


def run(arguments: argparse.Namespace) -> int:
    """Simulate, save, print and draw."""

    def compute(problem: Problem) -> Study:
        # Imported once the problem is known to be good: a mistake in it is answered without waiting for CasADi.
        from kiteocp.cycle import simulate  # noqa: PLC0415
        from kiteocp.cycle.remedies import explain_simulation  # noqa: PLC0415
        from kiteocp.studies.protocol import ResultStudy  # noqa: PLC0415

        try:
            return ResultStudy(simulate(problem, gravity=arguments.gravity, time_step=arguments.time_step))
        except CycleError as error:
            found = explain_simulation(problem, error, gravity=arguments.gravity)
            error.explain(found.sentence, found.to_dict())
            raise

    options = {"gravity": None if arguments.gravity else False, "time-step": arguments.time_step}
    return calculate(arguments, "simulate", compute, options)
