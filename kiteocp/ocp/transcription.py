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
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from kiteocp.ocp.collocation import PhaseMesh, differentiation_matrix, slope_bounds_matrix
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


@dataclass
class _Entries:
    """Variables or constraint rows under construction: columns of expressions, bounds and labels grow together."""

    columns: list[Any] = field(default_factory=list)
    bounds: list[tuple[Expression, Expression]] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)

    def new_variables(self, declared: Sequence[Variable], labels: Sequence[Label]) -> tuple[list[int], Any]:
        """Add variables; return their indices and their values in physical units, a column."""
        first = len(self.labels)
        symbols = ca.SX.sym(str(labels[0]) if labels else "", len(declared))
        self.append(symbols, declared, labels)
        return list(range(first, len(self.labels))), symbols * ca.DM([v.scale for v in declared])

    def append(
        self, column: Any, bounded: Sequence[Variable | PathConstraint | RateLimit | Link], labels: Sequence[Label]
    ) -> None:
        """Add a column of expressions with the bounds of their declarations."""
        self.columns.append(column)
        self.bounds += [(declared.lower, declared.upper) for declared in bounded]
        self.labels += labels

    def append_equations(self, column: Any, labels: Sequence[Label]) -> None:
        """Add a column of expressions that must vanish."""
        self.columns.append(column)
        self.bounds += [(0.0, 0.0)] * len(labels)
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


def point_function(phase: Phase, statics: Any, parameters: Any) -> Any:
    """Model of a phase at one point as a CasADi function, built once and called at every point.

    Returns
    -------
    casadi.Function
        (states, algebraics, controls, time, duration, statics, parameters) ->
        (derivatives, residuals, constraints, outputs), columns in the order of declaration, physical units.

    Raises
    ------
    ValueError
        If the model uses a symbol that is none of these.

    """
    point, said = phase.point, phase.expressions
    groups = [_column([point[v.name] for v in g]) for g in (phase.states, phase.algebraics, phase.controls)]
    inputs = [*groups, point.time, point.duration, statics, parameters]
    outputs = [
        _column([said.derivatives[v.name] for v in phase.states]),
        _column([r.expression for r in said.residuals]),
        _column([c.expression for c in said.constraints]),
        _column(list(said.outputs.values())),
    ]
    _require_known(f"the model of phase '{phase.name}'", outputs, inputs)
    return ca.Function(f"point_{phase.name}", inputs, outputs, {"cse": True})


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
    _, statics = variables.new_variables(
        problem.statics, [Label("static", static.name, static.scale) for static in problem.statics]
    )
    static_symbols = _column([static.symbol for static in problem.statics])
    parameters = ca.SX(problem.parameters)
    layouts, functions = {}, {}
    symbols, values = [static_symbols, parameters], [statics, parameters]
    for phase in problem.phases:
        function = functions[phase.name] = point_function(phase, static_symbols, parameters)
        layout, used, meant = _transcribe_phase(
            phase, mesh[phase.name], function, (statics, parameters), (variables, rows)
        )
        layouts[phase.name] = layout
        symbols += used
        values += meant
    wanted = [ca.SX(problem.objective), *(ca.SX(link.expression) for link in problem.links)]
    _require_known("the objective or a link", wanted, symbols)
    objective, *linked = ca.Function("links", symbols, wanted).call(values)
    rows.append(_column(linked), problem.links, [Label("link", link.name, link.scale) for link in problem.links])
    bounds = [entries.bound(side) for entries in (variables, rows) for side in (0, 1)]
    _require_known("a bound", bounds, [parameters])
    return NonlinearProgram(
        x=ca.vertcat(*variables.columns),
        p=parameters,
        f=objective,
        g=ca.vertcat(*rows.columns) / rows.scales,
        bounds=ca.Function("bounds", [parameters], bounds, ["p"], ["lbx", "ubx", "lbg", "ubg"]),
        variables=tuple(variables.labels),
        rows=tuple(rows.labels),
        problem=problem,
        mesh=dict(mesh),
        layouts=layouts,
        functions=functions,
    )


