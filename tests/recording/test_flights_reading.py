"""A recording read: units, frames and senses against a flight that is known, and every fault counted."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_flight import kitepower_rows, made_flight, write_csv
from msgspec.structs import replace

from kiteocp import InputError
from kiteocp.recording import FlightData, load_columns, load_flight, shipped_columns
from kiteocp.recording.blocks import FACTORS
from kiteocp.recording.cleaning import circular_median_deg, drop_frozen, drop_spikes, off_tether, turn_directions
from kiteocp.recording.columns import ColumnMap

Rows = list[dict[str, Any]]


@cache
def flown() -> FlightData:
    """One cycle with a little noise, so that no sensor stands still."""
    from kiteocp.studies.estimation.synthetic import Noise  # noqa: PLC0415

    noise = Noise(0.1, 0.01, 0.05, 0.1, 0.1, 0.02)
    return made_flight(1, noise, seed=3)


@cache
def recorded() -> Rows:
    return kitepower_rows(flown())


def read(tmp_path: Path, spoil: Callable[[Rows], Any] | None = None, **options: Any) -> FlightData:
    return load_flight(write_csv(tmp_path / "flight.csv", recorded(), spoil), **options)


def assert_same_flight(found: FlightData, expected: FlightData, tolerance: float = 1e-6) -> None:
    assert len(found) == len(expected)
    assert found.phase.tolist() == expected.phase.tolist()
    for name, values in expected.arrays().items():
        # The height is not measured on its own: it follows from the place.
        if values.dtype.kind == "f" and name not in ("angle_of_attack_deg", "ground_wind_direction_deg", "height_m"):
            off = np.abs(getattr(found, name) - values)
            if name in ("course_deg", "azimuth_deg"):
                off = np.minimum(off, 360.0 - off)
            assert np.nanmax(off) < tolerance, name


def test_a_recording_is_the_flight_it_was_made_from(tmp_path: Path) -> None:
    found = read(tmp_path)
    assert dict(found.counts) == {}
    assert found.downwind_bearing_deg == pytest.approx(90.0)
    assert found.cycles() == (0,)
    assert_same_flight(found, flown())
    np.testing.assert_allclose(found.height_m, flown().distance_m * np.sin(np.radians(flown().elevation_deg)))


@cache
def flown_figure() -> FlightData:
    """A figure of eight whose velocity is the derivative of its position, which a representative state's is not."""
    flight = flown()
    time, length = flight.time_s, flight.tether_length_m
    elevation, azimuth = 30.0 + 6.0 * np.sin(0.8 * time), 25.0 * np.sin(0.4 * time)
    radial = np.gradient(length, time)
    polar = -length * np.radians(4.8 * np.cos(0.8 * time))
    azimuthal = length * np.cos(np.radians(elevation)) * np.radians(10.0 * np.cos(0.4 * time))
    return replace(
        flight, distance_m=length, elevation_deg=elevation, azimuth_deg=azimuth, radial_speed_m_s=radial,
        polar_speed_m_s=polar, azimuthal_speed_m_s=azimuthal, reeling_speed_m_s=radial,
        course_deg=np.degrees(np.arctan2(azimuthal, polar)) % 360.0,
    )  # fmt: skip


def read_figure(tmp_path: Path, spoil: Callable[[Rows], Any] | None = None, **options: Any) -> FlightData:
    rows = kitepower_rows(flown_figure())
    return load_flight(write_csv(tmp_path / "flight.csv", rows, spoil), **options)


def rewritten(rows: Rows, changes: dict[str, Callable[[float], float]], renamed: dict[str, str]) -> Rows:
    return [{renamed.get(k, k): changes[k](v) if k in changes else v for k, v in row.items()} for row in rows]


