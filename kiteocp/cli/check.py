"""Check problem files without computing a cycle: keys, types, ranges, and what is worth a warning."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from kiteocp.cli.output import complain, say
from kiteocp.cli.parser import add_overrides
from kiteocp.cli.run import load
from kiteocp.errors import InputError

if TYPE_CHECKING:
    from kiteocp.problem import Problem

HELP = "check problem files"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problems."""
    parser.add_argument(
        "problems", metavar="PROBLEM", nargs="+", help="name of a shipped problem, or path of a problem file"
    )
    add_overrides(parser)


def run(arguments: argparse.Namespace) -> int:
    """Report on every problem; exit status 2 where one is wrong, 0 where there are only warnings."""
    status = 0
    for name in arguments.problems:
        try:
            problem = load(name, arguments.overrides)
        except InputError as error:
            complain(str(error))
            status = error.exit_status
            continue
        say(f"{name}: ok\n  {key_facts(problem)}")
        for warning in [*problem.warnings(), *_impossible(problem)]:
            say(f"  warning: {warning}")
    return status


def _impossible(problem: Problem) -> list[str]:
    """Say why no cycle can exist, where that is known without looking for one."""
    # Not before every mistake of the file is said: this loads CasADi.
    from kiteocp.cycle.weight import uncarried_weight  # noqa: PLC0415
    from kiteocp.physics.parameters import parameter_values  # noqa: PLC0415

    weight = uncarried_weight(parameter_values(problem), problem.optimisation.power_setting)
    return [] if weight is None else [weight.sentence]


def key_facts(problem: Problem) -> str:
    """Return what a problem is about in one line."""
    wind = problem.environment.wind
    # A table of wind speeds has no reference speed.
    speed = getattr(wind, "reference_speed_m_s", None)
    height = getattr(wind, "reference_height_m", None)
    profile = wind.__struct_config__.tag
    parts = [
        f"{profile} wind"
        + (f" {speed:g} m/s" if speed is not None else "")
        + (f" at {height:g} m" if height is not None else ""),
        f"kite {problem.kite.projected_area_m2:g} m2, {problem.kite.mass_kg:g} kg",
        f"tether {problem.operation.tether_length_min_m:g} to {problem.operation.tether_length_max_m:g} m",
        f"force {problem.limits.tether_force_min_N:g} to {problem.limits.tether_force_max_N:g} N",
    ]
    return "; ".join(parts)
