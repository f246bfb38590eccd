"""Adaptive Runge-Kutta integration in which any component of the state may be the independent variable.

An integration may end at a value of any component. With that component as the independent variable the last
step ends there exactly (Henon, *On the numerical computation of Poincare maps*, Physica D 5, 1982), and a phase in
which it is monotone needs no search for its end at all. Rates that are smooth by branches are stepped from kink to
kink. One step is one CasADi call of some microseconds; a general integrator (scipy's, against which the tests hold this
one) costs many times as much for the same accuracy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.numerics.tableaus import DORMAND_PRINCE_5, DORMAND_PRINCE_8, Tableau

#: A kink is located to this share of the step over it. The rates are continuous there, so that its square counts.
KINK_ACCURACY = 1e-4

#: A step that has to be made smaller than this share of its scale has met the end of the model's domain.
SMALLEST_STEP = 1e-9

#: Stages of a step, as shares of all, at which a branch is checked beside the step's end.
CHECKED = (0.55, 0.75)


class Branches(msgspec.Struct, frozen=True):
    """Continuous rates that are smooth between kinks.

    Attributes
    ----------
    rates
        ``(state, parameters) -> time derivatives`` of each branch.
    thresholds
        ``(state, parameters) -> values``, one fewer than branches and falling: so many of them as are positive, that
        is the branch that holds. What is not a number counts as not positive.
    """

    rates: tuple[ca.Function, ...]
    thresholds: ca.Function


def step_function(
    rates: ca.Function,
    independent: int,
    scales: np.ndarray,
    tableau: Tableau = DORMAND_PRINCE_5,
    thresholds: ca.Function | None = None,
) -> ca.Function:
    """Build one step: ``(state, step, parameters) -> next state, error[, thresholds at the end and at two stages]``.

    Parameters
    ----------
    rates
        ``(state, parameters) -> time derivatives``; component 0 of the state is the time itself.
    independent
        Index of the component that advances by ``step``.
    scales
        Size of each component; the error is relative to them.
    tableau
        The Runge-Kutta pair.
    thresholds
        As in `Branches`.
    """
    symbol: Any = ca.SX if rates.is_a("SXFunction") else ca.MX
    state, step = symbol.sym("state", rates.size1_in(0)), symbol.sym("step")
    parameters = symbol.sym("parameters", rates.size1_in(1))
    slopes: list[Any] = []
    points: list[Any] = []

    def moved(weights: tuple[float, ...]) -> Any:
        # One product: CasADi's operators cost more to call than to evaluate.
        return ca.mtimes(ca.horzcat(*slopes[: len(weights)]), ca.sparsify(ca.DM(weights)))

    for row in tableau.stages:
        points.append(state + step * moved(row) if row else state)
        slope = rates(points[-1], parameters)
        slopes.append(slope if independent == 0 else slope / slope[independent])
    end = state + step * moved(tableau.weights)
    errors = [ca.sumsqr(step * moved(weights) / scales) for weights in tableau.errors]
    # Of two estimates the finer counts, less so where it is not much smaller than the coarser (Hairer et al.).
    error = errors[0] / ca.sqrt(errors[0] + 0.01 * errors[1] + 1e-60) if len(errors) > 1 else ca.sqrt(errors[0])
    results = [ca.densify(end), error]
    if thresholds is not None:
        checked = [points[round(share * len(points))] for share in CHECKED]
        results.append(ca.horzcat(*(thresholds(point, parameters) for point in (end, *checked))))
    return ca.Function("step", [state, step, parameters], results)


class IntegrationError(Exception):
    """The integration cannot go on; ``state`` is the last good state, ``reason`` is ``domain`` or ``too_long``."""

    def __init__(self, state: np.ndarray, reason: str) -> None:
        super().__init__(reason)
        self.state = state
        self.reason = reason


class Integrator(msgspec.Struct, dict=True):
    """Integrate one phase to a given value of one component.

    Attributes
    ----------
    rates
        ``(state, parameters) -> time derivatives``, component 0 of the state being the time; or `Branches`.
    target
        Index of the component whose value ends the integration.
    monotone
        The component moves towards its end throughout, so that it can be the independent variable from the start.
    scales
        Size of each component, for the error estimate.
    tolerance
        Admissible error of a step relative to the scales.
    max_steps
        Steps tried at most.
    order
        8 for smooth rates, or 5, which loses less at kinks inside the rates.
    """

    rates: ca.Function | Branches
    target: int
    monotone: bool
    scales: np.ndarray
    tolerance: float = 1e-9
    max_steps: int = 20000
    order: int = 5

    def __post_init__(self) -> None:
        tableau = DORMAND_PRINCE_8 if self.order == 8 else DORMAND_PRINCE_5
        branches = self.rates.rates if isinstance(self.rates, Branches) else (self.rates,)
        thresholds = self.rates.thresholds if isinstance(self.rates, Branches) else None

        @cache
        def step(independent: int, branch: int) -> BufferedFunction:
            """Build a step when it is first taken; most cycles know one or two branches."""
            return BufferedFunction(step_function(branches[branch], independent, self.scales, tableau, thresholds))

        self._step = step
        self._thresholds = None if thresholds is None else BufferedFunction(thresholds)

    def run(self, start: np.ndarray, parameters: np.ndarray, end: float, max_time: float) -> np.ndarray:
        """Return the states at the accepted steps, start and end included, shape (steps + 1, n).

        Raises
        ------
        IntegrationError
            A state on the way does not exist, or the end is not reached within ``max_time`` seconds.
        """
        states = [start]
        state, target = start, self.target
        step_in_time = 0.05 * max(self.scales[0], 1e-6)
        step_to_target = 0.05 * (end - start[target])
        if self.order == 8:
            step_in_time, step_to_target = 4 * step_in_time, 5 * step_to_target
        branch = 0 if self._thresholds is None else _branch(self._thresholds(state, parameters))
        for _ in range(self.max_steps):
            remaining = end - state[target]
            if remaining == 0.0:
                return np.array(states)
            if self.monotone:
                step_to_target = min(step_to_target, remaining, key=abs)
                new, step_to_target, branch = self._accepted(target, branch, state, step_to_target, parameters)
            else:
                new, next_step, next_branch = self._accepted(0, branch, state, step_in_time, parameters)
                if (end - new[target]) * remaining <= 0.0:
                    new, _, next_branch = self._accepted(target, branch, state, remaining, parameters)
                    next_step = step_in_time
                    if new[0] <= state[0]:
                        # The target is not yet being approached: come nearer in time first.
                        step_in_time /= 4
                        continue
                step_in_time, branch = next_step, next_branch
            if abs(end - new[target]) <= 1e-13 * self.scales[target]:
                new[target] = end
            if new[0] < state[0]:
                raise IntegrationError(state, "domain")
            if new[0] > max_time:
                raise IntegrationError(new, "too_long")
            states.append(new)
            state = new
        raise IntegrationError(state, "too_long")

    def refined(self, states: np.ndarray, parameters: np.ndarray, parts: int) -> np.ndarray:
        """Return the states of a run with more between them, each a shorter step from the one before.

        They are as accurate as those of the run. The result has the shape (steps * parts + 1, n).
        """
        independent = self.target if self.monotone else 0
        dense = []
        for state, after in itertools.pairwise(states):
            branch = 0 if self._thresholds is None else _branch(self._thresholds(state, parameters))
            call = self._step(independent, branch).call
            step = (after[independent] - state[independent]) / parts
            dense += [state, *(call(state, part * step, parameters)[0].copy() for part in range(1, parts))]
        return np.array([*dense, states[-1]])

    def _accepted(
        self, independent: int, branch: int, state: np.ndarray, step: float, parameters: np.ndarray
    ) -> tuple[np.ndarray, float, int]:
        """Take a step of at most the given size; return the new state, the size proposed for the next, its branch."""
        call = self._step(independent, branch).call
        smallest = SMALLEST_STEP * self.scales[independent]
        wanted = step
        while step == wanted or abs(step) > smallest:
            new, error, *thresholds = call(state, step, parameters)
            size = float(error[0]) / self.tolerance
            if not size <= 1.0:
                # A step out of the model's domain gives no error estimate: a quarter of it may stay inside.
                step *= max(0.2, 0.9 * size ** (-1 / self.order)) if math.isfinite(size) else 0.25
                continue
            proposed = step * min(5.0, 0.9 * max(size, 1e-10) ** (-1 / self.order))
            if not thresholds:
                return new.copy(), proposed, branch
            at_end, *within = thresholds[0].reshape(1 + len(CHECKED), -1)
            if _margin(at_end, branch) < 0:
                return self._at_kink(call, branch, state, step, parameters)
            if all(_margin(values, branch) >= 0 for values in within):
                return new.copy(), proposed, branch
            # Another branch holds somewhere within the step.
            step /= 2
        raise IntegrationError(state, "domain")

    def _at_kink(
        self, call: Callable[..., list[np.ndarray]], branch: int, state: np.ndarray, step: float, parameters: np.ndarray
    ) -> tuple[np.ndarray, float, int]:
        """Step just beyond the end of a branch, which lies within the given step, by false position (Illinois)."""

        def margin_after(size: float) -> float:
            return _margin(call(state, size, parameters)[2].reshape(1 + len(CHECKED), -1)[0], branch)

        low, high = 0.0, step
        margin_low, margin_high = margin_after(low), margin_after(high)
        beyond, enough = margin_high, KINK_ACCURACY * margin_high
        side = 0
        while abs(high - low) > KINK_ACCURACY * abs(step) and beyond < enough:
            share = margin_low / (margin_low - margin_high)
            trial = low + (high - low) * (share if 0 < share < 1 else 0.5)
            margin = margin_after(trial)
            # An end that stays twice counts half, so that it moves too.
            if margin < 0:
                high, margin_high, beyond = trial, margin, margin
                margin_low *= 0.5 if side < 0 else 1.0
                side = -1
            else:
                low, margin_low = trial, margin
                margin_high *= 0.5 if side > 0 else 1.0
                side = 1
        new, _, thresholds = call(state, high, parameters)
        return new.copy(), step, _branch(thresholds.reshape(1 + len(CHECKED), -1)[0])


def _branch(thresholds: np.ndarray) -> int:
    return int(np.count_nonzero(thresholds > 0))


def _margin(thresholds: np.ndarray, branch: int) -> float:
    """How far the thresholds are inside a branch; negative outside."""
    above = float(thresholds[branch - 1]) if branch > 0 else math.inf
    below = -float(thresholds[branch]) if branch < thresholds.size else math.inf
    return min(above, below)
