"""What the figures of the paper's results section show, by the stem of their files."""

from __future__ import annotations

_GRAVITY = "Solid: gravity included; dashed: gravity excluded."
_PHASES = (
    "The shaded bands are the phases of the cycle with gravity; the circles mark the phase changes of the cycle "
    "without it."
)

#: In their order on the page.
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
