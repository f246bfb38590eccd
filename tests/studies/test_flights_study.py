"""A flight of a known system against the model: what went in comes out; and the real flight, where it is at hand."""

from __future__ import annotations

import json
from functools import cache
from html import escape
from pathlib import Path

import numpy as np
import pytest
from made_flight import DATA, RECORDING, TRUTH, kitepower_rows, made_flight, true_result, write_csv
from msgspec.structs import replace

import kiteocp
from kiteocp import InputError
from kiteocp.cli.main import main
from kiteocp.physics.flight import flight_state
from kiteocp.physics.parameters import parameter_values
from kiteocp.recording import FlightData, load_flight
from kiteocp.report.document import WIDTH
from kiteocp.studies.estimation.synthetic import Noise
from kiteocp.studies.prediction.aerodynamics import check_forces
from kiteocp.studies.prediction.comparison import compare_cycle
from kiteocp.studies.prediction.kite import estimate_kite
from kiteocp.studies.prediction.limits import WINDOW_S, flown_limits
from kiteocp.studies.prediction.measured import measured_cycle, model_lengths, time_mean
from kiteocp.studies.prediction.optimum import LEFT_OUT, largest
from kiteocp.studies.prediction.predictions import Prediction
from kiteocp.studies.prediction.prescribed import fly_law
from kiteocp.studies.prediction.reasons import delay
from kiteocp.studies.prediction.replay import FlownWinchLaw, path_of, replay, winch_law
from kiteocp.studies.prediction.statements import statements
from kiteocp.studies.prediction.study import FlightStudy, validate_flight

NOISE = Noise(
    speed_m_s=0.3, force_share=0.02, angle_deg=0.2, distance_m=0.5, airspeed_m_s=0.3, wind_share=0.1, wrong_share=0.01
)

#: An airspeed sensor that reads too low, as the real one does.
SENSOR = 0.9


@cache
def exact_study() -> FlightStudy:
    """Two cycles without noise, the first to estimate on."""
    flight = made_flight(2, sample_rate_Hz=5.0)
    flight = replace(flight, apparent_wind_speed_m_s=SENSOR * flight.apparent_wind_speed_m_s)
    return validate_flight(flight, kiteocp.load_problem("v9-kite"))


def test_coefficients_wind_and_sensor_come_back() -> None:
    kite = exact_study().kite
    for key, value in TRUTH.items():
        assert parameter_values(kite.problem)[key] == pytest.approx(value, rel=1e-6), key
    assert kite.airspeed_factor == pytest.approx(1 / SENSOR, rel=1e-6)
    assert kite.cycles == (0,)
    assert [cycle.measured.number for cycle in exact_study().cycles] == [1]
    assert exact_study().wind.reference_speed_m_s == pytest.approx(10.2, rel=1e-5)


def test_phases_and_power_come_back_by_every_law() -> None:
    (cycle,) = exact_study().cycles
    assert set(cycle.phases) == {"retraction", "transition", "traction"}
    for name, phase in cycle.phases.items():
        # Samples are 0.2 s apart: that is 6 % of the transition.
        share = 0.01 if name != "transition" else 0.07
        for law, quantities in phase.predictions.items():
            for quantity, found in quantities.items():
                assert abs(found.deviation) < (share if law == "constant_force" else 1e-6), (name, law, quantity)
        assert phase.without_equilibrium == {"force_schedule": 0, "speed_schedule": 0}
    assert {law: round(found.deviation, 3) for law, found in cycle.power.items()} == pytest.approx(
        dict.fromkeys(cycle.power, 0.0), abs=5e-3
    )
    assert cycle.measured.mean_power_W == pytest.approx(true_result().cycle["mean_power_W"], rel=5e-3)


def test_the_law_of_a_phase_is_that_of_the_simulation() -> None:
    """Flown from the simulated ends instead of samples, each phase is the simulated one."""
    result, flight = true_result(), made_flight(1)
    cycle, values = measured_cycle(flight, 0), parameter_values(result.problem)
    for name in ("retraction", "transition", "traction"):
        expected = result.phases[name]
        ends = {f"{key}_m": expected[f"{key}_m"] for key in ("tether_length_start", "tether_length_end")}
        ends |= {f"{key}_deg": expected[f"{key}_deg"] for key in ("elevation_start", "elevation_end")}
        phase = replace(cycle.phases[name], **ends)
        exact = replace(cycle, phases={**cycle.phases, name: phase})
        found = fly_law(phase, exact, values).summary()
        assert found["duration_s"] == pytest.approx(expected["duration_s"], rel=2e-4), name
        assert found["mean_power_W"] == pytest.approx(expected["mean_power_W"], rel=2e-3), name


