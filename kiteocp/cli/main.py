"""The command ``kiteocp``: choose the verb, run it, turn every error into one sentence and an exit status."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

import kiteocp
from kiteocp import verbs
from kiteocp.cli.output import complain, prepare_streams, say
from kiteocp.cli.parser import Parser, nearest
from kiteocp.errors import InputError, KiteocpError
from kiteocp.execution import Terminated, interruptible, was_interrupted

#: The module of each verb, in the order of the help.
VERBS: dict[str, ModuleType] = {verb.name: import_module(f"kiteocp.cli.{verb.name}") for verb in verbs.VERBS}

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130
EXIT_TERMINATED = 143

_DESCRIPTION = "Optimal pumping cycles of kite power systems: simulate, optimise, draw."
_EPILOG = (
    "PROBLEM is the name of a shipped problem (kiteocp list) or the path of a problem file (kiteocp new). "
    "Exit status: 0 done; 1 the calculation did not succeed, what was reached is saved; 2 bad input; "
    "130 interrupted (143 by SIGTERM), what was reached is saved."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; those of the process where left out.

    Returns
    -------
    int
        Exit status: 0 done; 1 the calculation did not succeed; 2 bad input; 130 interrupted; 143 ended by SIGTERM.
    """
    if argv is not None:
        return _status_of(list(argv))
    status = _status_of(sys.argv[1:])
    # Everything is written; a signal while the interpreter ends would only print a traceback.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


def _status_of(words: list[str]) -> int:
    """Run one command and return its exit status."""
    prepare_streams()
    # Read by hand: it must also hold for errors of parsing.
    debug = "--debug" in words
    try:
        with interruptible(termination=True):
            try:
                return _run([word for word in words if word != "--debug"])
            except Exception as error:
                if was_interrupted():
                    raise KeyboardInterrupt from error
                raise
    except KiteocpError as error:
        complain(str(error))
        return error.exit_status
    except KeyboardInterrupt as interruption:
        ended = isinstance(interruption, Terminated)
        complain("; ".join(["terminated" if ended else "interrupted", *map(str, interruption.args)]))
        return EXIT_TERMINATED if ended else EXIT_INTERRUPTED
    except SystemExit as leave:  # argparse leaves this way after printing help
        return leave.code if isinstance(leave.code, int) else 0
    except Exception as error:
        if debug:
            raise
        complain(
            f"internal error ({type(error).__name__}: {error}); please run the same command with --debug "
            "and report what it prints"
        )
        return EXIT_FAILED


def _run(words: list[str]) -> int:
    parser, parsers = build_parsers()
    verb = next((word for word in words if not word.startswith("-")), None)
    if verb is not None and verb not in VERBS:
        raise InputError(nearest(verb, VERBS, "verb"))
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        option = next((word for word in unknown if word.startswith("-")), unknown[0])
        name = option.partition("=")[0]
        if not name.startswith("-"):
            raise InputError(f"unexpected argument '{name}'; see kiteocp {verb} --help")
        raise InputError(nearest(name, (parsers[verb] if verb else parser).option_names(), "option"))
    if arguments.version:
        say(f"kiteocp {kiteocp.__version__}")
        return 0
    if verb is None:
        raise InputError(f"name a verb: {', '.join(VERBS)}; see kiteocp --help")
    status: int = VERBS[verb].run(arguments)
    return status


def build_parsers() -> tuple[Parser, dict[str, Parser]]:
    """Return the parser of the command and those of the verbs by name."""
    parser = Parser(prog="kiteocp", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument("--version", action="store_true", help="print the version")
    _add_debug(parser)
    verbs = parser.add_subparsers(title="verbs", dest="verb", metavar="VERB", parser_class=Parser)
    parsers: dict[str, Parser] = {}
    for name, module in VERBS.items():
        parsers[name] = verbs.add_parser(name, help=module.HELP, description=module.__doc__)
        module.add_arguments(parsers[name])
        _add_debug(parsers[name])
    return parser, parsers


def _add_debug(parser: argparse.ArgumentParser) -> None:
    # Taken out of the words before parsing; added here for the help and for the nearest name of a mistyped option.
    parser.add_argument("--debug", action="store_true", help="show the traceback of an internal error")
