"""How reliably the optimum is found: ``python -m benchmarks.robustness [--count 500] [--jobs 2] [--json FILE]``.

Every problem of `benchmarks.family` is solved as ``kiteocp solve`` does it, cold. The reference for the power are ten
random starts with seeds of their own. A problem without a solution must resist these too, the continuation from
less and from more wind, and the elastic program; exceptions are listed by name.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.family import WIND_KEY, Member, random_draws, wind_sweeps
from kiteocp.errors import InfeasibleError, InputError, SolveError
from kiteocp.ocp.formulation import Formulation
from kiteocp.ocp.infeasibility import NOTHING
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.search import Attempt, best_of, cycle_solver, solver_options
from kiteocp.ocp.solution import Optimum, optimise
from kiteocp.ocp.starts import STARTS, Start, guess_of, random_start
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem

#: Random starts of the reference, and the seed of the first; unlike those that the solver itself falls back on.
REFERENCE_STARTS, REFERENCE_SEED = 10, 7

#: Iterations of a reference solve: nineteen of twenty that succeed from a random start take fewer than 90, while one
#: that fails spends all it is given.
REFERENCE_ITERATIONS = 100

#: A power this much below the best known, relative, is not the optimum.
SHORTFALL = 1e-3

#: Wind of the neighbours of a problem that has none in the family, and steps of the way back to it.
NEIGHBOUR_WIND = (0.8, 0.9, 1.1, 1.25)
CONTINUATION_STEPS = 5

#: Every so many solved problems the mesh is refined and the certificate is full.
MESH_SAMPLE = 5


@dataclass
class Outcome:
    """What became of one problem.

    Attributes
    ----------
    name
        Of the member of the family.
    power_W
        Mean power found; None where no start led to a cycle.
    reference_W
        The largest that the reference found.
    attempts
        For each start that was tried its power, None where it failed.
    best_start, time_s, iterations
        Start of the largest power, and what the solver took from there.
    total_time_s, answer_time_s
        Solver time of all starts together, and wall time of the answer, whatever it was.
    found_by
        For a problem that was not solved: what found a cycle all the same; None if nothing did.
    elastic_sum, sentence
        For such a problem: the smallest relaxation, and the reason given.
    failed_checks, mesh_error
        Of the full certificate; power of the first mesh against that of the finest. None where it was not asked for.
    quick_failed_checks
        Of the quick certificate.
    """

    name: str
    power_W: float | None = None
    reference_W: float | None = None
    attempts: dict[str, float | None] = field(default_factory=dict)
    best_start: str | None = None
    time_s: float | None = None
    iterations: int | None = None
    total_time_s: float = 0.0
    answer_time_s: float = 0.0
    found_by: str | None = None
    elastic_sum: float | None = None
    sentence: str | None = None
    failed_checks: list[str] | None = None
    mesh_error: float | None = None
    quick_failed_checks: list[str] = field(default_factory=list)

    @property
    def feasible(self) -> bool:
        """Whether anything found a cycle."""
        return self.power_W is not None or self.found_by is not None

    @property
    def shortfall(self) -> float | None:
        """Power missing to the best that is known, relative to it; None where there is nothing to compare."""
        if self.power_W is None or self.reference_W is None:
            return None
        return (self.reference_W - self.power_W) / max(abs(self.reference_W), 1.0)

    @property
    def solved(self) -> bool:
        """Whether the best known cycle was found."""
        return self.power_W is not None and (self.shortfall is None or self.shortfall <= SHORTFALL)

    @property
    def recognised(self) -> bool:
        """Whether the elastic program agrees that there is no cycle."""
        return not self.feasible and self.elastic_sum is not None and self.elastic_sum > NOTHING


def family(count: int) -> list[Member]:
    """Return the wind sweeps, and random draws to make up the count; of a smaller count evenly spread."""
    sweeps = list(wind_sweeps())
    members = [*sweeps, *random_draws(max(count - len(sweeps), 50))]
    return [members[i] for i in np.linspace(0, len(members) - 1, count).round().astype(int)]


def examine(member: Member, *, certify: bool = False) -> Outcome:
    """Solve one problem as the program does and hold it against the reference."""
    problem, outcome = member.problem, Outcome(member.name)
    began = time.perf_counter()
    try:
        _take_optimum(outcome, optimise(problem, certificate="quick"))
    except InfeasibleError as error:
        outcome.elastic_sum, outcome.sentence = error.explanation["elastic_sum"], str(error)
    except SolveError as error:
        outcome.sentence = str(error)
    outcome.answer_time_s = time.perf_counter() - began
    solver, values = _reference_solver(problem), parameter_values(problem)
    random = np.random.default_rng(REFERENCE_SEED)
    references = [_from_start(solver, random_start(random), values) for _ in range(REFERENCE_STARTS)]
    powers = [power for s in references if (power := Attempt("", s).mean_power_W) is not None]
    outcome.reference_W = max(powers, default=None)
    if outcome.power_W is None:
        if powers:
            outcome.found_by = "a random start"
        elif any(_continued(neighbour, problem) for neighbour in _neighbours(problem)):
            outcome.found_by = "the continuation from a neighbour"
    elif certify:
        optimum = optimise(problem, certificate="full")
        meshes = [mesh["mean_power_W"] for mesh in optimum.facts["meshes"]]
        outcome.failed_checks = [check.name for check in optimum.certificate.failures]
        outcome.mesh_error = abs(meshes[0] - meshes[-1]) / max(abs(meshes[-1]), 1.0)
    return outcome


def _take_optimum(outcome: Outcome, optimum: Optimum) -> None:
    best = best_of(optimum.attempts)
    outcome.power_W, outcome.best_start = best.mean_power_W, best.start
    outcome.attempts = {attempt.start: attempt.mean_power_W for attempt in optimum.attempts}
    outcome.time_s, outcome.iterations = best.solution.time_s, best.solution.iterations
    outcome.total_time_s = sum(attempt.solution.time_s for attempt in optimum.attempts)
    outcome.quick_failed_checks = [check.name for check in optimum.certificate.failures]


def _reference_solver(problem: Problem) -> Solver:
    options = {**dict(solver_options(problem)), "max_iter": REFERENCE_ITERATIONS}
    return cycle_solver(parameter_values(problem).structure, Formulation.of(problem), tuple(options.items()))


def _from_start(solver: Solver, start: Start, values: ParameterValues) -> Solution:
    return solver.solve(solver.program.pack(guess_of(start, values, solver.program)), values.vector)


def _neighbours(problem: Problem) -> Iterator[Problem]:
    """Yield the same system in more and in less wind, as far as a problem file may say so."""
    wind = problem.to_dict()["environment"]["wind"]["reference_speed_m_s"]
    for factor in NEIGHBOUR_WIND:
        try:
            yield problem.with_values({WIND_KEY: factor * wind})
        except InputError:
            continue


def _continued(neighbour: Problem, problem: Problem) -> bool:
    """Whether a solution of a neighbour can be followed to the problem, step by step."""
    solver, start, end = _reference_solver(problem), parameter_values(neighbour), parameter_values(problem)
    solution = _from_start(solver, STARTS[0], start)
    if not solution.success:
        return False
    x = solution.x
    for share in np.linspace(0.0, 1.0, CONTINUATION_STEPS + 1)[1:]:
        solution = solver.solve(x, start.vector + share * (end.vector - start.vector))
        # A step that fails may still lead nearer; only the last one decides.
        x = solution.x if solution.success else x
    return solution.success


def run(members: Sequence[Member], jobs: int) -> list[Outcome]:
    """Examine all members on some processes, with progress on stderr."""
    began, outcomes = time.perf_counter(), dict.fromkeys((member.name for member in members), Outcome(""))
    with ProcessPoolExecutor(jobs) as pool:
        tasks = [pool.submit(examine, member, certify=i % MESH_SAMPLE == 0) for i, member in enumerate(members)]
        for done, task in enumerate(as_completed(tasks), 1):
            outcome = task.result()
            outcomes[outcome.name] = outcome
            if done % 25 == 0 or done == len(tasks):
                print(f"{done} of {len(tasks)} problems, {time.perf_counter() - began:.0f} s", file=sys.stderr)
    return list(outcomes.values())


def report(outcomes: Sequence[Outcome]) -> str:
    """Return the success rates, the cost, and the exceptions by name."""
    feasible = [o for o in outcomes if o.feasible]
    infeasible = [o for o in outcomes if not o.feasible]
    found = [o for o in outcomes if o.power_W is not None]
    solved, recognised = [o for o in feasible if o.solved], [o for o in infeasible if o.recognised]
    refusals_s = [o.answer_time_s for o in recognised]
    times_ms = [1e3 * o.time_s for o in found if o.time_s is not None]
    totals_ms = [1e3 * o.total_time_s for o in found]
    iterations = [o.iterations for o in found if o.iterations is not None]
    sampled = [o for o in found if o.mesh_error is not None]
    errors = [o.mesh_error for o in sampled if o.mesh_error is not None]
    certified = [o for o in sampled if not o.failed_checks]
    quick = [o for o in found if not o.quick_failed_checks]
    lines = [
        f"problems                        {len(outcomes)}: {len(feasible)} feasible, {len(infeasible)} infeasible",
        f"solved to the best of {REFERENCE_STARTS} random   {_share(len(solved), len(feasible))}, "
        f"within {100 * SHORTFALL:g} %",
        f"infeasible, recognised as such  {_share(len(recognised), len(infeasible))}",
        f"time to say so                  {_spread(refusals_s)} s (median / 95 %)",
        f"solver time of the best start   {_spread(times_ms)} ms (median / 95 %)",
        f"solver time of all starts       {_spread(totals_ms)} ms",
        f"iterations of the best start    {_spread(iterations)}",
        f"starts that were needed         {_starts(found)}",
        f"error of the first mesh         {_spread([100 * e for e in errors], '.2g')} %, "
        f"largest {100 * max(errors, default=np.nan):.2g} % ({len(errors)} problems)",
        f"certified, full                 {_share(len(certified), len(sampled))}",
        f"certified, quick                {_share(len(quick), len(found))}",
    ]
    for o in feasible:
        if not o.solved and o.power_W is None:
            lines.append(f"  not solved: {o.name}, although {o.found_by} led to a cycle")
        elif not o.solved and o.reference_W is not None:
            lines.append(f"  not the best: {o.name}, {o.power_W:.1f} W against {o.reference_W:.1f} W")
    lines += [f"  not recognised: {o.name}, {o.sentence}" for o in infeasible if not o.recognised]
    lines += [f"  not certified: {o.name}, {', '.join(o.failed_checks)}" for o in sampled if o.failed_checks]
    lines += [f"  not certified, quick: {o.name}, {', '.join(o.quick_failed_checks)}" for o in found if o not in quick]
    return "\n".join(lines)


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.1f} %)" if whole else "none to count"


def _spread(numbers: Sequence[float], form: str = ".1f") -> str:
    if not numbers:
        return "no number"
    return f"{np.median(numbers):{form}} / {np.percentile(numbers, 95):{form}}"


def _starts(found: Sequence[Outcome]) -> str:
    """For each start, how many problems have their best optimum from it and from none before it."""
    needed: dict[str, int] = {}
    for outcome in found:
        best = outcome.power_W
        first = next(
            name
            for name, power in outcome.attempts.items()
            if best is not None and power is not None and power >= best - SHORTFALL * max(abs(best), 1.0)
        )
        needed[first] = needed.get(first, 0) + 1
    return ", ".join(f"{name} {count}" for name, count in sorted(needed.items(), key=lambda item: -item[1]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run from the command line; 1 where a problem was not solved or not recognised."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robustness", description=__doc__)
    parser.add_argument("--count", type=int, default=500, help="problems (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every outcome to FILE")
    given = parser.parse_args(arguments)
    outcomes = run(family(given.count), given.jobs)
    if given.json is not None:
        content: dict[str, Any] = {"outcomes": [asdict(outcome) for outcome in outcomes]}
        given.json.write_text(json.dumps(content, indent=1) + "\n")
    print(report(outcomes))
    return 0 if all(outcome.solved or outcome.recognised for outcome in outcomes) else 1


if __name__ == "__main__":
    raise SystemExit(main())
