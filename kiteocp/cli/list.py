"""List the problems that come with kiteocp."""

from __future__ import annotations

import argparse

from kiteocp.cli.output import say

HELP = "list the shipped problems"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the verb takes no arguments."""


def run(arguments: argparse.Namespace) -> int:
    """Print the name and description of every shipped problem."""
    from kiteocp.problem import load_problem, shipped_problems  # noqa: PLC0415  (keeps --help fast)

    names = sorted(shipped_problems())
    width = max((len(name) for name in names), default=0)
    for name in names:
        say(f"{name.ljust(width)}  {load_problem(name).description}".rstrip())
    return 0
