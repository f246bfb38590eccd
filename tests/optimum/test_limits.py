"""Every bound that can shape an optimum is a key of the problem file, named where it is active or in conflict."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiteocp import simulate, simulate_batch
from kiteocp.cycle.limits import limits_of
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.errors import CycleError, InfeasibleError
from kiteocp.optimum.program import Formulation, cycle_program
from kiteocp.optimum.refine import optimise
from kiteocp.optimum.solve import solve
from kiteocp.physics.equilibrium import OUTPUTS
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem, load_problem
from kiteocp.studies.sensitivity.derivatives import LocalStudy
from kiteocp.studies.sensitivity.local import sensitivities

#: A kite for which a short transition is best; the case of ../shared/cases/short-transition.yaml.
SHORT_TRANSITION = """
name: short-transition
environment:
  wind: {profile: logarithmic, reference_speed_m_s: 14.4654, reference_height_m: 150, roughness_length_m: 0.03}
kite:
  projected_area_m2: 73.122
  mass_kg: 42.747
  powered: {lift_coefficient: 0.88576, drag_coefficient: 0.19655}
  depowered: {lift_coefficient: 0.16522, drag_coefficient: 0.14058}
tether: {diameter_m: 0.016315, density_kg_m3: 724, drag_coefficient: 1.1}
operation:
  force_reference: ground
  tether_length_min_m: 205
  tether_length_max_m: 280
  traction: {elevation_deg: 35, azimuth_deg: 15, course_deg: 95, tether_force_N: 14000}
  retraction: {tether_force_N: 3000}
limits:
  tether_force_min_N: 1870.9
  tether_force_max_N: 29419.3
  tether_force_max_at: ground
  reel_in_speed_max_m_s: 8
  reel_out_speed_max_m_s: 6
  generator_power_max_W: 100000
  height_min_m: 80
  height_max_m: 350
  traction_elevation_min_deg: 25
  traction_duration_min_s: 79.303