@pytest.mark.parametrize(
    ("predicted", "error", "verdict"),
    [
        (109.0, 0.0, "close"),
        (120.0, 12.0, "within"),
        (120.0, 9.0, "differs"),
        (120.0, 40.0, "unknown"),
        (-5.0, 60.0, "unknown"),
        (120.0, np.nan, "unknown"),
    ],
)
def test_the_verdict_on_a_prediction(predicted: float, error: float, verdict: str) -> None:
    assert Prediction(100.0, predicted, error).verdict == verdict


def test_the_force_follows_from_velocity_alone() -> None:
    assert check_forces(exact_study()).deviations == pytest.approx((0.0,), abs=1e-6)


def test_the_optimum_is_no_worse_than_the_flown_schedule_and_the_gain_adds_up() -> None:
    optimum = exact_study().optimum
    assert optimum is not None
    assert optimum.result.status == "certified"
    assert optimum.wind_factor == pytest.approx(1.0, abs=2e-3)
    assert optimum.prescribed_power_W == pytest.approx(optimum.flown_power_W, rel=5e-3)
    assert optimum.prescribed_power_W is not None
    assert optimum.optimal_power_W > optimum.prescribed_power_W
    gain = optimum.optimal_power_W - optimum.flown_power_W
    assert sum(optimum.contributions.values()) == pytest.approx(gain, rel=1e-9)
    assert optimum.contributions[LEFT_OUT] == pytest.approx(optimum.prescribed_power_W - optimum.flown_power_W)
    # What was widened is told, and nothing was narrowed.
    for key, kept in optimum.widened.items():
        assert optimum.limits[key] < kept if "_min_" in key else optimum.limits[key] > kept
    said = " ".join(statements(exact_study())["the optimum"])
    assert all(key.removeprefix("limits.") in said for key in optimum.widened)


def test_what_brings_most_of_a_gain_or_loss() -> None:
    parts = {"a": 3.0, "b": -4.0, "c": 1.5}
    assert largest(parts, 0.5) == "a"
    assert largest(parts, -0.5) == "b"


@pytest.mark.usefixtures("no_optimum")
def test_noise_and_gaps_leave_the_truth_inside_the_bands() -> None:
    """Cycles numbered from 7, with noise, wrong samples and gaps."""
    flight = made_flight(2, NOISE, sample_rate_Hz=5.0, gaps=((12.0, 15.0), (90.0, 96.0)), seed=5)
    flight = replace(flight, cycle=flight.cycle + 7)
    study = validate_flight(flight, kiteocp.load_problem("v9-kite"))
    assert study.kite.cycles == (7,)
    assert [cycle.measured.number for cycle in study.cycles] == [8]
    values, fit = parameter_values(study.kite.problem), study.kite.fit.fit
    for key in TRUTH:
        if key.startswith("kite."):
            error = fit.parameter(key.removeprefix("kite."))["standard_error"]
            assert 0 < error < 0.1 * TRUTH[key]
            assert abs(values[key] - TRUTH[key]) < 4 * error, key
    for cycle in study.cycles:
        # The winch held a constant force: its law and the flown force predict what was flown.
        for quantity in ("mean_power_W", "reeled_length_m"):
            found = cycle.phases["traction"].predictions["force_schedule"][quantity]
            assert abs(found.predicted - found.measured) < 3.0 * found.standard_error, quantity
            assert 0 < found.standard_error < 0.2 * abs(found.measured)
        law = cycle.phases["traction"].predictions["constant_force"]["duration_s"]
        assert abs(law.predicted - law.measured) < 3.0 * law.standard_error


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_flights() -> None:
    """The spread of a prediction over seeds, from the kite estimated on each, is what its band says."""
    problem = kiteocp.load_problem("v9-kite")
    found = []
    for seed in range(8):
        flight = made_flight(2, NOISE, seed=100 + seed)
        kite = estimate_kite(flight, problem, [0])
        phase = compare_cycle(flight, kite, 1).phases["traction"]
        found.append(phase.predictions["force_schedule"]["mean_power_W"])
    deviations = np.array([prediction.predicted - prediction.measured for prediction in found])
    errors = np.array([prediction.standard_error for prediction in found])
    # Eight draws of a chi distribution: between a half and 1.6 in 98 cases of a hundred.
    ratio = float(np.sqrt(np.mean((deviations / errors) ** 2)))
    assert 0.45 < ratio < 1.6


