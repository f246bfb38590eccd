"""Samples of a problem whose numbers are uncertain: their distributions, and the optimum of each sample.

A sample is re-solved from the nominal optimum (`kiteocp.optimum.neighbours`) and accepted if first-order conditions,
recomputed, hold; otherwise it is solved from all starts, and where that fails too the reason is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal

import msgspec
import numpy as np
from scipy import stats

from kiteocp.errors import InputError, SolveError
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.optimum import certificate as certify
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.optimum.neighbours import Family
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.search import best_of, cycle_solver, search, solver_options
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem
from kiteocp.problem.catalogue import catalogue
from kiteocp.problem.uncertainty import Uncertainty
from kiteocp.studies.sensitivity.open_loop import OpenLoopCycle, fly_open_loop

#: Relative standard deviation where the problem states no uncertainty, and of what (the keys that it has of these).
USUAL_DEVIATION = 0.05
USUAL_KEYS = (
    "environment.wind.reference_speed_m_s",
    "kite.projected_area_m2",
    "kite.mass_kg",
    *(
        f"kite.{setting}.{name}"
        for setting in ("powered", "depowered")
        for name in ("lift_coefficient", "lift_to_drag", "drag_coefficient")
    ),
    "tether.diameter_m",
    "tether.drag_coefficient",
)

#: A cycle found otherwise counts as better than the warm one by this share of the nominal power.
BETTER = 1e-4

#: The same for the open-loop schedule: its flight differs from the collocation by some 1e-4 and may use limit margins.
OPEN_LOOP_BETTER = 2e-3

SampleStatus = Literal["solved", "infeasible", "failed", "invalid"]


class Sample(msgspec.Struct, frozen=True):
    """What became of one sample.

    Attributes
    ----------
    status
        ``solved``; ``infeasible``, no cycle keeps the limits; ``failed``, the solver found none; ``invalid``, the
        numbers would be refused in a problem file.
    mean_power_W
        Optimal mean power of the objective; None unless solved.
    cold_better
        Whether the search from all starts found a better cycle than the warm start; None where it was not asked.
    open_loop
        The nominal schedule flown on the sample; None where it was not asked.
    """

    status: SampleStatus
    mean_power_W: float | None = None
    cold_better: bool | None = None
    open_loop: OpenLoopCycle | None = None


def uncertainties(problem: Problem) -> tuple[dict[str, Uncertainty], bool]:
    """Return the uncertain keys with their uncertainties, and whether the problem states them.

    Where it does not, a relative standard deviation of 5 % of wind speed, area, mass, aerodynamic coefficients, tether
    diameter and tether drag.
    """
    if problem.uncertainty:
        return dict(problem.uncertainty), True
    keys = parameter_values(problem).structure.keys
    usual = Uncertainty(relative_standard_deviation=USUAL_DEVIATION)
    return {key: usual for key in USUAL_KEYS if key in keys}, False


def quantiles(problem: Problem, key: str, uncertainty: Uncertainty, probabilities: FloatArray) -> FloatArray:
    """Return values of an uncertain key at given probabilities, shape as ``probabilities``.

    A range is uniform; a standard deviation is that of a normal distribution around the value of the file, cut off
    where a problem file may not go.
    """
    value = parameter_values(problem)[key]
    # A normal distribution has no ends; Sobol points may come arbitrarily near to 0.
    inside = np.clip(probabilities, 1e-12, 1.0 - 1e-12)
    if isinstance(uncertainty.range, tuple):
        low, high = uncertainty.range
        return np.asarray(low + (high - low) * inside)
    bare, deviation = key.partition("[")[0], uncertainty.deviation(value)
    bounds = next(known for known in catalogue().walk() if known.path == bare).bounds
    low, high = bounds.get("gt", bounds.get("ge", -np.inf)), bounds.get("lt", bounds.get("le", np.inf))
    ends = (low - value) / deviation, (high - value) / deviation
    return np.asarray(stats.truncnorm.ppf(inside, *ends, loc=value, scale=deviation), dtype=float)


class Resolver(msgspec.Struct, frozen=True, dict=True):
    """A nominal optimum from which samples are solved; in a process pool each process builds its own."""

    problem: Problem
    keys: tuple[str, ...]
    solver: Solver
    formulation: Formulation
    nominal: Solution
    cycle: OptimalCycle

    @classmethod
    def of(
        cls, problem: Problem, keys: Sequence[str], nominal: Solution, formulation: Formulation | None = None
    ) -> Resolver:
        """Build the solver of a problem around its optimum; on the mesh of the problem file if not told otherwise."""
        values = parameter_values(problem)
        formulation = formulation or Formulation.of(problem)
        solver = cycle_solver(values.structure, formulation, solver_options(problem))
        return cls(problem, tuple(keys), solver, formulation, nominal, OptimalCycle.of(solver.program, nominal, values))

    def sample(self, point: Sequence[float], *, open_loop: bool = False, cold: bool = False) -> Sample:
        """Solve one sample.

        Parameters
        ----------
        point
            Values of the keys.
        open_loop
            Also fly the nominal schedule on the sample; where that gives more power than re-solving, within all
            limits, the sample is solved from all starts as well.
        cold
            Solve from all starts as well, and keep the better.
        """
        try:
            varied = self.problem.with_values(dict(zip(self.keys, map(float, point), strict=True)))
        except InputError:
            return Sample("invalid")
        values = parameter_values(varied)
        flown = fly_open_loop(self.cycle, values, self.problem.optimisation.objective) if open_loop else None
        power = self._warm(values)
        better: bool | None = None
        suspicious = (
            power is not None
            and flown is not None
            and flown.mean_power_W is not None
            and not flown.exceeded
            and flown.mean_power_W > power + OPEN_LOOP_BETTER * self._nominal_power_W
        )
        if power is None or cold or suspicious:
            found = self._cold(values)
            if isinstance(found, float):
                better = None if power is None else found > power + BETTER * self._nominal_power_W
                power = found if power is None else max(power, found)
            elif power is None:
                return Sample(found, open_loop=flown)
        return Sample("solved", power, better, flown)

    @property
    def _nominal_power_W(self) -> float:
        return abs(self._power_W(self.nominal))

    def _power_W(self, solution: Solution) -> float:
        return float(self.solver.program.in_units(solution.f))

    def _accepted(self, solution: Solution) -> bool:
        return solution.success and bool(certify.kkt_check(self.solver.program, solution).passed)

    def _warm(self, values: ParameterValues) -> float | None:
        powers = [self._power_W(attempt.solution) for attempt in self._family.attempts(values)]
        return max(powers, default=None)

    @cached_property
    def _family(self) -> Family:
        structure = parameter_values(self.problem).structure
        return Family(structure, self.formulation, solver_options(self.problem), (self.nominal,))

    def _cold(self, values: ParameterValues) -> float | Literal["infeasible", "failed"]:
        try:
            solution = best_of(search(values, self.formulation, solver_options(self.problem), explained=False)).solution
        except SolveError as error:
            return "infeasible" if error.explanation else "failed"
        except ValueError:
            return "infeasible"
        return self._power_W(solution) if self._accepted(solution) else "failed"


_OWN: dict[str, Any] = {}


def start_process(problem: Problem, keys: Sequence[str], nominal: Solution, formulation: Formulation) -> None:
    """Build the resolver of a process of the pool."""
    _OWN["resolver"] = Resolver.of(problem, keys, nominal, formulation)


def sample_in_process(points: FloatArray, open_loop: Sequence[bool], cold: Sequence[bool]) -> list[Sample]:
    """Solve some samples in a process of the pool; points of shape (samples, keys)."""
    resolver: Resolver = _OWN["resolver"]
    return [
        resolver.sample(point, open_loop=fly, cold=search_too)
        for point, fly, search_too in zip(points, open_loop, cold, strict=True)
    ]
