"""Which pictures a result is drawn as, and how they get to disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from kiteocp.errors import InputError
from kiteocp.plots.crosswind import compose_crosswind
from kiteocp.plots.cycle import compose_cycle, compose_optimum
from kiteocp.plots.distribution import compose_distribution
from kiteocp.plots.estimate import compose_estimate
from kiteocp.plots.sensitivity import compose_sensitivities, compose_variation
from kiteocp.plots.style import save_figure
from kiteocp.result import Result

Compose = Callable[[Result], Figure]

#: Verb to its pictures: file stem, the key of the details it needs (None: the time series), and what composes it.
PICTURES: dict[str, tuple[tuple[str, str | None, Compose], ...]] = {
    "simulate": (("cycle", None, compose_cycle),),
    "solve": (("cycle", None, compose_optimum),),
    "sensitivity": (
        ("sensitivity", "sensitivities", compose_sensitivities),
        ("variation", "variation", compose_variation),
        ("global", "global", compose_distribution),
    ),
    "crosswind": (("crosswind", "crosswind", compose_crosswind),),
    "estimate": (("estimate", "estimates", compose_estimate),),
}


def draw(result: Result, directory: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw every picture of a result.

    Parameters
    ----------
    result : Result
        Of any verb of `PICTURES`; what it holds decides which pictures there are.
    directory : pathlib.Path
        Where the files go, as ``cycle.png``.
    formats : sequence of str
        Of ``png``, ``svg``, ``pdf``.

    Returns
    -------
    list of pathlib.Path
        The files written.

    Raises
    ------
    InputError
        If the result holds nothing to draw, a format is unknown or a file cannot be written.
    """
    if result.verb not in PICTURES:
        raise InputError(f"a saved {result.verb} result cannot be drawn again; run kiteocp {result.verb}")
    composed = {
        stem: compose
        for stem, key, compose in PICTURES[result.verb]
        if (result.channels if key is None else key in result.details)
    }
    if not composed:
        raise InputError(f"the {result.verb} result of {result.problem.name} holds nothing to draw")
    return [
        path for stem, compose in composed.items() for path in save_figure(compose(result), directory / stem, formats)
    ]