def _transcribe_phase(
    phase: Phase, mesh: PhaseMesh, function: Any, shared: tuple[Any, Any], program: tuple[_Entries, _Entries]
) -> tuple[PhaseLayout, list[Any], list[Any]]:
    """Add the variables and rows of a phase; return its layout, and its link symbols with their meaning."""
    variables, rows = program
    declared = {"state": phase.states, "algebraic": phase.algebraics, "control": phase.controls}
    places: dict[str, list[list[int]]] = {kind: [] for kind in declared}

    def add(kind: str, point: int, fraction: float) -> Any:
        """Add the variables of one kind at one point; return their values."""
        labels = [Label(kind, v.name, v.scale, phase.name, point, fraction) for v in declared[kind]]
        indices, values = variables.new_variables(declared[kind], labels)
        places[kind].append(indices)
        return values

    (duration_index,), duration = variables.new_variables(
        [phase.duration_variable], [Label("duration", "duration", phase.duration_variable.scale, phase.name)]
    )
    states, quantities = [add("state", 0, 0.0)], []
    for interval, width in enumerate(mesh.interval_fractions):
        results = []
        for k in range(interval * mesh.degree, (interval + 1) * mesh.degree):
            fraction = float(mesh.points[k])
            groups = [add(kind, k + 1, fraction) for kind in declared]
            results.append(function(*groups, fraction * duration, duration, *shared))
            states.append(groups[0])
            quantities.append(ca.vertcat(*groups, results[-1][3]))
        slopes = ca.horzcat(*states[-mesh.degree - 1 :]) @ differentiation_matrix(mesh.degree).T
        for j, result in enumerate(results):
            defect = slopes[:, j] - width * duration * result[0]
            place = interval * mesh.degree + j, mesh
            _add_point_rows(rows, phase, place, (defect, result))
        _add_rate_rows(rows, phase, (interval, mesh), (quantities, duration))
    layout = PhaseLayout(duration_index, *(np.array(p, dtype=np.intp).T for p in places.values()))
    integrals = duration * (ca.horzcat(*quantities) @ mesh.weights)
    symbols, values = [phase.duration], [duration]
    for used, column in (
        (phase.start.used, states[0]),
        (phase.first.used, quantities[0]),
        (phase.end.used, quantities[-1]),
        (phase.integral.used, integrals),
        (phase.mean.used, integrals / duration),
    ):
        for name, symbol in used.items():
            symbols.append(symbol)
            values.append(column[phase.quantities.index(name)])  # states come first, so this serves `start` too
    return layout, symbols, values


def _add_point_rows(rows: _Entries, phase: Phase, place: tuple[int, PhaseMesh], point: tuple[Any, Any]) -> None:
    """Add defects, residuals and path constraints of one collocation point (index from 0)."""
    (index, mesh), (defect, (_, residuals, constraints, _)) = place, point
    paths = phase.expressions.constraints
    rows.append_equations(defect, _point_labels("defect", phase, mesh, index, phase.states))
    rows.append_equations(residuals, _point_labels("residual", phase, mesh, index, phase.expressions.residuals))
    rows.append(constraints, paths, _point_labels("path", phase, mesh, index, paths))


def _add_rate_rows(rows: _Entries, phase: Phase, place: tuple[int, PhaseMesh], so_far: tuple[list[Any], Any]) -> None:
    """Add the rate limits of one interval: as many rows as steps between its points and from the interval before."""
    (interval, mesh), (quantities, duration) = place, so_far
    if not phase.rate_limits:
        return
    matrix = slope_bounds_matrix(mesh.degree, interval == 0)
    steps, nodes = matrix.shape
    chosen = [phase.quantities.index(limit.quantity) for limit in phase.rate_limits]
    values = ca.horzcat(*(point[chosen] for point in quantities[-nodes:]))
    rates = (values @ matrix.T) / (mesh.interval_fractions[interval] * duration)
    for step in range(steps):
        index = len(quantities) - steps + step
        rows.append(rates[:, step], phase.rate_limits, _point_labels("rate", phase, mesh, index, phase.rate_limits))


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


def _column(expressions: Sequence[Expression]) -> Any:
    """Column vector of scalars, of shape (0, 1) when there are none."""
    return ca.SX(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


def _require_known(owner: str, expressions: Sequence[Any], known: Sequence[Any]) -> None:
    """Reject expressions of symbols that have no value where they are used."""
    allowed = {symbol.__hash__() for group in known for symbol in ca.symvar(group)}
    strange = [s.name() for s in ca.symvar(ca.veccat(*expressions)) if s.__hash__() not in allowed]
    if strange:
        raise ValueError(f"{owner} uses {', '.join(strange)}, which has no value there")
