"""What an optimal cycle maximises: its mean mechanical or electrical power, and how both are called."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from kiteocp.cycle.phases import PHASE_CHANGES
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.physics.parameters import ParameterValues

#: Power that is integrated, an output of a flight state, by the word of ``optimisation.objective``.
POWERS: Mapping[str, str] = {"mechanical": "power", "electrical": "electrical_power"}


def mean_power(records: Iterable[PhaseRecord], values: ParameterValues, objective: str) -> float:
    """Mean power of a cycle in the sense of the objective, W: its energy over its time, phase changes included.

    Parameters
    ----------
    records
        All phases of the cycle.
    values
        For the phase-change time.
    objective
        ``mechanical`` or ``electrical``.
    """
    phases = list(records)
    duration = sum(record.duration_s for record in phases) + PHASE_CHANGES * values["limits.phase_change_time_s"]
    return energy(phases, objective) / duration


def energy(records: Iterable[PhaseRecord], objective: str) -> float:
    """Energy of flown phases in the sense of the objective, J."""
    return sum(record.energy_J if objective == "mechanical" else record.electrical_energy_J for record in records)
