"""The figures of the paper's results section, drawn from simulated cycles and two studies."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from matplotlib.figure import Figure

from kiteocp.plots.validation_cycles import (
    draw_angular_coordinates,
    draw_side_views,
    draw_tether_force,
    draw_time_series,
    draw_wind_speed,
)
from kiteocp.plots.validation_studies import draw_convergence, draw_mass_isolines
from kiteocp.result import Result
from kiteocp.studies.paper.convergence import Convergence
from kiteocp.studies.paper.isolines import GravityIsolines


def figures(
    cases: Mapping[str, Mapping[str, Result]], convergence: Convergence, isolines: GravityIsolines
) -> dict[str, Callable[[], Figure]]:
    """Draw the results section of the paper.

    Parameters
    ----------
    cases : mapping
        Name of a case, as ``strong-wind``, to ``gravity included`` and ``gravity excluded`` to the simulated cycle.
        One column for each case, in this order.
    convergence : Convergence
        The convergence study.
    isolines : GravityIsolines
        Mass over course and kinematic ratio.

    Returns
    -------
    dict of str to callable
        By file stem what draws each figure.
    """
    return {
        "side_view": lambda: draw_side_views(cases),
        "angular_coordinates": lambda: draw_angular_coordinates(cases),
        "tether_length": lambda: draw_time_series(cases, "tether_length_m", "tether length (m)"),
        "reeling_speed": lambda: draw_time_series(cases, "reeling_speed_m_s", "reeling speed (m/s)"),
        "flight_speed": lambda: draw_time_series(cases, "kite_speed_m_s", "flight speed (m/s)"),
        "wind_speed": lambda: draw_wind_speed(cases),
        "tether_force": lambda: draw_tether_force(cases),
        "power": lambda: draw_time_series(cases, "power_W", "mechanical power (kW)", factor=1e-3),
        "convergence": lambda: draw_convergence(convergence),
        "mass_isolines": lambda: draw_mass_isolines(isolines),
    }
