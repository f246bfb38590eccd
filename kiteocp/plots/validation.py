"""The figures of the paper's results section, drawn from simulated cycles and two studies, with their captions."""

from __future__ import annotations

from collections.abc import Mapping

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

_GRAVITY = "Solid: gravity included; dashed: gravity excluded."
_PHASES = (
    "The shaded bands are the phases of the cycle with gravity; the circles mark the phase changes of the cycle "
    "without it."
)

#: One caption for each figure of `figures`, by the same key.
CAPTIONS: dict[str, str] = {
    "side_view": (
        "Position of the kite over a full pumping cycle: ground distance along the tether's azimuth, and height. "
        f"{_GRAVITY} The colours are the phases, the arcs the shortest and the longest tether."
    ),
    "angular_coordinates": (
        "Angular coordinates of the kite over a full pumping cycle. The dot is the representative place of the "
        "traction phase. Retraction and transition both run along zero azimuth; lines that would cover each other "
        f"are drawn side by side. {_GRAVITY} The elevations at which the retraction ends are written beside its end."
    ),
    "tether_length": f"Tether length over a full pumping cycle. {_GRAVITY} {_PHASES}",
    "reeling_speed": f"Reeling speed of the tether, positive when reeling out. {_GRAVITY} {_PHASES}",
    "flight_speed": f"Flight speed of the kite over a full pumping cycle. {_GRAVITY} {_PHASES}",
    "wind_speed": (
        "Wind speed at the kite (thin lines), apparent wind speed (thick lines) and wind speed at the reference "
        f"height (dotted). {_GRAVITY} {_PHASES}"
    ),
    "tether_force": (
        f"Tether force at the ground over a full pumping cycle, and the set values (dotted). {_GRAVITY} {_PHASES}"
    ),
    "power": f"Mechanical power at the winch over a full pumping cycle. {_GRAVITY} {_PHASES}",
    "convergence": (
        "Mean harvesting factor of the finite-difference scheme over its nondimensional time step, normalised by the "
        "value of the smallest step. The dash-dotted lines are the 3 % band, the marks on the left the adaptive "
        "integrator."
    ),
    "mass_isolines": (
        "Mass of a kite that flies a course in equilibrium at a kinematic ratio (no tether drag, no tether weight), in "
        "kg. The dashed line is the lift-to-drag ratio, at which the massless kite flies every course; where the "
        "ground is grey no mass gives a state. Course 0 deg is straight down, 180 deg straight up."
    ),
}


def figures(
    cases: Mapping[str, Mapping[str, Result]], convergence: Convergence, isolines: GravityIsolines
) -> dict[str, Figure]:
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
    dict of str to matplotlib.figure.Figure
        File stem, a key of `CAPTIONS`, to the figure; `kiteocp.plots.style.save_figure` writes it.
    """
    drawn = {
        "side_view": draw_side_views(cases),
        "angular_coordinates": draw_angular_coordinates(cases),
        "tether_length": draw_time_series(cases, "tether_length_m", "tether length (m)"),
        "reeling_speed": draw_time_series(cases, "reeling_speed_m_s", "reeling speed (m/s)"),
        "flight_speed": draw_time_series(cases, "kite_speed_m_s", "flight speed (m/s)"),
        "wind_speed": draw_wind_speed(cases),
        "tether_force": draw_tether_force(cases),
        "power": draw_time_series(cases, "power_W", "mechanical power (kW)", factor=1e-3),
        "convergence": draw_convergence(convergence),
        "mass_isolines": draw_mass_isolines(isolines),
    }
    return {stem: drawn[stem] for stem in CAPTIONS}
