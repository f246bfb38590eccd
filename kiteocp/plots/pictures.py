"""Which pictures a study is drawn as, and how they get to disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from matplotlib import figure as mpl

from kiteocp.errors import InputError
from kiteocp.plots import flights, validation
from kiteocp.plots.crosswind import compose_crosswind
from kiteocp.plots.cycle import compose_cycle, compose_optimum
from kiteocp.plots.distribution import compose_distribution
from kiteocp.plots.estimate import compose_estimate
from kiteocp.plots.sensitivity import compose_sensitivities, compose_variation
from kiteocp.plots.style import figure_bytes, save_figure
from kiteocp.report.document import Picture
from kiteocp.result import Result
from kiteocp.studies.paper.paper import PaperValidation
from kiteocp.studies.prediction.study import FlightStudy
from kiteocp.studies.protocol import ResultStudy, Study

#: What composes each picture of `kiteocp.verbs` from a result.
COMPOSE: dict[str, Callable[[Result], mpl.Figure]] = {
    "cycle": compose_cycle,
    "sensitivity": compose_sensitivities,
    "variation": compose_variation,
    "global": compose_distribution,
    "crosswind": compose_crosswind,
    "estimate": compose_estimate,
}

#: What a page shows, by suffix: a drawing of lines rather than pixels.
MEDIA_TYPES = {".svg": "image/svg+xml", ".png": "image/png"}


def drawings(study: Study) -> Mapping[str, Callable[[], mpl.Figure]]:
    """Return by file stem what draws each figure of a study."""
    if isinstance(study, FlightStudy):
        return flights.figures(study)
    if isinstance(study, PaperValidation):
        return validation.figures(study.cycles(), study.convergence, study.isolines)
    result = study.result()
    compose = {**COMPOSE, "cycle": compose_optimum} if result.verb == "solve" else COMPOSE
    return {figure.stem: partial(compose[figure.stem], result) for figure in study.figures()}


def draw_study(
    study: Study,
    directory: Path,
    formats: Sequence[str],
    written: list[Path],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Picture]:
    """Draw every figure of a study.

    Parameters
    ----------
    study
        The study.
    directory
        Where the files go, as ``cycle.png``.
    formats
        Of ``png``, ``svg``, ``pdf``.
    written
        Gets the files as they are written, so that an interruption does not hide them.
    progress
        Called with the figures done and their number.

    Returns
    -------
    list of Picture
        The figures for the page.

    Raises
    ------
    InputError
        A format is unknown or a file cannot be written.
    """
    draw_one = drawings(study)
    pictures: list[Picture] = []
    for figure in study.figures():
        progress(len(pictures), len(draw_one))
        drawn = draw_one[figure.stem]()
        paths = save_figure(drawn, directory / figure.stem, formats)
        written += paths
        shown = next((path for suffix in MEDIA_TYPES for path in paths if path.suffix == suffix), None)
        suffix, content = (".svg", figure_bytes(drawn, "svg")) if shown is None else (shown.suffix, shown.read_bytes())
        pictures.append(Picture(figure, MEDIA_TYPES[suffix], content))
    return pictures


def draw(result: Result, directory: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw every picture of a result.

    Parameters
    ----------
    result : Result
        Of any verb that computes one cycle; what it holds decides which pictures there are.
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
    if result.verb == "validate":
        raise InputError(f"a saved {result.verb} result cannot be drawn again; run kiteocp {result.verb}")
    study = ResultStudy(result)
    if not study.figures():
        raise InputError(f"the {result.verb} result of {result.problem.name} holds nothing to draw")
    written: list[Path] = []
    draw_study(study, directory, formats, written)
    return written
