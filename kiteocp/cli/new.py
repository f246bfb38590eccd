"""Write a commented problem file, or a column map of flight recordings, to start from."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from kiteocp.cli.output import say
from kiteocp.errors import InputError

HELP = "write a commented problem file (or column map) to start from"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the name of the problem or map and where to write it."""
    parser.add_argument("name", metavar="NAME", help="name of the new problem or column map")
    parser.add_argument(
        "--columns", action="store_true", help="write a column map for estimate and validate instead of a problem"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="where to write (default NAME.yaml)")


def run(arguments: argparse.Namespace) -> int:
    """Write the file, unless there is one already."""
    from kiteocp.problem import problem_template  # noqa: PLC0415  (keeps --help fast)
    from kiteocp.writing import write_atomically  # noqa: PLC0415

    name = arguments.name.removesuffix(".yaml")
    if not name or "/" in name or "\\" in name:
        raise InputError(f"'{arguments.name}' is not a name; give a plain one, and the path with -o FILE")
    path = Path(arguments.output) if arguments.output is not None else Path(f"{name}.yaml")
    # The functions of os.path take a folder that may not be entered, or a name that is too long, for one that is not
    # there; writing then says why it cannot be.
    if os.path.isdir(path):
        path /= f"{name}.yaml"
    if os.path.lexists(path):
        raise InputError(f"{path}: is there already and is not overwritten; choose another file with -o FILE")
    if arguments.columns:
        from kiteocp.recording.template import columns_template  # noqa: PLC0415

        content = columns_template(name)
    else:
        content = problem_template(name)
    write_atomically({path: content.encode()})
    say(f"written: {path}")
    return 0
