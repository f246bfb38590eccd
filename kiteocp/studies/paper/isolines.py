"""Kite mass over course angle and kinematic ratio, the paper's fig:kinematiclifttodragratio."""

from __future__ import annotations

import casadi as ca
import msgspec
import numpy as np

from kiteocp.ocp.collocation import FloatArray
from kiteocp.physics.equilibrium import POSITION_ARGUMENTS, equilibrium_functions
from kiteocp.physics.flight import OperatingPoint
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem, problem_from_dict

#: The state of the figure's caption, and a wind without shear and an air without layers to hold it.
ELEVATION_DEG, REELING_FACTOR, LIFT_TO_DRAG, LIFT, AREA_M2, WIND_M_S, DENSITY_KG_M3 = (
    25.0,
    0.37,
    5.0,
    1.0,
    16.7,
    7.0,
    1.225,
)

COURSES_DEG: FloatArray = np.linspace(0.0, 360.0, 241)
KINEMATIC_RATIOS: FloatArray = np.linspace(1.5, 9.0, 151)

#: Lean of the force (rad) that is rounding of the arithmetic: the kite is massless.
TILT_ROUNDING = 1e-12

#: Tether length without meaning: the tether has neither weight nor drag, and the wind is uniform.
_LENGTH_M = 100.0


class GravityIsolines(msgspec.Struct, frozen=True):
    """Mass of a kite without tether that flies a course at a kinematic ratio in equilibrium.

    Attributes
    ----------
    course_deg
        Course angle, shape (n,).
    kinematic_ratio
        Tangential over radial apparent wind speed, shape (m,).
    mass_kg
        Mass, shape (m, n); not a number where the kinematic ratio is not the one that a kite of any mass flies at.
    lift_to_drag
        Kinematic ratio of the massless kite.
    """

    course_deg: FloatArray
    kinematic_ratio: FloatArray
    mass_kg: FloatArray
    lift_to_drag: float


def isoline_problem(mass_kg: float) -> Problem:
    """Return the kite of the figure's caption with a mass, as a problem whose tether is next to nothing."""
    setting = {"lift_coefficient": LIFT, "lift_to_drag": LIFT_TO_DRAG}
    return problem_from_dict(
        {
            "name": "mass-isolines",
            "environment": {
                "wind": {"profile": "uniform", "reference_speed_m_s": WIND_M_S},
                "air": {"density_sea_level_kg_m3": DENSITY_KG_M3, "density_scale_height_m": 1e12},
            },
            "kite": {
                "projected_area_m2": AREA_M2,
                "mass_kg": mass_kg,
                "powered": setting,
                "depowered": setting,
            },
            "tether": {"diameter_m": 1e-9, "density_kg_m3": 1e-9, "drag_coefficient": 0.0},
            "limits": {"tether_force_max_N": 1e4},
        }
    )


def mass_isolines(
    course_deg: FloatArray = COURSES_DEG, kinematic_ratio: FloatArray = KINEMATIC_RATIOS
) -> GravityIsolines:
    """Solve the equilibrium residual for the mass at every course and kinematic ratio, in closed form.

    Parameters
    ----------
    course_deg
        Courses, shape (n,).
    kinematic_ratio
        Kinematic ratios above zero, rising, shape (m,).

    Notes
    -----
    With the reeling factor given, the kinematic ratio alone decides the apparent wind and the magnitude F of the force
    (eq:F_a_magnitude2). Only the angle epsilon of the force to the tether depends on the weight:
    ``sin(epsilon) = m g cos(beta) / F``. In it the residual of eq:F_a_projection is
    ``A cos(epsilon) - B sin(epsilon) - C_D / C_R``: A is read off the residual of the massless kite, B off its
    derivative with respect to the mass. It has two solutions. Kept are those where the residual falls with the angle of
    the apparent wind, which the massless kite's flight goes over into as the mass grows and which
    `kiteocp.flight_state` gives: of one mass at one course, one kinematic ratio.
    """
    values = parameter_values(isoline_problem(1.0))
    functions = equilibrium_functions(values.structure, "reeling_factor")
    angle, arguments = ca.SX.sym("angle"), ca.SX.sym("arguments", functions.residual.size1_in(1))
    residual = functions.residual(angle, arguments)
    mass = values.structure.keys.index("kite.mass_kg")
    state = functions.state(angle=angle, arguments=arguments)
    by_mass = ca.jacobian(residual, arguments)[mass]
    weight_by_mass = ca.jacobian(state["weight_across"], arguments)[mass]
    drag_share = state["drag_coefficient"] / state["resultant_coefficient"]
    quantities = [residual, by_mass, state["aerodynamic_force"], weight_by_mass, drag_share]
    massless = ca.Function("massless", [angle, arguments], quantities)
    steepness = ca.Function("steepness", [angle, arguments], [ca.jacobian(residual, angle)])

    ratios, courses = (grid.ravel() for grid in np.meshgrid(kinematic_ratio, course_deg, indexing="ij"))
    table = np.repeat(_arguments(values)[:, None], courses.size, axis=1)
    table[len(values.vector) + POSITION_ARGUMENTS.index("course_deg")] = courses
    angles = np.arctan(ratios)[None, :]
    found = massless.map(courses.size)(angles, table)
    # `weight` is that across the tether per kilogram, `target` the cosine of the angle of force and apparent wind.
    given, tilting, strength, weight, target = (np.asarray(output).ravel() for output in found)
    masses = np.full(courses.size, np.nan)
    with np.errstate(invalid="ignore"):
        a, b = given + target, -tilting * strength / weight
        opening, turn = np.arccos(target / np.hypot(a, b)), np.arctan2(b, a)
        # The second solution is cut off from the massless kite where the first does not end: flying down so steeply
        # that even at an infinite kinematic ratio the force could lean far enough.
        for tilt, connected in ((opening - turn, np.cos(np.radians(courses)) <= target), (-opening - turn, True)):
            leaning = np.where(np.abs(tilt) < TILT_ROUNDING, 0.0, tilt)
            solution = np.where((leaning >= 0) & (leaning < np.pi / 2), strength * np.sin(leaning) / weight, np.nan)
            here = np.flatnonzero(np.isfinite(solution) & connected)
            if not here.size:
                continue
            table[mass] = solution
            falls = np.asarray(steepness.map(here.size)(angles[:, here], table[:, here])).ravel() < 0
            masses[here[falls]] = solution[here[falls]]
    grid = masses.reshape(len(kinematic_ratio), len(course_deg))
    # Close to no flight at all the residual may fall once more, at a mass that a faster kite already has.
    reached = np.fmax.accumulate(grid[::-1])[::-1]
    grid[(grid < reached) & (kinematic_ratio[:, None] < LIFT_TO_DRAG)] = np.nan
    return GravityIsolines(course_deg, kinematic_ratio, grid, LIFT_TO_DRAG)


def _arguments(values: ParameterValues) -> FloatArray:
    """Return the arguments of the residual for the figure's state, without mass and heading straight down."""
    place = OperatingPoint(_LENGTH_M, ELEVATION_DEG, 0.0, 0.0, LIFT, LIFT / LIFT_TO_DRAG)
    return np.concatenate([values.replaced({"kite.mass_kg": 0.0}).vector, place.vector(), [REELING_FACTOR]])