def test_units_frames_and_senses_of_another_layout(tmp_path: Path) -> None:
    """The same flight in knots, feet and pounds, east-north-up, courses from below, directions towards."""
    factor = {name: FACTORS[name] for name in ("kn", "ft", "lbf", "min", "kgf")}
    rows = rewritten(
        recorded(),
        {
            "time": lambda t: (t - 1.6e9) / factor["min"],
            "kite_pos_east": lambda x: x / factor["ft"],
            "kite_course": lambda c: np.degrees(np.pi - c) % 360.0,
            "ground_tether_force": lambda f: f * factor["kgf"] / factor["lbf"],
            "ground_tether_reelout_speed": lambda v: -3.6 * v,
            "ground_upwind_direction": lambda d: (d + 180.0) % 360.0,
            **{f"kite_0_v{axis}": lambda v: v / factor["kn"] for axis in "xy"},
            "kite_0_vz": lambda v: -v / factor["kn"],
        },
        {"kite_0_vz": "climb"},
    )
    text = shipped_columns()["kitepower"].read_text()
    for old, new in (
        ("{column: time, unit: s}", "{column: time, unit: min}"),
        ("kite_pos_east, unit: m}", "kite_pos_east, unit: ft}"),
        ("unit: rad, zero: up, sense: counter-clockwise", "unit: deg, zero: down, sense: clockwise"),
        ("ground_tether_force, unit: kgf", "ground_tether_force, unit: lbf"),
        ("reelout_speed, unit: m/s", "reelout_speed, unit: km/h, sign: -1"),
        ("unit: deg, of: from", "unit: deg, of: to"),
        (
            "frame: NED, columns: [kite_0_vx, kite_0_vy, kite_0_vz], unit: m/s",
            "frame: ENU, columns: [kite_0_vy, kite_0_vx, climb], unit: kn",
        ),
    ):
        assert old in text, old
        text = text.replace(old, new)
    (tmp_path / "map.yaml").write_text(text)
    found = load_flight(write_csv(tmp_path / "flight.csv", rows), str(tmp_path / "map.yaml"))
    assert dict(found.counts) == {}
    assert_same_flight(found, flown())


def test_a_spherical_layout_without_cycle_numbers(tmp_path: Path) -> None:
    flight = flown()
    rows = [
        {
            "t": t, "p": p, "r": r, "el": el, "az": 40.0 - az, "vr": vr, "vp": vp, "va": va, "v": v, "f": f,
        }
        for t, p, r, el, az, vr, vp, va, v, f in zip(
            flight.time_s, flight.phase, flight.distance_m, flight.elevation_deg, flight.azimuth_deg,
            flight.radial_speed_m_s, flight.polar_speed_m_s, flight.azimuthal_speed_m_s, flight.reeling_speed_m_s,
            flight.tether_force_ground_N, strict=True,
        )
    ]  # fmt: skip
    layout = msgspec.convert(
        {
            "name": "mine",
            "downwind_bearing_deg": 130.0,
            "time": {"column": "t", "unit": "s"},
            "phase": {"column": "p", "labels": {p: p for p in ("retraction", "transition", "traction")}},
            "position": {
                "frame": "spherical",
                "distance": {"column": "r", "unit": "m"},
                "elevation": {"column": "el", "unit": "deg"},
                # Its zero is 40 deg to the left of downwind.
                "azimuth": {"column": "az", "unit": "deg", "sense": "clockwise", "zero_bearing_deg": 90.0},
            },
            "velocity": {"frame": "spherical", "columns": ["vr", "vp", "va"], "unit": "m/s"},
            "reeling_speed": {"column": "v", "unit": "m/s"},
            "tether_force": {"column": "f", "unit": "N"},
        },
        ColumnMap,
    )
    found = load_flight(write_csv(tmp_path / "flight.csv", rows), layout)
    np.testing.assert_allclose(found.azimuth_deg, flight.azimuth_deg, atol=1e-9)
    assert found.downwind_bearing_deg == 130.0
    # The traction begins once, after retraction and transition.
    assert found.cycles() == (0, 1)
    assert set(found.phase[found.cycle == 1].tolist()) == {"traction"}


def spoil_times(rows: Rows) -> None:
    rows[20], rows[21] = rows[21], rows[20]
    rows.append(dict(rows[50]))
    rows[30]["time"] = ""


def spoil_values(rows: Rows) -> None:
    rows[40]["ground_tether_force"] = "broken"
    rows[41]["ground_tether_force"] = ""
    rows[60]["ground_tether_force"] = -5.0
    rows[80]["kite_0_vx"] += 60.0
    for row in rows[100:150]:
        row["airspeed_apparent_windspeed"] = rows[100]["airspeed_apparent_windspeed"]
    for row in rows[200:260]:
        row["ground_upwind_direction"] = (row["ground_upwind_direction"] + 180.0) % 360.0
    for row in rows[300:310]:
        row["kite_height"] += 60.0
    for row in rows[5:10]:
        row["flight_phase"] = "landing"
    for row in rows[350:370]:
        row["kite_course"] += 1.5


