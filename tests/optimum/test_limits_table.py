"""A limit is one row: what a row of `kiteocp.problem.limits` alone makes of a new limit, shown on two of them."""

from __future__ import annotations

import numpy as np
import pytest

from kiteocp import load_problem, simulate, solve
from kiteocp.cycle.limits import limits_of
from kiteocp.errors import InfeasibleError, InputError
from kiteocp.optimum.refine import optimise
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem.catalogue import limit_keys
from kiteocp.studies.sensitivity.derivatives import LocalStudy
from kiteocp.studies.sensitivity.local import sensitivities
from kiteocp.studies.winch.export import winch_export

WIND, SLOWEST = "limits.apparent_wind_speed_max_m_s", "limits.reel_out_speed_min_m_s"


def test_every_row_says_what_it_bounds_and_how_to_say_it() -> None:
    for path, key in limit_keys().items():
        row = key.limit
        assert row is not None
        assert ("_min" in path) != ("_max" in path) or row.quantity is None, path
        assert row.cannot.count("{}") == row.needs.count("{}") == 1, path
        assert row.more.split()[0] in {"more", "faster"}, path
        assert row.unit == key.unit, path


def test_the_apparent_wind_of_the_kite_is_kept_below_its_limit() -> None:
    free = solve(load_problem("v3-kite"))
    fastest = float(np.max(free.channel("apparent_wind_speed_m_s")))
    assert WIND not in str(free)
    result = solve(load_problem("v3-kite", {WIND: 0.9 * fastest}))
    assert result.status == "certified"
    assert float(np.max(result.channel("apparent_wind_speed_m_s"))) <= 0.9 * fastest * 1.005
    assert WIND in [e["limit"] for entries in result.details["active_limits"].values() for e in entries]
    assert result.details["limit_margins"][WIND]["margin"] == pytest.approx(0.0, abs=5e-3)
    assert result.cycle["mean_power_W"] < free.cycle["mean_power_W"]


def test_a_slowest_reel_out_is_kept_in_traction_only() -> None:
    free = solve(load_problem("v3-kite", {"environment.wind.reference_speed_m_s": 6.0}))
    slowest = float(np.min(free.channel("reeling_speed_m_s", "traction")))
    result = solve(load_problem("v3-kite", {"environment.wind.reference_speed_m_s": 6.0, SLOWEST: 1.1 * slowest}))
    assert result.status == "certified"
    assert float(np.min(result.channel("reeling_speed_m_s", "traction"))) >= 1.1 * slowest * 0.995
    assert float(np.min(result.channel("reeling_speed_m_s", "retraction"))) < 0.0
    assert SLOWEST in [entry["limit"] for entry in result.details["active_limits"]["traction"]]


@pytest.mark.parametrize(("key", "factor"), [(WIND, 0.95), (SLOWEST, 1.02)])
def test_the_price_of_a_new_limit_is_its_slope(key: str, factor: float) -> None:
    problem = load_problem("v3-kite", {"environment.wind.reference_speed_m_s": 6.0})
    free = optimise(problem, certificate="quick").cycle.records
    reached = {
        WIND: max(float(np.max(r.output("apparent_wind_speed"))) for r in free),
        SLOWEST: float(np.min(free[-1].output("reeling_speed"))),
    }
    value = factor * reached[key]
    study = LocalStudy.of(optimise(problem.with_values({key: value}), certificate="quick"))
    column, step = study.keys.index(key), 1e-4 * value
    above, below = study.power_at(column, step), study.power_at(column, -step)
    assert above is not None
    assert below is not None
    assert study.gradient[column] * (1 if key == WIND else -1) > 0.1
    assert study.gradient[column] == pytest.approx((above - below) / (2 * step), rel=0.02)
    found = sensitivities(problem.with_values({key: value}), intervals=False)
    (price,) = [row["text"] for row in found.details["shadow_prices"] if row["key"] == key]
    assert price.startswith(("1 m/s more apparent wind speed is worth", "1 m/s more minimum reel-out speed costs"))


def test_new_limits_are_named_in_a_conflict() -> None:
    with pytest.raises(InfeasibleError, match=r"keep its apparent wind speed below 5 m/s"):
        solve(load_problem("v3-kite", {WIND: 5.0}))
    with pytest.raises(InfeasibleError, match=r"reel out at 7 m/s or more in traction"):
        solve(load_problem("v3-kite", {SLOWEST: 7.0}))


def test_new_limits_warn_of_a_prescribed_cycle() -> None:
    warnings = simulate(load_problem("v3-kite", {WIND: 15.0, SLOWEST: 3.0})).warnings
    assert any(f"outside {WIND} (15 m/s): it needs a" in text for text in warnings)
    assert any(f"outside {SLOWEST} (3 m/s): it needs a" in text for text in warnings)


def test_a_comparison_says_what_the_prescribed_cycle_leaves() -> None:
    text = str(solve(load_problem("v3-kite", {"limits.traction_duration_min_s": 200.0}), certificate="quick"))
    assert "; the prescribed cycle is outside limits.traction_duration_min_s" in text


def test_a_range_without_room_is_refused() -> None:
    with pytest.raises(InputError, match=r"reel_out_speed_min_m_s \(9\) is greater than limits\.reel_out"):
        load_problem("v3-kite", {SLOWEST: 9.0, "limits.reel_out_speed_max_m_s": 8.0})


def test_winch_laws_are_judged_by_all_limits() -> None:
    problem = load_problem("v3-kite", {WIND: 24.0, "limits.stroke_min_m": 150.0})
    export = winch_export(optimise(problem, certificate="quick"))
    known = {limit.key for limit in limits_of(parameter_values(problem).structure)}
    assert {WIND, "limits.stroke_min_m", "limits.reeling_acceleration_max_m_s2"} <= known
    found = [v["limit"] for one in export.evaluations for v in one.violations]
    # In more wind than that of the laws the kite flies faster.
    assert WIND in found
