"""Crosswind-resolved traction: against closed forms and states solved one by one, its best course, and its mistakes."""

from __future__ import annotations

import json
import math

import matplotlib.image
import numpy as np
import pytest
from scipy.integrate import quad

import kiteocp
from kiteocp import InputError, flight_state, load_problem
from kiteocp.cli.main import main
from kiteocp.physics.parameters import parameter_values
from kiteocp.result.channels import TIME_SERIES_CHANNELS
from kiteocp.studies.crosswind.course import _matching_course, matching_path
from kiteocp.studies.crosswind.flight import UnflyableError, Winch, fly_path
from kiteocp.studies.crosswind.path import PATHS, antiderivative, circle, derivative, figure_of_eight, make_path
from kiteocp.studies.crosswind.report import crosswind_document
from kiteocp.studies.crosswind.study import crosswind, representative_course

FORCE_N, LENGTH_M = 3008.0, 555.0
HOLD = Winch("tether_force_kite", FORCE_N)


@pytest.fixture(scope="module")
def problem():
    return load_problem("strong-wind")


@pytest.fixture(scope="module")
def study(problem):
    return crosswind(problem, mass_ratios=(0.0, 1.0, 20.0))


def weightless_state(problem, elevation, azimuth, course):
    """Path speed and power of the weightless kite at constant force by the paper's formulas, written out."""
    height = LENGTH_M * math.sin(elevation)
    wind = 9.9 * math.log(height / 0.07) / math.log(6.0 / 0.07)
    density = 1.225 * math.exp(-height / 8550.0)
    drag = 0.69 / 4.0 + 0.25 * 0.004 * LENGTH_M / 10.2 * 1.1
    kappa = 0.69 / drag
    apparent = math.sqrt(2.0 * FORCE_N / (density * math.hypot(0.69, drag) * 10.2))
    radial = apparent / math.sqrt(1.0 + kappa**2)
    polar, azimuthal = wind * math.sin(elevation) * math.cos(azimuth), -wind * math.sin(azimuth)
    along = polar * math.cos(course) + azimuthal * math.sin(course)
    across = azimuthal * math.cos(course) - polar * math.sin(course)
    speed = along + math.sqrt(apparent**2 - radial**2 - across**2)
    return speed, FORCE_N * (wind * math.cos(elevation) * math.cos(azimuth) - radial), kappa


def eight_at(s, centre, width, height, sign):
    """OperatingPoint and course of a figure of eight, and its length on the unit sphere per unit of its parameter."""
    azimuth, elevation = width * math.sin(s), centre + sign * height * math.sin(2.0 * s)
    side, up = math.cos(elevation) * width * math.cos(s), sign * 2.0 * height * math.cos(2.0 * s)
    return elevation, azimuth, math.atan2(side, -up), math.hypot(side, up)


@pytest.mark.parametrize("up", [True, False])
def test_weightless_figure_against_quadrature_of_the_closed_form(problem, up):
    values = parameter_values(problem, gravity=False)
    flown = fly_path(values, figure_of_eight(30.0, 20.0, 6.0, up=up), LENGTH_M, HOLD)

    def pace(s):
        elevation, azimuth, course, length = eight_at(s, *np.deg2rad([30.0, 20.0, 6.0]), -1.0 if up else 1.0)
        speed, power, _ = weightless_state(problem, elevation, azimuth, course)
        return LENGTH_M * length / speed, power, math.cos(azimuth), math.cos(course)

    period = quad(lambda s: pace(s)[0], 0.0, 2.0 * math.pi, epsabs=1e-10)[0]
    means = [
        quad(lambda s, i=i: pace(s)[0] * pace(s)[i], 0.0, 2.0 * math.pi, epsabs=1e-9, epsrel=1e-11)[0] / period
        for i in (1, 2, 3)
    ]
    averages = flown.averages()
    assert flown.period_s == pytest.approx(period, rel=1e-10)
    found = [averages[name] for name in ("mean_power_W", "mean_cosine_azimuth", "mean_cosine_course")]
    assert found == pytest.approx(means, rel=1e-9)
    kappa = weightless_state(problem, 0.5, 0.0, 1.0)[2]
    assert np.allclose(flown.states["kinematic_ratio"], kappa, rtol=1e-11)
    half = math.pi
    assert flown.time_s[64] == pytest.approx(quad(lambda s: pace(s)[0], 0.0, half, epsabs=1e-10)[0], rel=1e-9)


