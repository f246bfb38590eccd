"""The argument parser: every mistake is one sentence, and names what was probably meant."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from typing import Any, NoReturn

from kiteocp.errors import InputError
from kiteocp.verbs import PICTURE_FORMATS


class Parser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` that raises `InputError` instead of printing a usage block and leaving."""

    def __init__(self, *args: Any, **options: Any) -> None:
        # Abbreviated options would change their meaning when an option is added.
        super().__init__(*args, **{"allow_abbrev": False, **options})

    def error(self, message: str) -> NoReturn:
        """Raise `InputError` with the message of argparse and where to look."""
        raise InputError(f"{message}; see {self.prog} --help")

    def option_names(self) -> list[str]:
        """Return the long and short names of every option."""
        return [name for action in self._actions for name in action.option_strings]


def nearest(name: str, known: Iterable[str], what: str) -> str:
    """Return the sentence for a name that is none of `known`, with the nearest or all of them."""
    import difflib  # noqa: PLC0415  (for mistakes only)

    names = list(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(names)}"
    return f"there is no {what} '{name}'; {hint}"


def positive_number(text: str) -> float:
    """Return a finite number above zero; for ``type=``."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0")
    return value


def number_from_zero(text: str) -> float:
    """Return a finite number of zero or more; for ``type=``."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number of 0 or more")
    return value


def picture_format(text: str) -> str:
    """Return a known picture format; for ``type=``."""
    if text not in PICTURE_FORMATS:
        raise argparse.ArgumentTypeError(nearest(text, PICTURE_FORMATS, "picture format"))
    return text


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add ``--set``."""
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key of the problem file, as environment.wind.reference_speed_m_s=8 (repeatable)",
    )


def add_picture_format(parser: argparse.ArgumentParser, default: str = "png") -> None:
    """Add ``--format``; `default` is for the help."""
    parser.add_argument(
        "--format",
        dest="formats",
        action="append",
        type=picture_format,
        metavar="FORMAT",
        help=f"format of the picture: {', '.join(PICTURE_FORMATS)} (repeatable; default {default})",
    )


def add_calculation(parser: argparse.ArgumentParser) -> None:
    """Add what every verb takes that computes a result from one problem."""
    parser.add_argument("problem", metavar="PROBLEM", help="name of a shipped problem, or path of a problem file")
    add_overrides(parser)
    add_output(parser)


def add_output(
    parser: argparse.ArgumentParser, directory: str = "results/<problem>/<verb>", formats: str = "png"
) -> None:
    """Add where to write, what to draw and what to print; the defaults are for the help."""
    parser.add_argument("-o", "--output", metavar="DIR", help=f"where to write (default {directory})")
    parser.add_argument("--no-plot", dest="plot", action="store_false", help="write no picture")
    add_picture_format(parser, formats)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON instead of the table")
