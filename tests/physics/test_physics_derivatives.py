"""Derivatives of the solved states, through the rootfinder, against central differences of the solved states.

Central differences over 1e-5 of a quantity err by 1e-10 (truncation) and 1e-12 / 1e-5 (rounding of the root): 1e-6 of
the largest sensitivity in a row leaves room.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from kiteocp.physics.equilibrium import OUTPUTS, equilibrium_functions
from kiteocp.physics.flight import OperatingPoint
from kiteocp.physics.parameters import ParameterValues

CASES = [
    ("tether_force_kite", OperatingPoint(500.0, 35.0, 12.0, 101.0, 0.69, 0.17), 3008.0),
    ("tether_force_ground", OperatingPoint(300.0, 60.0, -20.0, 170.0, 0.3, 0.07), 900.0),
    ("radial_ground_force", OperatingPoint(700.0, 25.0, 5.0, 30.0, 0.69, 0.17), 1500.0),
    ("reeling_speed", OperatingPoint(450.0, 40.0, 10.0, 95.0, 0.69, 0.17), 4.0),
    ("reeling_factor", OperatingPoint(450.0, 50.0, -15.0, 200.0, 0.2, 0.06), -0.3),
]


@pytest.mark.parametrize(("control", "place", "value"), CASES)
def test_state_derivatives(values: ParameterValues, control: str, place: OperatingPoint, value: float) -> None:
    """With respect to all numbers of the problem file, place, course, coefficients and control."""
    functions = equilibrium_functions(values.structure, control)
    arguments = ca.MX.sym("arguments", functions.solve.size1_in(1))
    named = functions.state(functions.solve(1.2, arguments), arguments)
    # The residual is zero at every state: its derivatives say nothing.
    quantities = [i for i, name in enumerate(OUTPUTS) if name != "residual"]
    state = ca.Function("state", [arguments], [ca.vertcat(*named)[quantities]])
    jacobian = ca.Function("jacobian", [arguments], [ca.jacobian(state(arguments), arguments)])
    point = np.concatenate([values.vector, place.vector(), [value]])
    exact = np.asarray(ca.densify(jacobian(point)))
    step = 1e-5 * np.maximum(np.abs(point), 1e-2)
    moved = point[:, None] + np.hstack([np.diag(step), -np.diag(step)])
    ends = np.asarray(state.map(moved.shape[1])(moved))
    differences = (ends[:, : point.size] - ends[:, point.size :]) / (2 * step)
    # Per relative change of the argument, over the size of the quantity: rows and columns of like numbers.
    sizes = np.maximum(np.abs(np.asarray(state(point))), 1e-2)
    relative = step / 1e-5 / sizes
    assert_allclose(exact * relative, differences * relative, atol=1e-6 * np.abs(exact * relative).max())
    # What should matter does: wind, area, mass, gravity, the place and the control.
    matters = [values.structure.keys.index(f"kite.{name}") for name in ("projected_area_m2", "mass_kg")]
    matters += [values.structure.keys.index("environment.gravity_m_s2"), point.size - 1]
    assert np.all(np.abs(exact * relative)[:, matters].max(axis=0) > 1e-3)