def test_every_fault_is_counted_once_and_left_out(tmp_path: Path) -> None:
    found = read(tmp_path, spoil_times)
    # The copy of row 50 stands at the end: late, and a repetition. So does the first of the two swapped rows.
    assert dict(found.counts) == {"rows_out_of_order": 2, "rows_repeated_time": 1, "rows_without_time": 1}
    assert len(found) == len(flown()) - 1
    assert np.all(np.diff(found.time_s) > 0)
    found = read(tmp_path, spoil_values)
    assert dict(found.counts) == {
        "rows_without_phase": 5,
        "values_course_disagrees": 20,
        "values_frozen": 49,
        "values_missing": 2,
        "values_out_of_range": 1,
        "values_position_off_tether": 10,
        "values_spikes": 1,
        "values_unreadable": 1,
        "values_wind_direction_turned": 60,
    }
    assert np.isnan(found.tether_force_ground_N[[40, 41, 60]]).all()
    assert np.isnan(found.elevation_deg[300:310]).all()
    assert found.ground_wind_direction_deg == pytest.approx(270.0)
    untouched = np.r_[10:40, 160:200, 400 : len(found)]
    assert_same_flight(found.where(np.isin(np.arange(len(found)), untouched)), flown().where(
        np.isin(np.arange(len(found)), untouched)
    ))  # fmt: skip


def test_gaps_are_counted_and_stay_gaps(tmp_path: Path) -> None:
    def spoil(rows: Rows) -> None:
        del rows[100:140]
        del rows[300:303]

    found = read(tmp_path, spoil)
    assert dict(found.counts) == {"gaps": 2}
    assert len(found) == len(flown()) - 43


def drop_column(name: str) -> Callable[[Rows], None]:
    return lambda rows: [row.pop(name) for row in rows] and None


@pytest.mark.parametrize(
    ("spoil", "options", "part"),
    [
        (drop_column("ground_tether_force"), {}, "kitepower lacks ground_tether_force"),
        (drop_column("ground_tether_force"), {"columns": "kitepower"}, "has no column ground_tether_force"),
        (None, {"columns": "kitepowre"}, "did you mean kitepower?"),
        (lambda rows: [row.update(flight_phase="landed") for row in rows], {}, "holds none of the labels"),
        (lambda rows: rows.__delitem__(slice(1, None)), {}, "time"),
        (lambda rows: [row.update(time="now") for row in rows], {}, "has no times in column time"),
        (lambda rows: [row.update(ground_tether_force="?") for row in rows], {}, "tether_force_ground_N"),
        (lambda rows: [row.update(kite_height=1e9) for row in rows], {}, "no usable value of distance_m"),
    ],
)
def test_what_cannot_be_read_is_one_sentence_with_its_remedy(
    tmp_path: Path, spoil: Any, options: dict[str, Any], part: str
) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, spoil, **options)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "holds no samples"),
        (b"a,b\n", "holds no samples"),
        (b"\xff\xfe\x00", "is not UTF-8"),
        (None, "no such file"),
    ],
)
def test_a_file_that_is_no_recording(tmp_path: Path, content: bytes | None, part: str) -> None:
    path = tmp_path / "flight.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=part):
        load_flight(path)
    with pytest.raises(InputError, match="is a directory"):
        load_flight(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("unit: kgf", "unit: lb", "tether_force.unit is 'lb'; it can be N, kN"),
        ("unit: kgf", "units: kgf", "did you mean tether_force.unit?"),
        ("frame: NED", "frame: NEDD", "velocity.frame is 'NEDD'; it can be NED, ENU, spherical"),
        ("frame: cartesian", "frame: polar", "position.frame is 'polar'; it can be cartesian, spherical"),
        ("pp-ri: retraction", "pp-ri: reel-in", "phase.labels.pp-ri is 'reel-in'; it can be retraction"),
        ("tether_force:", "tether_forces:", "did you mean tether_force?"),
        ("zero: up", "zero: left", "course.zero is 'left'; it can be up, down"),
        ("kite_actual_depower}", "kite_actual_depower, powered: 62.0, depowered: 62.0}", "are both 62"),
        ("kite_actual_depower}", "kite_actual_depower, powered: 30.0, depowered: 50.0}", "power_setting.powered is 30"),
    ],
)
def test_a_wrong_map_names_its_key(tmp_path: Path, old: str, new: str, part: str) -> None:
    text = shipped_columns()["kitepower"].read_text()
    assert old in text
    path = tmp_path / "map.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read(tmp_path, columns=str(path))
    assert part in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("unit: rad, sense: clockwise}", "unit: rad, sense: counter-clockwise}", "position.azimuth.sense"),
        ("[kite_0_vx, kite_0_vy,", "[kite_0_vy, kite_0_vx,", "change places"),
        ("frame: NED", "frame: ENU", "velocity"),
        ("kite_0_vz], unit: m/s", "kite_0_vz], unit: kn", "velocity.unit"),
        ("reelout_speed, unit: m/s}", "reelout_speed, unit: m/s, sign: -1}", "has the opposite sign"),
        ("zero: up, sense: counter-clockwise", "zero: down, sense: counter-clockwise", "kite_course contradicts"),
        ("zero: up, sense: counter-clockwise", "zero: up, sense: clockwise", "correct course.sense"),
        ("unit: deg, of: from}\nwind", "unit: deg, of: to}\nwind", "ground_wind_direction.of"),
    ],
)
def test_a_map_that_contradicts_itself_is_named(tmp_path: Path, old: str, new: str, part: str) -> None:
    text = shipped_columns()["kitepower"].read_text()
    assert old in text
    path = tmp_path / "map.yaml"
    path.write_text(text.replace(old, new, 1))
    assert part in " ".join(read_figure(tmp_path, columns=str(path)).warnings)
    assert read_figure(tmp_path).warnings == ()


