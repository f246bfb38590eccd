"""The functions under test, built once."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from paper import StateTable

import kiteocp
from kiteocp.physics.equilibrium import (
    OUTPUTS,
    POSITION_ARGUMENTS,
    equilibrium_functions,
    explicit_state,
    inflow_angle_at_force,
    outputs_of,
    paper_iteration,
    radial_ground_force_flying_down,
)
from kiteocp.physics.kinematics import DOWN, Course, radians
from kiteocp.physics.model import Coefficients, Model, Position
from kiteocp.physics.parameters import ParameterValues, parameter_values, parameters_of


@pytest.fixture(scope="session")
def problem() -> kiteocp.Problem:
    return kiteocp.load_problem("strong-wind")


@pytest.fixture(scope="session")
def values(problem: kiteocp.Problem) -> ParameterValues:
    return parameter_values(problem)


@pytest.fixture(scope="session")
def massless(problem: kiteocp.Problem) -> ParameterValues:
    return parameter_values(problem, gravity=False)


def columns(values: ParameterValues, places: np.ndarray, control: np.ndarray) -> np.ndarray:
    """Arguments of the numeric functions, one state a column."""
    return np.vstack([np.tile(values.vector[:, None], len(places)), places.T, control])


@pytest.fixture(scope="session")
def solved() -> StateTable:
    """States by `casadi.rootfinder` from the angle of the massless kite, as columns of named quantities."""

    def table(values: ParameterValues, control: str, places: np.ndarray, given: np.ndarray) -> dict[str, np.ndarray]:
        functions = equilibrium_functions(values.structure, control)
        arguments = columns(values, places, given)
        length, lift, kite_drag = places[:, 0], places[:, 4], places[:, 5]
        lumped = values["tether.diameter_m"] * values["tether.drag_coefficient"] / values["kite.projected_area_m2"] / 4
        guess = np.arctan2(lift, kite_drag + lumped * length)
        angle = functions.solve.map(len(places))(guess[None, :], arguments)
        return {
            name: np.asarray(row).ravel() for name, row in zip(OUTPUTS, functions.state(angle, arguments), strict=True)
        }

    return table


@pytest.fixture(scope="session")
def explicit(values: ParameterValues) -> StateTable:
    """States of a given radial ground force by the closed form, with the margins of their existence."""
    p = parameters_of(values.structure)
    model, place, force = Model(p), [ca.SX.sym(name) for name in POSITION_ARGUMENTS], ca.SX.sym("force")
    length, elevation, azimuth, course, lift, kite_drag = place
    position = Position(length, radians(elevation), radians(azimuth), Course.of_angle(radians(course)))
    around = model.conditions(position, Coefficients(lift, kite_drag))
    form = inflow_angle_at_force(model, position, around, force)
    margins = [form.crosswind_margin, form.drag_angle_margin, form.forward_margin, form.radial_margin]
    named = outputs_of(explicit_state(model, position, around, force))
    named |= {"weight_along": around.weight_along, "margin": ca.mmin(ca.vertcat(*margins))}
    function = ca.Function("explicit", [ca.vertcat(p.vector, *place, force)], [ca.vertcat(*named.values())])

    def table(values: ParameterValues, places: np.ndarray, given: np.ndarray) -> dict[str, np.ndarray]:
        rows = np.asarray(function.map(len(places))(columns(values, places, given)))
        return dict(zip(named, rows, strict=True))

    return table


@pytest.fixture(scope="session")
def flying_down(values: ParameterValues) -> StateTable:
    """Radial ground force by the closed Newton form at a reeling speed, straight down in the plane of the wind."""
    p = parameters_of(values.structure)
    model, place, speed = Model(p), [ca.SX.sym(name) for name in POSITION_ARGUMENTS], ca.SX.sym("speed")
    length, elevation, _, _, lift, kite_drag = place
    around = model.conditions(Position(length, radians(elevation), 0.0, DOWN), Coefficients(lift, kite_drag))
    force = radial_ground_force_flying_down(model, around, speed)
    function = ca.Function("down", [ca.vertcat(p.vector, *place, speed)], [force])

    def table(values: ParameterValues, places: np.ndarray, given: np.ndarray) -> dict[str, np.ndarray]:
        return {"radial_ground_force": np.asarray(function.map(len(places))(columns(values, places, given))).ravel()}

    return table


@pytest.fixture(scope="session")
def iterated(values: ParameterValues) -> StateTable:
    """Kinematic ratio by the paper's fixed-point iteration, and its last step."""
    p = parameters_of(values.structure)
    model, place, f = Model(p), [ca.SX.sym(name) for name in POSITION_ARGUMENTS], ca.SX.sym("f")
    length, elevation, azimuth, course, lift, kite_drag = place
    position = Position(length, radians(elevation), radians(azimuth), Course.of_angle(radians(course)))
    around = model.conditions(position, Coefficients(lift, kite_drag))
    kappas = [paper_iteration(model, position, around, f, iterations=count) for count in (150, 151)]
    function = ca.Function("iterated", [ca.vertcat(p.vector, *place, f)], kappas)

    def table(values: ParameterValues, places: np.ndarray, given: np.ndarray) -> dict[str, np.ndarray]:
        before, after = (np.asarray(v).ravel() for v in function.map(len(places))(columns(values, places, given)))
        return {"kinematic_ratio": after, "step": np.abs(after - before)}

    return table
