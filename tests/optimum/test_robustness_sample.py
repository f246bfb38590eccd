"""Forty members of the family of `benchmarks.robustness`, ten of them infeasible or at the edge of it, solved cold.

The powers are those of the finest mesh of the full certificate, of optima that ten random starts (seed 7) do not better
on the default mesh. A power beyond them fails as well: then ten random starts are no reference any more.
"""

from __future__ import annotations

from functools import lru_cache

import pytest

from benchmarks.family import Member, random_draws, wind_sweeps
from benchmarks.robustness_outcome import SHORTFALL
from kiteocp.errors import InfeasibleError
from kiteocp.optimum.infeasibility import NOTHING
from kiteocp.optimum.refine import optimise

#: What the optimum may miss, and the error of the default mesh, which was up to 0.07 % at the edge.
TOLERANCE = SHORTFALL + 1e-3

#: Mean power in W.
FEASIBLE = {
    "moderate-wind 5.0 m/s": 216.07,
    "moderate-wind 5.5 m/s": 417.02,
    "moderate-wind 6.5 m/s": 954.26,
    "moderate-wind 10.0 m/s": 3175.24,
    "moderate-wind 18.0 m/s": 3616.46,
    "strong-wind 10.0 m/s": 2729.63,
    "strong-wind 14.0 m/s": 6036.42,
    "strong-wind 18.0 m/s": 6599.39,
    "strong-wind 24.5 m/s": 5284.88,
    "v3-kite 3.5 m/s": 229.39,
    "v3-kite 5.0 m/s": 1453.27,
    "v3-kite 7.0 m/s": 4410.21,
    "v3-kite 14.0 m/s": 10167.74,
    "v3-kite 22.0 m/s": 8720.78,
    "v3-kite draw 2": 10037.55,
    "v3-kite draw 3": 7028.46,
    "strong-wind draw 4": 5868.77,
    "moderate-wind draw 5": 921.24,
    "strong-wind draw 6": 8079.36,
    "v3-kite draw 11": 1810.01,
    "v3-kite draw 14": 2799.71,
    "strong-wind draw 15": 3150.90,
    "v3-kite draw 16": 11679.72,
    "strong-wind draw 18": 3918.50,
    "v3-kite draw 23": 9807.18,
    "moderate-wind draw 25": 2020.82,
    "moderate-wind draw 27": 2920.03,
    "strong-wind draw 32": 6242.70,
    "v3-kite draw 38": 1190.65,
}

#: At the edge: the next step of wind has no cycle, or most starts lead to none.
EDGE = {
    "moderate-wind 4.5 m/s": 73.77,
    "moderate-wind 22.0 m/s": 2624.05,
    "strong-wind 7.5 m/s": 744.48,
    "v3-kite 3.0 m/s": 27.43,
}

#: Ten random starts and the continuation from neighbours find no cycle either; what one of them finds for "draw 19" is
#: an artefact of the mesh, whose power halves whenever the mesh is refined (964, 519, 269, 137 W).
INFEASIBLE = (
    "v3-kite draw 19",
    "strong-wind 6.5 m/s",
    "strong-wind 7.0 m/s",
    "moderate-wind 22.5 m/s",
    "strong-wind draw 0",
    "strong-wind draw 30",
)


@lru_cache
def family() -> dict[str, Member]:
    return {member.name: member for member in (*wind_sweeps(), *random_draws(39))}


#: A long stroke and a short one (1940 W) are both local optima here.
BISTABLE = ("moderate-wind 8.0 m/s", 1952.95)


@pytest.mark.parametrize(("name", "power_W"), [*FEASIBLE.items(), *EDGE.items(), BISTABLE])
def test_solved_to_the_best_of_ten_random_starts(name: str, power_W: float) -> None:
    assert optimise(family()[name].problem, certificate="quick").mean_power_W == pytest.approx(power_W, rel=TOLERANCE)


@pytest.mark.parametrize("name", INFEASIBLE)
def test_infeasible_is_recognised(name: str) -> None:
    with pytest.raises(InfeasibleError, match=r"no cycle found: with .* the kite cannot") as caught:
        optimise(family()[name].problem, certificate="quick")
    assert caught.value.explanation["elastic_sum"] > NOTHING