"""

#: Reels out so slowly that its traction takes longer than an hour.
SLOW = {
    "limits.reel_out_speed_max_m_s": 0.1,
    "limits.stroke_min_m": 370.0,
    "operation.tether_length_max_m": 600.0,
}


@pytest.fixture
def short_transition(tmp_path: Path) -> Problem:
    path = tmp_path / "short-transition.yaml"
    path.write_text(SHORT_TRANSITION)
    return load_problem(str(path))


@pytest.mark.parametrize("equilibrium", ["implicit", "explicit"])
@pytest.mark.parametrize(
    ("elevation", "setting"),
    [("constant", "fixed"), ("linear", "fixed"), ("free", "traction"), ("course-coupled", "all")],
)
def test_no_bound_of_the_program_is_a_number_that_no_key_gives(equilibrium: str, elevation: str, setting: str) -> None:
    problem = load_problem(
        "v3-kite",
        {
            "optimisation.equilibrium": equilibrium,
            "optimisation.traction_elevation": elevation,
            "optimisation.power_setting": setting,
            "optimisation.speed_jumps": "limited",
            "limits.stroke_min_m": 50.0,
        },
    )
    values = parameter_values(problem)
    program = cycle_program(values.structure, Formulation.of(problem))
    lower_x, upper_x, lower_g, upper_g = (ca.SX(side) for side in program.bounds(program.p))
    hidden = set()
    for labels, lower, upper in (
        (program.variables, lower_x, upper_x),
        (program.rows, lower_g, upper_g),
    ):
        for index, label in enumerate(labels):
            sides = (lower[index], upper[index])
            constant = [float(side) for side in sides if side.is_constant()]
            # An equation of the model or a link has the same constant on both sides.
            if len(constant) == 2 and constant[0] == constant[1]:
                continue
            # The lowest height is not below the ground, and so implies that the elevation is not negative.
            hidden |= {(label.name, side) for side in constant if np.isfinite(side)} - {("elevation", 0.0)}
    assert not hidden


def test_every_key_of_the_limits_is_in_the_table() -> None:
    problem = load_problem("v3-kite", {"limits.generator_power_max_W": 2e4, "limits.motor_power_max_W": 1e4, **SLOW})
    structure = parameter_values(problem).structure
    keys = {key for key in structure.keys if key.startswith("limits.")}
    # The one is no bound, the other that of a phase that is not flown.
    apart = {"limits.phase_change_time_s", "limits.turn_duration_min_s"}
    assert {limit.key for limit in limits_of(structure)} == keys - apart


def test_a_transition_at_its_shortest_is_an_active_limit_with_a_price(short_transition: Problem) -> None:
    result = solve(short_transition)
    key = "limits.transition_duration_min_s"
    assert result.status == "certified"
    assert result.phases["transition"]["duration_s"] == pytest.approx(0.2, rel=1e-6)
    assert key in [entry["limit"] for entry in result.details["active_limits"]["transition"]]
    free = solve(short_transition.with_values({key: 0.01}))
    # The audit of the case found 0.58 % free of the bound.
    assert free.cycle["mean_power_W"] / result.cycle["mean_power_W"] - 1 == pytest.approx(0.0058, abs=0.0003)


def test_an_optimum_so_flat_that_the_barrier_hides_its_limits_has_prices(short_transition: Problem) -> None:
    """The multipliers of the force in 0.2 s of transition are 1e-6: as small as the slacks that the barrier leaves."""
    result = sensitivities(short_transition, intervals=False)
    prices = {row["key"]: row for row in result.details["shadow_prices"]}
    slope = prices["limits.transition_duration_min_s"]["derivative"]
    powers = [
        optimise(short_transition.with_values({"limits.transition_duration_min_s": value})).mean_power_W
        for value in (0.19, 0.21)
    ]
    # The powers are known to 1e-8 of themselves on one mesh, and the slope is that of the finest.
    assert slope == pytest.approx((powers[1] - powers[0]) / 0.02, rel=1e-2)


def test_the_price_of_a_shortest_phase_is_said() -> None:
    key = "limits.transition_duration_min_s"
    result = sensitivities(load_problem("v3-kite", {key: 10.0}), intervals=False)
    prices = {row["key"]: row for row in result.details["shadow_prices"]}
    assert prices[key]["derivative"] < 0
    assert prices[key]["text"].startswith("1 s more minimum duration of the transition costs ")


def test_a_phase_that_takes_longer_than_allowed_is_a_conflict_that_names_the_key() -> None:
    problem = load_problem("v3-kite", SLOW)
    with pytest.raises(InfeasibleError) as caught:
        solve(problem)
    entry = next(
        entry for entry in caught.value.explanation["conflict"] if entry["key"] == "limits.phase_duration_max_s"
    )
    # 370 m at 0.1 m/s.
    assert entry["needed"] == pytest.approx(3700.0, rel=1e-3)
    assert "finish each phase within 3600 s" in str(caught.value)
    assert solve(problem.with_values({"limits.phase_duration_max_s": 4000.0}), certificate="quick").phases["traction"][
        "duration_s"
    ] == pytest.approx(3700.0, rel=0.01)


@pytest.mark.parametrize(
    ("key", "value", "choices"),
    [
        ("limits.kinematic_ratio_max", 4.8, {}),
        ("limits.phase_duration_max_s", 60.0, {}),
        ("limits.retraction_duration_min_s", 51.0, {}),
        ("limits.transition_duration_min_s", 10.0, {}),
        ("limits.traction_course_max_deg", 101.0, {"optimisation.traction_elevation": "course-coupled"}),
        ("limits.power_setting_max", 0.9, {"optimisation.power_setting": "traction"}),
    ],
)
def test_a_bound_that_shapes_the_optimum_bears_a_price_and_the_price_is_its_slope(
    key: str, value: float, choices: dict[str, str]
) -> None:
    problem = load_problem("v3-kite", {**choices, key: value})
    study = LocalStudy.of(optimise(problem, certificate="quick"))
    column = study.keys.index(key)
    slope, step = study.gradient[column], 1e-4 * value
    above, below = study.power_at(column, step), study.power_at(column, -step)
    assert abs(slope) > 0.1
    assert above is not None
    assert below is not None
    # IPOPT's tolerance is 1e-8 of the power: 1e-4 W over a step of 1e-4 of the value.
    assert slope == pytest.approx((above - below) / (2 * step), rel=0.02, abs=2.0 / value)


@pytest.mark.parametrize(
    ("low", "high", "value"),
    [
        ("traction_elevation_min_deg", "traction_elevation_max_deg", 25.0),
        ("phase_duration_max_s", "traction_duration_min_s", 55.0),
    ],
)
def test_equal_bounds_fix_a_quantity(low: str, high: str, value: float) -> None:
    result = solve(load_problem("v3-kite", {f"limits.{low}": value, f"limits.{high}": value}))
    assert result.status == "certified"
    traction = result.phases["traction"]
    reached = traction["elevation_start_deg"] if low.endswith("deg") else traction["duration_s"]
    assert reached == pytest.approx(value, rel=1e-6)
    assert {f"limits.{low}", f"limits.{high}"} <= {e["limit"] for e in result.details["active_limits"]["traction"]}


def test_the_price_of_a_fixed_quantity_is_on_the_side_that_its_optimum_lies() -> None:
    # The optimum of v3-kite is at its lowest elevation: of equal bounds, the lower one costs.
    study = LocalStudy.of(
        optimise(load_problem("v3-kite", {"limits.traction_elevation_max_deg": 20.0}), certificate="quick")
    )
    price = dict(zip(study.keys, study.gradient, strict=True))
    assert price["limits.traction_elevation_min_deg"] < -30.0
    assert price["limits.traction_elevation_max_deg"] == 0.0


@settings(max_examples=60, deadline=None)
@given(
    speeds=st.lists(st.floats(-12.0, 12.0), min_size=3, max_size=8),
    force=st.floats(100.0, 6000.0),
    ratio=st.floats(0.01, 300.0),
)
def test_margins_shares_and_reached_values_agree(speeds: list[float], force: float, ratio: float) -> None:
    values = parameter_values(load_problem("v3-kite"))
    count = len(speeds)
    outputs = np.ones((len(OUTPUTS), count))
    outputs[OUTPUTS.index("reeling_speed")] = speeds
    outputs[OUTPUTS.index("tether_force_kite")] = outputs[OUTPUTS.index("tether_force_ground")] = force
    outputs[OUTPUTS.index("inflow_angle")] = np.arctan(ratio)
    outputs[OUTPUTS.index("height")] = 100.0
    lengths, elevation = np.linspace(220.0, 380.0, count), np.full(count, 0.5)
    record = PhaseRecord("traction", np.linspace(0.0, 30.0, count), lengths, elevation, outputs, 0.0, 0.0)
    for limit in limits_of(values.structure):
        margin, reached = limit.margin(record, values), limit.reached(record)
        assert (margin is None) == (reached is None)
        if margin is None or reached is None:
            continue
        number = values[limit.key]
        exceeds = reached < number if limit.key.rpartition("_max")[1] == "" else reached > number
        assert (margin < 0) == exceeds or margin == pytest.approx(0.0, abs=1e-12)
        assert limit.share(record, values, 0.0) is None or margin <= 0.0


def test_a_traction_of_more_than_an_hour_is_certified_where_it_may_last_so_long() -> None:
    """The re-simulation gave up after 3600 s, whatever the limits said."""
    result = solve(load_problem("v3-kite", {**SLOW, "limits.phase_duration_max_s": 4000.0}))
    assert result.status == "certified"
    assert result.phases["traction"]["duration_s"] > 3600.0


def test_a_prescribed_phase_may_take_as_long_as_the_limits_say() -> None:
    slow = load_problem("v3-kite", {"limits.phase_duration_max_s": 40.0})
    with pytest.raises(CycleError, match=r"takes longer than limits\.phase_duration_max_s \(40 s\)"):
        simulate(slow)
    batch = simulate_batch(slow, {})
    assert (batch.reason[0], batch.failed_phase[0]) == ("endless", "traction")
