"""Derivatives of the prescribed cycle against central differences of the simulation, and the band of rounding."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from kiteocp import load_problem, shipped_problems
from kiteocp.cli.main import main
from kiteocp.cycle.fast.tangent import QUANTITIES
from kiteocp.cycle.simulation import fly
from kiteocp.errors import InputError
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem
from kiteocp.studies.sensitivity.forward import ForwardSensitivity, forward_sensitivity, rounding_band

GRAVITY = "environment.gravity_m_s2"

#: Half units of the last digits that the paper gives.
HALF_UNITS = {
    "environment.wind.reference_speed_m_s": 0.05,
    "environment.wind.roughness_length_m": 0.005,
    "kite.projected_area_m2": 0.05,
    "kite.mass_kg": 0.05,
    "kite.powered.lift_coefficient": 0.005,
    "kite.powered.lift_to_drag": 0.05,
    "kite.depowered.lift_coefficient": 0.005,
    "kite.depowered.lift_to_drag": 0.05,
    "tether.drag_coefficient": 0.05,
    "operation.tether_length_min_m": 0.5,
    "operation.tether_length_max_m": 0.5,
    "operation.traction.elevation_deg": 0.05,
    "operation.traction.azimuth_deg": 0.05,
    "operation.traction.course_deg": 0.05,
    "operation.traction.tether_force_N": 0.5,
    "operation.retraction.tether_force_N": 0.5,
}


def flown(values: ParameterValues) -> np.ndarray:
    """`QUANTITIES`, from the simulation alone."""
    parts = [(phase.duration_s, phase.energy_J) for phase in fly(values)]
    parts.append((sum(time for time, _ in parts), sum(energy for _, energy in parts)))
    return np.array([number for time, energy in parts for number in (time, energy, energy / time)])


def richardson(values: ParameterValues, key: str) -> np.ndarray:
    """Central differences by 0.1 % and 0.05 % of a value, extrapolated; nothing taken from the derivatives."""
    value = values[key]

    def difference(share: float) -> np.ndarray:
        step = share * abs(value)
        return (flown(values.replaced({key: value + step})) - flown(values.replaced({key: value - step}))) / (2 * step)

    return (4 * difference(5e-4) - difference(1e-3)) / 3


@cache
def study_of(name: str, gravity: bool) -> tuple[ForwardSensitivity, ParameterValues]:
    problem = load_problem(name)
    return forward_sensitivity(problem, gravity=gravity), parameter_values(problem, gravity=gravity)


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("name", list(shipped_problems()))
def test_against_differences_of_the_simulation(name: str, gravity: bool) -> None:
    study, values = study_of(name, gravity)
    quantities = np.array(list(study.quantities.values()))
    assert quantities == pytest.approx(flown(values), rel=1e-12)
    felt = [key for key, column in zip(study.keys, study.jacobian.T, strict=True) if column.any()]
    assert len(felt) >= 18
    for key in felt:
        found, expected = study.jacobian[:, study.keys.index(key)], richardson(values, key)
        # The integration is good to some 1e-9 of a quantity, which a step of 0.05 % turns into some 1e-6 of it.
        noise = 2e-6 * np.abs(quantities) / abs(values[key])
        assert np.all(np.abs(found - expected) <= 1e-4 * np.abs(expected) + noise), key


@pytest.mark.parametrize("name", list(shipped_problems()))
def test_what_has_no_influence_shows_zero_and_not_noise(name: str) -> None:
    for gravity in (True, False):
        study, _ = study_of(name, gravity)
        # Without weight the forces on the kite do not depend on where it heads to.
        weights = () if gravity else (GRAVITY, "kite.mass_kg", "tether.density_kg_m3", "operation.traction.course_deg")
        silent = {key for key, column in zip(study.keys, study.jacobian.T, strict=True) if not column.any()}
        unused = {key for key in study.keys if key.startswith(("limits.", "machine.", "operation.turn."))}
        assert silent == {*unused, *weights}
        # The depowered retraction knows nothing of the kite's powered coefficients.
        for quantity in ("duration_s", "energy_J", "mean_power_W"):
            assert study.derivative(f"retraction.{quantity}", "kite.powered.lift_coefficient") == 0.0


def test_a_kite_without_weight_has_a_derivative_to_gravity_on_one_side() -> None:
    problem = load_problem("moderate-wind", {GRAVITY: 0.0})
    study, values = forward_sensitivity(problem), parameter_values(problem)
    step = 1e-2
    at, after, far = (flown(values.replaced({GRAVITY: factor * step})) for factor in (0.0, 1.0, 2.0))
    found = study.jacobian[:, study.keys.index(GRAVITY)]
    # One-sided differences of second order: what they leave is some 1e-6.
    assert found == pytest.approx((-3 * at + 4 * after - far) / (2 * step), rel=1e-5)


def test_defaults_that_follow_a_key_are_carried_along() -> None:
    given = load_problem("strong-wind")
    problem = given.with_values({"operation.traction.tether_force_N": None})
    key = "limits.tether_force_max_N"
    derivative = forward_sensitivity(problem).derivative("cycle.mean_power_W", key)
    ends = [
        flown(parameter_values(problem.with_values({key: 3008.0 + sign * 3.0})))[QUANTITIES.index("cycle.mean_power_W")]
        for sign in (1, -1)
    ]
    assert derivative == pytest.approx((ends[0] - ends[1]) / 6.0, rel=1e-4)
    assert forward_sensitivity(given).derivative("cycle.mean_power_W", key) == 0.0


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind"])
def test_rounding_band_against_simulation_at_perturbed_inputs(name: str, gravity: bool) -> None:
    problem = load_problem(name)
    study, values = study_of(name, gravity)
    band = rounding_band(problem, HALF_UNITS, gravity=gravity)
    assert tuple(band) == QUANTITIES
    nominal = flown(values)
    columns = [study.keys.index(key) for key in HALF_UNITS]
    halves = np.array(list(HALF_UNITS.values()))
    worst, root = np.array(list(band.values())).T
    assert np.all(root <= worst)

    def moved(shifts: np.ndarray) -> np.ndarray:
        return (
            flown(values.replaced({key: values[key] + s for key, s in zip(HALF_UNITS, shifts, strict=True)})) - nominal
        )

    # The corner where all roundings raise a quantity, and the opposite one: half of their difference is the band but
    # for the third order (2.1 % of it at most, for the duration of the weightless retraction, which the band moves by
    # 15 %); a single corner misses the second order as well (16 % of the band for the same).
    for row in range(len(QUANTITIES)):
        corner = np.sign(study.jacobian[row, columns]) * halves
        high, low = moved(corner)[row], moved(-corner)[row]
        assert (high - low) / 2 == pytest.approx(worst[row], rel=0.03)
        assert high == pytest.approx(worst[row], rel=0.2)
        assert low == pytest.approx(-worst[row], rel=0.2)
    # Rounding errors at random: their standard deviation is the root of the sum of squares over the root of 3, and
    # none of the samples comes near the worst case.
    random = np.random.default_rng(4)
    samples = np.array([moved(random.uniform(-halves, halves)) for _ in range(400)])
    assert np.all(np.abs(samples) <= worst)
    # 400 samples know a standard deviation to 3.5 %; three times that, and the second order.
    assert np.sqrt((samples**2).mean(axis=0)) == pytest.approx(root / np.sqrt(3), rel=0.12)


def test_rounding_band_of_one_key_is_its_derivative() -> None:
    problem, key = load_problem("strong-wind"), "kite.mass_kg"
    study, _ = study_of("strong-wind", True)
    expected = abs(study.derivative("cycle.mean_power_W", key)) * 0.5
    assert rounding_band(problem, {key: 0.5})["cycle.mean_power_W"] == pytest.approx((expected, expected))
    assert rounding_band(problem, {})["cycle.mean_power_W"] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("half_units", "expected"),
    [
        ({"kite.mas_kg": 0.5}, "kite.mas_kg is no number of the problem"),
        ({"kite.mass_kg": -0.5}, "half unit of kite.mass_kg is -0.5"),
        ({"kite.mass_kg": float("nan")}, "half unit of kite.mass_kg is nan"),
    ],
)
def test_mistakes_in_half_units_are_one_sentence(half_units: dict[str, float], expected: str) -> None:
    problem: Problem = load_problem("strong-wind")
    with pytest.raises(InputError, match=expected):
        rounding_band(problem, half_units)


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sensitivity", "strong-wind", "--no-intervals", "--no-plot", "--simulate", "-o", str(tmp_path)]
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "prescribed cycle: mean power" in out
    summary = json.loads((tmp_path / "summary.json").read_text())
    study, _ = study_of("strong-wind", True)
    assert summary["forward_cycle"]["cycle"]["mean_power_W"] == study.quantities["cycle.mean_power_W"]
    rows = {row["key"]: row for row in summary["forward_sensitivities"]}
    assert tuple(rows) == study.keys
    row = rows["environment.wind.reference_speed_m_s"]
    assert (row["value"], row["unit"]) == (9.9, "m/s")
    assert row["derivative"] == row["cycle"]["mean_power_W"]
    assert row["elasticity"] == pytest.approx(row["derivative"] * 9.9 / study.quantities["cycle.mean_power_W"])
    assert row["retraction"]["duration_s"] == study.derivative("retraction.duration_s", row["key"])


def test_a_prescribed_cycle_that_cannot_be_flown_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sensitivity", "strong-wind", "--no-intervals", "--no-plot", "--simulate", "-o", str(tmp_path)]
    # More force than the kite can hold in reel-out; the optimum does not use it.
    assert main([*words, "--set", "operation.traction.tether_force_N=30000"]) == 1
    out, err = capsys.readouterr()
    assert "optimal mean power" in out
    assert "the prescribed cycle cannot be flown" in err
    assert err.count("\n") == 1
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["sensitivities"]
    assert summary["forward_cycle"] is None
    assert summary["forward_sensitivities"] == []
