"""Names in pictures: none covers another or a line, axes speak in words, and text from a file is text."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from made_result import make_optimum, make_result
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from kiteocp import load_problem, simulate, solve
from kiteocp.cli.main import main
from kiteocp.plots import draw
from kiteocp.plots.cycle import compose_cycle, compose_optimum
from kiteocp.plots.labels import extent, place
from kiteocp.plots.sensitivity import compose_variation
from kiteocp.plots.side_view import path_of
from kiteocp.plots.style import make_figure, write_line
from kiteocp.plots.words import label_of, words_of
from kiteocp.problem.catalogue import catalogue
from kiteocp.result import Result
from kiteocp.studies.sensitivity.sobol_report import _histogram

PHASES = ("retraction", "transition", "traction")


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the problem file that README begins with."""
    path = tmp_path_factory.mktemp("new") / "my-kite.yaml"
    assert main(["new", "my-kite", "-o", str(path)]) == 0
    return path


def readme_example(template: Path) -> Result:
    changes = {"environment.wind.reference_speed_m_s": 7, "operation.force_reference": "ground"}
    return simulate(load_problem(template, changes))


def covering(figure: Figure) -> list[tuple[str, str]]:
    """Return the pairs of names, of all axes, that cover each other."""
    figure.canvas.draw()
    texts = [t for axes in figure.axes for t in axes.texts if t.get_text() and t.get_visible()]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    return [(a, b) for (a, one), (b, other) in itertools.combinations(boxes, 2) if one.overlaps(other)]


def test_names_in_the_picture_of_the_first_example_of_readme_cover_nothing(template: Path) -> None:
    result = readme_example(template)
    figure = compose_cycle(result)
    assert covering(figure) == []
    side = figure.axes[0]
    steps = np.linspace(0.0, len(result["time_s"]) - 1.0, 4000)
    path = [np.interp(steps, np.arange(len(part)), part) for part in path_of(result)]
    flown = side.transData.transform(np.column_stack(path))
    for text in side.texts:
        if text.get_text() in PHASES:
            assert text.get_window_extent().count_contains(flown) == 0, text.get_text()


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind", "v3-kite", "v9-kite"])
def test_names_in_the_pictures_of_shipped_optima_cover_nothing(name: str) -> None:
    assert covering(compose_optimum(solve(load_problem(name), certificate="quick"))) == []


@pytest.mark.parametrize("make", [make_result, make_optimum])
@pytest.mark.parametrize("text", ["costs $5", r"$\frac{1}{", "$x_1^{2$ and $y$", "two\nlines", "many words " * 60])
def test_a_description_is_written_as_it_stands(make: object, text: str, tmp_path: Path) -> None:
    result = make()  # type: ignore[operator]
    msgspec.structs.force_setattr(result, "problem", load_problem("strong-wind", {"description": text}))
    [path] = draw(result, tmp_path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_line_ends_where_the_figure_does() -> None:
    figure = make_figure(6.0, 2.0)
    write_line(figure, 0.9, "a short one")
    write_line(figure, 0.5, "so many words " * 30)
    write_line(figure, 0.1, "$" * 500)
    short, *long = figure.texts
    assert short.get_text() == "a short one"
    for text in long:
        assert text.get_text().endswith(" ...")
        box = text.get_window_extent()
        assert 0.8 * figure.bbox.width < box.width < figure.bbox.width


def test_every_number_of_the_problem_file_has_words_for_an_axis() -> None:
    numbers = [key for key in catalogue().walk() if key.unit]
    assert len(numbers) > 40
    for key in numbers:
        words = words_of(key.path)
        assert "_" not in words, words
        assert label_of(key.path) == (words if key.unit == "1" else f"{words} ({key.unit})")
    assert label_of("limits.tether_force_max_N") == "limit: maximum tether force (N)"
    assert words_of("kite.powered.lift_to_drag") == "powered kite: lift-to-drag ratio"
    assert label_of("environment.wind.speeds_m_s[3]") == "wind: speeds[3] (m/s)"


def test_axes_of_a_variation_speak_in_words() -> None:
    limits = {"traction": [{"limit": "limits.tether_force_max_N", "share": 1.0}]}
    points = [{"value": v, "mean_power_W": 1e3 * v, "tangent_W": None, "active_limits": limits} for v in (10.0, 20.0)]
    made = make_result("sensitivity", details={"variation": {"key": "kite.mass_kg", "points": points}})
    power, active = compose_variation(made).axes
    assert active.get_xlabel() == "kite: mass (kg)"
    assert [tick.get_text() for tick in active.get_yticklabels()] == ["traction: maximum tether force"]
    assert power.get_ylabel() == "optimal mean power (kW)"


@pytest.mark.parametrize("count", [2, 16, 64, 400, 5000])
def test_a_histogram_has_no_more_bars_than_its_samples_fill(count: int) -> None:
    powers = np.random.default_rng(1).normal(5e3, 5e2, count).tolist()
    histogram = _histogram(powers)
    assert sum(histogram["counts"]) == count
    assert len(histogram["counts"]) == min(math.ceil(math.sqrt(count)), 24)


@pytest.mark.parametrize("across", ["left", "center", "right"])
@pytest.mark.parametrize("up", ["bottom", "center", "top"])
def test_a_name_is_placed_by_the_box_that_it_will_have(across: str, up: str) -> None:
    axes = make_figure(6.0, 4.0).add_axes((0.1, 0.1, 0.8, 0.8))
    name = axes.annotate("graph", (0.5, 0.5), xytext=(7, -4), textcoords="offset points", ha=across, va=up)
    box = extent(name)
    (x, y), hair = 0.5 * (box.min + box.max), 0.01
    near = ((0.5, 0.5), (7, -4), across, up)
    far = ((0.1, 0.1), (0, 0), "left", "bottom")
    for side in ((box.x0, y, -hair), (box.x1, y, hair), (x, box.y0, -hair), (x, box.y1, hair)):
        *point, outwards = side
        along = np.array([outwards, 0.0] if point[1] == y else [0.0, outwards])
        for step, expected in ((along, near), (-along, far)):
            spot = Bbox([np.array(point) + step - 1e-6, np.array(point) + step + 1e-6])
            place(name, [near, far], [], [spot])
            assert (name.xy, name.xyann, name.get_ha(), name.get_va()) == expected
