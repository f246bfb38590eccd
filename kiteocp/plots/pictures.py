"""Which pictures a study is drawn as, and how they get to disk.

Nothing here loads matplotlib before something is drawn: drawing may be another process's work (`kiteocp.cli.drawing`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from kiteocp.errors import InputError
from kiteocp.report.document import Picture
from kiteocp.result import Result
from kiteocp.studies.protocol import ResultStudy, Study
from kiteocp.verbs import PICTURE_FORMATS, verb_named
from kiteocp.writing import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Module of this room and function that compose each picture of `kiteocp.verbs` from a result.
COMPOSE: dict[str, tuple[str, str]] = {
    "cycle": ("cycle", "compose_cycle"),
    "sensitivity": ("sensitivity", "compose_sensitivities"),
    "variation": ("sensitivity", "compose_variation"),
    "global": ("distribution", "compose_distribution"),
    "crosswind": ("crosswind", "compose_crosswind"),
    "estimate": ("estimate", "compose_estimate"),
}
#: The same where a verb has its own way.
COMPOSE_OF_VERB: dict[tuple[str, str], tuple[str, str]] = {("solve", "cycle"): ("cycle", "compose_optimum")}

#: What a page shows, by suffix: a drawing of lines rather than pixels.
MEDIA_TYPES = {"svg": "image/svg+xml", "png": "image/png"}

#: From a study and suffixes to the contents of the files of each of its figures, in their order.
Contents = Callable[[Study, Sequence[str]], Iterator[Mapping[str, bytes]]]


def composer(verb: str, stem: str) -> Callable[[Result], Figure]:
    """Return what composes a picture from a result of a verb."""
    module, function = COMPOSE_OF_VERB.get((verb, stem), COMPOSE[stem])
    compose: Callable[[Result], Figure] = getattr(import_module(f"kiteocp.plots.{module}"), function)
    return compose


def drawings(study: Study) -> Mapping[str, Callable[[], Figure]]:
    """Return by file stem what draws each figure of a study."""
    result = study.result()
    if result.verb == "validate":
        # Their modules load scipy, which no other picture needs.
        from kiteocp.plots import flights, validation  # noqa: PLC0415
        from kiteocp.studies.paper.paper import PaperValidation  # noqa: PLC0415
        from kiteocp.studies.prediction.study import FlightStudy  # noqa: PLC0415

        if isinstance(study, FlightStudy):
            return flights.figures(study)
        if isinstance(study, PaperValidation):
            return validation.figures(study.cycles(), study.convergence, study.isolines)
    return {figure.stem: partial(composer(result.verb, figure.stem), result) for figure in study.figures()}


def make_ready(verb: str, suffixes: Sequence[str]) -> None:
    """Load all that draws the pictures of a verb, fonts included."""
    from kiteocp.plots.style import figure_bytes, make_figure, style_axes  # noqa: PLC0415

    found = verb_named(verb)
    for stem in found.pictures if found else ():
        composer(verb, stem)
    figure = make_figure(1.0, 1.0)
    style_axes(figure.add_axes((0.2, 0.2, 0.6, 0.6)))
    for suffix in suffixes:
        figure_bytes(figure, suffix)


def drawn(study: Study, suffixes: Sequence[str]) -> Iterator[Mapping[str, bytes]]:
    """Draw the figures of a study one by one; yield the contents of the files of each by suffix."""
    from kiteocp.plots.style import figure_bytes, look  # noqa: PLC0415

    draw_one = drawings(study)
    for figure in study.figures():
        with look():
            composed = draw_one[figure.stem]()
            files = {suffix: figure_bytes(composed, suffix) for suffix in suffixes}
        yield files


def draw_study(
    study: Study,
    directory: Path,
    formats: Sequence[str],
    written: list[Path],
    progress: Callable[[int, int], None] = lambda done, total: None,
    contents: Contents = drawn,
) -> list[Picture]:
    """Draw every figure of a study; each file is there whole or not at all.

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
    contents
        What draws.

    Returns
    -------
    list of Picture
        The figures for the page.

    Raises
    ------
    InputError
        A format is unknown or a file cannot be written.
    """
    for suffix in formats:
        if suffix not in PICTURE_FORMATS:
            raise InputError(f"picture format '{suffix}' is not known; choose from {', '.join(PICTURE_FORMATS)}")
    shown = next((suffix for suffix in MEDIA_TYPES if suffix in formats), "svg")
    figures = study.figures()
    pictures: list[Picture] = []
    files_of = contents(study, list(dict.fromkeys([*formats, shown])))
    for figure in figures:
        progress(len(pictures), len(figures))
        files = next(files_of)
        paths = {directory / f"{figure.stem}.{suffix}": files[suffix] for suffix in formats}
        write_atomically(paths)
        written += paths
        pictures.append(Picture(figure, MEDIA_TYPES[shown], files[shown]))
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