def test_tiny_weightless_circle_is_the_average_over_all_courses_at_its_centre(problem):
    values = parameter_values(problem, gravity=False)
    averages = fly_path(values, circle(27.0, 1e-3), LENGTH_M, HOLD).averages()
    centre = math.radians(27.0)
    pace = [1.0 / weightless_state(problem, centre, 0.0, course)[0] for course in np.arange(64) * (2 * math.pi / 64)]
    cosine = np.sum(np.cos(np.arange(64) * (2 * math.pi / 64)) * pace) / np.sum(pace)
    assert averages["mean_cosine_course"] == pytest.approx(cosine, abs=1e-6)
    # The wind blows the kite down there: it takes longer to fly up, weight or no weight.
    assert cosine < -0.05
    assert averages["mean_power_W"] == pytest.approx(weightless_state(problem, centre, 0.0, 0.0)[1], rel=1e-5)


def test_averages_converge_spectrally(problem):
    values = parameter_values(problem)
    powers = {
        points: fly_path(values, figure_of_eight(27.0, 15.0, up=True, points=points), LENGTH_M, HOLD).averages()
        for points in (8, 16, 32, 128)
    }
    best = powers[128]["mean_power_W"]
    errors = [abs(powers[points]["mean_power_W"] / best - 1.0) for points in (8, 16, 32)]
    assert errors[0] > 1e-6
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 1e-3 * errors[1]


@pytest.mark.parametrize("kind", PATHS)
def test_figure_with_weight_against_states_solved_one_by_one(problem, kind):
    flown = fly_path(parameter_values(problem), make_path(kind, 27.0, 14.0), LENGTH_M, HOLD)
    path, some = flown.path, slice(3, None, 4)
    paces, powers = [], []
    for elevation, azimuth, course, length in zip(
        path.elevation_rad[some], path.azimuth_rad[some], path.course_rad[some], path.length_rad[some], strict=True
    ):
        state = flight_state(
            problem,
            tether_length_m=LENGTH_M,
            elevation_deg=math.degrees(elevation),
            azimuth_deg=math.degrees(azimuth),
            course_deg=math.degrees(course),
            tether_force_kite_N=FORCE_N,
        )
        paces.append(length / state["tangential_speed_m_s"])
        powers.append(state["power_W"])
    assert np.allclose(flown.states["power"][some], powers, rtol=1e-9)
    # Every fourth point is a rule of its own for the periodic averages.
    assert flown.averages()["mean_power_W"] == pytest.approx(np.average(powers, weights=paces), rel=1e-6)


def test_geometry_of_the_circle():
    path = circle(40.0, 12.0)
    assert np.sum(path.length_rad) == pytest.approx(2.0 * math.pi * math.sin(math.radians(12.0)), rel=1e-12)
    assert np.allclose(np.abs(path.curvature), 1.0 / math.tan(math.radians(12.0)), rtol=1e-9)
    distance = np.arccos(
        np.sin(path.elevation_rad) * math.sin(math.radians(40.0))
        + np.cos(path.elevation_rad) * math.cos(math.radians(40.0)) * np.cos(path.azimuth_rad)
    )
    assert np.allclose(np.rad2deg(distance), 12.0)


