"""Cost of a flight state: the equilibrium in closed form, by the rootfinder, in a batch, and through Python."""

from __future__ import annotations

import numpy as np

import kiteocp
from benchmarks.timing import Line, time_calls
from kiteocp.cycle.laws import phase_functions
from kiteocp.numerics.buffered import BufferedFunction
from kiteocp.physics.parameters import parameter_values

BATCH = 1000


def lines(repeats: int) -> list[Line]:
    """Measure the traction state of strong-wind, all its outputs, with the force at the kite held."""
    problem = kiteocp.load_problem("strong-wind")
    values = parameter_values(problem)
    traction = problem.operation.traction
    state = np.array([0.0, 500.0, np.radians(traction.elevation_deg), 0.0])
    closed = phase_functions(values.structure, "traction", "explicit").outputs
    rootfinder = phase_functions(values.structure, "traction", "rootfinder").outputs
    call_closed, call_rootfinder = BufferedFunction(closed), BufferedFunction(rootfinder)
    batch = BufferedFunction(closed.map(BATCH))
    lengths = np.linspace(390.0, 720.0, BATCH)
    states = np.stack([0 * lengths, lengths, 0 * lengths + state[2], 0 * lengths], axis=1).ravel()
    parameters = np.tile(values.vector, BATCH)
    times = time_calls(
        {
            "closed form": lambda: call_closed(state, values.vector),
            "rootfinder": lambda: call_rootfinder(state, values.vector),
            f"closed form, each of a batch of {BATCH}": lambda: batch(states, parameters),
            "flight_state (Python, finds or explains)": lambda: kiteocp.flight_state(
                problem,
                tether_length_m=500.0,
                elevation_deg=traction.elevation_deg,
                azimuth_deg=traction.azimuth_deg,
                course_deg=traction.course_deg,
                tether_force_kite_N=traction.tether_force_N,
            ),
        },
        repeats,
    )
    measured = []
    for name, durations in times.items():
        share = BATCH if "batch" in name else 1
        reference = None if name == "closed form" else "closed form"
        measured.append(
            Line("flight state", name, tuple(duration / share for duration in durations), relative_to=reference)
        )
    return measured
