"""What may move in the elastic cycle problem: every limit, in the direction that loosens it, and the wind speed."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from kiteocp.ocp.elastic import ElasticProgram, ElasticSlack, PenaltyWeight
from kiteocp.ocp.nlpsolver import Solution
from kiteocp.ocp.trajectory import Guess, Trajectory
from kiteocp.optimum.program import Formulation, cycle_program
from kiteocp.physics.parameters import ParameterValues, Structure
from kiteocp.physics.wind import wind_keys
from kiteocp.problem.catalogue import limit_keys

#: Wind speed upwards and downwards, beside the limits.
WIND_UP, WIND_DOWN = "wind up", "wind down"

#: Weights of what is not to move, and of the second try: the first is easier, the second all but exact.
HEAVY = (1e2, 1e4)

#: Farthest moves: upwards to ten times the number, downwards short of zero.
CAP_UP, CAP_DOWN = 9.0, 0.99

#: Farthest move of the wind speed upwards: from a calm it is a long way.
WIND_CAP_UP = 99.0


@lru_cache(maxsize=16)
def elastic_program(structure: Structure, formulation: Formulation) -> ElasticProgram:
    """Build (once) the elastic program of a structure: every limit and the wind speed may move."""
    limits = [ElasticSlack(key, (i,)) for i, key in enumerate(structure.keys) if key in limit_keys()]
    wind = tuple(structure.keys.index(key) for key in wind_keys(structure))
    return ElasticProgram(
        cycle_program(structure, formulation), [*limits, ElasticSlack(WIND_UP, wind), ElasticSlack(WIND_DOWN, wind)]
    )


def loosening(key: str) -> int:
    """Direction in which a limit loosens: a minimum downwards, a maximum (and a time that is allowed) upwards."""
    return -1 if "_min" in key else 1


def farthest(key: str, value: float) -> float:
    """Largest relative move of a limit in its loosening direction that a problem file may hold."""
    if loosening(key) < 0:
        return CAP_DOWN if value > 0 else 0.0
    bounds = limit_keys()[key].bounds
    highest = bounds.get("le", 0.999 * bounds.get("lt", np.inf))
    return min(CAP_UP, highest / value - 1) if value > 0 else CAP_UP


def penalty_of(term: ElasticSlack, values: ParameterValues, weight: float) -> PenaltyWeight:
    """Weight, direction and reach of a term; a slack is relative to the number that it moves."""
    numbers = values.vector[list(term.parameters)]
    if term.name in (WIND_UP, WIND_DOWN):
        up = term.name == WIND_UP
        return PenaltyWeight(numbers if up else -numbers, WIND_CAP_UP if up else CAP_DOWN, weight)
    number = float(numbers[0])
    return PenaltyWeight(loosening(term.name) * unit_of(number), farthest(term.name, number), weight)


def unit_of(value: float) -> float:
    """Change of a limit for a slack of one: the number itself, or 1 where that is zero."""
    return value if value > 0 else 1.0


def penalised_optimum(
    values: ParameterValues, formulation: Formulation, starts: Iterable[Trajectory | Guess]
) -> Solution | None:
    """Optimise where the set of feasible cycles is too thin for the interior point method, by an exact penalty.

    At the edge of feasibility IPOPT calls problems infeasible even from a feasible point. The elastic program, with
    the mean power as its objective and every slack at a large weight, has an interior and the same optimum. It has
    local optima that keep a slack of less than a hundredth as well, so that one start is not enough.

    Parameters
    ----------
    values, formulation
        The problem, its own mesh included.
    starts
        Cycles to begin with, tried in turn; best first a feasible one, such as `Infeasibility.start`.

    Returns
    -------
    Solution or None
        Of the cycle problem itself, with its multipliers, to about 1e-6; None if slacks remain from every start.
    """
    elastic = elastic_program(values.structure, formulation)
    for start in starts:
        x0 = elastic.program.pack(start)
        # First without the objective: a start of another mesh may be out of reach of an optimum without slacks.
        for share, heavy in ((0.0, 1.0), *((1.0, heavy) for heavy in HEAVY)):
            penalties = {term.name: penalty_of(term, values, heavy) for term in elastic.terms}
            found = elastic.solve(x0, values.vector, penalties, share)
            solution = elastic.optimum(found)
            if solution.success and share:
                return solution
            if found.success:
                x0 = found.x
    return None
