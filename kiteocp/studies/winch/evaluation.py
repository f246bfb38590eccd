"""What winch laws lose against the optimum and where they leave the limits, in the wind of the problem and others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from kiteocp.cycle.limits import Limit
from kiteocp.cycle.objective import mean_power
from kiteocp.cycle.phases import PhaseName
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.errors import CycleError
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem
from kiteocp.studies.winch.flight import HeldQuantities, Switching, fly_laws
from kiteocp.studies.winch.law import Kind, WinchLaw

#: A limit overstepped by less than this, relative to it, is not reported: fits and integration are no more exact.
WITHIN = 2e-3


class LawEvaluation(msgspec.Struct, frozen=True):
    """A cycle under winch laws in one wind.

    Attributes
    ----------
    kind
        Which laws flew.
    wind_factor
        Wind speed over that of the problem.
    mean_power_W
        Mean power of the objective under the laws; None where they cannot fly the cycle, `message` saying why.
    optimal_mean_power_W
        The same of the optimum in that wind; None where none was found.
    force_overshoot_percent
        Largest tether force over its limit, where that acts; 0 where it is kept.
    violations
        Limits left by more than `WITHIN`: ``limit``, ``phase``, ``value`` and ``reached`` in the unit of the limit, and
        ``excess_percent``.
    records
        The phases flown, empty where none were.
    """

    kind: Kind
    wind_factor: float
    mean_power_W: float | None
    optimal_mean_power_W: float | None
    force_overshoot_percent: float | None
    violations: tuple[dict[str, Any], ...]
    records: tuple[PhaseRecord, ...]
    message: str | None = None

    @property
    def loss_percent(self) -> float | None:
        """Power lost against the optimum of that wind; negative only where the laws leave a limit."""
        if self.mean_power_W is None or self.optimal_mean_power_W is None:
            return None
        return 100.0 * (1.0 - self.mean_power_W / self.optimal_mean_power_W)

    def to_dict(self) -> dict[str, Any]:
        """Return the evaluation as it is written to ``laws.json``."""
        return {
            "laws": self.kind,
            "wind_factor": self.wind_factor,
            "mean_power_W": self.mean_power_W,
            "optimal_mean_power_W": self.optimal_mean_power_W,
            "loss_percent": self.loss_percent,
            "force_overshoot_percent": self.force_overshoot_percent,
            "violations": list(self.violations),
            "message": self.message,
        }


def evaluate(
    kind: Kind,
    laws: Mapping[PhaseName, WinchLaw],
    nominal: OptimalCycle,
    problem: Problem,
    wind_factor: float,
    optimum: OptimalCycle | None,
) -> LawEvaluation:
    """Fly the laws of an optimum in a wind.

    Parameters
    ----------
    kind, laws
        Laws of one kind for all phases.
    nominal
        The optimum they come from; it also gives the phase ends and what the kite holds.
    problem
        The problem in the wind to fly in.
    wind_factor
        That wind over the one of the laws.
    optimum
        The optimal cycle in that wind, if there is one.
    """
    values, objective = parameter_values(problem), problem.optimisation.objective
    reference = mean_power(optimum.records, values, objective) if optimum is not None else None
    try:
        held = {record.name: HeldQuantities.of(nominal, record.name) for record in nominal.records}
        records = tuple(fly_laws(values, laws, Switching.of(nominal), held))
    except CycleError as error:
        message = f"the {error.phase} ends {error.cause}"
        return LawEvaluation(kind, wind_factor, None, reference, None, (), (), message)
    force = f"tether_force_{values.structure.choice('limits.tether_force_max_at')}"
    highest = max(float(record.output(force).max()) for record in records)
    overshoot = max(0.0, 100.0 * (highest / values["limits.tether_force_max_N"] - 1.0))
    power = mean_power(records, values, objective)
    violations = tuple(violations_of(records, values, nominal.limits))
    return LawEvaluation(kind, wind_factor, power, reference, overshoot, violations, records)


def violations_of(
    records: Sequence[PhaseRecord], values: ParameterValues, limits: Sequence[Limit]
) -> list[dict[str, Any]]:
    """List the limits that flown phases leave, the worst instant of each phase; the largest excess first."""
    found: list[dict[str, Any]] = []
    for record in records:
        for limit in limits:
            margin, reached = limit.margin(record, values), limit.reached(record)
            if margin is not None and reached is not None:
                found.append(
                    {
                        "limit": limit.key,
                        "phase": record.name,
                        "value": values[limit.key],
                        "reached": reached,
                        "excess_percent": -100.0 * margin,
                    }
                )
    return sorted((v for v in found if v["excess_percent"] > 100 * WITHIN), key=lambda v: -v["excess_percent"])
