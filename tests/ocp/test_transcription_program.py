"""The nonlinear program: names and rows line up, guesses go in and trajectories come out, errors say what is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import msgspec
import numpy as np
import pytest
from vehicle import GUESS, MESHES, P, there_and_back

from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.declaration import (
    Link,
    OptimalControlProblem,
    Phase,
    Point,
    PointExpressions,
    RateLimit,
    Variable,
)
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solver
from kiteocp.ocp.optimality import Optimality
from kiteocp.ocp.trajectory import Guess, PhaseGuess
from kiteocp.ocp.transcription import transcribe


@pytest.fixture(scope="module")
def program() -> NonlinearProgram:
    return transcribe(there_and_back(), MESHES)


def test_names_line_up_with_variables(program: NonlinearProgram) -> None:
    assert len(program.variables) == program.x.numel() == 1 + (1 + 2 + 6 * 4) + (1 + 2 + 2 * 4)
    assert str(program.variables[0]) == "static effort"
    x = program.pack(GUESS) * program.scales
    for point, index in enumerate(program.find_variables(phase="out", name="x")):
        label = program.variables[index]
        assert (label.kind, label.point) == ("state", point)
        assert x[index] == pytest.approx(2.0 * label.fraction)
    assert [program.variables[i].point for i in program.find_variables(phase="out", kind="control")] == [*range(1, 7)]
    np.testing.assert_allclose(x[program.find_variables(phase="home", name="drag")], [-0.1, 0.1])


def test_names_line_up_with_rows(program: NonlinearProgram) -> None:
    """Each row is recomputed from the trajectory, in physical units, by what its name says."""
    assert len(program.rows) == program.g.numel()
    generator = np.random.default_rng(1)
    x = program.pack(GUESS) + generator.normal(0.0, 0.1, program.x.numel())
    g = ca.Function("g", [program.x, program.p], [program.g])(x, P).full().ravel()
    g *= [label.scale for label in program.rows]
    trajectory = program.unpack(x, P)
    effort = trajectory.statics["effort"]
    for name, direction in (("out", 1.0), ("home", -1.0)):
        phase = trajectory[name]
        v, a, drag = phase.values["v"][1:], phase.values["a"], phase.values["drag"]
        rows = {kind: g[program.find_rows(phase=name, kind=kind)] for kind in ("residual", "path", "rate")}
        np.testing.assert_allclose(rows["residual"], drag - P[0] * v * np.sqrt(v**2 + 0.01), atol=1e-12)
        np.testing.assert_allclose(rows["path"], direction * v, atol=1e-12)
        if phase.mesh.intervals == 1:
            # Through two points the slope is the difference quotient.
            np.testing.assert_allclose(rows["rate"], np.diff(a) / np.diff(phase.times[1:]), rtol=1e-10)
        else:
            # Of a polynomial of degree 3 the first and the last coefficient of the slope are the slopes at the ends.
            for interval in range(phase.mesh.intervals):
                inside = phase.mesh.borders[interval : interval + 2] + np.array([1e-7, -1e-7])
                ends = (phase.mesh.continuous_matrix(inside + 1e-8) - phase.mesh.continuous_matrix(inside)) @ a
                found = rows["rate"][[max(3 * interval - 1, 0), 3 * interval + 1]]
                np.testing.assert_allclose(found, ends / (1e-8 * phase.duration), rtol=1e-4, atol=1e-4)
        # A defect is the slope minus the model, over the interval: zero slope error there means zero row.
        widths = np.repeat(phase.mesh.interval_fractions, phase.mesh.degree) * phase.duration
        rates, residuals = phase.defects(phase.mesh.points)
        for state in ("x", "v"):
            found = g[program.find_rows(phase=name, kind="defect", name=state)]
            np.testing.assert_allclose(found, rates[state] * widths, atol=1e-11)
        np.testing.assert_allclose(residuals["drag law"], rows["residual"], atol=1e-12)
        np.testing.assert_allclose(phase.values["power"], effort * a * v, atol=1e-12)
        np.testing.assert_allclose(phase.values["clock"], phase.mesh.points, atol=1e-12)
    turn = g[program.find_rows(kind="link", name="turn v")]
    assert turn == pytest.approx(trajectory["out"].values["v"][-1] - trajectory["home"].values["v"][0])


def test_labels_read_well(program: NonlinearProgram) -> None:
    row = program.find_rows(phase="home", kind="rate")[0]
    assert str(program.rows[row]) == "rate home.jerk at point 2 (1 of the phase)"


def test_bounds_are_scaled_and_follow_the_parameters(program: NonlinearProgram) -> None:
    lbx, ubx, lbg, ubg = program.numeric_bounds(P)
    assert (lbx[0], ubx[0]) == (0.2, 4.0)
    path = program.find_rows(kind="path")
    np.testing.assert_allclose([lbg[path[0]], ubg[path[0]]], [-0.75, 0.75])
    rate = program.find_rows(kind="rate")
    np.testing.assert_allclose([lbg[rate[0]], ubg[rate[0]]], [-2.0, 2.0])
    # Slopes have one coefficient for each step between points, inside a phase.
    assert len(rate) == (6 - 1) + (2 - 1)


def test_pack_and_unpack_are_inverse(program: NonlinearProgram) -> None:
    x = np.random.default_rng(2).normal(1.0, 0.3, program.x.numel())
    np.testing.assert_allclose(program.pack(program.unpack(x, P)), x, rtol=0, atol=1e-14)


def test_dense_evaluation_meets_the_mesh_values(program: NonlinearProgram) -> None:
    phase = program.unpack(program.pack(GUESS), P)["out"]
    sampled = phase.evaluate(phase.mesh.points)
    for name in phase.phase.quantities:
        np.testing.assert_allclose(sampled[name], phase.values[name][-6:], atol=1e-14, err_msg=name)


def test_integrals_and_means_of_links_agree_with_those_of_the_trajectory() -> None:
    problem = there_and_back()
    out = problem.phases[0]
    objective = out.integral["power"] + 3.0 * out.mean["v"] + out.first["a"] - out.end["clock"] * out.start["x"]
    program = transcribe(
        OptimalControlProblem(problem.phases, objective, (), problem.statics, problem.parameters), MESHES
    )
    x = np.random.default_rng(3).normal(1.0, 0.3, program.x.numel())
    value = float(ca.Function("f", [program.x, program.p], [program.f])(x, P))
    phase = program.unpack(x, P)["out"]
    expected = phase.integrals["power"] + 3.0 * phase.means["v"] + phase.values["a"][0] - phase.values["x"][0]
    assert value == pytest.approx(expected, rel=1e-12)


def test_solution_holds_limits_and_restarts_on_another_mesh(program: NonlinearProgram) -> None:
    solution = Solver(program).solve(program.pack(GUESS), P)
    assert solution.success
    trajectory = program.unpack(solution.x, P)
    for phase in trajectory.phases.values():
        jerk = np.diff(phase.values["a"]) / np.diff(phase.times[1:])
        # Bounds hold to the relaxation of 1e-10 and the feasibility tolerance of 1e-8.
        assert np.abs(jerk).max() == pytest.approx(0.8, abs=1e-6)
        assert np.abs(jerk).max() <= 0.8 + 1e-8
    fine = transcribe(program.problem, {name: mesh.refined() for name, mesh in MESHES.items()})
    start = fine.pack(trajectory)
    assert fine.unpack(start, P)["out"].evaluate([0.37])["x"] == pytest.approx(trajectory["out"].evaluate([0.37])["x"])
    refined = Solver(fine).solve(start, P)
    assert refined.success
    assert refined.f == pytest.approx(solution.f, rel=0.05)


def test_warm_start_needs_fewer_iterations(program: NonlinearProgram) -> None:
    solver = Solver(program)
    cold = solver.solve(program.pack(GUESS), P)
    neighbour = (P[0] * 1.01, P[1])
    warm = solver.solve(cold.x, neighbour, warm=cold)
    again = solver.solve(program.pack(GUESS), neighbour)
    assert warm.success
    assert warm.f == pytest.approx(again.f, abs=1e-7)
    assert warm.iterations < again.iterations


def test_gradient_of_the_optimum_against_solving_again(program: NonlinearProgram) -> None:
    solver, optimality = Solver(program, {"tol": 1e-10}), Optimality(program)
    p = np.array([0.5, 0.55])  # slow enough that the speed limit acts
    solution = solver.solve(program.pack(GUESS), p)
    gradient = optimality.parametric_gradient(solution)
    for i in range(2):
        step = 1e-4 * np.eye(2)[i]
        up, down = (solver.solve(solution.x, p + s).f for s in (step, -step))
        # A central difference of 1e-4 is good to about 1e-8 / 1e-4 from the solver and 1e-7 from curvature.
        assert gradient[i] == pytest.approx((up - down) / 2e-4, rel=1e-3, abs=1e-5)
    assert gradient[1] < -1e-3  # a higher speed limit saves time


def test_first_order_residuals_name_what_is_wrong(program: NonlinearProgram) -> None:
    solution = Solver(program).solve(program.pack(GUESS), P)
    judge = Optimality(program)
    assert judge.residuals(solution).largest < 1e-8
    x = solution.x.copy()
    x[program.find_variables(phase="out", name="drag")[2]] += 0.2
    disturbed = judge.residuals(msgspec.structs.replace(solution, x=x))
    # Scale 3 of the variable over scale 2 of the row.
    assert disturbed.primal_feasibility == pytest.approx(0.2 * 3.0 / 2.0, rel=1e-6)
    assert (disturbed.worst_row.kind, disturbed.worst_row.point) == ("residual", 3)


def one(model: Callable[[Point], PointExpressions], **others: Any) -> Phase:
    """Phase with one state and a model under test."""
    return Phase("p", duration=Variable("T", 1.0, 1.0), states=[Variable("x")], model=model, **others)


STRANGER = ca.SX.sym("stranger")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Variable("x", 2.0, 1.0), r"variable 'x': lower bound 2.0 must not exceed upper bound 1.0"),
        (lambda: Variable("x", math.nan, 1.0), "variable 'x': lower bound nan"),
        (lambda: Link("l", 0.0, scale=0.0), "link 'l': scale must be positive"),
        (lambda: one(lambda q: PointExpressions({})), r"missing \['x'\]"),
        (lambda: one(lambda q: PointExpressions({"x": 1.0, "y": 1.0})), r"not a state \['y'\]"),
        (lambda: one(lambda q: PointExpressions({"x": 1.0}, outputs={"x": 1.0})), "more than one quantity is called x"),
        (
            lambda: one(lambda q: PointExpressions({"x": 1.0}), rate_limits=[RateLimit("r", "w", 0, 1)]),
            "names the unknown quantity 'w'",
        ),
        (lambda: transcribe(there_and_back(), {}), "meshes are given for"),
        (lambda: OptimalControlProblem([one(lambda q: PointExpressions({"x": 1.0}))] * 2, 0.0), "more than one phase"),
    ],
)
def test_bad_declarations_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("where", ["model", "objective", "bound"])
def test_unknown_symbols_are_named(where: str) -> None:
    chosen = {name: STRANGER if name == where else 0.0 for name in ("model", "objective", "bound")}
    phase = one(lambda q: PointExpressions({"x": chosen["model"]}), controls=[Variable("u", chosen["bound"])])
    with pytest.raises(ValueError, match=f"{where}.* uses stranger"):
        transcribe(OptimalControlProblem([phase], chosen["objective"]), {"p": PhaseMesh.uniform(1, 2)})


def test_unknown_quantities_are_named() -> None:
    with pytest.raises(KeyError, match=r"p\.end has no 'y'; it has x"):
        one(lambda q: PointExpressions({"x": 1.0})).end["y"]


def test_incomplete_guesses_are_refused(program: NonlinearProgram) -> None:
    good = GUESS.phases["out"]
    for phases, message in (
        ({"out": good}, "lacks 'home' in phases"),
        (GUESS.phases | {"out": PhaseGuess(4.0, {"x": 0.0})}, "lacks 'v' in phase 'out'"),
        (GUESS.phases | {"out": PhaseGuess(4.0, {**good.values, "v": [1.0, 2.0]})}, "out.v needs 7 values"),
        (GUESS.phases | {"out": PhaseGuess(4.0, {**good.values, "a": math.nan})}, "not finite for control out.a at"),
    ):
        with pytest.raises(ValueError, match=message):
            program.pack(Guess(phases, GUESS.statics))


def test_bad_parameters_are_refused(program: NonlinearProgram) -> None:
    solver, x0 = Solver(program), program.pack(GUESS)
    with pytest.raises(ValueError, match="takes 2 finite parameters"):
        solver.solve(x0, (1.0,))
    with pytest.raises(ValueError, match=r"path out.speed at point 1 .*lower bound 1 must not exceed upper bound -1"):
        solver.solve(x0, (0.5, -1.0))


def test_failure_is_reported_not_raised(program: NonlinearProgram) -> None:
    solution = Solver(program, {"max_iter": 1}).solve(program.pack(GUESS), P)
    assert not solution.success
    assert solution.status == "Maximum_Iterations_Exceeded"
    assert Optimality(program).residuals(solution).largest > 1e-6
