"""Figures of the validation: every one there, with the curves of the results it was given, and quick to draw."""

from __future__ import annotations

import io

import matplotlib.image
import numpy as np
import pytest

from kiteocp import load_problem, simulate
from kiteocp.plots.style import BLUE, INK, figure_bytes, phase_colour
from kiteocp.plots.validation import figures
from kiteocp.plots.validation_studies import draw_mass_isolines, isoline_levels
from kiteocp.studies.paper.captions import CAPTIONS
from kiteocp.studies.paper.convergence import Convergence, Curve
from kiteocp.studies.paper.isolines import GravityIsolines, mass_isolines

INCLUDED, EXCLUDED = "gravity included", "gravity excluded"


@pytest.fixture(scope="module")
def cases():
    return {
        name: {gravity: simulate(load_problem(name), gravity=gravity == INCLUDED) for gravity in (INCLUDED, EXCLUDED)}
        for name in ("strong-wind", "moderate-wind")
    }


def made_convergence():
    """First-order curves of four slopes, one of them with a time step that failed."""
    steps = np.geomspace(0.3, 1e-4, 9)
    curves = {}
    for slope, name in enumerate(("strong wind, gravity included", "strong wind, gravity excluded", "third", "fourth")):
        ratios = 1.0 - (0.5 + slope) * (steps - 1e-4)
        if slope == 3:
            ratios[0] = np.nan
        curves[name] = Curve(steps, ratios, 1.0 + 1e-4 * slope, 3.0 / steps)
    return Convergence(curves)


def made_isolines(lift_to_drag=5.0):
    """Mass growing away from the lift-to-drag ratio, upward on one side of it and downward on the other."""
    course, ratio = np.linspace(0.0, 360.0, 49), np.linspace(0.5, 9.5, 37)
    mass = 40.0 * (ratio[:, None] - lift_to_drag) * np.cos(np.deg2rad(course))[None, :]
    return GravityIsolines(course, ratio, np.where(mass >= 0.0, mass, np.nan), lift_to_drag)


@pytest.fixture(scope="module")
def drawn(cases):
    return {stem: draw() for stem, draw in figures(cases, made_convergence(), made_isolines()).items()}


def lines_like(axes, x, y):
    return [
        line
        for line in axes.lines
        if len(line.get_xdata()) == len(x) and np.allclose(line.get_xdata(), x) and np.allclose(line.get_ydata(), y)
    ]


def test_every_figure_has_a_caption(drawn):
    assert list(drawn) == list(CAPTIONS)
    assert len(set(CAPTIONS.values())) == len(CAPTIONS) == 10


@pytest.mark.parametrize(
    ("stem", "channel", "factor"),
    [
        ("tether_length", "tether_length_m", 1.0),
        ("reeling_speed", "reeling_speed_m_s", 1.0),
        ("flight_speed", "kite_speed_m_s", 1.0),
        ("wind_speed", "wind_speed_m_s", 1.0),
        ("wind_speed", "apparent_wind_speed_m_s", 1.0),
        ("tether_force", "tether_force_ground_N", 1e-3),
        ("power", "power_W", 1e-3),
    ],
)
def test_every_phase_of_every_cycle_is_a_line_of_its_own(cases, drawn, stem, channel, factor):
    for axes, cycles in zip(drawn[stem].axes, cases.values(), strict=True):
        for gravity, colour in ((INCLUDED, INK), (EXCLUDED, BLUE)):
            cycle = cycles[gravity]
            for phase in cycle.phases:
                x, y = cycle.channel("time_s", phase), factor * cycle.channel(channel, phase)
                (line,) = lines_like(axes, x, y)
                assert line.get_color() == colour
                assert (line.get_linestyle() == "-") == (gravity == INCLUDED)


def test_phases_are_shaded_where_the_cycle_with_gravity_has_them(cases, drawn):
    for axes, cycles in zip(drawn["power"].axes, cases.values(), strict=True):
        cycle = cycles[INCLUDED]
        # A band is a rectangle or a polygon, as the version of matplotlib has it.
        outlines = (patch.get_path().transformed(patch.get_patch_transform()) for patch in axes.patches)
        bands = sorted(outline.get_extents().intervalx.tolist() for outline in outlines)
        times = [cycle.channel("time_s", phase) for phase in ("retraction", "transition", "traction")]
        assert np.allclose(bands, [(time[0], time[-1]) for time in times])


def test_phase_changes_without_gravity_are_marked_on_its_curve(cases, drawn):
    for axes, cycles in zip(drawn["reeling_speed"].axes, cases.values(), strict=True):
        cycle = cycles[EXCLUDED]
        (marks,) = [line for line in axes.lines if line.get_marker() == "o"]
        ends = [cycle.channel("time_s", phase)[-1] for phase in ("retraction", "transition")]
        assert np.allclose(marks.get_xdata(), ends)


