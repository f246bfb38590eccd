"""The simulated phases beside the tables of van der Vlugt et al. (2019), strong and moderate wind.

The tables cannot be hit from the rounded inputs that were published, and nothing is tuned to them (model-notes.md). The
bands below are what was measured, rounded up: powers and durations of retraction, traction and cycle 5 to 17 % away.
Of that the rounding of the inputs alone explains 5 to 15 %, as a test here shows. Outside it lies the transition, whose
published power is 1.4 to 4.9 times as large. It takes stroke from the traction, which is why the duration of traction
differs by up to 32 %, while the energy of both together agrees to 8 %.
"""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Simulated

import kiteocp
from kiteocp.cycle.simulation import fly
from kiteocp.physics.parameters import ParameterValues, parameter_values

#: Mean power in kW and duration in s of retraction, transition, traction and cycle (tab:results_highwind, _lowwind).
PAPER = {
    ("strong-wind", False): ((-2.46, 103), (17.90, 8), (24.72, 36), (5.37, 148)),
    ("strong-wind", True): ((-4.03, 60), (23.67, 7), (22.57, 38), (7.59, 106)),
    ("moderate-wind", False): ((-1.73, 66), (5.08, 14), (9.20, 42), (2.84, 123)),
    ("moderate-wind", True): ((-2.73, 40), (8.11, 10), (7.67, 49), (3.55, 101)),
}

CASES = pytest.mark.parametrize(("name", "gravity"), PAPER)


@CASES
def test_against_paper_powers_and_durations(simulated: Simulated, name: str, gravity: bool) -> None:
    result = simulated(name, gravity)
    retraction, _, traction, cycle = PAPER[name, gravity]
    assert result.phases["retraction"]["mean_power_W"] == pytest.approx(1e3 * retraction[0], rel=0.17)
    assert result.phases["retraction"]["duration_s"] == pytest.approx(retraction[1], rel=0.17)
    assert result.phases["traction"]["mean_power_W"] == pytest.approx(1e3 * traction[0], rel=0.09)
    assert result.phases["traction"]["duration_s"] == pytest.approx(traction[1], rel=0.32)
    assert result.cycle["mean_power_W"] == pytest.approx(1e3 * cycle[0], rel=0.17)
    assert result.cycle["duration_s"] == pytest.approx(cycle[1], rel=0.14)


@CASES
def test_against_paper_transition_and_traction_together(simulated: Simulated, name: str, gravity: bool) -> None:
    """What the transition leaves of the stroke the traction uses: their energies add up."""
    result = simulated(name, gravity)
    _, transition, traction, _ = PAPER[name, gravity]
    energy = result.phases["transition"]["energy_J"] + result.phases["traction"]["energy_J"]
    assert energy == pytest.approx(1e3 * (transition[0] * transition[1] + traction[0] * traction[1]), rel=0.08)


@CASES
def test_against_paper_transition_lies_outside(simulated: Simulated, name: str, gravity: bool) -> None:
    """Short, and weaker than published throughout: said plainly rather than tuned away."""
    result = simulated(name, gravity)
    _, (power, duration), _, _ = PAPER[name, gravity]
    assert 1.4 < 1e3 * power / result.phases["transition"]["mean_power_W"] < 4.9
    assert result.phases["transition"]["duration_s"] == pytest.approx(duration, abs=2)


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind"])
def test_against_paper_gravity_pulls_the_same_way(simulated: Simulated, name: str) -> None:
    """With gravity the retraction is shorter and costs more power, the traction gives less, the cycle more."""
    without, included = simulated(name, False), simulated(name, True)
    for phase, less in (("retraction", True), ("transition", False), ("traction", True)):
        change = included.phases[phase]["mean_power_W"] - without.phases[phase]["mean_power_W"]
        assert (change < 0) == less, phase
        assert (PAPER[name, True][list(included.phases).index(phase)][0] < PAPER[name, False][
            list(included.phases).index(phase)
        ][0]) == less  # fmt: skip
    assert included.cycle["mean_power_W"] > without.cycle["mean_power_W"]
    assert included.cycle["duration_s"] < without.cycle["duration_s"]


@pytest.mark.parametrize(("name", "published", "uncertainty"), [("strong-wind", 35, 12), ("moderate-wind", 33, 18)])
def test_against_paper_force_reference(simulated: Simulated, name: str, published: float, uncertainty: float) -> None:
    """Retraction energy over reeled length falls by about the tether's weight when gravity is included.

    That is what tells control of the force at the kite, as here, from control at the ground, where it would not fall at
    all. The uncertainty is that of the table: 0.5 s of the durations and 5 W of the powers.
    """
    stroke = kiteocp.load_problem(name).operation
    reeled = stroke.tether_length_max_m - stroke.tether_length_min_m

    def force(result: kiteocp.Result) -> float:
        return -result.phases["retraction"]["energy_J"] / reeled

    fall = force(simulated(name, False)) - force(simulated(name, True))
    assert fall == pytest.approx(published, abs=uncertainty)
    table = [-1e3 * PAPER[name, gravity][0][0] * PAPER[name, gravity][0][1] / reeled for gravity in (False, True)]
    assert table[0] - table[1] == pytest.approx(published, abs=1.0)
    ground = kiteocp.load_problem(name, {"operation.force_reference": "ground"})
    assert force(kiteocp.simulate(ground, gravity=False)) == pytest.approx(force(kiteocp.simulate(ground)), rel=1e-6)


#: Half a unit of the last published digit of each input of the strong case.
ROUNDING = {
    "environment.wind.reference_speed_m_s": 0.05,
    "environment.wind.roughness_length_m": 0.005,
    "kite.projected_area_m2": 0.05,
    "kite.mass_kg": 0.5,
    "kite.powered.lift_coefficient": 0.005,
    "kite.powered.lift_to_drag": 0.05,
    "kite.depowered.lift_coefficient": 0.005,
    "kite.depowered.lift_to_drag": 0.05,
    "operation.traction.elevation_deg": 0.05,
    "operation.traction.azimuth_deg": 0.05,
    "operation.traction.course_deg": 0.05,
    "operation.traction.tether_force_N": 0.5,
    "operation.retraction.tether_force_N": 0.5,
    "operation.tether_length_min_m": 0.5,
    "operation.tether_length_max_m": 0.5,
    "tether.drag_coefficient": 0.05,
}


def _durations_and_powers(values: ParameterValues) -> np.ndarray:
    flown = fly(values)
    energy, time = sum(p.energy_J for p in flown), sum(p.duration_s for p in flown)
    return np.array([flown[0].duration_s, flown[2].duration_s, energy / time])


def test_rounding_of_the_inputs_alone_moves_the_retraction_by_more_than_a_tenth(problem: kiteocp.Problem) -> None:
    """Reel-in speed is a small difference of large numbers: worst cases of all inputs added up, strong case.

    Measured 12 % of the retraction time, 8 % of the traction time and 7 % of the mean power.
    """
    values = parameter_values(problem)
    given, band = _durations_and_powers(values), np.zeros(3)
    for key, half in ROUNDING.items():
        moved = [_durations_and_powers(values.replaced({key: values[key] + sign * half})) for sign in (1, -1)]
        band += np.max(np.abs(np.array(moved) / given - 1), axis=0)
    assert np.all(band > [0.10, 0.06, 0.05])
    assert np.all(band < [0.15, 0.10, 0.09])
