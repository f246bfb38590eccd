"""Problems without a cycle, contrived so that the cause is known."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from kiteocp import load_problem
from kiteocp.cycle.limits import limits_of
from kiteocp.ocp.optimality import Optimality
from kiteocp.ocp.trajectory import Trajectory
from kiteocp.optimum.conflict import Infeasibility
from kiteocp.optimum.infeasibility import explain
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.relaxations import farthest, loosening, penalised_optimum
from kiteocp.optimum.search import cycle_solver
from kiteocp.optimum.starts import STARTS, guess_of
from kiteocp.physics.parameters import ParameterValues, parameter_values

WIND = "environment.wind.reference_speed_m_s"
STRONG = load_problem("strong-wind")
FORMULATION = Formulation.of(STRONG)

#: Beyond the edge of feasibility a cycle must exist, before it none: one percent each way. The coarse mesh of the
#: elastic program is within 0.1 % of the default one.
EDGE = 0.01

#: Contrived causes: values set over the strong-wind problem, which solves.
CAUSES: dict[str, dict[str, float]] = {
    "too little wind for the minimum force": {WIND: 3.3},
    "too much wind": {WIND: 18.0},
    "the ceiling too low for the tether": {"limits.height_max_m": 200.0},
    "the floor too high for the tether": {
        "limits.height_min_m": 250.0,
        "limits.tether_length_max_m": 500.0,
        "limits.traction_elevation_max_deg": 31.0,
    },
    "reel-in too slow": {"limits.reel_in_speed_max_m_s": 1.0},
}


def values_of(changes: dict[str, float]) -> ParameterValues:
    return parameter_values(STRONG.with_values(changes))


@cache
def explained(cause: str) -> Infeasibility:
    return explain(values_of(CAUSES[cause]), FORMULATION)


def solves(values: ParameterValues, start: Trajectory | None = None) -> bool:
    """Whether the cycle problem itself, not its elastic version, has a solution from any of the starts."""
    solver = cycle_solver(values.structure, FORMULATION, (("tol", 1e-7), ("max_iter", 150)))
    guesses = [start] if start else [guess_of(entry, values, solver.program) for entry in STARTS]
    return any(solver.solve(solver.program.pack(guess), values.vector).success for guess in guesses)


@pytest.mark.parametrize("cause", CAUSES)
def test_after_each_relaxation_and_not_before_it_a_cycle_exists(cause: str) -> None:
    values, found = values_of(CAUSES[cause]), explained(cause)
    assert found.start is None
    # Two that agree are enough; five are drawn where none do.
    assert 2 <= found.starts <= 5
    best = next(entry for entry in found.conflict if entry.alone)
    assert best.needed is not None
    step = EDGE * loosening(best.key)
    assert solves(values.replaced({best.key: best.needed * (1 + step)}))
    assert not solves(values.replaced({best.key: best.needed * (1 - step)}))
    assert found.wind_factor is not None
    wind = found.wind_needed_m_s
    assert wind == pytest.approx(found.wind_factor * values[WIND])
    assert solves(values.replaced({WIND: wind * (1 + EDGE * np.sign(found.wind_factor - 1))}))


def test_the_needed_force_agrees_with_a_bisection_by_solving() -> None:
    cause = "too little wind for the minimum force"
    values, found = values_of(CAUSES[cause]), explained(cause)
    key = "limits.tether_force_min_N"
    low, high = 380.0, 500.0
    assert solves(values.replaced({key: low}))
    assert not solves(values.replaced({key: high}))
    while high - low > 2.0:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solves(values.replaced({key: middle})) else (low, middle)
    (entry,) = [entry for entry in found.conflict if entry.key == key]
    # Half the last interval, and the difference between the meshes, 0.1 %.
    assert entry.needed == pytest.approx(0.5 * (low + high), abs=1.0 + 1e-3 * high)
    assert entry.relative_change == pytest.approx(low / values[key] - 1, abs=0.005)
    assert entry.phase == "retraction"


@pytest.mark.parametrize(
    ("cause", "blamed"),
    [
        (
            "too little wind for the minimum force",
            {"tether_force_min_N", "reel_in_speed_max_m_s", "tether_length_min_m"},
        ),
        ("too much wind", {"tether_force_max_N", "reel_out_speed_max_m_s", "tether_length_min_m"}),
        ("the ceiling too low for the tether", {"height_max_m", "tether_length_min_m"}),
        (
            "the floor too high for the tether",
            {"height_min_m", "tether_length_max_m", "traction_elevation_max_deg"},
        ),
        ("reel-in too slow", {"reel_in_speed_max_m_s", "tether_force_min_N"}),
    ],
)
def test_the_limits_in_conflict_are_named(cause: str, blamed: set[str]) -> None:
    """Those that make the cause; the shortest traction and the largest force may have a part in it as well."""
    assert {f"limits.{name}" for name in blamed} <= {entry.key for entry in explained(cause).conflict}


def test_two_conflicts_that_no_limit_alone_can_repair() -> None:
    """Under this ceiling the tether is too long to fly, and the stroke too long for the ceiling: both must give."""
    values = values_of({"limits.stroke_min_m": 329.0, "limits.height_max_m": 250.0})
    found = explain(values, FORMULATION)
    assert found.conflict
    assert not any(entry.alone for entry in found.conflict)
    assert len(found.relaxation) > 1
    assert "together" in found.sentence
    assert solves(values.replaced({key: need * (1 + EDGE * loosening(key)) for key, need in found.relaxation.items()}))


def test_too_little_wind_whatever_the_limits() -> None:
    found = explain(values_of({WIND: 2.5}), FORMULATION)
    assert found.conflict == ()
    assert found.relaxation == {}
    assert "no relaxation of the limits gives a cycle; it takes" in found.sentence
    assert found.wind_needed_m_s is not None
    assert found.wind_needed_m_s > 3.3


@pytest.mark.slow
def test_in_a_calm_the_wind_that_is_needed_is_found() -> None:
    # No crude start leads anywhere at 0.5 m/s: the search goes on from a cycle in more wind.
    v3 = load_problem("v3-kite")
    found = explain(parameter_values(v3.with_values({WIND: 0.5})), FORMULATION)
    assert found.conflict == ()
    assert found.starts >= 3
    assert found.wind_needed_m_s is not None
    for share, feasible in ((1 + EDGE, True), (1 - EDGE, False)):
        assert solves(parameter_values(v3.with_values({WIND: share * found.wind_needed_m_s}))) is feasible


def test_a_feasible_problem_comes_back_with_a_start() -> None:
    values = values_of({})
    found = explain(values, FORMULATION)
    assert found.conflict == ()
    assert found.elastic_sum == pytest.approx(0.0, abs=1e-4)
    assert found.start is not None
    assert solves(values, found.start)


def test_a_cycle_at_the_edge_of_feasibility_is_found_by_penalty() -> None:
    """IPOPT calls this problem infeasible from every start, even from a feasible one; it has an optimum."""
    values = values_of({WIND: 10.7, "limits.height_max_m": 336.0, "limits.tether_force_max_N": 5000.0})
    assert not solves(values)
    found = explain(values, FORMULATION)
    assert found.start is not None
    optimum = penalised_optimum(values, FORMULATION, [found.start])
    assert optimum is not None
    solver = cycle_solver(values.structure, FORMULATION, (("tol", 1e-8),))
    residuals = Optimality(solver.program).residuals
    # The elastic solver's own tolerance; from there the program's solver takes a step or two to its tolerance.
    assert residuals(optimum).largest < 1e-5
    polished = solver.solve(optimum.x, values.vector, warm=optimum)
    assert polished.success
    assert residuals(polished).largest < 1e-7
    assert polished.f == pytest.approx(optimum.f, abs=1e-5)


def test_no_optimum_is_made_up_where_slacks_remain() -> None:
    values = values_of(CAUSES["the floor too high for the tether"])
    crude = cycle_solver(values.structure, FORMULATION, ()).program
    start = crude.unpack(crude.pack(guess_of(STARTS[0], values, crude)), values.vector)
    assert penalised_optimum(values, FORMULATION, [start]) is None


def test_the_sentence_says_what_where_and_how_much() -> None:
    sentence = explained("too little wind for the minimum force").sentence
    assert sentence.startswith("no cycle found: with 3.3 m/s of wind at 6 m the kite cannot ")
    for part in (
        "hold the minimum tether force of 749 N",
        "reel in at no more than 10 m/s",
        "while flying up at ",
        "smallest relaxation found: ",
        "4.42 m/s of wind",
        "a minimum tether force of 44",
    ):
        assert part in sentence
    assert "\n" not in sentence


def test_it_is_plain_values_in_a_summary() -> None:
    found = explained("too much wind")
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert content["sentence"] == found.sentence
    assert [entry["key"] for entry in content["conflict"]] == [entry.key for entry in found.conflict]
    changes = [abs(entry["relative_change"]) for entry in content["conflict"] if entry["alone"]]
    assert changes == sorted(changes)


def test_every_limit_has_its_direction_reach_and_words() -> None:
    structure = parameter_values(
        STRONG.with_values(
            {"limits.generator_power_max_W": 2e4, "limits.motor_power_max_W": 1e4, "limits.stroke_min_m": 50.0}
        )
    ).structure
    limits = limits_of(structure)
    for limit in limits:
        grows = (limit.side != "lower") == (limit.measure.to_quantity(2.0) > limit.measure.to_quantity(1.0))
        assert loosening(limit.key) == (1 if grows else -1), limit.key
    assert 60.0 * (1 + farthest("limits.traction_elevation_max_deg", 60.0)) < 90.0
    assert 85.0 * (1 + farthest("limits.elevation_max_deg", 85.0)) == pytest.approx(180.0)
    assert farthest("limits.height_min_m", 0.0) == 0.0
