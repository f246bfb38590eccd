"""Draw the picture of a saved result again."""

from __future__ import annotations

import argparse
from pathlib import Path

from kiteocp.cli.output import say
from kiteocp.cli.parser import add_picture_format
from kiteocp.errors import InputError

HELP = "draw a saved result again"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the directory of the result and the format of the picture."""
    parser.add_argument(
        "directory", metavar="DIR", help="directory that simulate, solve, sensitivity, crosswind or estimate wrote"
    )
    parser.add_argument("-o", "--output", metavar="DIR", help="where to write the picture (default DIR)")
    add_picture_format(parser)


def run(arguments: argparse.Namespace) -> int:
    """Load the result, draw it, print what was written."""
    from kiteocp.result import load_result  # noqa: PLC0415  (keeps --help fast)

    result = load_result(arguments.directory)
    output = Path(arguments.output if arguments.output is not None else arguments.directory)
    from kiteocp.plots import draw  # noqa: PLC0415  (matplotlib only once there is something to draw)

    try:
        written = draw(result, output, arguments.formats or ("png",))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # All that is drawn was read from files, which somebody may have changed.
        raise InputError(
            f"{arguments.directory}: is not a complete result ({error}); run the calculation again"
        ) from error
    say("written: " + ", ".join(str(path) for path in written))
    return 0
