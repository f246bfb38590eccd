"""Neighbours against all starts: ``python -m benchmarks.neighbours [--count 1000] [--jobs 1] [PROBLEM ...]``.

Random designs within 20 % of a shipped problem in nine or more numbers are solved by `kiteocp.solve_many`, and each
again from all starts. Counted are the designs that one of the two finds no cycle for, and the difference in power.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import kiteocp
from kiteocp.errors import SolveError
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.search import best_of, search, solver_options
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem

SPREAD = 0.2
KEYS = (
    "environment.wind.reference_speed_m_s",
    "kite.mass_kg",
    "kite.projected_area_m2",
    *(
        f"kite.{setting}.{name}"
        for setting in ("powered", "depowered")
        for name in ("lift_coefficient", "lift_to_drag", "drag_coefficient")
    ),
    "limits.tether_force_min_N",
    "limits.tether_force_max_N",
)

#: The same optimum: the two solvers stop at different residuals, and certificates divide intervals.
SAME = 2e-4


def designs(problem: Problem, count: int, seed: int = 1) -> list[Problem]:
    """Draw designs around a problem."""
    values, random = parameter_values(problem), np.random.default_rng(seed)
    keys = [key for key in KEYS if key in values.structure.keys]
    return [
        problem.with_values({key: values[key] * float(random.uniform(1 - SPREAD, 1 + SPREAD)) for key in keys})
        for _ in range(count)
    ]


def best_power_W(problem: Problem) -> float | None:
    """Return the power of the best of all starts, None where there is no cycle."""
    values, formulation = parameter_values(problem), Formulation.of(problem)
    try:
        return best_of(search(values, formulation, solver_options(problem), explained=False)).mean_power_W
    except SolveError:
        return None


def compare(name: str, count: int, jobs: int) -> str:
    """Solve the designs of a problem both ways and say how they compare, in a line."""
    problems = designs(kiteocp.load_problem(name), count)
    kiteocp.solve_many(problems[:2], certificate="none")
    began = time.perf_counter()
    found = kiteocp.solve_many(problems, jobs=jobs, certificate="none")
    each_ms = 1e3 * (time.perf_counter() - began) / count
    missed, worse, better, ways = [], [], 0, {"sqp": 0, "ipopt": 0}
    for place, (problem, result) in enumerate(zip(problems, found, strict=True)):
        best = best_power_W(problem)
        power = result.cycle["mean_power_W"] if isinstance(result, kiteocp.Result) else None
        if isinstance(result, kiteocp.Result):
            ways[result.details["solver"]["name"]] += 1
        if power is None and best is not None:
            missed.append(place)
        elif power is not None and best is not None:
            worse += [(place, 1 - power / best)] if power < best * (1 - SAME) else []
            better += power > best * (1 + SAME)
    cycles = sum(isinstance(result, kiteocp.Result) for result in found)
    return (
        f"{name}: {cycles} cycles of {count}, {each_ms:.1f} ms each with {jobs} jobs "
        f"({ways['sqp']} by SQP, {ways['ipopt']} by IPOPT); {len(missed)} missed {missed}, {len(worse)} worse than the "
        f"best of all starts by more than {SAME:g} {[(place, round(share, 4)) for place, share in worse]}, "
        f"{better} better"
    )


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.neighbours", description=__doc__)
    parser.add_argument("problems", nargs="*", default=["strong-wind", "moderate-wind", "v3-kite", "v9-kite"])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    for name in arguments.problems:
        print(compare(name, arguments.count, arguments.jobs), flush=True)


if __name__ == "__main__":
    main()
