"""Estimates from recordings with the kite on the ground, and with rows that belong to no phase."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

import kiteocp
from kiteocp.numerics.averages import effective_samples
from kiteocp.studies.estimation.study import estimate
from kiteocp.studies.estimation.synthetic import flight_of_result


def test_the_ground_and_rows_without_a_phase_change_nothing() -> None:
    problem = kiteocp.load_problem("v3-kite")
    flight = flight_of_result(kiteocp.simulate(problem), sample_rate_Hz=5.0, cycles=2)
    found = estimate(flight, problem)
    spoilt = {name: values.copy() for name, values in flight.arrays().items()}
    lying, idle = np.arange(len(flight)) < 40, np.arange(len(flight)) >= len(flight) - 60
    for name in ("height_m", "elevation_deg", "radial_speed_m_s", "polar_speed_m_s", "azimuthal_speed_m_s"):
        spoilt[name][lying] = 0.0
    spoilt["phase"][idle] = ""
    spoilt["apparent_wind_speed_m_s"][idle] *= 3.0
    again = estimate(replace(flight, **spoilt), problem)
    assert again.wind.scale == pytest.approx(found.wind.scale, rel=1e-6)
    assert again.flight.counts == {"rows_on_ground": 40, "rows_without_phase": 60}
    assert len(again.flight) == len(flight) - 100


def test_two_samples_are_worth_one() -> None:
    assert effective_samples(np.array([0.0, 1.0]), np.array([1.0, 2.0])) == 1.0
