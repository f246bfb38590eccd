"""Optimal control problems with known optima, through the whole chain: declare, transcribe, solve, read.

Unless a tolerance says otherwise it is 1e-7: IPOPT stops at 1e-8 and these objectives are of order one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest

from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.declaration import (
    Link,
    OptimalControlProblem,
    PathConstraint,
    Phase,
    Point,
    PointExpressions,
    Residual,
    Static,
    Variable,
)
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.optimality import Optimality
from kiteocp.ocp.trajectory import Guess, PhaseGuess, Profile
from kiteocp.ocp.transcription import transcribe

TOLERANCE = 1e-7


def solve(
    problem: OptimalControlProblem,
    mesh: PhaseMesh,
    guesses: Mapping[str, tuple[float, Mapping[str, Profile]]],
    p: tuple[float, ...] = (),
    statics: Mapping[str, float] | None = None,
) -> tuple[NonlinearProgram, Solution]:
    """Solve with the same mesh in all phases; demand success and small first-order residuals."""
    program = transcribe(problem, {phase.name: mesh for phase in problem.phases})
    guess = Guess({name: PhaseGuess(*given) for name, given in guesses.items()}, statics or {})
    solution = Solver(program).solve(program.pack(guess), p)
    assert solution.success, solution.status
    assert Optimality(program).residuals(solution).largest < 1e-7
    return program, solution


def fixed(phase: Phase, **values: float) -> list[Link]:
    """Initial conditions."""
    return [Link(f"{name} at start", phase.start[name] - value) for name, value in values.items()]


def test_minimum_time_double_integrator() -> None:
    """Unit distance rest to rest with unit acceleration: T = 2, full throttle then full brake."""
    move = Phase(
        "move",
        duration=Variable("duration", 0.1, 10.0),
        states=[Variable("x"), Variable("v")],
        controls=[Variable("a", -1.0, 1.0)],
        model=lambda q: PointExpressions({"x": q["v"], "v": q["a"]}),
    )
    links = [*fixed(move, x=0.0, v=0.0), Link("far", move.end["x"] - 1.0), Link("rest", move.end["v"])]
    problem = OptimalControlProblem([move], move.duration, links)
    # The switch, at half time, is an interval border, so the polynomials are exact.
    mesh = PhaseMesh.uniform(4, 3)
    program, solution = solve(problem, mesh, {"move": (1.5, {"x": lambda s: s, "v": 1.0, "a": 0.0})})
    assert solution.f == pytest.approx(2.0, abs=TOLERANCE)
    acceleration = program.unpack(solution.x)["move"].values["a"]
    np.testing.assert_allclose(acceleration, [1.0] * 6 + [-1.0] * 6, atol=1e-5)


def test_brachistochrone_to_a_vertical_line() -> None:
    """A half cycloid of generating radius x_f / pi, in the time sqrt(pi x_f / g)."""
    gravity, distance = 9.81, 2.0
    slide = Phase(
        "slide",
        duration=Variable("duration", 0.1, 10.0),
        states=[Variable("x"), Variable("depth"), Variable("speed", scale=5.0)],
        controls=[Variable("angle", 0.0, math.pi)],
        model=lambda q: PointExpressions(
            {
                "x": q["speed"] * ca.sin(q["angle"]),
                "depth": q["speed"] * ca.cos(q["angle"]),
                "speed": gravity * ca.cos(q["angle"]),
            }
        ),
    )
    links = [*fixed(slide, x=0.0, depth=0.0, speed=0.0), Link("line", slide.end["x"] - distance)]
    problem = OptimalControlProblem([slide], slide.duration, links)
    start = {"x": lambda s: 2.0 * s, "depth": lambda s: s, "speed": lambda s: 5.0 * s, "angle": lambda s: 0.2 + s}
    program, solution = solve(problem, PhaseMesh.uniform(4, 5), {"slide": (1.0, start)})
    assert solution.f == pytest.approx(math.sqrt(math.pi * distance / gravity), abs=TOLERANCE)
    # The whole curve, between the mesh points: the angle turns uniformly, from vertical to horizontal.
    fractions = np.linspace(0.0, 1.0, 33)
    sampled = program.unpack(solution.x)["slide"].evaluate(fractions)
    radius, roll = distance / math.pi, math.pi * fractions
    np.testing.assert_allclose(sampled["x"], radius * (roll - np.sin(roll)), atol=1e-5)
    np.testing.assert_allclose(sampled["depth"], radius * (1.0 - np.cos(roll)), atol=1e-5)


def linear_quadratic(implicit: bool) -> OptimalControlProblem:
    """x' = z, x(0) = 1, minimise half the integral of x^2 + z^2 over [0, 1]: tanh(1) / 2.

    Explicitly z is the control; implicitly the control is w with z + z^3 = w, an index-1 algebraic equation.
    """

    def model(q: Point) -> PointExpressions:
        z = q["z"]
        residuals = [Residual("cubic", z + z**3 - q["w"])] if implicit else []
        return PointExpressions({"x": z}, residuals, outputs={"cost": (q["x"] ** 2 + z**2) / 2})

    z = Variable("z")
    phase = Phase(
        "regulate",
        duration=Variable("duration", 1.0, 1.0),
        states=[Variable("x")],
        algebraics=[z] if implicit else [],
        controls=[Variable("w")] if implicit else [z],
        model=model,
    )
    return OptimalControlProblem([phase], phase.integral["cost"], fixed(phase, x=1.0))


@pytest.mark.parametrize("implicit", [False, True])
@pytest.mark.parametrize(("degree", "error"), [(2, 1e-3), (3, 2e-6), (4, 2e-9), (5, 1e-11), (7, 1e-12)])
def test_linear_quadratic_regulator(implicit: bool, degree: int, error: float) -> None:
    values: dict[str, Profile] = {"x": 1.0, "z": 0.0} | ({"w": 0.0} if implicit else {})
    program, solution = solve(linear_quadratic(implicit), PhaseMesh.uniform(2, degree), {"regulate": (1.0, values)})
    assert solution.f == pytest.approx(math.tanh(1.0) / 2.0, abs=error)
    if degree == 7:
        fractions = np.linspace(0.0, 1.0, 9)
        sampled = program.unpack(solution.x)["regulate"].evaluate(fractions)
        np.testing.assert_allclose(sampled["x"], np.cosh(1.0 - fractions) / math.cosh(1.0), atol=1e-8)
        np.testing.assert_allclose(sampled["z"], -np.sinh(1.0 - fractions) / math.cosh(1.0), atol=1e-6)


def bryson_denham() -> OptimalControlProblem:
    """Bryson and Ho, Applied Optimal Control, section 3.11: a cart that must not pass a wall at `wall`."""
    wall = ca.SX.sym("wall")
    cart = Phase(
        "cart",
        duration=Variable("duration", 1.0, 1.0),
        states=[Variable("x"), Variable("v")],
        controls=[Variable("a", scale=5.0)],
        model=lambda q: PointExpressions(
            {"x": q["v"], "v": q["a"]}, constraints=[PathConstraint("wall", q["x"], upper=wall)],
            outputs={"effort": q["a"] ** 2 / 2},
        ),
    )  # fmt: skip
    links = [*fixed(cart, x=0.0, v=1.0), Link("back", cart.end["x"]), Link("reversed", cart.end["v"] + 1.0)]
    return OptimalControlProblem([cart], cart.integral["effort"], links, parameters=wall)


@pytest.mark.parametrize(
    ("wall", "intervals", "effort"),
    [
        (1 / 9, 3, 4 / (9 / 9)),  # rests on the wall from t = 3 l to 1 - 3 l: borders of three intervals
        (0.2, 2, 2 + 6 * (1 - 4 * 0.2) ** 2),  # touches it at half time
        (0.5, 1, 2.0),  # never meets it
    ],
)
def test_bryson_denham(wall: float, intervals: int, effort: float) -> None:
    start: dict[str, Profile] = {"x": 0.0, "v": lambda s: 1.0 - 2.0 * s, "a": -2.0}
    program, solution = solve(bryson_denham(), PhaseMesh.uniform(intervals, 3), {"cart": (1.0, start)}, (wall,))
    # Pieces are cubic, so a mesh that meets the switches is exact.
    assert solution.f == pytest.approx(effort, abs=1e-6)
    assert program.unpack(solution.x, solution.p)["cart"].values["x"].max() <= wall + 1e-8


def trolley() -> OptimalControlProblem:
    """Accelerate, lose part of the speed in a coupling impact, brake: least time over a distance, two phases.

    Parameters: distance d, greatest acceleration a (chosen as a static), greatest braking b, speed kept e.
    With e^2/b < e/a, no coasting: v^2 (1/a + e^2/b) / 2 = d and T = v (1/a + e/b).
    """
    p = ca.SX.sym("p", 4)
    push = Static("push", 0.0, p[1])
    first = Phase(
        "push",
        duration=Variable("duration", 0.01, 10.0),
        states=[Variable("x"), Variable("v")],
        model=lambda q: PointExpressions({"x": q["v"], "v": push.symbol}),
    )
    second = Phase(
        "brake",
        duration=Variable("duration", 0.01, 10.0),
        states=[Variable("x"), Variable("v", 0.0)],
        controls=[Variable("a", -p[2], 0.0)],
        model=lambda q: PointExpressions({"x": q["v"], "v": q["a"]}),
    )
    links = [
        *fixed(first, x=0.0, v=0.0),
        Link("position", second.start["x"] - first.end["x"]),
        Link("impact", second.start["v"] - p[3] * first.end["v"]),
        Link("far", second.end["x"], p[0], math.inf),
        Link("rest", second.end["v"]),
    ]
    return OptimalControlProblem([first, second], first.duration + second.duration, links, [push], p)


def trolley_time(p: Any) -> float:
    """Closed form of the trolley's least time."""
    distance, push, brake, kept = p
    speed = math.sqrt(2.0 * distance / (1.0 / push + kept**2 / brake))
    return speed * (1.0 / push + kept / brake)


