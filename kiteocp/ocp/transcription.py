"""Direct collocation of optimal control problems of several phases, generic and symbolic.

Three separate things, each with its module:

1. **Declaration** (`kiteocp.ocp.declaration`): variables, phases, links, objective.
2. **Discretisation** (this module): `transcribe` a problem on a mesh (`kiteocp.ocp.collocation.PhaseMesh` for each
   phase) into a `kiteocp.ocp.nlp.NonlinearProgram`, all in CasADi ``SX``, parameters symbolic.
3. **Solution** (`kiteocp.ocp.nlpsolver`): a `Solver` is built once and called with numbers;
   `kiteocp.ocp.trajectory.Trajectory` holds the values over time; `kiteocp.ocp.optimality` checks and differentiates.

The shortest time to move a trolley by `distance` from rest to rest with at most unit acceleration::

    distance = ca.SX.sym("distance")

    def model(point):
        return PointExpressions({"x": point["v"], "v": point["a"]}, outputs={"power": point["v"] * point["a"]})

    move = Phase(
        "move",
        duration=Variable("duration", 0.1, 10.0),
        states=[Variable("x"), Variable("v", scale=2.0)],
        controls=[Variable("a", -1.0, 1.0)],
        model=model,
    )
    links = [Link(f"{n} at start", move.start[n]) for n in ("x", "v")]
    links += [Link("distance", move.end["x"] - distance), Link("rest", move.end["v"])]
    problem = OptimalControlProblem([move], move.duration, links, parameters=distance)

    program = transcribe(problem, {"move": PhaseMesh.uniform(intervals=4, degree=3)})
    solver = Solver(program)
    guess = Guess({"move": PhaseGuess(1.5, {"x": lambda s: s, "v": 1.0, "a": 0.0})}, statics={})
    solution = solver.solve(program.pack(guess), p=[1.0])
    solution.success, solution.f                       # True, 2.0
    trajectory = program.unpack(solution.x, p=[1.0])
    trajectory["move"].evaluate([0.0, 0.5, 1.0])["v"]  # any quantity anywhere
    program.pack(trajectory)                           # start for any program of the same problem, on any mesh

Statics (`Static`) are decisions shared by phases: use their ``symbol`` anywhere. Links and the objective refer to
phases by ``phase.start[state]``, ``phase.end[quantity]``, ``phase.first[quantity]`` (first collocation point),
``phase.duration``, ``phase.integral[quantity]`` and ``phase.mean[quantity]``. Quantities are states, algebraics,
controls and outputs. Bounds may be expressions of the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.ocp.collocation import PhaseMesh, differentiation_matrix, slope_bounds_matrix
from kiteocp.ocp.composition import Composition, PointBlock
from kiteocp.ocp.declaration import (
    Expression,
    Link,
    OptimalControlProblem,
    PathConstraint,
    Phase,
    RateLimit,
    Residual,
    Variable,
)
from kiteocp.ocp.nlp import Label, NonlinearProgram, PhaseLayout
from kiteocp.ocp.point_model import PointModel, column_of, point_model, require_known


class _Entries(msgspec.Struct):
    """Variables or constraint rows under construction: columns of expressions, bounds and labels grow together."""

    columns: list[Any] = msgspec.field(default_factory=list)
    bounds: list[tuple[Expression, Expression]] = msgspec.field(default_factory=list)
    labels: list[Label] = msgspec.field(default_factory=list)

    def new_variables(self, declared: Sequence[Variable], labels: Sequence[Label]) -> Any:
        """Add variables, the same ones again and again where there are more labels; return them in physical units.

        Returns
        -------
        SX, shape (variables, times)
        """
        count, name = len(declared), str(labels[0]) if labels else ""
        symbols = ca.SX.sym(name, count, len(labels) // count if count else 1)
        self.append(ca.vec(symbols), _bounds(declared) * symbols.shape[1], labels)
        return symbols * ca.repmat(ca.SX(ca.DM([v.scale for v in declared])), 1, symbols.shape[1])

    def append(self, column: Any, bounds: Sequence[tuple[Expression, Expression]], labels: Sequence[Label]) -> None:
        """Add a column of expressions with their bounds."""
        self.columns.append(column)
        self.bounds += bounds
        self.labels += labels

    @property
    def scales(self) -> Any:
        """Scale of every entry."""
        return ca.DM([label.scale for label in self.labels])

    def bound(self, side: int) -> Any:
        """Lower (0) or upper (1) bounds over their scales."""
        values = [bound[side] for bound in self.bounds]
        numbers = ca.SX(ca.DM([v if isinstance(v, (int, float)) else 0.0 for v in values]))
        for index, value in enumerate(values):
            if not isinstance(value, (int, float)):
                numbers[index] = value
        return numbers / self.scales


def transcribe(problem: OptimalControlProblem, mesh: Mapping[str, PhaseMesh]) -> NonlinearProgram:
    """Discretise a problem by Radau collocation.

    States have a value at the phase start and at each collocation point, algebraics and controls at each collocation
    point. Rows come phase by phase, interval by interval: point by point defects (dynamics), residuals and path
    constraints, then the rate limits of the interval; the links last.

    Parameters
    ----------
    problem
        What to solve.
    mesh
        Mesh of each phase, by phase name.

    Returns
    -------
    NonlinearProgram

    Raises
    ------
    ValueError
        If the mesh of a phase is missing, or an expression uses a symbol it may not (bounds: only parameters).

    """
    if set(mesh) != {phase.name for phase in problem.phases}:
        raise ValueError(f"meshes are given for {sorted(mesh)}, phases are {sorted(p.name for p in problem.phases)}")
    variables, rows = _Entries(), _Entries()
    statics = variables.new_variables(
        problem.statics, [Label("static", static.name, static.scale) for static in problem.statics]
    )
    static_symbols = column_of([static.symbol for static in problem.statics])
    parameters = ca.SX(problem.parameters)
    layouts, functions, blocks = {}, {}, []
    symbols, values = [static_symbols, parameters], [statics, parameters]
    for phase in problem.phases:
        model = point_model(problem, phase)
        functions[phase.name] = model.function
        outputs = ca.SX.sym(f"{phase.name}.outputs", model.outputs, mesh[phase.name].points.size)
        layout, used, meant = _transcribe_phase(phase, mesh[phase.name], outputs, (variables, rows))
        blocks.append(_block(phase, mesh[phase.name], (model, layout, len(problem.statics), outputs)))
        layouts[phase.name] = layout
        symbols += used
        values += meant
    wanted = [ca.SX(problem.objective), *(ca.SX(link.expression) for link in problem.links)]
    require_known("the objective or a link", wanted, symbols)
    objective, *linked = ca.Function("links", symbols, wanted).call(values)
    rows.append(
        column_of(linked), _bounds(problem.links), [Label("link", link.name, link.scale) for link in problem.links]
    )
    bounds = [entries.bound(side) for entries in (variables, rows) for side in (0, 1)]
    require_known("a bound", bounds, [parameters])
    x, g = ca.vertcat(*variables.columns), ca.vertcat(*rows.columns) / rows.scales
    return NonlinearProgram(
        composition=Composition(x, parameters, objective, g, blocks, problem.point_parameters),
        bounds=ca.Function("bounds", [parameters], bounds, ["p"], ["lbx", "ubx", "lbg", "ubg"]),
        variables=tuple(variables.labels),
        rows=tuple(rows.labels),
        problem=problem,
        mesh=dict(mesh),
        layouts=layouts,
        functions=functions,
    )


def _block(phase: Phase, mesh: PhaseMesh, of: tuple[PointModel, PhaseLayout, int, Any]) -> PointBlock:
    """Return the points of a phase: where the variables of each of them stand in x, and the symbols of its outputs."""
    model, layout, statics, outputs = of
    shared = np.array([*range(statics), layout.duration], dtype=np.intp)
    places = [layout.states[:, 1:], layout.algebraics, layout.controls, np.tile(shared[:, None], mesh.points.size)]
    return PointBlock(model, np.vstack(places), mesh.points, outputs)


def _transcribe_phase(
    phase: Phase, mesh: PhaseMesh, outputs: Any, program: tuple[_Entries, _Entries]
) -> tuple[PhaseLayout, list[Any], list[Any]]:
    """Add the variables and rows of a phase; return its layout, and its link symbols with their meaning."""
    variables, rows = program
    declared = {"state": phase.states, "algebraic": phase.algebraics, "control": phase.controls}
    first = len(variables.labels)
    duration = variables.new_variables(
        [phase.duration_variable], [Label("duration", "duration", phase.duration_variable.scale, phase.name)]
    )
    started = variables.new_variables(
        phase.states, [Label("state", v.name, v.scale, phase.name, 0, 0.0) for v in phase.states]
    )
    unknowns = variables.new_variables(
        [variable for group in declared.values() for variable in group],
        [
            label
            for index in range(mesh.points.size)
            for kind, group in declared.items()
            for label in _point_labels(kind, phase, mesh, index, group)
        ],
    )
    layout = _layout(first, [len(group) for group in declared.values()], mesh.points.size)
    said, count = phase.expressions, len(phase.states)
    sizes = [count, len(said.residuals), len(said.constraints), len(said.outputs)]
    derivatives, residuals, constraints, reported = ca.vertsplit(outputs, np.cumsum([0, *sizes]).tolist())
    states, quantities = ca.horzcat(started, unknowns[:count, :]), ca.vertcat(unknowns, reported)
    degree, differentiation = mesh.degree, differentiation_matrix(mesh.degree).T
    for interval, width in enumerate(mesh.interval_fractions):
        points = slice(interval * degree, (interval + 1) * degree)
        slopes = states[:, interval * degree : (interval + 1) * degree + 1] @ differentiation
        defects = slopes - width * duration * derivatives[:, points]
        rows.append(
            ca.vec(ca.vertcat(defects, residuals[:, points], constraints[:, points])),
            [*[(0.0, 0.0)] * (sizes[0] + sizes[1]), *_bounds(said.constraints)] * degree,
            [label for k in range(mesh.points.size)[points] for label in _row_labels(phase, mesh, k)],
        )
        _add_rate_rows(rows, phase, (interval, mesh), (quantities, duration))
    integrals = duration * (quantities @ mesh.weights)
    symbols, values = [phase.duration], [duration]
    for used, column in (
        (phase.start.used, started),
        (phase.first.used, quantities[:, 0]),
        (phase.end.used, quantities[:, -1]),
        (phase.integral.used, integrals),
        (phase.mean.used, integrals / duration),
    ):
        for name, symbol in used.items():
            symbols.append(symbol)
            values.append(column[phase.quantities.index(name)])  # states come first, so this serves `start` too
    return layout, symbols, values


def _layout(first: int, sizes: Sequence[int], points: int) -> PhaseLayout:
    """Return where a phase stands in x: its duration, states at the start, then all kinds point by point."""
    start = first + 1 + np.arange(sizes[0], dtype=np.intp)
    places = first + 1 + sizes[0] + np.arange(sum(sizes) * points, dtype=np.intp).reshape(points, sum(sizes)).T
    states, algebraics, controls = np.split(places, np.cumsum(sizes)[:-1])
    return PhaseLayout(first, np.column_stack((start, states)), algebraics, controls)


def _add_rate_rows(rows: _Entries, phase: Phase, place: tuple[int, PhaseMesh], of: tuple[Any, Any]) -> None:
    """Add the rate limits of one interval: as many rows as steps between its points and from the interval before."""
    (interval, mesh), (quantities, duration) = place, of
    if not phase.rate_limits:
        return
    matrix = slope_bounds_matrix(mesh.degree, interval == 0)
    steps, nodes = matrix.shape
    end = (interval + 1) * mesh.degree
    chosen = [phase.quantities.index(limit.quantity) for limit in phase.rate_limits]
    values = quantities[chosen, end - nodes : end]
    rates = (values @ matrix.T) / (mesh.interval_fractions[interval] * duration)
    labels = [
        label
        for index in range(end - steps, end)
        for label in _point_labels("rate", phase, mesh, index, phase.rate_limits)
    ]
    rows.append(ca.vec(rates), _bounds(phase.rate_limits) * steps, labels)


def _row_labels(phase: Phase, mesh: PhaseMesh, index: int) -> list[Label]:
    """Label defects, residuals and path constraints of a collocation point (index from 0)."""
    said = phase.expressions
    return [
        *_point_labels("defect", phase, mesh, index, phase.states),
        *_point_labels("residual", phase, mesh, index, said.residuals),
        *_point_labels("path", phase, mesh, index, said.constraints),
    ]


def _bounds(
    declared: Sequence[Variable | PathConstraint | RateLimit | Link],
) -> list[tuple[Expression, Expression]]:
    return [(one.lower, one.upper) for one in declared]


def _point_labels(
    kind: str,
    phase: Phase,
    mesh: PhaseMesh,
    index: int,
    of: Sequence[Variable | Residual | PathConstraint | RateLimit],
) -> list[Label]:
    """Label the rows of a collocation point (index from 0)."""
    fraction = float(mesh.points[index])
    return [Label(kind, declared.name, declared.scale, phase.name, index + 1, fraction) for declared in of]
