"""Many optima at once: problems in families, each solved from its nearest neighbour, in one process or several."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, get_args

import msgspec
import numpy as np

from kiteocp.errors import InputError, SolveError, check_word
from kiteocp.execution import one_at_a_time
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlpsolver import Solution
from kiteocp.optimum.certificate import Level
from kiteocp.optimum.neighbours import ANOTHER_KIND, Family, optimise_near
from kiteocp.optimum.solve import result_of
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.processes import Processes
from kiteocp.result import Result

#: A problem is solved from another than the middle of its family where that is nearer by this factor: a chain of
#: neighbours reaches far, but the middle is known to be the best of all starts.
NEARER = 0.5

#: A neighbour this near, over the distance to the middle, has the word which kind of cycle is the best one here.
CLOSE = 0.25

#: Neighbours among which a solution of another kind is looked for.
NEAREST = 12

#: Problems that a process takes at a time.
CHUNK = 8


class _Start(msgspec.Struct, frozen=True):
    """Where a problem is solved from.

    Attributes
    ----------
    solution
        A solution of another one.
    known
        The nearest one that a crude start agreed with.
    traction_duration
        Of its traction, whatever the unit.
    asked
        Whether a crude start had the word on the solution itself.
    """

    solution: Solution
    known: Solution
    traction_duration: float
    asked: bool = True


#: What became of a problem, and where others may start from.
_Outcome = tuple[Result | SolveError, _Start | None]


@one_at_a_time
def solve_many(
    problems: Sequence[Problem],
    *,
    jobs: int = 1,
    certificate: Level = "quick",
    progress: Callable[[int, int], None] | None = None,
) -> list[Result | SolveError]:
    """Find the optimal cycles of many problems, in milliseconds each where they are neighbours.

    Problems that differ in numbers only are neighbours. One in their middle is solved from all starts, and the others
    from there or from a nearer one that is solved: by sequential quadratic programming, by IPOPT where that fails, and
    from all starts where both do. What is found does not depend on ``jobs``.

    Parameters
    ----------
    problems
        Any problems.
    jobs
        Processes. More than one need a main module that can be imported (``if __name__ == "__main__"``).
    certificate
        ``quick`` or ``full`` as for `kiteocp.solve`; ``none`` solves without one: only the first-order conditions and
        the objective are checked, nothing between the mesh points, and the status is ``not_certified``.
    progress
        Called with the problems done and their number.

    Returns
    -------
    list of Result or SolveError
        In the order of the problems: as `kiteocp.solve` returns it, without the prescribed cycle beside it; or the
        error that it would raise, `kiteocp.errors.InfeasibleError` where no cycle keeps the limits; that does not look
        for the limits in conflict, which takes seconds and `kiteocp.solve` does.

    Raises
    ------
    InputError
        ``jobs`` is not a positive number, or ``certificate`` no such word.
    SolveError
        A process was ended from outside.
    """
    check_word("certificate", certificate, get_args(Level))
    if jobs < 1:
        raise InputError(f"jobs: {jobs} is not a number of processes; give 1 or more")
    members: dict[Any, list[int]] = {}
    for place, problem in enumerate(problems):
        members.setdefault(Family.key_of(problem), []).append(place)
    found: dict[int, _Outcome] = {}

    def keep(place: int, outcome: _Outcome) -> None:
        found[place] = outcome
        if progress is not None:
            progress(len(found), len(problems))

    for places in members.values():
        _solve_family([problems[place] for place in places], places, jobs, certificate, keep)
    return [found[place][0] for place in range(len(problems))]


def _solve_family(
    problems: Sequence[Problem],
    places: Sequence[int],
    jobs: int,
    certificate: Level,
    keep: Callable[[int, _Outcome], None],
) -> None:
    """Solve problems that share a program, and keep what becomes of each at its place."""
    points = _scaled(problems)
    family, first = None, 0
    order = np.argsort(np.linalg.norm(points - np.median(points, axis=0), axis=1), kind="stable").tolist()
    solved: dict[int, _Start | None] = {}
    for first in order:
        try:
            family = Family.around(problems[first], explained=False)
        except SolveError as error:
            solved[first] = None
            keep(places[first], (error, None))
            continue
        break
    if family is None:
        return
    rest = [index for index in order if index not in solved]
    parents = _parents(points, rest)
    waves = list(_waves(parents, rest))

    best = _Start(family.optima[0], family.optima[0], family.traction_duration(family.optima[0]))

    def start_of(index: int) -> _Start:
        """Return the nearest ancestor that has a solution; from afar it is the middle that kinds are compared with."""
        ancestor = parents[index]
        while ancestor is not None:
            start = solved[ancestor]
            if start is not None:
                way, home = (float(np.linalg.norm(points[index] - points[at])) for at in (ancestor, first))
                return start if way <= CLOSE * home else msgspec.structs.replace(start, known=best.known)
            ancestor = parents[ancestor]
        return best

    def put(index: int, outcome: _Outcome) -> None:
        solved[index] = outcome[1]
        keep(places[index], outcome)

    def put_better(index: int, outcome: _Outcome) -> None:
        before, after = solved[index], outcome[1]
        if before is not None and after is not None and after.solution.f < before.solution.f:
            put(index, outcome)

    with contextlib.ExitStack() as stack:
        if jobs == 1 or len(rest) <= CHUNK:

            def solve(wave: Sequence[int], starts: Mapping[int, _Start]) -> Iterator[tuple[int, _Outcome]]:
                for index in wave:
                    yield index, _solved(problems[index], family, starts[index], certificate)

        else:
            processes = stack.enter_context(Processes(jobs, _start_process, family, certificate))

            def solve(wave: Sequence[int], starts: Mapping[int, _Start]) -> Iterator[tuple[int, _Outcome]]:
                size = max(1, min(CHUNK, -(-len(wave) // jobs)))
                chunks = [wave[begin : begin + size] for begin in range(0, len(wave), size)]
                tasks = [([(problems[index], starts[index]) for index in chunk],) for chunk in chunks]
                for place, outcomes in processes.run(_solve_in_process, tasks):
                    yield from zip(chunks[place], outcomes, strict=True)

        for wave in waves:
            for index, outcome in solve(wave, {index: start_of(index) for index in wave}):
                put(index, outcome)
        # Near a neighbour of another kind that kind may be the better one.
        rivals = _rivals(points, solved)
        for index, outcome in solve(list(rivals), rivals):
            put_better(index, outcome)


def _rivals(points: FloatArray, solved: Mapping[int, _Start | None]) -> dict[int, _Start]:
    """Return, for problems without a second opinion, a near solution of another kind of cycle where there is one."""
    known = {index: start for index, start in solved.items() if start is not None}
    places = np.array(list(known))
    if not places.size:
        return {}
    durations = np.log([start.traction_duration for start in known.values()])
    found: dict[int, _Start] = {}
    for place, (index, start) in enumerate(known.items()):
        if start.asked:
            continue
        distance = np.linalg.norm(points[places] - points[index], axis=1)
        near = np.argsort(distance)[1 : NEAREST + 1]
        other = near[np.abs(durations[near] - durations[place]) > np.log(ANOTHER_KIND)]
        if other.size:
            rival = known[int(places[other[0]])]
            # Followed as it is, whatever it turns into.
            found[index] = msgspec.structs.replace(rival, known=rival.solution)
    return found


def _solved(problem: Problem, family: Family, start: _Start, certificate: Level) -> _Outcome:
    began = time.perf_counter()
    try:
        optimum = optimise_near(problem, family, start.solution, start.known, certificate=certificate)
    except SolveError as error:
        return error, None
    result = result_of(optimum, time.perf_counter() - began, compared=False)
    # On another mesh it is no start for the others.
    if optimum.formulation != family.formulation:
        return result, None
    asked = any(attempt.start not in {"neighbour", "rival"} for attempt in optimum.attempts)
    known = optimum.solution if asked else start.known
    return result, _Start(optimum.solution, known, family.traction_duration(optimum.solution), asked)


def _scaled(problems: Sequence[Problem]) -> FloatArray:
    """Return the numbers that differ between problems over their sizes, shape (problems, numbers)."""
    vectors = np.array([parameter_values(problem).vector for problem in problems])
    differing = vectors[:, np.ptp(vectors, axis=0) > 0.0]
    return np.asarray(differing / np.maximum(np.abs(differing).max(axis=0, initial=0.0), 1e-300), dtype=np.float64)


def _parents(points: FloatArray, order: Sequence[int]) -> dict[int, int | None]:
    """Choose for each point, but the first of the order, the point before it that it is solved from."""
    first = order[0]
    parents: dict[int, int | None] = {first: None}
    home = np.linalg.norm(points - points[first], axis=1)
    nearest, distance = np.full(len(points), first), home * NEARER
    for index in order[1:]:
        parents[index] = int(nearest[index])
        here = np.linalg.norm(points - points[index], axis=1)
        nearer = here < distance
        nearest[nearer], distance[nearer] = index, here[nearer]
    return parents


def _waves(parents: dict[int, int | None], order: Sequence[int]) -> Iterator[list[int]]:
    """Yield points in waves: each is solved from one of a wave before."""
    depth: dict[int, int] = {}
    waves: list[list[int]] = []
    for index in order:
        parent = parents[index]
        depth[index] = 0 if parent is None else depth[parent] + 1
        if depth[index] == len(waves):
            waves.append([])
        waves[depth[index]].append(index)
    yield from waves


_OWN: dict[str, Any] = {}


def _start_process(family: Family, certificate: Level) -> None:
    _OWN["family"], _OWN["certificate"] = family, certificate


def _solve_in_process(tasks: Sequence[tuple[Problem, _Start]]) -> list[_Outcome]:
    family, certificate = _OWN["family"], _OWN["certificate"]
    return [_solved(problem, family, start, certificate) for problem, start in tasks]