def test_side_view_keeps_angles_and_shows_every_phase_and_the_ground_station(cases, drawn):
    for axes, cycles in zip(drawn["side_view"].axes, cases.values(), strict=True):
        assert axes.get_aspect() == 1.0
        low, high = axes.get_xlim()
        assert low < 0.0 < high
        for cycle in cycles.values():
            for phase in cycle.phases:
                elevation = np.deg2rad(cycle.channel("elevation_deg", phase))
                x = cycle.channel("tether_length_m", phase) * np.cos(elevation)
                (line,) = lines_like(axes, x, cycle.channel("height_m", phase))
                assert line.get_color() == phase_colour(phase)
                assert low <= x.min()
                assert x.max() <= high
                assert line.get_ydata().max() <= axes.get_ylim()[1]


def test_angular_coordinates_have_the_place_of_the_traction_and_the_ends_of_the_retractions(cases, drawn):
    for axes, cycles in zip(drawn["angular_coordinates"].axes, cases.values(), strict=True):
        traction = cycles[INCLUDED].problem.operation.traction
        dots = {
            (float(line.get_xdata()[0]), float(line.get_ydata()[0])) for line in axes.lines if line.get_marker() == "o"
        }
        assert np.allclose(list(dots), [(traction.azimuth_deg, traction.elevation_deg)])
        ends = {f"{cycle.phases['retraction']['elevation_end_deg']:.1f} deg" for cycle in cycles.values()}
        assert {text.get_text() for text in axes.texts} == ends


def test_convergence_shows_four_curves_apart_the_band_and_the_adaptive_integrator(drawn):
    (axes,) = drawn["convergence"].axes
    convergence = made_convergence()
    looks = set()
    for name, curve in convergence.curves.items():
        flown = np.isfinite(curve.ratios)
        (line,) = lines_like(axes, curve.time_steps[flown], curve.ratios[flown])
        assert line.get_label() == name
        looks |= {line.get_color(), str(line._unscaled_dash_pattern)}
        accurate = [
            mark for mark in axes.lines if mark.get_linestyle() == "None" and mark.get_color() == line.get_color()
        ]
        assert [float(mark.get_ydata()[0]) for mark in accurate] == [curve.accurate_ratio]
        assert float(accurate[0].get_xdata()[0]) < curve.time_steps.min()
    assert len(looks) == 8
    levels = sorted(float(line.get_ydata()[0]) for line in axes.lines if line.get_linestyle() == "-.")
    assert np.allclose(levels, [0.97, 1.03])
    assert axes.get_xscale() == "log"


def test_isolines_are_drawn_at_round_masses_where_the_mass_has_them(drawn):
    (axes,) = drawn["mass_isolines"].axes
    isolines = made_isolines()
    contours = max(axes.collections, key=lambda item: len(item.get_paths()))
    levels = isoline_levels(isolines.mass_kg)
    assert 4 <= len(levels) <= 12
    assert np.array_equal(contours.levels, levels)
    for level, path in zip(contours.levels, contours.get_paths(), strict=True):
        course, ratio = path.vertices[np.isfinite(path.vertices).all(axis=1)].T
        mass = 40.0 * (ratio - 5.0) * np.cos(np.deg2rad(course))
        # Linear interpolation in the grid of 7.5 deg.
        assert np.allclose(mass, level, atol=1.0)


def test_masses_that_are_nowhere_give_a_picture_without_isolines():
    nowhere = GravityIsolines(np.array([0.0, 90.0]), np.array([1.0, 2.0]), np.full((2, 2), np.nan), 5.0)
    assert isoline_levels(nowhere.mass_kg).size == 0
    assert isoline_levels(np.zeros((2, 2))).size == 0


def overlaps(figure):
    """Return pairs of texts of a figure whose boxes on the page overlap, and texts that leave the page."""
    figure.draw_without_rendering()
    legends = [text for legend in figure.legends for text in legend.get_texts()]
    texts = list(legends)
    for axes in figure.axes:
        texts += [axes.xaxis.label, axes.yaxis.label, axes._left_title, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            texts += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text() and text.get_visible()]
    page = figure.bbox
    found = [name for name, box in boxes if box.x0 < 0 or box.y0 < 0 or box.x1 > page.x1 or box.y1 > page.y1]
    for place, (name, box) in enumerate(boxes):
        found += [(name, other) for other, next_box in boxes[place + 1 :] if box.overlaps(next_box)]
    return found


@pytest.mark.parametrize("stem", list(CAPTIONS))
def test_no_text_overlaps_another_or_leaves_the_page(drawn, stem):
    assert overlaps(drawn[stem]) == []


def test_labels_of_the_real_isolines_do_not_overlap():
    figure = draw_mass_isolines(mass_isolines())
    assert overlaps(figure) == []
    labels = [text.get_text() for text in figure.axes[0].texts]
    # On both sides, and flying up.
    assert labels.count("10") == 3


def test_all_formats_are_drawn(drawn):
    assert len(drawn) == 10
    for figure in drawn.values():
        for suffix in ("png", "svg", "pdf"):
            content = figure_bytes(figure, suffix)
            assert len(content) > 5000
            if suffix == "png":
                picture = matplotlib.image.imread(io.BytesIO(content))[..., :3]
                assert np.mean(np.any(picture < 0.95, axis=-1)) > 0.01