def test_a_winch_with_a_law_of_its_own() -> None:
    """A kite on a winch that lets out with force: state by state where the lines meet, and the law found again."""
    problem = true_result().problem
    law = FlownWinchLaw(14000.0, 1.5, 2e-4, 1.0)
    flight = made_flight(1)
    traction = flight.select(phase="traction")
    states = [
        flight_state(
            problem,
            tether_length_m=float(traction.distance_m[index]),
            elevation_deg=25.0 + 20.0 * index / len(traction),
            azimuth_deg=15.0,
            course_deg=95.0,
            tether_force_ground_N=14000.0,
        )
        for index in (0, 100, 300)
    ]
    path = path_of(traction, 0, "traction", (0.0, 1.0))
    path = replace(
        path,
        time_s=path.time_s[[0, 100, 300]],
        force_N=path.force_N[[0, 100, 300]],
        reeling_speed_m_s=np.array([state["reeling_speed_m_s"] for state in states]),
        places=np.stack(
            [
                traction.distance_m[[0, 100, 300]],
                [25.0 + 20.0 * index / len(traction) for index in (0, 100, 300)],
                np.full(3, 15.0),
                np.full(3, 95.0),
                np.ones(3),
            ]
        ),
    )
    again = replay(path, parameter_values(problem), law)
    np.testing.assert_allclose(again.reeling_speed_m_s, path.reeling_speed_m_s, rtol=1e-9)
    np.testing.assert_allclose(again.force_N, 14000.0, rtol=1e-6)
    np.testing.assert_allclose(again.winch_speed_m_s, law.speed(again.winch_force_N))
    for index, force in enumerate(again.winch_force_N):
        length, elevation, azimuth, course, _ = path.places[:, index]
        state = flight_state(
            problem,
            tether_length_m=length,
            elevation_deg=elevation,
            azimuth_deg=azimuth,
            course_deg=course,
            tether_force_ground_N=force,
        )
        assert state["reeling_speed_m_s"] == pytest.approx(again.winch_speed_m_s[index], abs=1e-5)
    force = np.linspace(1e4, 2e4, len(traction))
    lawful = replace(traction, tether_force_ground_N=force, reeling_speed_m_s=law.speed(force))
    found = winch_law(lawful)
    assert found is not None
    assert found.slope_m_s_per_N == pytest.approx(2e-4)
    assert winch_law(traction) is None


def test_means_bridge_gaps_and_lengths_follow_the_drum() -> None:
    time = np.array([0.0, 1.0, 2.0, 8.0, 9.0])
    assert time_mean(time, 2.0 * time) == pytest.approx(9.0)
    assert time_mean(time, np.array([1.0, np.nan, 3.0, 9.0, np.nan])) == pytest.approx(5.0)
    assert np.isnan(time_mean(time, np.full(5, np.nan)))
    flight = made_flight(1)
    drifting = replace(
        flight, tether_length_m=flight.distance_m - 21.0, distance_m=flight.distance_m + np.sin(flight.time_s)
    )
    off = model_lengths(drifting) - flight.distance_m
    assert np.ptp(off) < 1e-9
    assert abs(off[0]) < 0.2


def test_limits_are_those_flown() -> None:
    flight = made_flight(2)
    limits = flown_limits(flight)
    assert limits["limits.tether_force_max_N"] == pytest.approx(14000.0)
    assert limits["limits.tether_force_min_N"] == pytest.approx(3000.0)
    assert limits["limits.tether_length_max_m"] == pytest.approx(280.0, abs=0.3)
    assert limits["limits.traction_elevation_min_deg"] == pytest.approx(35.0, abs=0.1)
    assert limits["limits.reel_in_speed_max_m_s"] == pytest.approx(np.max(-flight.reeling_speed_m_s), rel=0.02)
    # A force that swings within a figure of eight is held as its mean.
    swinging = replace(
        flight,
        tether_force_ground_N=flight.tether_force_ground_N * (1 + 0.3 * np.sin(2 * np.pi * flight.time_s / WINDOW_S)),
    )
    assert flown_limits(swinging)["limits.tether_force_max_N"] == pytest.approx(14000.0, rel=0.02)


def turned_flight(flight: FlightData) -> FlightData:
    """The last part of each traction relabelled as the turn, which the real machine has."""
    phase = flight.phase.copy()
    for cycle in flight.cycles():
        last = np.flatnonzero((flight.cycle == cycle) & (phase == "traction"))[-16:]
        phase[last] = "turn"
    return replace(flight, phase=phase)


