"""Saving and loading: the same numbers again, and whole files or none."""

from __future__ import annotations

import errno
import json
import os

import numpy as np
import pytest
from made_result import make_optimum, make_result

from kiteocp import InputError, Result, load_result, writing
from kiteocp.result import TIME_SERIES_CHANNELS


@pytest.mark.parametrize("make", [make_result, make_optimum])
def test_round_trip_is_exact(tmp_path, make):
    result = make()
    result.save(tmp_path)
    again = load_result(tmp_path)
    assert again.summary() == result.summary()
    assert again.problem == result.problem
    for one, other in ((result, again), (result.prescribed, again.prescribed)):
        if one is None:
            assert other is None
            continue
        assert set(one.channels) == set(other.channels)
        assert all(np.array_equal(one[name], other[name]) for name in one.channels)


def test_columns_come_in_the_order_of_the_contract_and_others_after(tmp_path):
    make_result().save(tmp_path)
    header, first, *rows = (tmp_path / "timeseries.csv").read_text().splitlines()
    names = header.split(",")
    assert tuple(names[: len(TIME_SERIES_CHANNELS)]) == TIME_SERIES_CHANNELS
    assert names[len(TIME_SERIES_CHANNELS) :] == ["winch_torque_N_m"]
    assert first.startswith("0.0,retraction,720.0,27.0,")
    assert len(rows) == 14


def test_a_number_that_is_not_finite_is_an_empty_cell(tmp_path):
    channels = {"time_s": np.array([0.0, 1.0]), "phase": np.array(["traction"] * 2), "power_W": [np.nan, 2.0]}
    make_result(channels=channels).save(tmp_path)
    assert (tmp_path / "timeseries.csv").read_text() == "time_s,phase,power_W\n0.0,traction,\n1.0,traction,2.0\n"
    assert np.isnan(load_result(tmp_path)["power_W"][0])


def test_files_have_ordinary_permissions(tmp_path):
    plain = tmp_path / "plain"
    plain.touch()
    make_result().save(tmp_path)
    assert (tmp_path / "summary.json").stat().st_mode == plain.stat().st_mode


def fail_with(code):
    def fail(*_arguments, **_options):
        raise OSError(code, os.strerror(code))

    return fail


@pytest.mark.parametrize("function", ["replace", "fsync"])
def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch, function):
    make_result().save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(writing.os, function, fail_with(errno.ENOSPC))
    with pytest.raises(InputError, match="No space left on device") as caught:
        make_optimum().save(tmp_path)
    assert "\n" not in str(caught.value)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_interruption_leaves_nothing_half_written(tmp_path, monkeypatch):
    def interrupt(_descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(writing.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        make_result().save(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_place_of_the_directory_is_one_sentence(tmp_path):
    (tmp_path / "taken").write_text("mine")
    for directory in (tmp_path / "taken", tmp_path / "taken" / "below"):
        with pytest.raises(InputError, match="cannot be written"):
            make_result().save(directory)
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_directory_in_place_of_a_file_changes_no_other_file(tmp_path):
    (tmp_path / "timeseries.csv").mkdir()
    with pytest.raises(InputError, match=r"timeseries\.csv: cannot be written"):
        make_result().save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["timeseries.csv"]


def test_a_failure_does_not_keep_the_series_of_an_earlier_success(tmp_path):
    make_optimum().save(tmp_path)
    (tmp_path / "cycle.png").write_bytes(b"old")
    (tmp_path / "notes.txt").write_text("mine")
    Result("solve", make_result().problem, "failed", details={"message": "no"}).save(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "summary.json"]
    loaded = load_result(tmp_path)
    assert loaded.status == "failed"
    assert not loaded.channels
    assert loaded.phases == {}


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (None, "holds no summary.json"),
        ("{", "is not JSON"),
        ("[]", "schema_version is None"),
        ('{"schema_version": 2}', "schema_version is 2"),
        ('{"schema_version": 1}', "is not a complete result"),
        ('{"schema_version": 1, "input": {"name": "x"}, "input_sha256": "0"}', "summary.json"),
    ],
)
def test_a_directory_without_a_result_is_one_sentence(tmp_path, damage, sentence):
    if damage is not None:
        (tmp_path / "summary.json").write_text(damage)
    with pytest.raises(InputError, match=sentence) as caught:
        load_result(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("damage", ["", "time_s,power_W\n1.0\n", "time_s\nfast\n", "time_s,power_W\n1,2,3\n"])
def test_a_damaged_time_series_is_one_sentence(tmp_path, damage):
    make_result().save(tmp_path)
    (tmp_path / "timeseries.csv").write_text(damage)
    with pytest.raises(InputError, match=r"timeseries\.csv"):
        load_result(tmp_path)


def test_a_result_with_text_in_place_of_numbers_is_one_sentence(tmp_path):
    make_result().save(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    summary["phases"] = "none"
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(InputError, match="is not a complete result"):
        load_result(tmp_path)