@pytest.mark.parametrize("p", [(1.0, 1.0, 2.0, 1.0), (1.0, 1.0, 1.0, 0.5), (3.0, 2.0, 4.0, 0.8)])
def test_two_phases_with_a_jump_at_a_free_switch(p: tuple[float, ...]) -> None:
    start: dict[str, Profile] = {"x": 0.5, "v": 1.0}
    guesses = {"push": (1.0, start), "brake": (1.0, start | {"a": -0.5})}
    program, solution = solve(trolley(), PhaseMesh.uniform(2, 2), guesses, p, {"push": 0.5})
    assert solution.f == pytest.approx(trolley_time(p), abs=TOLERANCE)
    trajectory = program.unpack(solution.x, p)
    assert trajectory.statics["push"] == pytest.approx(p[1], abs=1e-6)
    before, after = trajectory["push"].values["v"][-1], trajectory["brake"].values["v"][0]
    assert after == pytest.approx(p[3] * before, abs=1e-8)
    # The gradient counts bounds of a static (a), a control (b) and a link (d), and a link's expression (e).
    gradient = Optimality(program).parametric_gradient(solution)
    for i in range(4):
        up, down = (np.array(p) + h * np.eye(4)[i] for h in (1e-5, -1e-5))
        # Multipliers are as good as the solver's tolerance, the difference quotient as 1e-10.
        assert gradient[i] == pytest.approx((trolley_time(up) - trolley_time(down)) / 2e-5, abs=1e-5)


