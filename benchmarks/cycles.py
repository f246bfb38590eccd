"""Cost of a simulated pumping cycle."""

from __future__ import annotations

import kiteocp
from benchmarks.caches import clear_caches
from benchmarks.timing import Line, time_call, time_calls
from kiteocp.cycle.simulation import fly
from kiteocp.physics.parameters import parameter_values

FLOWN = "one cycle (fly)"
TARGET_S = 1e-3


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
    return [*measured, building]
