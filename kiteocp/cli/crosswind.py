"""Fly a figure of eight or a circle in the traction phase, and compare it with the representative state."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from kiteocp.cli.parser import add_calculation, positive_number
from kiteocp.cli.run import calculate
from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.studies.protocol import Study

HELP = "resolve the crosswind manoeuvres of the traction, and find its representative course"

#: As `kiteocp.studies.crosswind.path.PATHS`, which cannot be imported for the help without loading NumPy.
_PATHS = ("eight-up", "eight-down", "circle")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem and the figure."""
    add_calculation(parser)
    parser.add_argument(
        "--path",
        choices=_PATHS,
        default="eight-down",
        help="figure of eight with up-loops (up at its sides) or down-loops (the default), or a circle",
    )
    parser.add_argument(
        "--azimuth-amplitude-deg",
        type=positive_number,
        metavar="DEG",
        help="half the width of an eight (default: averaged cosines are those of the problem's traction place)",
    )
    parser.add_argument(
        "--elevation-amplitude-deg",
        type=positive_number,
        metavar="DEG",
        help="half the height of an eight (default 0.3 of its half width), or the angular radius of a circle",
    )
    parser.add_argument(
        "--centre-elevation-deg",
        type=positive_number,
        metavar="DEG",
        help="elevation of the centre (default as for the azimuth amplitude)",
    )
    parser.add_argument(
        "--tether-length-m",
        type=positive_number,
        metavar="M",
        help="tether length (default: the mean of shortest and longest)",
    )
    parser.add_argument(
        "--reeling-speed-m-s",
        type=_number,
        metavar="M/S",
        help="hold this reeling speed, positive reels out (default: hold the traction force of the problem)",
    )
    parser.add_argument(
        "--no-gravity", dest="gravity", action="store_false", help="leave out the weight of kite and tether"
    )


def run(arguments: argparse.Namespace) -> int:
    """Fly, compare, save, print and draw."""
    circle = arguments.path == "circle"
    if circle and arguments.azimuth_amplitude_deg is not None:
        raise InputError("--azimuth-amplitude-deg: a circle has one size; give --elevation-amplitude-deg, its radius")
    options = {
        "path": None if arguments.path == "eight-down" else arguments.path,
        "azimuth-amplitude-deg": arguments.azimuth_amplitude_deg,
        "elevation-amplitude-deg": arguments.elevation_amplitude_deg,
        "centre-elevation-deg": arguments.centre_elevation_deg,
        "tether-length-m": arguments.tether_length_m,
        "reeling-speed-m-s": arguments.reeling_speed_m_s,
        "gravity": None if arguments.gravity else False,
    }

    def compute(problem: Problem) -> Study:
        # Imported once the problem is known to be good: a mistake in it is answered without waiting for CasADi.
        from kiteocp.studies.crosswind.report import crosswind_document  # noqa: PLC0415
        from kiteocp.studies.crosswind.study import crosswind  # noqa: PLC0415
        from kiteocp.studies.protocol import ResultStudy  # noqa: PLC0415

        found = crosswind(
            problem,
            arguments.path,
            centre_elevation_deg=arguments.centre_elevation_deg,
            amplitude_deg=arguments.elevation_amplitude_deg if circle else arguments.azimuth_amplitude_deg,
            elevation_amplitude_deg=None if circle else arguments.elevation_amplitude_deg,
            tether_length_m=arguments.tether_length_m,
            reeling_speed_m_s=arguments.reeling_speed_m_s,
            gravity=arguments.gravity,
        )
        return ResultStudy(found, crosswind_document)

    return calculate(arguments, "crosswind", compute, options)


def _number(text: str) -> float:
    """Return a finite number; for ``type=``."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value
