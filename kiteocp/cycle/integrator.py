"""Adaptive Runge-Kutta integration in which any component of the state may be the independent variable.

A phase of the cycle ends at a tether length or an elevation. With that quantity as the independent variable the last
step ends there exactly (Henon, *On the numerical computation of Poincare maps*, Physica D 5, 1982), and a phase in
which it is monotone needs no search for its end at all. One step is one CasADi call of some microseconds; a general
integrator (scipy's, against which the tests hold this one) costs thirty times as much for the same accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from kiteocp.cycle.buffered import BufferedFunction

# Dormand and Prince (1980), order 5 with an embedded error estimate of order 4; the last row is the solution.
_STAGES = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


def step_function(rates: ca.Function, independent: int) -> ca.Function:
    """Build one step of the pair: ``(state, step, parameters) -> (next state, error estimate)``.

    Parameters
    ----------
    rates
        ``(state, parameters) -> time derivatives``; component 0 of the state is the time itself.
    independent
        Index of the component that advances by ``step``.
    """
    symbol: Any = ca.SX if rates.is_a("SXFunction") else ca.MX
    state, step = symbol.sym("state", rates.size1_in(0)), symbol.sym("step")
    parameters = symbol.sym("parameters", rates.size1_in(1))
    slopes: list[Any] = []
    point = state
    for row in _STAGES:
        point = state
        for weight, slope in zip(row, slopes, strict=True):
            point = point + step * weight * slope
        slope = rates(point, parameters)
        slopes.append(slope if independent == 0 else slope / slope[independent])
    error = sum(weight * slope for weight, slope in zip(_ERROR, slopes, strict=True))
    return ca.Function("step", [state, step, parameters], [ca.densify(point), ca.densify(step * error)])


class IntegrationError(Exception):
    """The integration cannot go on; ``state`` is the last good state, ``reason`` is ``domain`` or ``too_long``."""

    def __init__(self, state: np.ndarray, reason: str) -> None:
        super().__init__(reason)
        self.state = state
        self.reason = reason


@dataclass
class Integrator:
    """Integrate one phase to a given value of one component.

    Attributes
    ----------
    rates
        ``(state, parameters) -> time derivatives``, component 0 of the state being the time.
    target
        Index of the component whose value ends the integration.
    monotone
        The component moves towards its end throughout, so that it can be the independent variable from the start.
    scales
        Size of each component, for the error estimate.
    tolerance
        Admissible error of a step relative to the scales.
    """

    rates: ca.Function
    target: int
    monotone: bool
    scales: np.ndarray
    tolerance: float = 1e-9
    max_steps: int = 20000

    def __post_init__(self) -> None:
        self._to_target = BufferedFunction(step_function(self.rates, self.target))
        self._in_time = None if self.monotone else BufferedFunction(step_function(self.rates, 0))

    def run(self, start: np.ndarray, parameters: np.ndarray, end: float, max_time: float) -> np.ndarray:
        """Return the states at the accepted steps, start and end included, shape (steps + 1, n).

        Raises
        ------
        IntegrationError
            A state on the way does not exist, or the end is not reached within ``max_time`` seconds.
        """
        states = [start]
        state = start
        step_in_time = 0.05 * max(self.scales[0], 1e-6)
        step_to_target = 0.05 * (end - start[self.target])
        for _ in range(self.max_steps):
            remaining = end - state[self.target]
            if remaining == 0.0:
                return np.array(states)
            if self._in_time is None:
                step_to_target = min(step_to_target, remaining, key=abs)
                new, step_to_target = self._accepted(self._to_target, state, step_to_target, parameters)
            else:
                new, next_step = self._accepted(self._in_time, state, step_in_time, parameters)
                if (end - new[self.target]) * remaining <= 0.0:
                    new, _ = self._accepted(self._to_target, state, remaining, parameters)
                    next_step = step_in_time
                    if new[0] <= state[0]:
                        # The target is not yet being approached: come nearer in time first.
                        step_in_time /= 4
                        continue
                step_in_time = next_step
            if abs(end - new[self.target]) <= 1e-13 * self.scales[self.target]:
                new[self.target] = end
            if new[0] < state[0]:
                raise IntegrationError(state, "domain")
            if new[0] > max_time:
                raise IntegrationError(new, "too_long")
            states.append(new)
            state = new
        raise IntegrationError(state, "too_long")

    def _accepted(
        self, step_call: BufferedFunction, state: np.ndarray, step: float, parameters: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Take a step of at most the given size; return the new state and the size proposed for the next."""
        smallest = abs(step) * 1e-9
        while abs(step) > smallest:
            new, error = step_call.call(state, step, parameters)
            size = float(np.max(np.abs(error) / self.scales)) / self.tolerance
            if size <= 1.0:
                return new.copy(), step * min(5.0, 0.9 * max(size, 1e-10) ** -0.2)
            # A step out of the model's domain gives no error estimate: a quarter of it may stay inside.
            step *= max(0.2, 0.9 * size**-0.2) if np.isfinite(size) else 0.25
        raise IntegrationError(state, "domain")