@pytest.mark.parametrize(("up", "at_the_side"), [(True, 180.0), (False, 0.0)])
def test_loops_go_up_or_down_at_both_sides(up, at_the_side):
    path = figure_of_eight(30.0, 15.0, up=up)
    assert path.elevation_amplitude_deg == pytest.approx(4.5)
    for side in (np.argmax(path.azimuth_rad), np.argmin(path.azimuth_rad)):
        assert abs(math.degrees(path.course_rad[side])) == pytest.approx(at_the_side, abs=1e-9)
    # At the side the curve bends with A / (2 B)^2, of the azimuth seen on the parallel there.
    width = math.radians(15.0) * math.cos(math.radians(30.0))
    assert path.curvature[np.argmax(path.azimuth_rad)] == pytest.approx(
        (1 if up else -1) * width / (2.0 * math.radians(4.5)) ** 2, rel=1e-3
    )


def test_derivative_and_antiderivative_of_a_periodic_function():
    s = np.arange(64) * (2 * np.pi / 64)
    values = 2.0 + np.exp(np.sin(s))
    assert np.allclose(derivative(values), np.cos(s) * np.exp(np.sin(s)), atol=1e-12)
    assert np.allclose(antiderivative(values) - values.mean() * s, antiderivative(values - values.mean()), atol=1e-12)
    assert np.allclose(derivative(antiderivative(values - values.mean())), values - values.mean(), atol=1e-12)


@pytest.mark.parametrize("kind", PATHS)
def test_matching_path_averages_to_the_representative_place(problem, kind):
    values = parameter_values(problem)
    path = matching_path(values, kind, LENGTH_M, HOLD)
    averages = fly_path(values, path, LENGTH_M, HOLD).averages()
    assert averages["mean_cosine_azimuth"] == pytest.approx(math.cos(math.radians(10.5)), abs=1e-10)
    assert averages["mean_cosine_elevation"] == pytest.approx(math.cos(math.radians(27.0)), abs=1e-10)


def test_best_course_has_the_power_of_the_figure(problem):
    found = representative_course(problem, "eight-up", 22.0)
    heavier = load_problem("strong-wind", {"kite.mass_kg": 22.0})
    place = {
        "tether_length_m": LENGTH_M,
        "elevation_deg": found.elevation_deg,
        "azimuth_deg": found.azimuth_deg,
        "tether_force_kite_N": FORCE_N,
    }
    state = flight_state(heavier, course_deg=found.course_deg, **place)
    assert state["power_W"] == pytest.approx(found.resolved_power_W, rel=1e-8)
    state = flight_state(heavier, course_deg=found.gravity_course_deg, **place)
    light = flight_state(heavier, course_deg=100.9, gravity=False, **place)
    loss = found.resolved_power_W / found.resolved_weightless_power_W
    assert state["power_W"] / light["power_W"] == pytest.approx(loss, rel=1e-8)
    state = flight_state(heavier, course_deg=100.9, **place)
    assert found.power_ratio == pytest.approx(found.resolved_power_W / state["power_W"], rel=1e-8)


def test_gravity_costs_power_and_the_paper_expects_an_upward_mean_course(problem):
    found = representative_course(problem, "circle")
    assert found.resolved_power_W < found.resolved_weightless_power_W
    assert found.mean_course_deg > 90.0
    heavy = representative_course(problem, "circle", 45.0)
    assert heavy.resolved_power_W < found.resolved_power_W
    assert heavy.mean_course_deg > found.mean_course_deg


def test_mirrored_problem_has_the_mirrored_course(problem):
    mirrored = load_problem(
        "strong-wind", {"operation.traction.azimuth_deg": -10.5, "operation.traction.course_deg": 259.1}
    )
    one, other = representative_course(problem), representative_course(mirrored)
    assert other.azimuth_deg == pytest.approx(-one.azimuth_deg)
    assert other.course_deg == pytest.approx(360.0 - one.course_deg, abs=1e-6)
    assert other.power_ratio == pytest.approx(one.power_ratio, rel=1e-9)


def test_weightless_kite_has_no_best_course(problem):
    found = representative_course(problem, gravity=False)
    assert found.course_deg is None
    assert "does not depend on the course" in found.note
    assert found.gravity_course_deg is None