@pytest.mark.parametrize(
    ("factor", "part"),
    [
        (1.0, None),
        (9.80665, "is on the whole"),
        (0.001, "correct unit or sign of tether_force, reeling_speed or mechanical_power"),
        (-1.0, "has the opposite sign of ground_tether_force times ground_tether_reelout_speed"),
    ],
)
def test_a_power_in_another_unit_is_told_from_another_power(tmp_path: Path, factor: float, part: str | None) -> None:
    """As in the open data the recorded power is 1.1 times force times speed in reel-out and 2.3 times in reel-in."""

    def spoil(rows: Rows) -> None:
        for row in rows:
            product = 9.80665 * row["ground_tether_force"] * row["ground_tether_reelout_speed"]
            row["ground_mech_power"] = factor * (1.1 if product > 0 else 2.3) * product

    found = read_figure(tmp_path, spoil)
    if part is None:
        assert found.warnings == ()
        assert any("1.1 times it in the traction and 2.3 times it in the retraction" in note for note in found.notes)
    else:
        assert part in " ".join(found.warnings)


def test_the_course_tells_a_wrong_azimuth_where_there_is_no_velocity(tmp_path: Path) -> None:
    text = shipped_columns()["kitepower"].read_text()
    lines = [line for line in text.splitlines() if not line.startswith("velocity:")]
    start, end = lines.index("position:"), next(i for i, line in enumerate(lines) if line.startswith("course:"))
    lines[start:end] = [
        "position:",
        "  frame: spherical",
        "  distance: {column: kite_distance, unit: m}",
        "  elevation: {column: kite_elevation, unit: rad}",
        "  azimuth: {column: kite_azimuth, unit: rad, sense: counter-clockwise, zero_bearing_deg: 30}",
    ]
    path = tmp_path / "map.yaml"
    path.write_text("\n".join(lines))

    def spoil(rows: Rows) -> None:
        for row in rows:
            place = np.array([row["kite_pos_east"], row["kite_pos_north"], row["kite_height"]])
            row["kite_distance"] = float(np.linalg.norm(place))
            row["kite_elevation"] = float(np.arcsin(row["kite_height"] / row["kite_distance"]))

    warnings = " ".join(read_figure(tmp_path, spoil, columns=str(path)).warnings)
    assert "kite_course contradicts the motion of the position" in warnings
    assert "correct course.sense, or position.azimuth.sense" in warnings


