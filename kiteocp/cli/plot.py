"""Draw the picture of a saved result again."""

from __future__ import annotations

import argparse
from pathlib import Path

from kiteocp.cli.output import say
from kiteocp.cli.parser import add_picture_format

NAME = "plot"
HELP = "draw a saved result again"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the directory of the result and the format of the picture."""
    parser.add_argument("directory", metavar="DIR", help="directory that simulate, solve, sensitivity or crosswind wrote")
    parser.add_argument("-o", "--output", metavar="DIR", help="where to write the picture (default DIR)")
    add_picture_format(parser)


def run(arguments: argparse.Namespace) -> int:
    """Load the result, draw it, print what was written."""
    from kiteocp.result import load_result  # noqa: PLC0415  (keeps --help fast)

    result = load_result(arguments.directory)
    output = Path(arguments.output if arguments.output is not None else arguments.directory)
    formats = arguments.formats or ("png",)
    # matplotlib only once there is something to draw.
    if "sensitivities" in result.details:
        from kiteocp.plots.study import plot_study  # noqa: PLC0415

        written = plot_study(result, output, formats)
    elif "crosswind" in result.details:
        from kiteocp.plots.crosswind import plot_crosswind  # noqa: PLC0415

        written = plot_crosswind(result, output / "crosswind", formats)
    elif "estimates" in result.details:
        from kiteocp.plots.estimate import plot_estimate  # noqa: PLC0415

        written = plot_estimate(result, output / "estimate", formats)
    else:
        from kiteocp.plots import plot_result  # noqa: PLC0415

        written = plot_result(result, output / "cycle", formats)
    say("written: " + ", ".join(str(path) for path in written))
    return 0
