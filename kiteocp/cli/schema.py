"""Print the JSON Schema of problem files, for editors that complete and check them."""

from __future__ import annotations

import argparse
import json

from kiteocp.cli.output import say

HELP = "print the JSON Schema of problem files"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the verb takes no arguments."""


def run(arguments: argparse.Namespace) -> int:
    """Print the schema."""
    from kiteocp.problem import json_schema  # noqa: PLC0415  (keeps --help fast)

    say(json.dumps(json_schema(), indent=2, ensure_ascii=False))
    return 0