def test_whole_seconds_the_ground_and_other_levels(tmp_path: Path) -> None:
    """Ten samples a second with the time in whole seconds, the first minute on the ground, another depower tape."""

    def spoil(rows: Rows) -> None:
        for row in rows:
            row["kite_actual_depower"] = 41.5 + 0.5 * (row["kite_actual_depower"] - 38.0)
        start = rows[0]["time"]
        lying = {**rows[0], **dict.fromkeys(("kite_height", "kite_0_vx", "kite_0_vy", "kite_0_vz"), 0.0)}
        rows[:0] = [{**lying, "time": start - 60.0 + 0.1 * index} for index in range(600)]
        for row in rows:
            row["time"] = float(np.floor(row["time"] + 1e-6))

    found = read_figure(tmp_path, spoil)
    assert found.counts["rows_on_ground"] == 600
    assert found.counts["rows_time_rebuilt"] == len(flown()) + 600
    np.testing.assert_allclose(found.time_s - found.time_s[0], flown().time_s, atol=0.02)
    assert any("was rebuilt from the order of the rows" in text for text in found.warnings)
    np.testing.assert_allclose(found.power_setting, flown().power_setting)


def test_without_a_velocity_the_position_is_differentiated(tmp_path: Path) -> None:
    text = shipped_columns()["kitepower"].read_text()
    path = tmp_path / "map.yaml"
    path.write_text("\n".join(line for line in text.splitlines() if not line.startswith("velocity:")))
    found = read_figure(tmp_path, columns=str(path))
    # A parabola over 0.4 s to either side loses 1 to 2 % of motions of 0.1 Hz.
    off = found.azimuthal_speed_m_s - flown_figure().azimuthal_speed_m_s
    assert np.nanmedian(np.abs(off)) < 0.02 * np.max(np.abs(flown_figure().azimuthal_speed_m_s))
    assert np.isfinite(off).mean() > 0.95


def test_shipped_maps_load_and_go_with_the_package() -> None:
    assert "kitepower" in shipped_columns()
    for name, path in shipped_columns().items():
        assert load_columns(name).name == name
        assert path.parent.name == "recording"


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(100, 400),
    st.lists(st.integers(20, 80), unique=True, max_size=4),
)
def test_spikes_are_found_and_nothing_else_of_a_smooth_signal(seed: int, size: int, places: list[int]) -> None:
    random = np.random.default_rng(seed)
    time = 0.1 * np.arange(size)
    smooth = 10.0 * np.sin(0.7 * time + random.uniform(0, 6)) + random.normal(scale=0.1, size=size)
    spoilt = smooth.copy()
    # Apart from each other: two in a row are no single wrong value.
    places = [place for place in places if all(abs(place - other) > 10 for other in places if other < place)]
    spoilt[places] += 30.0
    assert drop_spikes(spoilt, time) == len(places)
    assert np.flatnonzero(np.isnan(spoilt)).tolist() == sorted(places)


def test_a_frozen_sensor_and_one_constant_by_nature() -> None:
    time = 0.1 * np.arange(300)
    values = np.sin(time)
    values[100:140] = values[100]
    assert drop_frozen(values, time) == 39
    assert np.isfinite(values[100])
    assert drop_frozen(np.repeat([1.0, 2.0], 150), time) == 0


def test_directions_and_positions() -> None:
    turned, count = turn_directions(np.array([250.0, 70.0, 300.0, np.nan]), 70.0)
    np.testing.assert_allclose(turned, [250.0, 250.0, 300.0, np.nan])
    assert count == 1
    assert circular_median_deg(np.array([350.0, 10.0, 0.0, 2.0, 358.0])) == pytest.approx(0.0, abs=1e-9)
    length = np.full(50, 200.0)
    distance = length + 20.0 + np.linspace(-3, 3, 50)
    distance[7] += 15.0
    assert np.flatnonzero(off_tether(distance, length)).tolist() == [7]
    assert not off_tether(distance, np.full(50, np.nan)).any()


def test_flights_are_selected_and_refused() -> None:
    flight = flown()
    parts = [flight.select([0], phase) for phase in ("retraction", "transition", "traction", "turn")]
    assert [len(part) for part in parts][3] == 0
    assert sum(map(len, parts)) == len(flight.select([0])) == len(flight)
    assert len(flight.select(phase=["retraction", "traction"])) == len(parts[0]) + len(parts[2])
    with pytest.raises(ValueError, match="one common length"):
        FlightData(**{**flight.arrays(), "course_deg": np.zeros(3)})
