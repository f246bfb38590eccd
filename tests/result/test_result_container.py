"""The result object: channels by name, units, the summary contract, the printed table."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from made_result import DURATIONS_S, SAMPLES_OF_A_PHASE, make_optimum, make_result

from kiteocp.result import TIME_SERIES_CHANNELS, Result, unit_of

CONTRACT_KEYS = {
    "schema_version", "kiteocp_version", "versions", "verb", "problem", "input_sha256", "input", "status", "warnings",
    "phases", "cycle",
}  # fmt: skip
PHASE_KEYS = {
    "duration_s", "mean_power_W", "energy_J", "tether_length_start_m", "tether_length_end_m", "elevation_start_deg",
    "elevation_end_deg",
}  # fmt: skip
CYCLE_KEYS = {
    "duration_s", "mean_power_W", "energy_J", "mean_harvesting_factor", "mean_traction_altitude_m",
    "wind_speed_at_mean_traction_altitude_m_s",
}  # fmt: skip


def test_channels_are_found_by_name_and_phase():
    result = make_result()
    assert result["time_s"].shape == (3 * SAMPLES_OF_A_PHASE,)
    traction = result.channel("tether_force_kite_N", phase="traction")
    assert traction.tolist() == [3008.0] * SAMPLES_OF_A_PHASE
    assert result.unit("tether_force_kite_N") == "N"


def test_unknown_names_are_errors_that_name_the_nearest():
    result = make_result()
    with pytest.raises(KeyError, match="did you mean 'tether_force_kite_N'"):
        result["tether_force_kit_N"]
    with pytest.raises(KeyError, match="did you mean 'traction'"):
        result.channel("power_W", phase="tracton")
    with pytest.raises(KeyError, match="did you mean 'power_W'"):
        result.unit("power_kW")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("reeling_acceleration_m_s2", "m/s2"), ("wind_speed_m_s", "m/s"), ("time_s", "s"), ("height_m", "m"),
        ("elevation_rate_deg_s", "deg/s"), ("kinematic_ratio", "1"), ("phase", "1"), ("winch_torque_N_m", "N m"),
        ("limits.tether_force_max_N", "N"), ("inflow_angle_rad", "rad"), ("density_kg_m3", "kg/m3"),
    ],
)  # fmt: skip
def test_units_are_read_off_the_suffix(name, unit):
    assert unit_of(name) == unit


def test_nothing_in_a_result_can_be_changed_by_accident():
    result = make_result()
    with pytest.raises(ValueError, match="read-only"):
        result["power_W"][0] = 1.0
    with pytest.raises(AttributeError):
        result.status = "failed"


def test_a_result_survives_a_process_pool():
    copy = pickle.loads(pickle.dumps(make_optimum()))
    assert copy.prescribed is not None
    assert np.array_equal(copy["power_W"], make_optimum()["power_W"])


def test_what_cannot_be_a_result_is_refused():
    problem = make_result().problem
    with pytest.raises(ValueError, match="one length"):
        Result("simulate", problem, channels={"time_s": np.zeros(3), "power_W": np.zeros(2)})
    with pytest.raises(ValueError, match="status 'fine'"):
        Result("simulate", problem, status="fine")
    with pytest.raises(ValueError, match="'cycle'"):
        Result("simulate", problem, details={"cycle": {}})


def test_summary_keeps_the_contract():
    summary = make_result().summary()
    assert set(summary) == CONTRACT_KEYS
    assert summary["schema_version"] == 1
    assert set(summary["versions"]) >= {"python", "numpy"}
    assert set(summary["phases"]) == {"retraction", "transition", "traction"}
    assert all(set(phase) >= PHASE_KEYS for phase in summary["phases"].values())
    assert set(summary["cycle"]) >= CYCLE_KEYS
    assert summary["input"]["limits"]["height_max_m"] == 500.0  # a default, filled in
    assert len(summary["input_sha256"]) == 64


def test_summary_of_an_optimum_holds_the_prescribed_cycle_in_the_same_shape():
    summary = make_optimum().summary()
    assert set(summary) == CONTRACT_KEYS | {"prescribed", "solver", "active_limits"}
    assert set(summary["prescribed"]) == {"status", "warnings", "phases", "cycle"}
    assert set(summary["prescribed"]["phases"]["traction"]) == set(summary["phases"]["traction"])
    assert make_result("solve").summary()["prescribed"] is None


def test_summary_holds_finite_numbers_or_null():
    result = make_result(
        cycle={"mean_power_W": float("nan"), "energy_J": np.float64("inf")},
        details={"sensitivities": np.array([1.0, np.nan]), "pair": (np.int64(3), True)},
    )
    summary = json.loads(json.dumps(result.summary(), allow_nan=False))
    assert summary["cycle"]["mean_power_W"] is None
    assert summary["cycle"]["energy_J"] is None
    assert set(summary["cycle"]) >= CYCLE_KEYS
    assert summary["sensitivities"] == [1.0, None]
    assert summary["pair"] == [3, True]


def test_table_of_a_simulation():
    text = str(make_result())
    rows = {line.split()[0]: line.split() for line in text.splitlines() if line}
    assert rows["retraction"][1:] == ["60.0", "-3.00", "-180.0", "720.0", "->", "390.0", "27.0", "->", "70.0"]
    assert rows["cycle"][1:] == ["112.0", "5.56", "623.0"]
    assert float(rows["phase"][-1]) == 112.0 - sum(DURATIONS_S)
    assert "warning: the kite rises above 500 m" in text
    assert text.isascii()


def test_table_of_an_optimum_shows_the_prescribed_cycle_limits_and_solver():
    text = str(make_optimum())
    assert "mean cycle power 6.95 kW, prescribed 5.56 kW: +1.39 kW (+25.0 %)" in text
    assert "limits.tether_force_min_N = 749 N (93 %)" in text
    assert "limits.tether_force_max_N = 30080 N (100 %)" in text
    assert "limits.elevation_max_deg = 85 deg (at a point)" in text
    assert "solver: Solve_Succeeded, 34 iterations, solved in 42 ms, built in 1.3 s, 1 start" in text
    assert max(map(len, text.splitlines())) <= 100  # fits a terminal


def test_table_of_a_failure_says_why():
    result = Result("simulate", make_result().problem, "infeasible", details={"message": "no equilibrium at r_min"})
    assert str(result).endswith("simulate: infeasible - no equilibrium at r_min")


def test_table_without_a_prescribed_cycle_to_compare_with():
    failed = Result("simulate", make_result().problem, "infeasible", details={"message": "the kite is too heavy"})
    text = str(make_result("solve", prescribed=failed))
    assert "no comparison with the prescribed cycle: the kite is too heavy" in text


def test_first_channels_are_those_of_the_contract():
    assert TIME_SERIES_CHANNELS[:2] == ("time_s", "phase")
    assert len(set(TIME_SERIES_CHANNELS)) == 14
