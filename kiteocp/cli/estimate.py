"""Estimate lift, drag and wind from a recorded flight, by the paper's formulas and by the model itself."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.cli.drawing import drawing_apart
from kiteocp.cli.parser import add_output, add_overrides, number_from_zero, positive_number
from kiteocp.cli.run import asked_of, digest_of, formats_of, load, place_of, run_study
from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.problem import Problem
    from kiteocp.studies.protocol import Study

HELP = "estimate the aerodynamics of a kite, and the wind, from flight data"

#: Cycles that can be named in one range; a day of flight has some hundreds.
MOST_CYCLES = 100_000

#: Named here, so that a mistyped one is answered without loading what computes.
WIND_SOURCES = ("measured", "airspeed", "ground", "fit", "problem")

#: Options that say how far off is what the data do not tell, with their attribute of `WindUnknowns` and what they mean.
UNKNOWNS = {
    "shear_error": ("shear_exponent", "exponent of the wind profile (default 0.1)"),
    "height_error": ("sensor_height_share", "share of the height of the wind sensor at the ground (default 0.2)"),
    "gauge_error": ("airspeed_gauge", "share by which the gain of the airspeed sensor changes (default 0.03)"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add flight, problem, and where the wind comes from."""
    parser.add_argument("flight", metavar="FLIGHT.csv", help="the recording")
    parser.add_argument(
        "--system",
        metavar="PROBLEM",
        required=True,
        help="shipped problem or problem file with area, masses, tether and wind profile, as v9-kite",
    )
    parser.add_argument(
        "--columns", metavar="MAP", help="column map: a shipped name or a file (default: the shipped one that fits)"
    )
    parser.add_argument(
        "--cycles", type=_cycles, metavar="N,N", help="numbers of the cycles to use, as 0,1 or 0-3 (default: all)"
    )
    parser.add_argument(
        "--wind",
        choices=WIND_SOURCES,
        help="where the wind at the kite comes from: measured at several heights (lidar), the airspeed sensor, the "
        "sensor at the ground and the profile, the force equilibrium itself, or the problem (default: the first of "
        "measured, airspeed, ground and problem there is)",
    )
    parser.add_argument(
        "--trust-airspeed",
        dest="calibrate",
        action="store_false",
        help="take the airspeed sensor at its word instead of finding its gain along with the wind",
    )
    parser.add_argument(
        "--ground-height",
        type=positive_number,
        metavar="M",
        help="height of the wind sensor at the ground (default: that of the profile, 10 m at most)",
    )
    for name, (_, meaning) in UNKNOWNS.items():
        parser.add_argument(
            f"--{name.replace('_', '-')}",
            type=number_from_zero,
            metavar="S",
            help=f"standard deviation of the {meaning}; the interval of the wind carries it",
        )
    add_overrides(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Estimate, save, print and draw."""
    problem = load(arguments.system, arguments.overrides)
    flight = Path(arguments.flight)
    options = {
        "flight_sha256": digest_of(flight),
        "columns": arguments.columns,
        "cycles": arguments.cycles,
        "wind": arguments.wind,
        "trust-airspeed": None if arguments.calibrate else True,
        "ground-height": arguments.ground_height,
        **{name.replace("_", "-"): getattr(arguments, name) for name in UNKNOWNS},
    }
    asked = asked_of(arguments, "estimate", problem, options, flight.stem)
    with drawing_apart("estimate", formats_of(arguments)) as contents:
        place = place_of(arguments, asked)
        return run_study(arguments, asked, place, lambda: _estimated(arguments, problem), contents=contents)


def _estimated(arguments: argparse.Namespace, problem: Problem) -> Study:
    from kiteocp.recording import load_flight  # noqa: PLC0415  (keeps --help fast, as those below)
    from kiteocp.studies.estimation.replacement import FILE, problem_yaml  # noqa: PLC0415
    from kiteocp.studies.estimation.report import estimates_document  # noqa: PLC0415
    from kiteocp.studies.estimation.study import estimate  # noqa: PLC0415
    from kiteocp.studies.estimation.unknowns import WindUnknowns  # noqa: PLC0415
    from kiteocp.studies.protocol import ResultStudy  # noqa: PLC0415

    flight = load_flight(arguments.flight, arguments.columns)
    if not (flight.phase == "traction").any():
        raise InputError(
            "has no sample of the traction; check the phase labels of the column map", file=str(arguments.flight)
        )
    found = estimate(
        flight,
        problem,
        wind=arguments.wind,
        cycles=arguments.cycles,
        calibrate=arguments.calibrate,
        ground_height_m=arguments.ground_height,
        unknowns=WindUnknowns(**_given_unknowns(arguments)),
    )
    return ResultStudy(found.result(), estimates_document, {FILE: problem_yaml(found).encode()})


def _given_unknowns(arguments: argparse.Namespace) -> dict[str, float]:
    values = {attribute: getattr(arguments, name) for name, (attribute, _) in UNKNOWNS.items()}
    return {attribute: value for attribute, value in values.items() if value is not None}


def _cycles(text: str) -> tuple[int, ...]:
    """Return the cycle numbers of a list such as ``0,2-4``; for ``type=``."""
    numbers: set[int] = set()
    # A flight has hundreds of cycles; numbers far beyond would fill the memory before anybody says so.
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            low = int(first)
            high = int(last if dash else first)
            if high - low >= MOST_CYCLES:
                raise argparse.ArgumentTypeError(f"'{text}' names more than {MOST_CYCLES} cycles; name those to use")
            numbers.update(range(low, high + 1))
        except ValueError:
            raise argparse.ArgumentTypeError(f"'{text}' is no list of cycle numbers, such as 0,1 or 0-3") from None
    if not numbers:
        raise argparse.ArgumentTypeError(f"'{text}' names no cycle; give numbers such as 0,1 or 0-3")
    return tuple(sorted(numbers))
