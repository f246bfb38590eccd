"""Pictures: there, not blank, of every format, and one sentence where they cannot be."""

from __future__ import annotations

import io

import matplotlib.image
import msgspec
import numpy as np
import pytest
from made_result import make_optimum, make_result

from kiteocp import InputError
from kiteocp.plots import draw
from kiteocp.plots.cycle import compose_cycle, compose_optimum
from kiteocp.plots.pictures import composer
from kiteocp.plots.side_view import path_of, segments
from kiteocp.verbs import VERBS


def read_picture(path):
    return matplotlib.image.imread(io.BytesIO(path.read_bytes()))[..., :3]


@pytest.mark.parametrize("make", [make_result, make_optimum])
def test_picture_shows_something_in_every_quarter(tmp_path, make):
    (path,) = draw(make(), tmp_path)
    picture = read_picture(path)
    height, width, _ = picture.shape
    assert height >= 800
    assert width >= 1200
    for rows in (slice(0, height // 2), slice(height // 2, height)):
        for columns in (slice(0, width // 2), slice(width // 2, width)):
            # Text and lines cover a few per cent; a blank page nothing.
            assert np.mean(np.any(picture[rows, columns] < 0.95, axis=-1)) > 0.005


def test_every_format_is_written_and_says_what_it_is(tmp_path):
    paths = draw(make_result(), tmp_path / "deep", ("png", "svg", "pdf"))
    assert [path.name for path in paths] == ["cycle.png", "cycle.svg", "cycle.pdf"]
    marks = [path.read_bytes()[:5] for path in paths]
    assert marks == [b"\x89PNG\r", b"<?xml", b"%PDF-"]


@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_pictures_of_equal_results_are_equal(tmp_path, suffix):
    (one,) = draw(make_result(), tmp_path / "one", (suffix,))
    (other,) = draw(make_result(), tmp_path / "other", (suffix,))
    assert one.read_bytes() == other.read_bytes()


def test_optimum_names_both_powers_and_draws_both_cycles():
    figure = compose_optimum(make_optimum())
    texts = [text.get_text() for text in figure.texts]
    assert any("mean power 6.95 kW (prescribed 5.56 kW, +25.0 %)" in text for text in texts)
    assert any("limits.tether_force_min_N = 749 N (93 %)" in text for text in texts)
    assert not any("elevation_max_deg" in text for text in texts)  # met at one point only: in the table
    side = figure.axes[0]
    prescribed = path_of(make_result())
    assert any(np.array_equal(line.get_xdata(), prescribed[0]) for line in side.lines)


def test_no_two_labels_overlap():
    crowded = make_optimum().problem.with_values({"limits.generator_power_max_W": 7500.0})
    optimum = msgspec.structs.replace(make_optimum(), problem=crowded)
    for figure in (compose_cycle(make_result()), compose_optimum(optimum)):
        figure.canvas.draw()
        renderer = figure.canvas.get_renderer()
        texts = [*figure.texts, *(text for axes in figure.axes for text in axes.texts)]
        boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in texts if text.get_text()]
        overlaps = [
            (one, other)
            for index, (one, box) in enumerate(boxes)
            for other, other_box in boxes[index + 1 :]
            if box.overlaps(other_box)
        ]
        assert overlaps == []
        page = figure.bbox
        beyond = [
            text for text, box in boxes if box.x0 < page.x0 or box.x1 > page.x1 or box.y0 < page.y0 or box.y1 > page.y1
        ]
        assert beyond == []


def test_more_active_limits_than_there_is_room_for_are_owned_up_to():
    limit = {"limit": "limits.tether_force_max_N", "value": 3008.0, "share": 0.5}
    crowd = msgspec.structs.replace(make_optimum(), details={"active_limits": {"traction": [limit] * 40}})
    texts = [text.get_text() for text in compose_optimum(crowd).texts]
    assert "... and more in summary.json" in texts
    assert 5 < sum("tether_force_max_N" in text for text in texts) < 20


def test_axes_have_units():
    figure = compose_cycle(make_result())
    side, *panels = figure.axes
    assert "(m)" in side.get_xlabel()
    assert "(m)" in side.get_ylabel()
    assert [axes.get_ylabel().split("\n")[1] for axes in panels] == ["(m)", "(m/s)", "(kN)", "(kW)", "(deg)"]
    assert panels[-1].get_xlabel() == "time (s)"
    assert side.get_aspect() == 1.0


def test_segments_follow_the_phases():
    assert [(name, run.stop - run.start) for name, run in segments(make_result())] == [
        ("retraction", 5),
        ("transition", 5),
        ("traction", 5),
    ]


def test_a_cycle_without_prescribed_series_is_drawn_alone(tmp_path):
    (path,) = draw(make_result("solve"), tmp_path)
    assert path.stat().st_size > 20_000


def test_what_cannot_be_drawn_is_one_sentence(tmp_path):
    empty = make_result(channels={}, status="failed")
    with pytest.raises(InputError, match=r"simulate result of .* holds nothing to draw"):
        draw(empty, tmp_path)
    with pytest.raises(InputError, match="a saved validate result cannot be drawn again; run kiteocp validate"):
        draw(make_result("validate"), tmp_path)
    with pytest.raises(InputError, match="holds no time series"):
        compose_cycle(empty)
    with pytest.raises(InputError, match="picture format 'gif'"):
        draw(make_result(), tmp_path, ("gif",))
    assert list(tmp_path.iterdir()) == []


def test_every_picture_of_a_result_has_its_composer():
    for verb in VERBS:
        if verb.name != "validate":
            assert all(callable(composer(verb.name, stem)) for stem in verb.pictures)
    assert composer("solve", "cycle") is compose_optimum