def test_periodic_tracking() -> None:
    """x' = u, minimise the mean of (x - cos t)^2 + u^2 over one period, x periodic: x = cos(t) / 2, mean 1/4."""
    follow = Phase(
        "follow",
        duration=Variable("duration", 2.0 * math.pi, 2.0 * math.pi),
        states=[Variable("x")],
        controls=[Variable("u")],
        model=lambda q: PointExpressions({"x": q["u"]}, outputs={"cost": (q["x"] - ca.cos(q.time)) ** 2 + q["u"] ** 2}),
    )
    links = [Link("periodic", follow.end["x"] - follow.start["x"])]
    problem = OptimalControlProblem([follow], follow.mean["cost"], links)
    start: dict[str, Profile] = {"x": 0.0, "u": 0.0}
    program, solution = solve(problem, PhaseMesh.uniform(6, 5), {"follow": (2.0 * math.pi, start)})
    assert solution.f == pytest.approx(0.25, abs=1e-8)
    fractions = np.linspace(0.0, 1.0, 25)
    sampled = program.unpack(solution.x)["follow"].evaluate(fractions)
    np.testing.assert_allclose(sampled["x"], np.cos(2.0 * math.pi * fractions) / 2.0, atol=1e-5)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_convergence_order_under_refinement(degree: int) -> None:
    """Radau IIA has order 2d - 1 at the end point: logistic growth x' = 3 x (1 - x) from 1/2."""
    flow = Phase(
        "flow",
        duration=Variable("duration", 1.0, 1.0),
        states=[Variable("x")],
        model=lambda q: PointExpressions({"x": 3.0 * q["x"] * (1.0 - q["x"])}),
    )
    problem = OptimalControlProblem([flow], 0.0, fixed(flow, x=0.5))
    errors = []
    for intervals in (4, 8):
        mesh = PhaseMesh.uniform(intervals, degree)
        program, solution = solve(problem, mesh, {"flow": (1.0, {"x": 0.5})})
        errors.append(abs(program.unpack(solution.x)["flow"].values["x"][-1] - 1.0 / (1.0 + math.exp(-3.0))))
    # The observed order approaches its limit like 1/N; on these meshes it is within 0.05 of it.
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2 * degree - 1, abs=0.1)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_optimal_cost_converges_at_least_as_fast(degree: int) -> None:
    errors = []
    for intervals in (2, 4):
        mesh = PhaseMesh.uniform(intervals, degree)
        _, solution = solve(linear_quadratic(False), mesh, {"regulate": (1.0, {"x": 1.0, "z": 0.0})})
        errors.append(abs(solution.f - math.tanh(1.0) / 2.0))
    assert math.log2(errors[0] / errors[1]) > 2 * degree - 1 - 0.35