def test_constant_reeling_speed_is_held_and_asks_for_a_steeper_course(problem):
    values = parameter_values(problem)
    path = figure_of_eight(27.0, 15.0, up=False)
    flown = fly_path(values, path, LENGTH_M, Winch("reeling_speed", 7.0))
    assert np.allclose(flown.states["reeling_speed"], 7.0, atol=1e-12)
    assert np.ptp(flown.states["tether_force_kite"]) > 100.0
    by_speed = representative_course(problem, path, reeling_speed_m_s=7.0)
    by_force = representative_course(problem, path)
    assert by_speed.gravity_course_deg > by_force.gravity_course_deg + 1.0


def test_courses_that_match_are_none_one_or_two():
    courses = np.linspace(0.0, 180.0, 61)

    def bowl(course):
        return 100.0 + (np.asarray(course) - 100.0) ** 2

    course, note = _matching_course(bowl, courses, bowl(courses), 325.0, 96.0)
    assert course == pytest.approx(85.0)
    assert "115.0 deg too" in note
    course, note = _matching_course(bowl, courses, bowl(courses), 99.0, 96.0)
    assert course is None
    assert "less power (99 W)" in note
    course, note = _matching_course(bowl, courses, bowl(courses), 1e4 + 200.0, 96.0)
    assert course is None
    assert "more power" in note
    flown = np.where(courses < 95.0, bowl(courses), np.nan)
    assert _matching_course(bowl, courses, flown, 325.0, 96.0) == (pytest.approx(85.0), "")


def test_too_heavy_a_kite_is_told_where_and_why(problem):
    with pytest.raises(UnflyableError, match="the path cannot be flown: no equilibrium of forces at 555 m") as caught:
        representative_course(problem, figure_of_eight(27.0, 15.0, up=False), 400.0)
    assert caught.value.reason in ("falling", "too_heavy")
    assert 0.0 < caught.value.facts["share_of_points"] < 1.0


def test_kite_blown_backwards_is_told_where(problem):
    values = parameter_values(problem).replaced({"kite.mass_kg": 70.0})
    # Every state is in equilibrium, but flying up the heavy kite is slower than the wind that blows it down.
    with pytest.raises(UnflyableError, match="does not move forward: its path speed is -") as caught:
        fly_path(values, circle(27.0, 13.0), LENGTH_M, Winch("reeling_speed", 3.0))
    assert caught.value.reason == "backwards"
    assert caught.value.facts["path_speed_m_s"] < 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "loop"}, "kind is 'loop'; it must be"),
        ({"amplitude_deg": 100.0}, "azimuth amplitude of the path is 100 deg"),
        ({"amplitude_deg": 60.0, "elevation_amplitude_deg": 40.0}, "keep it between 0 and 90 deg"),
        ({"tether_length_m": -1.0}, "the tether length is -1.0 m"),
        ({"reeling_speed_m_s": 0.0}, "no power to compare"),
    ],
)
def test_wrong_paths_are_told(problem, options, message):
    with pytest.raises(InputError, match=message):
        crosswind(problem, **options)


def test_wrong_mass_and_open_size_are_told(problem):
    with pytest.raises(InputError, match="mass of the kite is -1"):
        representative_course(problem, mass_kg=-1.0)
    centred = load_problem("strong-wind", {"operation.traction.azimuth_deg": 0.0})
    with pytest.raises(InputError, match="give its azimuth amplitude"):
        crosswind(centred)


