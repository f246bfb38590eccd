"""Values of a multi-phase problem over time: starting guesses and solutions, on and between the mesh points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.ocp.collocation import FloatArray, PhaseMesh
from kiteocp.ocp.declaration import Phase

Profile = float | ArrayLike | Callable[[FloatArray], ArrayLike]
"""A constant, an array at the mesh points, or a function of the fraction of the phase (0 to 1, array in and out)."""


class PhaseGuess(msgspec.Struct, frozen=True):
    """Start values of one phase.

    Attributes
    ----------
    duration
        In seconds.
    values
        A `Profile` for every state, algebraic and control. Arrays have one value at the phase start and one per
        collocation point for states, and one per collocation point for the others.

    """

    duration: float
    values: Mapping[str, Profile]


class Guess(msgspec.Struct, frozen=True):
    """Start values of a whole problem: every phase and every static, by name."""

    phases: Mapping[str, PhaseGuess]
    statics: Mapping[str, float]


class PhaseTrajectory(msgspec.Struct, frozen=True):
    """One phase of a solution.

    Attributes
    ----------
    phase, mesh
        What was discretised, and how.
    duration
        In seconds.
    values
        States at start and collocation points, shape (points + 1,); algebraics, controls and outputs at the
        collocation points, shape (points,).
    integrals
        Radau quadrature of every quantity over the phase.
    statics, parameters, point_parameters
        Values of the problem's statics and parameters, and what its models take of these (needed for the outputs).
    function
        The phase's model as a CasADi function, see `kiteocp.ocp.point_model.PointModel`.

    """

    phase: Phase
    mesh: PhaseMesh
    duration: float
    values: Mapping[str, FloatArray]
    integrals: Mapping[str, float]
    statics: FloatArray
    parameters: FloatArray
    point_parameters: FloatArray
    function: Any

    @property
    def fractions(self) -> FloatArray:
        """Start and collocation points as fractions of the phase, shape (points + 1,)."""
        return np.concatenate(([0.0], self.mesh.points))

    @property
    def times(self) -> FloatArray:
        """Start and collocation points as times since the phase start, shape (points + 1,)."""
        return self.fractions * self.duration

    @property
    def means(self) -> dict[str, float]:
        """Time mean of every quantity over the phase."""
        return {name: value / self.duration for name, value in self.integrals.items()}

    def evaluate(self, fractions: ArrayLike) -> dict[str, FloatArray]:
        """Every quantity at any fractions of the phase.

        States follow the collocation polynomial through interval start and points. Algebraics and controls follow the
        polynomial through the points of the interval, so that they may jump at its borders; a continuous one passes
        through the end of the interval before as well. At the phase start both are extrapolated. Outputs are the
        model's at these values.

        Parameters
        ----------
        fractions
            Between 0 and 1, shape (m,).

        Returns
        -------
        dict of ndarray, shape (m,)

        Raises
        ------
        ValueError
            If a fraction lies outside [0, 1].

        """
        wanted = np.atleast_1d(np.asarray(fractions, dtype=float))
        unknowns = self._interpolate(wanted)
        outputs = self._call(wanted, unknowns)[3]
        return unknowns | dict(zip(self.phase.expressions.outputs, outputs, strict=True))

    def defects(self, fractions: ArrayLike) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """How well the model holds between the collocation points, where nothing enforces it.

        Returns
        -------
        rates : dict of ndarray, shape (m,)
            Slope of each state's polynomial minus the model's derivative.
        residuals : dict of ndarray, shape (m,)
            The algebraic residuals.

        """
        wanted = np.atleast_1d(np.asarray(fractions, dtype=float))
        derivatives, residuals = self._call(wanted, self._interpolate(wanted))[:2]
        matrix = self.mesh.slope_matrix(wanted) / self.duration
        slopes = [matrix @ self.values[v.name] for v in self.phase.states]
        rates = {v.name: slopes[i] - derivatives[i] for i, v in enumerate(self.phase.states)}
        return rates, {r.name: residuals[i] for i, r in enumerate(self.phase.expressions.residuals)}

    def _interpolate(self, wanted: FloatArray) -> dict[str, FloatArray]:
        """States, algebraics and controls at `wanted`."""
        phase, state_matrix = self.phase, self.mesh.state_matrix(wanted)
        matrices = {False: self.mesh.control_matrix(wanted), True: self.mesh.continuous_matrix(wanted)}
        others = (*phase.algebraics, *phase.controls)
        result = {v.name: state_matrix @ self.values[v.name] for v in phase.states}
        return result | {v.name: matrices[v.continuous] @ self.values[v.name] for v in others}

    def _call(self, wanted: FloatArray, unknowns: Mapping[str, FloatArray]) -> list[FloatArray]:
        """Evaluate derivatives, residuals, constraints and outputs of the model at `wanted`, one row per quantity."""
        groups = [
            stack([unknowns[v.name] for v in variables], wanted.size)
            for variables in (self.phase.states, self.phase.algebraics, self.phase.controls)
        ]
        return call_model(self.function, groups, wanted, (self.duration, self.statics, self.point_parameters))

    def guess(self) -> PhaseGuess:
        """Return this phase as a start for any mesh."""
        phase, mesh = self.phase, self.mesh
        profiles: dict[str, Profile] = {v.name: partial(self._profile, v.name, mesh.state_matrix) for v in phase.states}
        for v in (*phase.algebraics, *phase.controls):
            profiles[v.name] = partial(
                self._profile, v.name, mesh.continuous_matrix if v.continuous else mesh.control_matrix
            )
        return PhaseGuess(self.duration, profiles)

    def _profile(self, name: str, matrix: Callable[[ArrayLike], FloatArray], fractions: FloatArray) -> FloatArray:
        return np.asarray(matrix(fractions) @ self.values[name], dtype=np.float64)


class Trajectory(msgspec.Struct, frozen=True):
    """All phases and statics of a solution, by name."""

    phases: Mapping[str, PhaseTrajectory]
    statics: Mapping[str, float]

    def __getitem__(self, phase: str) -> PhaseTrajectory:
        return self.phases[phase]

    def guess(self) -> Guess:
        """Return this trajectory as a start for any mesh."""
        return Guess({name: phase.guess() for name, phase in self.phases.items()}, self.statics)


def stack(rows: list[FloatArray], columns: int) -> FloatArray:
    """Rows as one array, of the right shape also when there are none."""
    return np.array(rows, dtype=np.float64).reshape(len(rows), columns)


def call_model(
    function: Any,
    groups: list[FloatArray],
    fractions: FloatArray,
    shared: tuple[float, FloatArray, FloatArray],
) -> list[NDArray[np.float64]]:
    """Evaluate a point function at many points at once.

    Parameters
    ----------
    function
        See `kiteocp.ocp.point_model.PointModel`.
    groups
        States, algebraics and controls, each of shape (number of them, m).
    fractions
        Shape (m,).
    shared
        Duration, statics and parameters, the same at all points.

    Returns
    -------
    list of ndarray
        Derivatives, residuals, constraints and outputs, each of shape (number of them, m).

    """
    count = fractions.size
    columns: list[Any] = [*(group.T.ravel() for group in groups), fractions * shared[0], *shared]
    results = _at_points(function, count).call(*columns)
    return [result.reshape(count, result.size // count).T.copy() for result in results]


@lru_cache(maxsize=128)
def _at_points(function: Any, count: int) -> BufferedFunction:
    """Return (once built) a point function at so many points, which share duration, statics and parameters."""
    shared = [function.n_in() - 3, function.n_in() - 2, function.n_in() - 1]
    return BufferedFunction(function.map("points", "serial", count, shared, []))
