"""The verbs of the command line: where each is, and what it writes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

PICTURE_FORMATS: tuple[str, ...] = ("png", "svg", "pdf")


class Verb(NamedTuple):
    """A verb and the files beside its ``summary.json``; no msgspec, which ``--help`` need not load.

    Attributes
    ----------
    name
        As it is typed; its module is ``kiteocp.cli.<name>``.
    files
        What it may write; patterns where names depend on the input.
    pictures
        Stems of its pictures, patterns too, with what the result must hold for each: a key of its details, or None
        for the time series.
    """

    name: str
    files: tuple[str, ...] = ()
    pictures: Mapping[str, str | None] = MappingProxyType({})

    @property
    def patterns(self) -> tuple[str, ...]:
        """All that it may write beside its summary."""
        return (*self.files, *(f"{stem}.{suffix}" for stem in self.pictures for suffix in PICTURE_FORMATS))


_SERIES = "timeseries.csv"
_BOTH = (_SERIES, "timeseries_prescribed.csv")

_OF_A_FLIGHT = ("cycle_*", "side_view_*", "comparison", "optimum")
_OF_THE_PAPER = (
    *("side_view", "angular_coordinates", "tether_length", "reeling_speed", "flight_speed", "wind_speed"),
    *("tether_force", "power", "convergence", "mass_isolines"),
)

#: In the order of the help.
VERBS: tuple[Verb, ...] = (
    Verb("list"),
    Verb("new"),
    Verb("check"),
    Verb("schema"),
    Verb("simulate", (_SERIES,), {"cycle": None}),
    Verb("solve", _BOTH, {"cycle": None}),
    Verb(
        "sensitivity",
        ("variation.csv", "global.csv", *_BOTH),
        {"sensitivity": "sensitivities", "variation": "variation", "global": "global"},
    ),
    Verb("crosswind", (_SERIES,), {"crosswind": "crosswind"}),
    Verb("validate", ("report.html", *_BOTH), dict.fromkeys((*_OF_THE_PAPER, *_OF_A_FLIGHT))),
    Verb("estimate", ("estimated.yaml", _SERIES), {"estimate": "estimates"}),
    Verb("plot"),
)


def verb_named(name: str) -> Verb | None:
    """Return a verb, None where there is none of the name."""
    return next((verb for verb in VERBS if verb.name == name), None)
