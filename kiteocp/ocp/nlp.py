"""The nonlinear program a transcription yields: expressions, bounds, and a name for every variable and row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kiteocp.ocp.collocation import FloatArray, PhaseMesh
from kiteocp.ocp.composition import Composition
from kiteocp.ocp.declaration import OptimalControlProblem
from kiteocp.ocp.trajectory import (
    Guess,
    PhaseGuess,
    PhaseTrajectory,
    Profile,
    Trajectory,
    call_model,
)

IndexArray = NDArray[np.intp]


class Label(msgspec.Struct, frozen=True):
    """What a variable or a constraint row of the program is.

    Attributes
    ----------
    kind
        Of variables: static, duration, state, algebraic, control. Of rows: defect, residual, path, rate, link.
    name
        The declared name of the quantity, residual, constraint or link.
    scale
        The program's number times this is in physical units; a multiplier divided by this is per physical unit.
    phase
        Name of the phase, None for statics and links.
    point
        0 for the phase start, k for the k-th collocation point, None where it does not apply.
    fraction
        Of the phase duration at that point.

    """

    kind: str
    name: str
    scale: float = 1.0
    phase: str | None = None
    point: int | None = None
    fraction: float | None = None

    def __str__(self) -> str:
        place = "" if self.point is None else f" at point {self.point} ({self.fraction:.3g} of the phase)"
        return f"{self.kind} {self.name if self.phase is None else f'{self.phase}.{self.name}'}{place}"


class PhaseLayout(msgspec.Struct, frozen=True):
    """Where the variables of a phase are in x; each array has one row per variable, one column per point."""

    duration: int
    states: IndexArray
    algebraics: IndexArray
    controls: IndexArray


class NonlinearProgram(msgspec.Struct, frozen=True, eq=False):
    """Minimise f(x, p) subject to lbx <= x <= ubx and lbg <= g(x, p) <= ubg.

    Attributes
    ----------
    composition
        Variables over their scales, parameters, objective, rows over their scales, and their derivatives.
    bounds
        CasADi function p -> (lbx, ubx, lbg, ubg).
    variables, rows
        A label for each entry of x and of g.
    problem, mesh, layouts, functions
        What it came from: declaration, mesh, places in x and model function of each phase, by phase name.

    """

    composition: Composition
    bounds: Any
    variables: tuple[Label, ...]
    rows: tuple[Label, ...]
    problem: OptimalControlProblem
    mesh: Mapping[str, PhaseMesh]
    layouts: Mapping[str, PhaseLayout]
    functions: Mapping[str, Any]

    def in_units(self, objective: Any) -> Any:
        """Return an objective, a change or a derivative of it in the unit of the problem (`objective_unit`)."""
        return objective * self.problem.objective_unit

    @property
    def x(self) -> Any:
        """Variables, an ``SX`` column."""
        return self.composition.x

    @property
    def p(self) -> Any:
        """Parameters, an ``SX`` column."""
        return self.composition.p

    @property
    def f(self) -> Any:
        """Objective as an ``SX`` expression of x and p; composed when it is first asked for."""
        return self.composition.expressions[0]

    @property
    def g(self) -> Any:
        """Rows as an ``SX`` expression of x and p; composed when they are first asked for."""
        return self.composition.expressions[1]

    @property
    def scales(self) -> FloatArray:
        """Scale of every variable, shape (number of variables,)."""
        return np.array([label.scale for label in self.variables])

    def find_rows(self, *, phase: str | None = None, kind: str | None = None, name: str | None = None) -> IndexArray:
        """Find the constraint rows with the given phase, kind and name (None: any), in point order."""
        return _find(self.rows, phase, kind, name)

    def find_variables(
        self, *, phase: str | None = None, kind: str | None = None, name: str | None = None
    ) -> IndexArray:
        """Find the variables with the given phase, kind and name (None: any), in point order."""
        return _find(self.variables, phase, kind, name)

    def pack(self, start: Guess | Trajectory) -> FloatArray:
        """Turn a guess, or a solution on any mesh, into a starting vector.

        Returns
        -------
        ndarray, shape (number of variables,)

        Raises
        ------
        ValueError
            If a phase, variable or static is missing, an array has the wrong length, or a number is not finite.

        """
        guess = start.guess() if isinstance(start, Trajectory) else start
        x = np.empty(len(self.variables))
        for index, static in enumerate(self.problem.statics):
            x[index] = _require(guess.statics, static.name, "statics")
        for phase in self.problem.phases:
            given: PhaseGuess = _require(guess.phases, phase.name, "phases")
            layout, points = self.layouts[phase.name], self.mesh[phase.name].points
            x[layout.duration] = given.duration
            everywhere = np.concatenate(([0.0], points))
            for variables, places, fractions in (
                (phase.states, layout.states, everywhere),
                (phase.algebraics, layout.algebraics, points),
                (phase.controls, layout.controls, points),
            ):
                for variable, place in zip(variables, places, strict=True):
                    profile = _require(given.values, variable.name, f"phase '{phase.name}'")
                    x[place] = _sample(profile, fractions, f"{phase.name}.{variable.name}")
        wrong = np.flatnonzero(~np.isfinite(x))
        if wrong.size:
            raise ValueError(f"the starting guess is not finite for {self.variables[wrong[0]]}")
        return x / self.scales

    def unpack(self, x: ArrayLike, p: ArrayLike = ()) -> Trajectory:
        """Turn a vector of variables into named values over time.

        Parameters
        ----------
        x
            Shape (number of variables,), as in a solution.
        p
            Parameters, shape (number of parameters,).

        """
        values, parameters = np.asarray(x, dtype=float) * self.scales, np.asarray(p, dtype=float).ravel()
        statics = values[: len(self.problem.statics)]
        shared = np.asarray(self.problem.point_parameters(parameters).full().ravel(), dtype=np.float64)
        phases = {}
        for phase in self.problem.phases:
            layout, mesh = self.layouts[phase.name], self.mesh[phase.name]
            function, duration = self.functions[phase.name], float(values[layout.duration])
            states, algebraics, controls = (values[i] for i in (layout.states, layout.algebraics, layout.controls))
            groups = [states[:, 1:], algebraics, controls]
            outputs = call_model(function, groups, mesh.points, (duration, statics, shared))[3]
            named = dict(zip(phase.quantities, (*states, *algebraics, *controls, *outputs), strict=True))
            weights = duration * mesh.weights
            integrals = {name: float(weights @ value[-weights.size :]) for name, value in named.items()}
            fixed = statics, parameters, shared
            phases[phase.name] = PhaseTrajectory(phase, mesh, duration, named, integrals, *fixed, function)
        return Trajectory(phases, {s.name: float(v) for s, v in zip(self.problem.statics, statics, strict=True)})

    def numeric_bounds(self, p: ArrayLike = ()) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Bounds lbx, ubx, lbg, ubg as arrays.

        Raises
        ------
        ValueError
            If the parameters make a bound NaN or cross two bounds; names the variable or row.

        """
        lbx, ubx, lbg, ubg = (b.full().ravel() for b in self.bounds(ca.DM(np.asarray(p, dtype=float).ravel())))
        for labels, lower, upper in ((self.variables, lbx, ubx), (self.rows, lbg, ubg)):
            wrong = np.flatnonzero(~(lower <= upper))
            if wrong.size:
                i, label = wrong[0], labels[wrong[0]]
                raise ValueError(
                    f"{label}: lower bound {lower[i] * label.scale:g} must not exceed "
                    f"upper bound {upper[i] * label.scale:g}"
                )
        return lbx, ubx, lbg, ubg


def _find(labels: tuple[Label, ...], phase: str | None, kind: str | None, name: str | None) -> IndexArray:
    chosen = [
        i
        for i, label in enumerate(labels)
        if phase in (None, label.phase) and kind in (None, label.kind) and name in (None, label.name)
    ]
    return np.array(chosen, dtype=np.intp)


def _require(mapping: Mapping[str, Any], name: str, owner: str) -> Any:
    """Value of a name that must be there."""
    if name not in mapping:
        raise ValueError(f"the starting guess lacks '{name}' in {owner}; it has {', '.join(mapping) or 'nothing'}")
    return mapping[name]


def _sample(profile: Profile, fractions: FloatArray, owner: str) -> FloatArray:
    """Values of a profile at the points."""
    values = np.asarray(profile(fractions) if callable(profile) else profile, dtype=float)
    if values.shape not in {(), fractions.shape}:
        raise ValueError(f"the starting guess of {owner} needs {fractions.size} values, not shape {values.shape}")
    return np.broadcast_to(values, fractions.shape)
