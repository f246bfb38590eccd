"""Against a global method: dynamic programming on a grid finds no better cycle than the certified one.

Measured errors of the mean power, dynamic programming against the certified optimum (tether lengths x elevation step
x controls): strong-wind -0.46 % (15 x 5 deg x 9), -0.15 % (30 x 2.5 deg x 15), -0.045 % (60 x 1.25 deg x 25), -0.017 %
(120 x 0.625 deg x 40); v3-kite -0.20, -0.064, -0.028 and -0.014 %. It converges from below, about linearly in the cell.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from dynamic_programming import CycleSearch, GlobalOptimum

from kiteocp import load_problem
from kiteocp.optimum.refine import Optimum, optimise

NAMES = ("strong-wind", "v3-kite")

#: Tether lengths, step of the elevation in deg, controls.
COARSE, MEDIUM, FINE = (15, 5.0, 9), (30, 2.5, 15), (60, 1.25, 25)

#: Last tether lengths of the traction that are tried, from a short stroke to the longest.
ENDS = 5


@lru_cache
def certified(name: str) -> Optimum:
    optimum = optimise(load_problem(name), certificate="full")
    assert optimum.certificate.status == "certified"
    return optimum


@lru_cache
def search(name: str, grid: tuple[int, float, int]) -> CycleSearch:
    return CycleSearch(load_problem(name), *grid)


@lru_cache
def best(name: str, grid: tuple[int, float, int]) -> GlobalOptimum:
    found = search(name, grid)
    return found.best_cycle(certified(name).mean_power_W, found.cases(ENDS))


def error(name: str, grid: tuple[int, float, int]) -> float:
    return best(name, grid).mean_power_W / certified(name).mean_power_W - 1


@pytest.mark.parametrize("name", NAMES)
def test_no_better_cycle_on_two_grids(name: str) -> None:
    # From below, and never above by more than the mesh error that the certificate allows.
    assert -6e-3 < error(name, COARSE) < 1e-4
    assert -2e-3 < error(name, MEDIUM) < 1e-4
    # Halving the cells must at least halve the error; it takes two thirds of it.
    assert abs(error(name, MEDIUM)) < 0.5 * abs(error(name, COARSE))


@pytest.mark.parametrize("name", NAMES)
def test_the_global_optimum_is_the_same_cycle(name: str) -> None:
    found, cycle = best(name, MEDIUM), certified(name).cycle
    traction = cycle.records[-1]
    # Half a row of elevations, and the optimum in it is flat.
    assert found.traction_elevation_deg == pytest.approx(np.degrees(traction.elevation_rad[0]), abs=2.5)
    assert found.tether_length_end_m == pytest.approx(traction.tether_length_m[-1], abs=1e-3)
    pauses = 3 * cycle.values["limits.phase_change_time_s"]
    # The duration is less sharply determined than the power, of which it is the gradient.
    assert found.duration_s == pytest.approx(sum(r.duration_s for r in cycle.records) + pauses, rel=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_a_better_cycle_would_be_found(name: str) -> None:
    """Had the certified power been half a per cent too low, the grid would show cycles that gain on it."""
    method, power_W = search(name, MEDIUM), certified(name).mean_power_W
    cases = method.cases(ENDS)
    assert method.net_gains((1 - 5e-3) * power_W, cases).max() > 0
    assert method.net_gains((1 + 1e-4) * power_W, cases).max() < 0


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_no_better_cycle_on_a_fine_grid(name: str) -> None:
    assert -6e-4 < error(name, FINE) < 1e-4
    assert abs(error(name, FINE)) < 0.6 * abs(error(name, MEDIUM))
