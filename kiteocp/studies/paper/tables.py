"""Tables of the results section: the simulated phases beside the published simulation and the experiment.

Deviations are judged by what the rounding of the published inputs, and of the published result itself, can explain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from kiteocp.cycle.phases import PHASES
from kiteocp.cycle.simulation import simulate
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem, load_problem
from kiteocp.result import Result
from kiteocp.studies.paper.published import (
    PAPER_TIME_STEP,
    Printed,
    half_units,
    published_experiment,
    published_simulation,
)
from kiteocp.studies.paper.rounding import (
    REEL_OUT_ENERGY,
    RETRACTION_FORCE,
    Band,
    flown_numbers,
    rounding_bands,
)
from kiteocp.studies.sensitivity.forward import forward_sensitivity

#: What rounding may explain of a deviation, the most modest first, and how each reads in a sentence.
EXPLANATIONS: dict[str, str] = {
    "likely": "explained by rounding: within twice the standard deviation of the rounded inputs",
    "at worst": "explained by rounding only if nearly all inputs were rounded against it",
    "nominal sizes": "explained only if tether diameter and mast height were rounded too",
    "no": "not explained by rounding",
}

#: How many standard deviations count as likely.
LIKELY = 2.0


class Number(msgspec.Struct, frozen=True):
    """A published number and how far its own rounding may have moved it."""

    value: float
    half_unit: float


class Row(msgspec.Struct, frozen=True):
    """One number of the tables, in W, s, N or J.

    Attributes
    ----------
    quantity
        Part and name, as ``traction.mean_power_W``.
    simulated, stepped
        Of this model, integrated accurately, and by the paper's scheme at its time step.
    published, experiment
        What the paper computed and measured.
    band, nominal_band
        Where rounding of the inputs may have moved the number; with sizes by name counted as well.
    """

    quantity: str
    simulated: float
    stepped: float
    published: Number
    experiment: Number
    band: Band
    nominal_band: Band

    @property
    def deviation(self) -> float:
        """Simulated less published."""
        return self.simulated - self.published.value

    @property
    def deviation_percent(self) -> float:
        """Deviation in percent of the published magnitude."""
        return 100 * self.deviation / abs(self.published.value)

    @property
    def experiment_percent(self) -> float:
        """Simulated less measured in percent of the measured magnitude."""
        return 100 * (self.simulated - self.experiment.value) / abs(self.experiment.value)

    @property
    def published_experiment_percent(self) -> float:
        """Published simulation less measured in percent of the measured magnitude."""
        return 100 * (self.published.value - self.experiment.value) / abs(self.experiment.value)

    @property
    def explained(self) -> str:
        """What rounding explains, a key of `EXPLANATIONS`."""
        half = self.published.half_unit
        if _within(self.band, self.published):
            spread = math.sqrt((self.band.root**2 + half**2) / 3)
            return "likely" if abs(self.deviation) <= LIKELY * spread else "at worst"
        return "nominal sizes" if _within(self.nominal_band, self.published) else "no"

    @property
    def outside(self) -> float:
        """How far the published number lies beyond the band without sizes by name; 0 within it."""
        low, high = self.band.low - self.published.half_unit, self.band.high + self.published.half_unit
        return max(self.published.value - high, low - self.published.value, 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the row for the summary."""
        return {
            "simulated": self.simulated,
            "simulated_with_the_papers_time_step": self.stepped,
            "published_simulation": self.published.value,
            "published_simulation_half_unit": self.published.half_unit,
            "deviation": self.deviation,
            "deviation_percent": self.deviation_percent,
            "rounding_band": _band_dict(self.band),
            "rounding_band_with_nominal_sizes": _band_dict(self.nominal_band),
            "explained_by_rounding": self.explained,
            "beyond_the_band": self.outside,
            "published_experiment": self.experiment.value,
            "deviation_from_experiment_percent": self.experiment_percent,
        }


class Comparison(msgspec.Struct, frozen=True):
    """One case, with or without gravity, the force held at the kite or at the ground."""

    case: str
    reference: str
    gravity: bool
    result: Result
    rows: tuple[Row, ...]

    def row(self, quantity: str) -> Row:
        """Return the row of a quantity."""
        return next(row for row in self.rows if row.quantity == quantity)

    @property
    def published_rows(self) -> tuple[Row, ...]:
        """The rows that the paper prints, without those derived from them."""
        return tuple(row for row in self.rows if row.quantity not in (RETRACTION_FORCE, REEL_OUT_ENERGY))


def compare(case: str, reference: str, *, gravity: bool) -> Comparison:
    """Simulate a case and set it beside the published tables.

    Parameters
    ----------
    case
        ``strong-wind`` or ``moderate-wind``.
    reference
        Where the tether force is held, ``kite`` or ``ground``.
    gravity
        False leaves out all weights.
    """
    problem = load_problem(case, {"operation.force_reference": reference})
    values = parameter_values(problem, gravity=gravity)
    study = forward_sensitivity(problem, gravity=gravity)
    bands, nominal_bands = (
        rounding_bands(values, study, half_units(case, nominal=nominal)) for nominal in (False, True)
    )
    simulated, stepped = flown_numbers(values), flown_numbers(values, PAPER_TIME_STEP)
    published = _with_derived(published_simulation(case, gravity=gravity), problem)
    experiment = _with_derived(published_experiment(case), problem)
    rows = tuple(
        Row(
            quantity,
            simulated[quantity],
            stepped[quantity],
            published[quantity],
            experiment[quantity],
            bands[quantity],
            nominal_bands[quantity],
        )
        for quantity in published
    )
    return Comparison(case, reference, gravity, simulate(problem, gravity=gravity), rows)


def _with_derived(printed: Mapping[str, Printed], problem: Problem) -> dict[str, Number]:
    """Return published numbers and those derived from them, with the rounding of both factors of an energy."""
    numbers = {quantity: Number(number.value, number.half_unit) for quantity, number in printed.items()}
    energies = {}
    for phase in PHASES:
        power, time = numbers[f"{phase}.mean_power_W"], numbers[f"{phase}.duration_s"]
        half = abs(power.value) * time.half_unit + time.value * power.half_unit
        energies[phase] = Number(power.value * time.value, half)
    stroke = problem.operation.tether_length_max_m - problem.operation.tether_length_min_m
    numbers[RETRACTION_FORCE] = Number(
        -energies["retraction"].value / stroke, energies["retraction"].half_unit / stroke
    )
    numbers[REEL_OUT_ENERGY] = Number(
        sum(energies[phase].value for phase in PHASES[1:]), sum(energies[phase].half_unit for phase in PHASES[1:])
    )
    return numbers


def _within(band: Band, number: Number) -> bool:
    return band.low - number.half_unit <= number.value <= band.high + number.half_unit


def _band_dict(band: Band) -> dict[str, float]:
    return {"low": band.low, "high": band.high, "first_order_worst": band.worst, "first_order_root": band.root}
