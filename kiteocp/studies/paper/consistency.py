"""Whether the published numbers agree with each other, and what the other reading of a contradiction would change."""

from __future__ import annotations

from typing import Any

import msgspec

from kiteocp.cycle.phases import PHASES
from kiteocp.physics.aerodynamics import resultant_coefficient
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import load_problem
from kiteocp.result import Result
from kiteocp.studies.paper.published import (
    CASES,
    ERRATA,
    PRINTED_CHECKS,
    Erratum,
    Printed,
    published_experiment,
    published_simulation,
)
from kiteocp.studies.paper.rounding import flown_numbers

#: Columns of a published table of results.
COLUMNS = ("gravity excluded", "gravity included", "experiment")


class PrintedCheck(msgspec.Struct, frozen=True):
    """A printed result of the inputs beside the same from the inputs used here."""

    case: str
    what: str
    computed: float
    printed: Printed

    @property
    def agrees(self) -> bool:
        """Whether they are the same but for the rounding of the printed number."""
        return abs(self.computed - self.printed.value) <= self.printed.half_unit

    def to_dict(self) -> dict[str, Any]:
        """Return the check for the summary."""
        return {
            "case": self.case,
            "what": self.what,
            "computed": self.computed,
            "printed": self.printed.value,
            "agrees": self.agrees,
        }


class TableCheck(msgspec.Struct, frozen=True):
    """Energy and duration of a published cycle, as printed and as the sum of its printed phases.

    Attributes
    ----------
    energy_J, energy_of_phases_J
        Mean power times duration of the cycle, and the sum of the same of the phases.
    rounding_J
        How far the rounding of both may have moved their difference, at worst.
    duration_s, duration_of_phases_s, rounding_s
        The same for the duration.
    """

    case: str
    column: str
    energy_J: float
    energy_of_phases_J: float
    rounding_J: float
    duration_s: float
    duration_of_phases_s: float
    rounding_s: float

    @property
    def agrees(self) -> bool:
        """Whether rounding explains both differences."""
        energy, duration = self.energy_J - self.energy_of_phases_J, self.duration_s - self.duration_of_phases_s
        return abs(energy) <= self.rounding_J and abs(duration) <= self.rounding_s

    def to_dict(self) -> dict[str, Any]:
        """Return the check for the summary."""
        return {**msgspec.structs.asdict(self), "agrees": self.agrees}


class ErratumEffect(msgspec.Struct, frozen=True):
    """What the reading of a contradictory input that is not used here would change, gravity included.

    Attributes
    ----------
    erratum
        The contradiction.
    used, other
        Numbers of `kiteocp.studies.paper.rounding.flown_numbers` by both readings.
    """

    erratum: Erratum
    used: dict[str, float]
    other: dict[str, float]

    def change_percent(self, quantity: str) -> float:
        """Return how much the other reading changes a number, in percent of its magnitude."""
        return 100 * (self.other[quantity] - self.used[quantity]) / abs(self.used[quantity])

    def to_dict(self) -> dict[str, Any]:
        """Return the erratum and its effect for the summary."""
        words = {name: getattr(self.erratum, name) for name in ("case", "what", "paper", "used", "why")}
        shown = ("retraction.duration_s", "cycle.mean_power_W")
        effects = {f"{quantity}_change_percent": self.change_percent(quantity) for quantity in shown}
        return {**words, "other_reading": dict(self.erratum.overrides), **effects}


def printed_checks(results: dict[str, Result]) -> tuple[PrintedCheck, ...]:
    """Check the printed results of the inputs of each case, given its simulation by name of the case."""
    checks = []
    for column, (case, result) in enumerate((case, results[case]) for case in CASES):
        values = parameter_values(result.problem)
        resultants = [
            float(
                resultant_coefficient(values[f"kite.{setting}.lift_coefficient"], values.kite_drag_coefficient(setting))
            )
            for setting in ("powered", "depowered")
        ]
        cycle = result.cycle
        computed = [
            cycle["mean_traction_altitude_m"],
            cycle["wind_speed_at_mean_traction_altitude_m_s"],
            *resultants,
        ]
        checks += [
            PrintedCheck(case, what, float(number or 0.0), printed[column])
            for (what, printed), number in zip(PRINTED_CHECKS.items(), computed, strict=True)
        ]
    return tuple(checks)


def table_checks() -> tuple[TableCheck, ...]:
    """Add up the phases of every published cycle."""
    return tuple(
        _table_check(case, column, numbers)
        for case in CASES
        for column, numbers in zip(
            COLUMNS,
            (
                published_simulation(case, gravity=False),
                published_simulation(case, gravity=True),
                published_experiment(case),
            ),
            strict=True,
        )
    )


def _table_check(case: str, column: str, numbers: dict[str, Printed]) -> TableCheck:
    powers = [numbers[f"{part}.mean_power_W"] for part in (*PHASES, "cycle")]
    times = [numbers[f"{part}.duration_s"] for part in (*PHASES, "cycle")]
    energies = [power.value * time.value for power, time in zip(powers, times, strict=True)]
    rounding = sum(
        abs(power.value) * time.half_unit + time.value * power.half_unit
        for power, time in zip(powers, times, strict=True)
    )
    return TableCheck(
        case,
        column,
        energies[-1],
        sum(energies[:-1]),
        rounding,
        times[-1].value,
        sum(time.value for time in times[:-1]),
        sum(time.half_unit for time in times),
    )


def errata_effects() -> tuple[ErratumEffect, ...]:
    """Fly each case by the reading of its contradictory inputs that is not used."""
    effects = []
    for erratum in ERRATA:
        values = parameter_values(load_problem(erratum.case))
        effects.append(ErratumEffect(erratum, flown_numbers(values), flown_numbers(values.replaced(erratum.overrides))))
    return tuple(effects)
