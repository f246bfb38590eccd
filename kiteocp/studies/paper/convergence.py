"""Convergence of the paper's finite-difference scheme (section Convergence Study): harvesting factor over time step."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from kiteocp.cycle.simulation import fly
from kiteocp.errors import CycleError
from kiteocp.ocp.collocation import FloatArray
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import load_problem
from kiteocp.studies.paper.published import CASES, PAPER_BAND, PAPER_TIME_STEP

#: Time steps of the study: the paper's range, in equal ratios.
TIME_STEPS: FloatArray = np.geomspace(0.3, 1e-4, 15)

#: Bisections that locate where the band begins: to 0.01 % of the time step.
BISECTIONS = 13


class Curve(msgspec.Struct, frozen=True):
    """Mean harvesting factor of one cycle over the nondimensional time step of the paper's scheme.

    Attributes
    ----------
    time_steps
        Nondimensional time steps, falling, shape (n,).
    ratios
        Mean harvesting factor over that of the smallest time step, shape (n,); not a number where the scheme failed.
    accurate_ratio
        The same for the adaptive integrator.
    steps
        Steps of the whole cycle, shape (n,); not a number where the scheme failed.
    """

    time_steps: FloatArray
    ratios: FloatArray
    accurate_ratio: float
    steps: FloatArray

    @property
    def order(self) -> float:
        """Observed order of the scheme, of the three smallest time steps (in equal ratios)."""
        first, second, third = self.ratios[-3:]
        return math.log((second - first) / (third - second)) / math.log(self.time_steps[-3] / self.time_steps[-2])

    @property
    def limit_ratio(self) -> float:
        """Richardson's limit of the scheme for a vanishing time step, over the value of the smallest."""
        factor = (self.time_steps[-2] / self.time_steps[-1]) ** self.order
        return float(self.ratios[-1] + (self.ratios[-1] - self.ratios[-2]) / (factor - 1))


class Convergence(msgspec.Struct, frozen=True):
    """The convergence study.

    Attributes
    ----------
    curves
        By the case and the treatment of gravity, as ``strong wind, gravity included``.
    band_time_steps
        Largest time step from which on the scheme stays within the paper's band, by the same names; not a number where
        it never does.
    paper_deviations, paper_steps
        Deviation from the smallest time step, and steps of the cycle, at the time step that the paper uses.
    """

    curves: dict[str, Curve]
    band_time_steps: dict[str, float] = msgspec.field(default_factory=dict)
    paper_deviations: dict[str, float] = msgspec.field(default_factory=dict)
    paper_steps: dict[str, int] = msgspec.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the study for the summary."""
        return {
            name: {
                "time_steps": curve.time_steps,
                "harvesting_factor_ratios": curve.ratios,
                "steps": curve.steps,
                "adaptive_integrator_ratio": curve.accurate_ratio,
                "richardson_limit_ratio": curve.limit_ratio,
                "observed_order": curve.order,
                "within_3_percent_from_time_step": self.band_time_steps[name],
                "deviation_at_the_papers_time_step": self.paper_deviations[name],
                "steps_at_the_papers_time_step": self.paper_steps[name],
            }
            for name, curve in self.curves.items()
        }


def convergence_study(
    time_steps: FloatArray = TIME_STEPS, progress: Callable[[int, int], None] | None = None
) -> Convergence:
    """Fly both cases with and without gravity at every time step, and by the adaptive integrator.

    The mean harvesting factor (eq:meanharvestfact) is normalised, so that the ratio is that of the mean cycle powers:
    wind power density and area do not depend on the time step.

    Parameters
    ----------
    time_steps
        Nondimensional time steps (eq:nondimentionaltime), falling, in equal ratios, shape (n,), n at least 3.
    progress
        Called with the curves done and the number of curves.
    """
    found = Convergence({})
    runs = [(case, gravity) for case in CASES for gravity in (True, False)]
    for done, (case, gravity) in enumerate(runs):
        if progress is not None:
            progress(done, len(runs))
        name = f"{CASES[case]}, gravity {'included' if gravity else 'excluded'}"
        values = parameter_values(load_problem(case), gravity=gravity)
        powers, steps = np.array([_mean_power(values, step) for step in time_steps]).T
        reference = float(powers[-1])
        accurate, _ = _mean_power(values, None)
        curve = Curve(time_steps, powers / reference, accurate / reference, steps)
        paper_power, paper_steps = _mean_power(values, PAPER_TIME_STEP)
        found.curves[name] = curve
        found.band_time_steps[name] = _band_begin(values, curve, reference)
        found.paper_deviations[name] = paper_power / reference - 1
        found.paper_steps[name] = int(paper_steps)
    return found


def _mean_power(values: ParameterValues, time_step: float | None) -> tuple[float, float]:
    """Return mean cycle power (W) and steps; not numbers where the scheme leaves the domain of the model."""
    try:
        flown = fly(values, time_step=time_step)
    except CycleError:
        return math.nan, math.nan
    power = sum(phase.energy_J for phase in flown) / sum(phase.duration_s for phase in flown)
    return power, float(sum(len(phase.states) - 1 for phase in flown))


def _band_begin(values: ParameterValues, curve: Curve, reference: float) -> float:
    """Return the time step at which the curve enters the paper's band for good, by bisection between two of it."""
    # What is not a number is outside.
    outside = np.flatnonzero(~(np.abs(curve.ratios - 1) <= PAPER_BAND))
    if not outside.size:
        return float(curve.time_steps[0])
    last = int(outside[-1])
    if last + 1 == len(curve.time_steps):
        return math.nan
    large, small = float(curve.time_steps[last]), float(curve.time_steps[last + 1])
    for _ in range(BISECTIONS):
        middle = math.sqrt(large * small)
        power, _ = _mean_power(values, middle)
        inside = abs(power / reference - 1) <= PAPER_BAND
        large, small = (large, middle) if inside else (middle, small)
    return small