def test_study_is_a_result_with_the_contract_of_a_time_series(study):
    assert study.status == "ok"
    assert list(study.channels)[: len(TIME_SERIES_CHANNELS)] == list(TIME_SERIES_CHANNELS)
    details = study.details["crosswind"]
    assert study["time_s"][-1] == pytest.approx(details["period_s"])
    for name in ("azimuth_deg", "elevation_deg", "power_W", "course_deg"):
        assert study[name][0] == study[name][-1]
    assert np.trapezoid(study["power_W"], study["time_s"]) / study["time_s"][-1] == pytest.approx(
        details["mean_power_W"], rel=1e-3
    )
    # The kite is where its speed takes it.
    climb = np.gradient(np.deg2rad(study["elevation_deg"][:-1]), study["time_s"][:-1])[5:-5]
    rate = -study["tangential_speed_m_s"] * np.cos(np.deg2rad(study["course_deg"])) / LENGTH_M
    assert np.allclose(climb, rate[5:-6], atol=1e-2 * np.ptp(rate))
    assert details["relative_error_of_averaging"] < 1e-9
    assert details["tether_length_change_m"] == pytest.approx(details["mean_reeling_speed_m_s"] * details["period_s"])


def test_reeling_along_is_within_what_the_study_says(problem, study):
    """Fly figure after figure at the lengths in between: the mean of many is that of Simpson's three."""
    details = study.details["crosswind"]
    values = parameter_values(problem)
    path = figure_of_eight(
        details["centre_elevation_deg"], details["azimuth_amplitude_deg"], details["elevation_amplitude_deg"], up=False
    )
    change = details["tether_length_change_m"]
    lengths = LENGTH_M + change * (np.arange(9) / 8 - 0.5)
    powers = [fly_path(values, path, length, HOLD).averages()["mean_power_W"] for length in lengths]
    mean = np.trapezoid(powers, dx=1 / 8)
    assert mean / details["mean_power_W"] - 1.0 == pytest.approx(details["relative_effect_of_length_change"], abs=2e-4)


def test_sweep_over_mass_has_every_path_and_says_what_cannot_be_flown(study):
    sweep = study.details["crosswind"]["masses"]
    assert list(sweep) == list(PATHS)
    for rows in sweep.values():
        assert [row["mass_kg"] for row in rows] == [0.0, 15.0, 300.0]
    assert sweep["eight-down"][1]["course_deg"] == pytest.approx(study.details["crosswind"]["comparison"]["course_deg"])
    assert "cannot be flown" in sweep["circle"][2]["message"]
    assert sweep["circle"][0]["course_deg"] is None
    assert "on no course" in sweep["circle"][0]["note"]
    table = crosswind_document(study).text()
    assert "heavy: the figure cannot be flown" in table
    assert "-: no course gives the power of the figure" in table
    assert f"{sweep['eight-up'][1]['course_deg']:.1f}" in table


def test_command_writes_summary_time_series_and_picture(tmp_path, capsys):
    assert main(["crosswind", "v3-kite", "--path", "circle", "-o", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["verb"], summary["status"]) == ("crosswind", "ok")
    comparison = summary["crosswind"]["comparison"]
    assert f"representative course with the power of the figure: {comparison['course_deg']:.1f} deg" in printed
    assert kiteocp.load_result(tmp_path)["azimuth_deg"].size == 129
    picture = matplotlib.image.imread(tmp_path / "crosswind.png")[..., :3]
    for half in np.array_split(picture, 2, axis=1):
        assert np.mean(np.any(half < 0.95, axis=-1)) > 0.01
    assert main(["plot", str(tmp_path), "--format", "svg", "-o", str(tmp_path / "again")]) == 0
    assert [path.name for path in (tmp_path / "again").iterdir()] == ["crosswind.svg"]


def test_command_with_too_heavy_a_kite_is_infeasible(tmp_path, capsys):
    words = ["crosswind", "strong-wind", "--set", "kite.mass_kg=400", "-o", str(tmp_path)]
    assert main(words) == 1
    assert "the path cannot be flown" in capsys.readouterr().err
    assert json.loads((tmp_path / "summary.json").read_text())["status"] == "infeasible"


def test_command_tells_a_circle_has_one_size(capsys):
    assert main(["crosswind", "strong-wind", "--path", "circle", "--azimuth-amplitude-deg", "9"]) == 2
    assert "a circle has one size" in capsys.readouterr().err
