"""Cost of a simulated pumping cycle."""

from __future__ import annotations

import numpy as np

import kiteocp
from benchmarks.caches import clear_caches
from benchmarks.timing import Line, time_call, time_calls
from kiteocp.cycle.fast.batch import simulate_batch
from kiteocp.cycle.simulation import fly
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

FLOWN = "one cycle (fly)"
TARGET_S = 1e-3

#: A batch: its size, what differs in it and by how much, and the cost of each cycle that is wanted.
BATCH_SIZE, BATCH_SPREAD, BATCH_TARGET_S = 1000, 0.05, 20e-6
BATCH_KEYS = (
    "environment.wind.reference_speed_m_s",
    "kite.mass_kg",
    "kite.projected_area_m2",
    "kite.powered.lift_coefficient",
)


def lines(repeats: int) -> list[Line]:
    """Measure the prescribed cycle of strong-wind."""
    problem = kiteocp.load_problem("strong-wind")
    values = parameter_values(problem)
    functions = {
        FLOWN: lambda: fly(values),
        "the same with the rootfinder": lambda: fly(values, equilibrium="rootfinder"),
        "the paper's finite differences, time step 0.01": lambda: fly(values, time_step=0.01),
        "with time series and summary (simulate)": lambda: kiteocp.simulate(problem),
    }
    measured = [
        Line(
            "simulated cycle",
            name,
            durations,
            target=TARGET_S if name == FLOWN else None,
            relative_to=None if name == FLOWN else FLOWN,
        )
        for name, durations in time_calls(functions, repeats).items()
    ]

    def first() -> float:
        clear_caches()
        return time_call(lambda: kiteocp.simulate(problem))

    building = Line("simulated cycle", "first simulate, functions built", tuple(first() for _ in range(repeats)))
    return [*measured, building, *batch_lines(problem, repeats)]


def batch_lines(problem: Problem, repeats: int) -> list[Line]:
    """Measure a batch of designs and sites near a problem, for each cycle of it."""
    random = np.random.default_rng(1)
    values = parameter_values(problem)
    varied = {key: values[key] * random.uniform(1 - BATCH_SPREAD, 1 + BATCH_SPREAD, BATCH_SIZE) for key in BATCH_KEYS}
    clear_caches()
    built = time_call(lambda: simulate_batch(values, varied))
    [durations] = time_calls({"batch": lambda: simulate_batch(values, varied)}, repeats).values()
    each = tuple(duration / BATCH_SIZE for duration in durations)
    name = f"each of a batch of {BATCH_SIZE} (simulate_batch)"
    return [
        Line("simulated cycle", name, each, target=BATCH_TARGET_S),
        Line("simulated cycle", "first simulate_batch, functions built", (built,)),
    ]
