"""The winch's acceleration: bounded all along the phases, and checked at every sample that is written."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from kiteocp.cli.main import main
from kiteocp.ocp.collocation import PhaseMesh, continuous_nodes, slope_bounds_matrix
from kiteocp.optimum.checks import MARGIN_TOLERANCE, limit_margins, resimulation_check
from kiteocp.optimum.cycle import active_limits
from kiteocp.optimum.refine import optimise
from kiteocp.problem import load_problem

ACCELERATION = "limits.reeling_acceleration_max_m_s2"

#: A winch that needs a quarter of an hour from rest to full speed, and cycles so short that it never rests.
SLOW_WINCH = {
    "environment.wind.reference_height_m": 100.0,
    "operation.tether_length_min_m": 200.0,
    "operation.tether_length_max_m": 400.0,
    "limits.tether_force_min_N": 300.0,
    "limits.tether_force_max_N": 5000.0,
    ACCELERATION: 0.02,
}
SHORT_TETHER = {
    "operation.tether_length_min_m": 20.0,
    "operation.tether_length_max_m": 40.0,
    "limits.height_min_m": 5.0,
}


@pytest.mark.parametrize("changes", [SLOW_WINCH, SHORT_TETHER], ids=["slow winch", "short tether"])
@pytest.mark.parametrize("level", ["quick", "full"])
def test_a_certified_acceleration_holds_at_every_sample_of_the_time_series(
    changes: dict[str, float], level: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["solve", "v3-kite", "--no-plot", "--certificate", level, "-o", str(tmp_path)]
    for key, value in changes.items():
        words += ["--set", f"{key}={value}"]
    assert main(words) == 0, capsys.readouterr()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["status"] == "certified"
    limit = summary["input"]["limits"]["reeling_acceleration_max_m_s2"]
    with (tmp_path / "timeseries.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for phase in ("retraction", "transition", "traction"):
        time, speed = (
            np.array([float(row[name]) for row in rows if row["phase"] == phase])
            for name in ("time_s", "reeling_speed_m_s")
        )
        assert np.max(np.abs(np.diff(speed) / np.diff(time))) <= limit * (1 + MARGIN_TOLERANCE)


def test_the_check_takes_the_worst_of_samples_mesh_intervals_and_resimulation() -> None:
    optimum = optimise(load_problem("v3-kite", SLOW_WINCH), certificate="quick")
    cycle = optimum.cycle
    _, flown, _ = resimulation_check(cycle)
    margins = {item.key: item.margin for item in limit_margins(cycle, flown)}
    limit = cycle.values[ACCELERATION]
    written = max(np.max(np.abs(record.rate("reeling_speed"))) for record in cycle.records)
    between = max(np.max(np.abs(record.rate("reeling_speed"))) for record in cycle.fine_records)
    assert margins[ACCELERATION] <= 1.0 - max(written, between) / limit + 1e-12
    # What is checked and what is called active are the same numbers.
    for record, fine in zip(cycle.records, cycle.fine_records, strict=True):
        held = np.max(np.abs(fine.rate("reeling_speed"))) >= 0.998 * limit
        assert held == (ACCELERATION in [entry["limit"] for entry in active_limits(cycle)[record.name]])


def test_the_reeling_speed_does_not_jump_between_mesh_intervals() -> None:
    cycle = optimise(load_problem("v3-kite", SHORT_TETHER), certificate="quick").cycle
    for schedule in cycle.schedules:
        inside = schedule.borders_s[1:-1]
        assert inside.size or schedule.name == "traction"
        # A border belongs to the piece that follows; just before it the one that ends there holds.
        before, after = (schedule.value("radial_ground_force", time) for time in (inside - 1e-9, inside))
        np.testing.assert_allclose(before, after, rtol=1e-6)


values = st.lists(st.floats(-10.0, 10.0), min_size=10, max_size=10)


@given(values, st.integers(1, 9), st.booleans())
def test_the_slope_of_a_polynomial_lies_between_its_bounds(drawn: list[float], degree: int, first: bool) -> None:
    nodes = continuous_nodes(degree, first)
    heights = np.array(drawn[: nodes.size])
    bounds = slope_bounds_matrix(degree, first) @ heights
    assert bounds.shape == (nodes.size - 1,)
    if not bounds.size:
        return
    slope = Polynomial(np.linalg.solve(np.vander(nodes, increasing=True), heights)).deriv()
    sampled = slope(np.linspace(0.0, 1.0, 101))
    # Rounding of the interpolation: the matrices of nine points have norms of some 1e5.
    room = 1e-8 * (1.0 + np.abs(bounds).max())
    assert bounds.min() - room <= sampled.min()
    assert sampled.max() <= bounds.max() + room
    np.testing.assert_allclose([bounds[0], bounds[-1]], sampled[[0, -1]], atol=room)


@given(st.integers(1, 6), st.integers(1, 6))
def test_a_continuous_curve_has_no_jumps_and_the_values_at_the_points(intervals: int, degree: int) -> None:
    mesh = PhaseMesh.uniform(intervals, degree)
    heights = np.random.default_rng(intervals * 10 + degree).normal(size=mesh.points.size)
    np.testing.assert_allclose(mesh.continuous_matrix(mesh.points) @ heights, heights, atol=1e-9)
    inside = mesh.borders[1:-1]
    behind = mesh.continuous_matrix(np.nextafter(inside, 1.0)) @ heights
    np.testing.assert_allclose(behind, mesh.continuous_matrix(inside) @ heights, atol=1e-9)


@pytest.mark.parametrize("intervals", [None, 4])
def test_a_course_that_steers_the_elevation_passes_a_quick_certificate(intervals: int | None) -> None:
    """On four intervals the optimum dives between the points, 32 % below the least elevation: a finer mesh is asked."""
    changes: dict[str, object] = {"optimisation.traction_elevation": "course-coupled"}
    if intervals is not None:
        changes["optimisation.mesh.traction_intervals"] = intervals
    optimum = optimise(load_problem("v3-kite", changes), certificate="quick")
    assert optimum.certificate.passed, optimum.certificate.message
    assert optimum.mean_power_W == pytest.approx(6265.05, rel=1e-3)


def test_a_quick_certificate_leaves_a_mesh_alone_that_serves() -> None:
    assert len(optimise(load_problem("v3-kite"), certificate="quick").facts["meshes"]) == 1
