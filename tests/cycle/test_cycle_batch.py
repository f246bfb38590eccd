"""Many cycles at once against the adaptive integrator, one by one; the cycle function and its derivatives."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import kiteocp
from kiteocp.cycle.fast.cycle_function import COARSE, FINE, OUTPUT_NAMES, cycle_function
from kiteocp.cycle.laws import phase_functions
from kiteocp.cycle.phases import PHASES, FlownPhase
from kiteocp.cycle.simulation import fly
from kiteocp.cycle.transition import transition_branches
from kiteocp.errors import CycleError, InputError
from kiteocp.numerics.vectorised import COLUMNS, VectorisedFunction
from kiteocp.physics.parameters import ParameterValues, parameter_values

SHIPPED = ("strong-wind", "moderate-wind", "v3-kite")

#: Numbers that are varied: all that move the cycle, but angles across the wind.
VARIED = (
    "environment.wind.reference_speed_m_s",
    "kite.projected_area_m2",
    "kite.mass_kg",
    "kite.powered.lift_coefficient",
    "kite.depowered.lift_coefficient",
    "tether.diameter_m",
    "operation.tether_length_min_m",
    "operation.tether_length_max_m",
    "operation.traction.elevation_deg",
    "operation.traction.tether_force_N",
    "operation.retraction.tether_force_N",
)


def values_of(name: str) -> ParameterValues:
    return parameter_values(kiteocp.load_problem(name))


def varied(values: ParameterValues, spread: float, count: int, seed: int) -> dict[str, np.ndarray]:
    factors = np.random.default_rng(seed).uniform(1 - spread, 1 + spread, (len(VARIED), count))
    drawn = {key: values[key] * row for key, row in zip(VARIED, factors, strict=True)}
    # A contradiction is refused, as in a file.
    shortest, longest = "operation.tether_length_min_m", "operation.tether_length_max_m"
    drawn[shortest], drawn[longest] = np.sort([drawn[shortest], drawn[longest]], axis=0)
    return drawn


def flown_or_not(values: ParameterValues) -> tuple[list[FlownPhase], tuple[str, str]]:
    """Return the phases, or the reason and the phase of the failure."""
    try:
        return fly(values), ("", "")
    except CycleError as error:
        return [], (error.reason, error.phase)


def check_against_fly(values: ParameterValues, parameters: dict[str, np.ndarray]) -> kiteocp.BatchResult:
    """Durations, energies and mean powers to 1e-4; a failed cycle fails for the same reason.

    The transition's energy is a small difference of reeling in and out: to 1e-4 of what the traction delivers.
    """
    batch = kiteocp.simulate_batch(values, parameters)
    for index in range(batch.route.size):
        one = values.replaced({key: float(column[index]) for key, column in parameters.items()})
        flown, failure = flown_or_not(one)
        assert (batch.reason[index], batch.failed_phase[index]) == failure
        if not flown:
            assert np.isnan(batch.cycle["mean_power_W"][index])
            continue
        for phase in flown:
            numbers = {quantity: column[index] for quantity, column in batch.phases[phase.name].items()}
            slack = 1e-4 * abs(flown[2].energy_J) if phase.name == "transition" else 0.0
            assert numbers["duration_s"] == pytest.approx(phase.duration_s, rel=1e-4)
            assert numbers["energy_J"] == pytest.approx(phase.energy_J, rel=1e-4, abs=slack)
            power = numbers["energy_J"] / numbers["duration_s"]
            assert numbers["mean_power_W"] == pytest.approx(power, rel=1e-12)
        duration, energy = sum(p.duration_s for p in flown), sum(p.energy_J for p in flown)
        assert batch.cycle["duration_s"][index] == pytest.approx(duration, rel=1e-4)
        assert batch.cycle["mean_power_W"][index] == pytest.approx(energy / duration, rel=1e-3, abs=1.0)
    return batch


@settings(max_examples=20, deadline=None)
@given(
    name=st.sampled_from(SHIPPED),
    spread=st.sampled_from([0.05, 0.15, 0.3]),
    seed=st.integers(0, 10000),
)
def test_against_the_adaptive_integrator(name: str, spread: float, seed: int) -> None:
    values = values_of(name)
    check_against_fly(values, varied(values, spread, 8, seed))


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_problems(name: str, gravity: bool) -> None:
    """One problem, weight or none, by all three routes: what `simulate` says, to 1e-4."""
    problem = kiteocp.load_problem(name)
    result = kiteocp.simulate(problem, gravity=gravity)
    batch = kiteocp.simulate_batch(problem, {}, gravity=gravity)
    for phase in PHASES:
        for quantity in ("duration_s", "mean_power_W"):
            expected = result.phases[phase][quantity]
            assert batch.phases[phase][quantity][0] == pytest.approx(expected, rel=1e-4), (phase, quantity)
    for mesh in (COARSE, FINE):
        outputs = cycle_function(parameter_values(problem).structure, mesh)(
            parameter_values(problem, gravity=gravity).vector
        )
        power = float(outputs[OUTPUT_NAMES.index("cycle_mean_power_W")])
        # Without weight the retraction starts near rest or reels out: the coarse steps are good to some 1e-3 there.
        assert power == pytest.approx(result.cycle["mean_power_W"], rel=1e-4 if gravity or mesh is FINE else 5e-3)


def test_nearly_all_take_the_coarse_steps() -> None:
    """What makes a batch fast: near a problem the fixed steps do, without a timed test."""
    for name in SHIPPED:
        values = values_of(name)
        batch = kiteocp.simulate_batch(values, varied(values, 0.05, 400, 1))
        assert batch.flown.all()
        assert np.mean(batch.route == "coarse") > 0.9


def test_impossible_cycles_say_why() -> None:
    """From calm to storm: a batch has the reasons of the single simulations, and every route is taken."""
    values = values_of("strong-wind")
    routes = set()
    for elevation in (27.0, 60.0):
        speeds = np.array([2.0, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0])
        one = values.replaced({"operation.traction.elevation_deg": elevation})
        batch = check_against_fly(one, {"environment.wind.reference_speed_m_s": speeds})
        routes |= set(batch.route)
        assert not batch.flown[0]
        assert batch.reason[0] in ("too_heavy", "falling", "force_too_high", "slack", "domain")
    assert {"coarse", "adaptive"} <= routes


def test_numpy_does_what_casadi_does() -> None:
    """The operations of the cycle function by NumPy and by CasADi, over a full block and a rest.

    NumPy's sines and logarithms may differ in the last bit.
    """
    values = values_of("moderate-wind")
    function = cycle_function(values.structure)
    count = COLUMNS + 3
    table = values.vector[:, None] * np.random.default_rng(2).uniform(0.97, 1.03, (values.vector.size, count))
    expected = np.array([np.asarray(output).ravel() for output in function.map(count)(table)])
    found = VectorisedFunction(function)(table)
    estimate = OUTPUT_NAMES.index("error_estimate")
    assert_allclose(np.delete(found, estimate, 0), np.delete(expected, estimate, 0), rtol=1e-10)
    # The estimate is a difference of nearly equal numbers.
    assert_allclose(found[estimate], expected[estimate], rtol=1e-4, atol=1e-9)


def test_an_unknown_operation_is_refused() -> None:
    x = ca.SX.sym("x", 1)
    with pytest.raises(NotImplementedError, match="of CasADi"):
        VectorisedFunction(ca.Function("error_function", [x], [ca.erf(x)]))


@pytest.mark.parametrize("name", SHIPPED)
def test_derivatives_against_finite_differences(name: str) -> None:
    """The Jacobian of durations and energies against central differences of the adaptive integrator.

    Kinks are located to 1e-3 and count as constant, which leaves derivatives of the transition an error of that size;
    all others are as good as the steps. The scale is what all parameters together do to an output.
    """
    values = values_of(name)
    p = ca.SX.sym("p", values.vector.size)
    names = [f"{phase}_{quantity}" for phase in PHASES for quantity in ("duration_s", "energy_J")]
    outputs = cycle_function(values.structure)(p)
    rows = ca.vertcat(*(outputs[OUTPUT_NAMES.index(row)] for row in names))
    jacobian = np.asarray(ca.Function("jacobian", [p], [ca.jacobian(rows, p)])(values.vector))
    for key in VARIED:
        step = 1e-4 * values[key]
        sides = [
            np.ravel([(phase.duration_s, phase.energy_J) for phase in fly(values.replaced({key: values[key] + side}))])
            for side in (step, -step)
        ]
        difference = (sides[0] - sides[1]) / (2 * step)
        column = jacobian[:, values.structure.keys.index(key)]
        scale = np.abs(np.ravel([(phase.duration_s, phase.energy_J) for phase in fly(values)])) / values[key]
        assert_allclose(column / scale, difference / scale, rtol=3e-3, atol=1e-3, err_msg=key)


def test_branches_are_the_law() -> None:
    """At any place of a transition one branch holds, and its rates are those of the clipped law."""
    values = values_of("moderate-wind")
    law, branches = phase_functions(values.structure, "transition").rates, transition_branches(values.structure)
    met = set()
    for length, degrees in itertools.product((180.0, 234.0, 380.0), np.linspace(20, 100, 23)):
        state = np.array([0.0, length, np.radians(degrees), 0.0])
        branch = int(np.sum(np.asarray(branches.thresholds(state, values.vector)) > 0))
        met.add(branch)
        assert_allclose(branches.rates[branch](state, values.vector), law(state, values.vector), rtol=1e-10, atol=1e-9)
    assert met == {0, 1, 2}


@pytest.mark.parametrize("name", SHIPPED)
def test_few_steps(name: str) -> None:
    """Order 8 and steps from kink to kink: some 20 steps a cycle at 1e-9 (order 5 over the kinks takes some 70)."""
    assert sum(len(phase.states) - 1 for phase in fly(values_of(name))) <= 30


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"kite.mas_kg": [1.0]}, "did you mean kite.mass_kg"),
        ({"nothing": [1.0]}, "give a key path"),
        ({"kite.mass_kg": ["a"]}, "give a list of numbers"),
        ({"kite.mass_kg": [15.0, np.nan]}, "finite numbers"),
        ({"kite.mass_kg": []}, "finite numbers"),
        ({"kite.mass_kg": [[15.0]]}, "finite numbers"),
        ({"kite.mass_kg": [15.0, 16.0], "tether.diameter_m": [0.004] * 3}, "others have 3"),
    ],
)
def test_bad_parameters(problem: kiteocp.Problem, parameters: dict[str, list[float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kiteocp.simulate_batch(problem, parameters)


def test_one_value_serves_all(problem: kiteocp.Problem) -> None:
    batch = kiteocp.simulate_batch(problem, {"kite.mass_kg": 20.0, "tether.diameter_m": [0.004, 0.005]})
    other = kiteocp.simulate_batch(problem.with_values({"kite.mass_kg": 20.0}), {"tether.diameter_m": [0.004, 0.005]})
    assert batch.route.shape == (2,)
    assert_array_equal(batch.cycle["mean_power_W"], other.cycle["mean_power_W"])


def test_weightless_values_are_made_from_a_problem(problem: kiteocp.Problem) -> None:
    with pytest.raises(InputError, match=r"environment\.gravity_m_s2"):
        kiteocp.simulate_batch(parameter_values(problem), {}, gravity=False)