def test_a_late_effect_is_found() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    cause = np.sin(0.6 * time) + 0.3 * np.sin(1.7 * time + 1.0)
    found = delay(time, cause, 5.0 + np.interp(time - 2.3, time, cause))
    assert found is not None
    late, at_once, best = found
    assert late == pytest.approx(2.3, abs=0.1)
    assert best > 0.99 > at_once
    assert delay(time, np.full(600, 3.0), cause) is None
    assert delay(time[:15], cause[:15], cause[:15]) is None


@pytest.fixture
def no_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits that no cycle can be flown under."""

    def fail(*arguments: object) -> None:
        raise kiteocp.SolveError("the limits leave nothing")

    monkeypatch.setattr("kiteocp.studies.prediction.study.study_optimum", fail)


@pytest.mark.usefixtures("no_optimum")
def test_one_cycle_alone_is_compared_with_itself_and_says_so() -> None:
    study = validate_flight(made_flight(1, sample_rate_Hz=4.0), kiteocp.load_problem("v9-kite"))
    assert any("the cycles are compared that the coefficients come from" in warning for warning in study.warnings)
    assert [cycle.measured.number for cycle in study.cycles] == [0]


@pytest.mark.usefixtures("no_optimum")
def test_a_wrong_unit_or_sense_of_the_map_is_suspected() -> None:
    flight = made_flight(1, sample_rate_Hz=4.0)
    weak = replace(flight, tether_force_ground_N=flight.tether_force_ground_N / 9.80665)
    study = validate_flight(weak, kiteocp.load_problem("v9-kite"))
    assert any("check units of force" in warning for warning in study.warnings)
    odd = replace(flight, warnings=("column map mine: check it",))
    study = validate_flight(odd, kiteocp.load_problem("v9-kite"))
    assert any("column map mine" in warning for warning in study.warnings)
    assert not any("check" in warning for warning in exact_study().warnings)


@pytest.mark.usefixtures("no_optimum")
def test_cycles_asked_for_and_cycles_left_out() -> None:
    flight, problem = made_flight(3, sample_rate_Hz=4.0), kiteocp.load_problem("v9-kite")
    with pytest.raises(InputError, match="complete cycles of the flight are 0, 1, 2"):
        validate_flight(flight, problem, estimate_on=[5])
    cut = flight.where(~((flight.cycle == 1) & (flight.phase == "transition")))
    study = validate_flight(turned_flight(cut), problem, estimate_on=[2])
    assert [cycle.measured.number for cycle in study.cycles] == [0]
    assert "cycle 1 is not complete and is left out" in study.warnings
    # The turn is flown straight up, other than here: it is there, and said to be without a phase in the model.
    assert "turn" in study.cycles[0].phases
    assert any("the model has no phase for it" in text for text in statements(study)["why"])
    with pytest.raises(InputError, match="holds no complete cycle"):
        validate_flight(flight.select(phase="traction"), problem)


def test_a_flight_without_an_airspeed_keeps_the_wind_of_the_estimation_cycles() -> None:
    flight = made_flight(2, sample_rate_Hz=4.0)
    blind = replace(flight, apparent_wind_speed_m_s=np.full(len(flight), np.nan))
    kite = estimate_kite(blind, kiteocp.load_problem("v9-kite"), [0])
    assert kite.airspeed_factor is None
    compared = compare_cycle(blind, kite, 1)
    assert compared.wind.estimate is kite.wind
    assert abs(compared.power["force_schedule"].deviation) < 1e-6


def test_the_summary_is_plain_and_the_text_names_flown_and_optimal() -> None:
    study = exact_study()
    summary = study.result().summary()
    assert summary["verb"] == "validate"
    assert summary["status"] == "ok"
    validation = summary["flight_validation"]
    assert json.loads(json.dumps(validation, allow_nan=False)) == validation
    assert {cycle["cycle"] for cycle in validation["cycles"]} == {1}
    assert validation["optimum"]["flown_mean_power_W"] == pytest.approx(study.cycles[0].measured.mean_power_W)
    # Sentences are for people.
    assert "statements" not in validation
    text, page = study.document().text(), study.document().html()
    assert "Flown 14.3 kW, optimal" in text
    assert max(map(len, text.splitlines())) <= WIDTH
    (whole,) = (line for line in text.splitlines() if line.startswith("cycle "))
    for power in study.cycles[0].power.values():
        assert f"{1e-3 * power.predicted:.2f}" in whole
    for sentences in statements(study).values():
        assert all(escape(sentence) in page for sentence in sentences)
    # The way to the optimum is too much for a terminal.
    assert study.optimum is not None
    assert all(f"<td>{name}</td>" in page for name in study.optimum.contributions)


@pytest.mark.usefixtures("no_optimum")
def test_without_an_optimum_the_comparison_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_csv(tmp_path / "flight.csv", kitepower_rows(made_flight(2, sample_rate_Hz=4.0)))
    assert main(["validate", str(path), "--system", "v9-kite", "--no-plot", "-o", str(tmp_path / "out"), "--json"]) == 1
    out, error = capsys.readouterr()
    summary = json.loads(out)
    assert summary["status"] == "failed"
    assert summary["flight_validation"]["optimum"] is None
    assert len(summary["flight_validation"]["cycles"]) == 1
    assert "the limits leave nothing" in error
    assert (tmp_path / "out" / "report.html").exists()


def test_the_command_writes_tables_pictures_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_csv(tmp_path / "flight.csv", kitepower_rows(made_flight(2, sample_rate_Hz=4.0)))
    assert main(["validate", str(path), "--system", "v9-kite", "--estimate-on", "0", "-o", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "constant force" in out
    assert "mostly because of" in out
    written = {file.name for file in (tmp_path / "out").iterdir()}
    assert written == {
        "summary.json", "report.html", "cycle_1.png", "side_view_1.png", "comparison.png", "optimum.png",
    }  # fmt: skip
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count("data:image/png;base64,") == 4
    assert "http" not in html.replace("http-equiv", "")


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["FLIGHT"], "add --system"),
        (["FLIGHT", "--system", "v9-kit"], "did you mean v9-kite?"),
        (["FLIGHT", "--system", "v9-kite", "--estimate-on", "a"], "expected numbers of cycles"),
        (["FLIGHT", "--system", "v9-kite", "--estimate-on", "3"], "the complete cycles of the flight are 0"),
        (["FLIGHT", "--system", "v9-kite", "--columns", "mine.yaml"], "no such column map"),
        (["nowhere.csv", "--system", "v9-kite"], "no such file"),
        (["--system", "v9-kite"], "--system needs a flight"),
        (["--set", "kite.mass_kg=3"], "--set needs a flight"),
    ],
)
def test_mistakes_are_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], part: str
) -> None:
    path = tmp_path / "flight.csv"
    write_csv(path, kitepower_rows(made_flight(1)))
    words = [str(path) if word == "FLIGHT" else word for word in arguments]
    assert main(["validate", *words, "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert part in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


needs_recording = pytest.mark.skipif(not RECORDING.exists(), reason=f"no flight data in {DATA}")


@needs_recording
def test_the_real_recording_is_read_with_its_known_faults() -> None:
    flight = load_flight(RECORDING)
    assert len(flight) == 3377
    assert flight.cycles() == (0, 1, 2, 3)
    assert set(flight.phase.tolist()) == {"traction", "turn", "retraction", "transition"}
    # The vane of cycle 0 points the wrong way; course and velocity agree, so that frames and senses are right.
    assert 600 < flight.counts["values_wind_direction_turned"] < 900
    assert "values_course_disagrees" not in flight.counts
    # Forces are in kgf there.
    assert 15_000 < np.nanmean(flight.select(phase="traction").tether_force_ground_N) < 18_000
    # The bearing of zero azimuth against the wind at the ground.
    assert abs(np.median(flight.ground_wind_direction_deg) + 180.0 - flight.downwind_bearing_deg) < 15.0
    lengths = model_lengths(flight)
    assert np.isfinite(lengths).all()
    assert np.nanstd(lengths - flight.distance_m) < 6.0


@needs_recording
@pytest.mark.slow
def test_the_real_flight_is_explained() -> None:
    study = validate_flight(load_flight(RECORDING), kiteocp.load_problem("v9-kite"))
    kite = study.kite
    assert 8.0 < (kite.wind.reference_speed_m_s or 0.0) < 14.0
    lift, drag = kite.fit.coefficients("powered")
    assert 0.6 < lift < 1.0
    assert 3.0 < lift / drag < 8.0
    for cycle in study.cycles:
        speed = cycle.phases["traction"].predictions["force_schedule"]["mean_kite_speed_m_s"]
        assert abs(speed.deviation) < 0.05
        retraction = cycle.phases["retraction"].predictions["constant_force"]["duration_s"]
        assert abs(retraction.deviation) < 0.4
    # The aerodynamics of cycles 0 and 1 hold on cycles 2 and 3.
    check = check_forces(study)
    assert max(map(abs, check.deviations)) < 0.08
    assert min(check.correlations) > 0.8
    assert study.optimum is not None
    assert study.optimum.result.status == "certified"
    assert study.optimum.optimal_power_W > (study.optimum.prescribed_power_W or np.inf)
