"""The optional turn: a powered climb between traction and retraction, in optima, simulations, exports and pictures."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import kiteocp
from kiteocp import load_problem, simulate, solve
from kiteocp.cli.main import main
from kiteocp.cycle.remedies import explain_simulation
from kiteocp.errors import CycleError, InputError
from kiteocp.optimum.refine import optimise
from kiteocp.studies.estimation.synthetic import flight_of_result
from kiteocp.studies.sensitivity.derivatives import LocalStudy
from kiteocp.studies.winch.export import winch_export

FLOWN = {"optimisation.turn": "flown"}

#: Mean powers (W) of a prototype with a turn; the notes on optimal cycles have them.
PROTOTYPE = {"strong-wind": 7058.0, "moderate-wind": 3097.0, "v3-kite": 6305.0, "v9-kite": 13704.5}


@pytest.mark.parametrize("name", PROTOTYPE)
def test_the_turn_is_certified_and_never_loses(name: str) -> None:
    without, result = solve(load_problem(name)), solve(load_problem(name, FLOWN))
    assert result.status == "certified"
    power = result.cycle["mean_power_W"]
    assert power == pytest.approx(PROTOTYPE[name], rel=1e-4)
    # A turn that does not pay lasts a millisecond, which costs less than the mesh tells.
    assert power >= without.cycle["mean_power_W"] * (1 - 1e-5)
    assert list(result.phases) == ["retraction", "transition", "traction", "turn"]
    turn = result.phases["turn"]
    assert turn["mean_power_setting"] == 1.0
    assert turn["mean_course_deg"] == pytest.approx(180.0)
    if name == "v9-kite":
        assert turn["duration_s"] == pytest.approx(1e-3, rel=1e-3)
        assert "limits.turn_duration_min_s" in [entry["limit"] for entry in result.details["active_limits"]["turn"]]
    else:
        assert turn["elevation_end_deg"] > turn["elevation_start_deg"] + 5.0
    assert "turn" not in without.phases


def test_nothing_pauses_between_traction_and_turn() -> None:
    result = solve(load_problem("v3-kite", FLOWN))
    time, phase = result.channel("time_s"), result["phase"]
    starts = {name: float(time[phase == name][0]) for name in result.phases}
    ends = {name: float(time[phase == name][-1]) for name in result.phases}
    assert starts["turn"] == pytest.approx(ends["traction"], abs=1e-9)
    assert starts["transition"] == pytest.approx(ends["retraction"] + 2.0, abs=1e-9)
    assert result.cycle["duration_s"] == pytest.approx(sum(p["duration_s"] for p in result.phases.values()) + 6.0)
    jumps = {jump["from_phase"]: jump["allowed_m_s"] for jump in result.details["speed_jumps"]}
    assert jumps["traction"] == 0.0
    assert jumps["turn"] == pytest.approx(6.0)


def test_limited_jumps_leave_none_into_the_turn() -> None:
    result = solve(load_problem("v3-kite", {**FLOWN, "optimisation.speed_jumps": "limited"}))
    assert result.status == "certified"
    (jump,) = [jump for jump in result.details["speed_jumps"] if jump["from_phase"] == "traction"]
    # The speed of the first mesh point, shortly after the start of the turn, is that of the last of the traction.
    assert abs(jump["jump_m_s"]) < 0.2


def test_a_shortest_turn_has_its_price() -> None:
    problem = load_problem("v9-kite", {**FLOWN, "limits.turn_duration_min_s": 4.0})
    study = LocalStudy.of(optimise(problem, certificate="quick"))
    column = study.keys.index("limits.turn_duration_min_s")
    above, below = study.power_at(column, 1e-3), study.power_at(column, -1e-3)
    assert above is not None
    assert below is not None
    assert study.gradient[column] < -1.0
    assert study.gradient[column] == pytest.approx((above - below) / 2e-3, rel=0.02)


def test_the_prescribed_turn_climbs_under_its_force_to_its_end() -> None:
    result = simulate(load_problem("v3-kite", {**FLOWN, "operation.turn.elevation_deg": 45.0}))
    turn, retraction = result.phases["turn"], result.phases["retraction"]
    assert turn["tether_length_start_m"] == pytest.approx(400.0, abs=1e-6)
    assert (turn["elevation_start_deg"], turn["elevation_end_deg"]) == pytest.approx((27.0, 45.0), abs=1e-6)
    np.testing.assert_allclose(result.channel("tether_force_kite_N", "turn"), 4000.0, rtol=1e-6)
    # The cycle closes: the retraction starts where the turn ends.
    assert retraction["tether_length_start_m"] == pytest.approx(turn["tether_length_end_m"], rel=1e-9)
    assert retraction["elevation_start_deg"] == pytest.approx(45.0, abs=1e-6)
    weak = simulate(load_problem("v3-kite", {**FLOWN, "operation.turn.tether_force_N": 2000.0}))
    assert weak.phases["turn"]["tether_length_end_m"] > turn["tether_length_end_m"]


def test_the_scheme_of_the_paper_flies_the_turn_too() -> None:
    problem = load_problem("v3-kite", FLOWN)
    exact = simulate(problem).phases["turn"]["duration_s"]
    errors = [simulate(problem, time_step=step).phases["turn"]["duration_s"] / exact - 1 for step in (0.01, 0.005)]
    assert abs(errors[0]) < 0.02
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.1)


def test_the_rootfinder_agrees_in_the_turn() -> None:
    problem = load_problem("v3-kite", FLOWN)
    one, other = (simulate(problem, equilibrium=way).phases["turn"] for way in ("explicit", "rootfinder"))
    assert one["energy_J"] == pytest.approx(other["energy_J"], rel=1e-6)


def test_a_turn_downwards_is_refused() -> None:
    with pytest.raises(InputError, match=r"traction\.elevation_deg \(27\) is not less than operation\.turn"):
        load_problem("v3-kite", {**FLOWN, "operation.turn.elevation_deg": 20.0})
    # Where no turn is flown its numbers do not matter.
    load_problem("v3-kite", {"operation.turn.elevation_deg": 20.0})


def test_a_turn_that_cannot_be_flown_is_named() -> None:
    problem = load_problem("v3-kite", {**FLOWN, "operation.turn.tether_force_N": 50.0})
    with pytest.raises(CycleError, match="its turn ends after 0 s") as caught:
        simulate(problem)
    assert "a turn force of 458 N" in explain_simulation(problem, caught.value).sentence


def test_batches_say_that_they_fly_three_phases() -> None:
    with pytest.raises(InputError, match=r"set optimisation\.turn to none"):
        kiteocp.simulate_batch(load_problem("v3-kite", FLOWN), {"kite.mass_kg": [20.0, 21.0]})


def test_winch_laws_fly_the_turn() -> None:
    export = winch_export(optimise(load_problem("v3-kite", FLOWN)))
    own = export.evaluation("force", 1.0)
    assert own.mean_power_W is not None
    assert [record.name for record in own.records] == ["retraction", "transition", "traction", "turn"]
    assert own.loss_percent is not None
    assert abs(own.loss_percent) < 5.0
    turn = export.to_dict()["phases"]["turn"]
    assert turn["ends_when"]["elevation_at_least_deg"] == pytest.approx(
        np.degrees(own.records[-1].elevation_rad[-1]), abs=1e-6
    )
    assert set(export.setpoints_time["phase"]) == {"retraction", "transition", "traction", "turn", "change"}
    assert "  turn        at " in export.report


def test_the_turn_is_in_the_files_and_the_picture(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["solve", "v3-kite", "--set", "optimisation.turn=flown", "--export", str(out / "winch"), "-o", str(out)]
    assert main(words) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["phases"]["turn"]["duration_s"] > 1.0
    with (out / "timeseries.csv").open(newline="") as stream:
        assert {row["phase"] for row in csv.DictReader(stream)} == {"retraction", "transition", "traction", "turn"}
    assert (out / "cycle.png").stat().st_size > 10_000
    assert (out / "winch" / "laws.json").exists()


def test_a_synthetic_flight_of_a_turn_is_refused() -> None:
    flown = simulate(load_problem("v3-kite", {"optimisation.turn": "flown"}))
    with pytest.raises(InputError, match="a synthetic flight flies retraction, transition, traction only"):
        flight_of_result(flown)


def test_the_jump_into_the_turn_is_not_blamed_on_the_phase_change_time() -> None:
    result = solve(load_problem("v3-kite", {"optimisation.turn": "flown"}), certificate="quick")
    [warning] = [text for text in result.warnings if text.startswith("from traction to turn")]
    assert "no time passes between these phases" in warning
