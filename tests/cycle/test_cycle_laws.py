"""Rates of the prescribed cycle: derivatives, and the same law by both routes to the equilibrium."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import kiteocp
from kiteocp.cycle.laws import phase_functions
from kiteocp.cycle.phases import PHASES, PhaseName
from kiteocp.physics.equilibrium import OUTPUTS
from kiteocp.physics.parameters import parameter_values

#: States (time, length, elevation, energy); in the transition slack, at rest and reeling out.
STATES = [
    ("retraction", [0.0, 350.0, 0.9, 0.0]),
    ("transition", [0.0, 232.0, 1.4, 0.0]),
    ("transition", [0.0, 230.0, 1.1, 0.0]),
    ("transition", [0.0, 230.0, 0.7, 0.0]),
    ("traction", [0.0, 300.0, 0.47, 0.0]),
]


@pytest.mark.parametrize(("phase", "state"), STATES)
def test_derivatives_of_the_rates(phase: PhaseName, state: list[float]) -> None:
    """With respect to state and all numbers of the file, against central differences.

    These err by about 1e-9 of the rate per relative change of an argument; 1e-6 of the largest leaves room.
    """
    values = parameter_values(kiteocp.load_problem("moderate-wind"))
    rates = phase_functions(values.structure, phase).rates
    x = ca.MX.sym("x", len(state) + values.vector.size)
    arguments = ca.vertsplit(x, [0, len(state), x.size1()])
    function = ca.Function("f", [x], [rates(*arguments)])
    exact = np.asarray(ca.Function("j", [x], [ca.jacobian(function(x), x)])(np.concatenate([state, values.vector])))
    point = np.concatenate([state, values.vector])
    step = 1e-6 * np.maximum(np.abs(point), 1e-2)
    moved = point[:, None] + np.hstack([np.diag(step), -np.diag(step)])
    ends = np.asarray(function.map(moved.shape[1])(moved))
    differences = (ends[:, : point.size] - ends[:, point.size :]) / (2 * step)
    # Speed and power may be zero, up to rounding: sizes that count are 0.01 m/s, 0.01 rad/s and 100 W.
    sizes = np.maximum(np.abs(np.asarray(function(point))), np.array([[1.0], [1e-2], [1e-2], [1e2]]))
    relative = step / 1e-6 / sizes
    assert_allclose(exact * relative, differences * relative, atol=1e-6 * np.abs(exact * relative).max())


@pytest.mark.parametrize("reference", ["kite", "ground"])
@pytest.mark.parametrize("phase", PHASES)
def test_both_routes_over_the_places_of_a_cycle(problem: kiteocp.Problem, phase: PhaseName, reference: str) -> None:
    """All outputs by rootfinder and closed form: 1e-8 of each; the residual, which is zero, to 1e-12."""
    values = parameter_values(problem.with_values({"operation.force_reference": reference}))
    rng = np.random.default_rng(7)
    states = np.vstack([np.zeros(300), rng.uniform(380, 730, 300), rng.uniform(0.45, 1.15, 300), np.zeros(300)])
    explicit, root = (
        np.asarray(phase_functions(values.structure, phase, route).outputs.map(300)(states, values.vector))
        for route in ("explicit", "rootfinder")
    )
    assert np.isfinite(explicit).all()
    for name, one, other in zip(OUTPUTS, explicit, root, strict=True):
        scale = max(1.0, float(np.abs(one).max()))
        assert_allclose(one / scale, other / scale, atol=1e-12 if name == "residual" else 1e-8, rtol=0, err_msg=name)
