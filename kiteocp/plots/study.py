"""All pictures of a sensitivity result: what it was asked for decides which there are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kiteocp.plots.distribution import plot_distribution
from kiteocp.plots.sensitivity import plot_sensitivities, plot_variation
from kiteocp.result import Result


def plot_study(result: Result, directory: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw the sensitivities and, where they were computed, the variation and the distribution.

    Parameters
    ----------
    result : Result
        Of the verb ``sensitivity``.
    directory : pathlib.Path
        Where the files go, as ``sensitivity.png``, ``variation.png`` and ``global.png``.
    formats : sequence of str
        Of ``png``, ``svg``, ``pdf``.

    Returns
    -------
    list of pathlib.Path
        The files written.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    written = plot_sensitivities(result, directory / "sensitivity", formats)
    if "variation" in result.details:
        written += plot_variation(result, directory / "variation", formats)
    if "global" in result.details:
        written += plot_distribution(result, directory / "global", formats)
    return written
