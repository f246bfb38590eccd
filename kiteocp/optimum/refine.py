"""The optimal pumping cycle of a problem: the best solution found, refined until its certificate passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.errors import SolveError, check_word
from kiteocp.execution import one_at_a_time
from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.transcription import transcribe
from kiteocp.optimum import certificate as certify
from kiteocp.optimum.certificate import Certificate, Check, Level
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.optimum.mesh_error import TARGET, IntervalErrors, adapted_mesh, interval_errors, passed_limit
from kiteocp.optimum.program import Formulation, cycle_problem, deferred_rows
from kiteocp.optimum.search import Attempt, best_of, cycle_solver, search, solver_options
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem

Options = tuple[tuple[str, Any], ...]

#: Times that the full certificate halves a mesh at most, and the collocation points that it goes up to.
REFINEMENTS = 4
MOST_POINTS = 500

#: Times that intervals in which a limit is left are divided, and the parts of each.
DIVISIONS = 3
DIVISION_PARTS = 2

#: Change of the power, relative, by which a solution on a divided mesh is another optimum, and is left alone.
SAME_POWER = 1e-3

#: Times that the quick certificate halves a mesh whose solution leaves limits between its points, or cannot be flown:
#: that is no solution. It leaves every other mesh as it is.
QUICK_REFINEMENTS = 2
USELESS = frozenset({"limits", "re-simulation"})

#: A mesh of so many points is halved a second time before it is adapted: that takes less time than to adapt it.
CHEAP_POINTS = 60

#: Times that it adapts the mesh before it halves it again, and the steps that it does so in.
ADAPTATIONS = 2
ADAPTING_STEPS = 3


#: Meshes in a row whose schedule cannot be flown between the points, after which it is taken that no mesh will do: the
#: solution lives on a gap in the steady states, such as a step in the wind, that it passes between two points.
UNFLYABLE = 2


class MeshSolution(msgspec.Struct, frozen=True):
    """The best cycle on one mesh.

    Attributes
    ----------
    formulation
        Holds the mesh.
    solver, solution
        What solved it, and the result.
    halved
        Whether every interval is half of one of the mesh before, or less.
    """

    formulation: Formulation
    solver: Solver
    solution: Solution
    halved: bool

    @property
    def mean_power_W(self) -> float:
        """Mean power of the objective."""
        return float(self.solver.program.in_units(self.solution.f))

    @property
    def name(self) -> str:
        """Intervals of each phase, and whether they are of equal length."""
        adapted = self.formulation.interval_fractions is not None
        return f"{self.formulation.intervals}{' adapted' if adapted else ''}"

    @property
    def shortest_interval_s(self) -> float:
        """Length of the shortest interval."""
        program = self.solver.program
        durations_s = self.solution.x * program.scales
        return float(
            min(
                durations_s[program.layouts[name].duration] * min(mesh.interval_fractions)
                for name, mesh in program.mesh.items()
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the mesh as plain values for the summary."""
        return {
            "intervals": list(self.formulation.intervals),
            "adapted": self.formulation.interval_fractions is not None,
            "points": self.formulation.points,
            "shortest_interval_s": self.shortest_interval_s,
            "mean_power_W": self.mean_power_W,
            "iterations": self.solution.iterations,
            "time_s": self.solution.time_s,
        }

    def errors(self, values: ParameterValues) -> dict[str, IntervalErrors]:
        """Estimate the error of each interval, by phase."""
        program = self.solver.program
        return interval_errors(program, self.solution, OptimalCycle.of(program, self.solution, values))

    def on(
        self, formulation: Formulation, values: ParameterValues, options: Options, *, halved: bool = False
    ) -> MeshSolution | None:
        """Solve on another mesh, from here; None where that fails."""
        if formulation.interval_fractions is None:
            solver = cycle_solver(values.structure, formulation, options)
        else:
            # No other problem will ask for this mesh again: it is not kept.
            program = transcribe(cycle_problem(values.structure, formulation), formulation.mesh)
            solver = Solver(program, dict(options), deferred=deferred_rows(program, values.structure))
        start = solver.program.pack(self.solver.program.unpack(self.solution.x, values.vector))
        solution = solver.solve(start, values.vector, near=True)
        if not solution.success:
            solution = solver.solve(start, values.vector)
        return MeshSolution(formulation, solver, solution, halved) if solution.success else None


class Optimum(msgspec.Struct, frozen=True):
    """An optimal cycle with all that is known about it.

    Attributes
    ----------
    problem, values
        What was solved.
    formulation, solver
        Of the mesh that the solution is on.
    attempts
        Solutions from all starts on the coarsest mesh.
    solution
        The best, on the finest mesh.
    cycle
        The solution in the words of the cycle.
    certificate
        Its checks.
    facts
        Numbers behind the checks: limit margins, re-simulation, mesh powers.
    """

    problem: Problem
    values: ParameterValues
    formulation: Formulation
    solver: Solver
    attempts: tuple[Attempt, ...]
    solution: Solution
    cycle: OptimalCycle
    certificate: Certificate
    facts: dict[str, Any]

    @property
    def mean_power_W(self) -> float:
        """Mean power of the objective."""
        return float(self.solver.program.in_units(self.solution.f))


@one_at_a_time
def optimise(problem: Problem, *, certificate: Level = "full", explained: bool = True) -> Optimum:
    """Find and certify the optimal cycle; `kiteocp.optimum.solve.solve` puts it into a result.

    Parameters
    ----------
    problem, certificate
        As for `kiteocp.optimum.solve.solve`.
    explained
        Where there is no cycle, look for the limits in conflict.

    Raises
    ------
    InfeasibleError, SolveError
        As `kiteocp.optimum.solve.solve`.
    """
    check_word("certificate", certificate, get_args(Level))
    values = parameter_values(problem)
    attempts = search(
        values,
        Formulation.of(problem),
        solver_options(problem),
        second_opinion=certificate == "full",
        explained=explained,
    )
    return certified(problem, attempts, certificate)


def certified(
    problem: Problem, attempts: Sequence[Attempt], certificate: Level, formulation: Formulation | None = None
) -> Optimum:
    """Judge the best of some solutions, and refine its mesh as the certificate asks for.

    Parameters
    ----------
    problem
        The problem.
    attempts
        Solutions on one mesh, or what came instead.
    certificate
        As for `optimise`.
    formulation
        Where their mesh is not that of the problem file.

    Raises
    ------
    SolveError
        None of them succeeded.
    """
    values, options = parameter_values(problem), solver_options(problem)
    formulation = formulation or Formulation.of(problem)
    best = best_of(attempts)
    meshes = [MeshSolution(formulation, best.solver, best.solution, halved=False)]
    optimum = None
    adaptations = unflyable = 0
    for count in range(REFINEMENTS if certificate == "full" else 0):
        steps: list[MeshSolution] = []
        if count > 1 or (count == 1 and _better_adapted(meshes[-1], values)):
            if adaptations == ADAPTATIONS:
                break
            adaptations += 1
            steps = _adapted(meshes[-1], formulation.mesh, values, options)
        last = (steps or meshes)[-1]
        finer = last.formulation.refined()
        halved = None if finer.points > MOST_POINTS and count else last.on(finer, values, options, halved=True)
        if halved is None:
            break
        meshes += [*steps, halved]
        optimum = _within_limits(_judged(problem, values, attempts, meshes, certificate), meshes, options)
        unflyable = 0 if optimum.facts["resimulation"]["completed"] else unflyable + 1
        if optimum.certificate.passed or unflyable == UNFLYABLE:
            break
    if optimum is None:
        optimum = _judged(problem, values, attempts, meshes, certificate)
    return _made_useful(optimum, meshes, options) if certificate == "quick" else optimum


def _within_limits(optimum: Optimum, meshes: list[MeshSolution], options: Options) -> Optimum:
    """Divide, again and again, the intervals in which a limit is left, where that is all that is wrong with a solution.

    The divided mesh takes the place of the one that it divides: both refine the mesh before.
    """
    for _ in range(DIVISIONS):
        if {check.name for check in optimum.certificate.failures} != {"limits"}:
            break
        last = meshes[-1]
        beyond = certify.intervals_beyond(optimum.cycle)
        before = last.formulation.mesh
        mesh = {str(name): before[name].divided(passed, DIVISION_PARTS) for name, passed in beyond.items()}
        formulation = last.formulation.on_mesh(mesh)
        if formulation.points > MOST_POINTS:
            break
        divided = last.on(formulation, optimum.values, options, halved=last.halved)
        if divided is None or abs(divided.mean_power_W - last.mean_power_W) > SAME_POWER * abs(last.mean_power_W):
            break
        meshes[-1] = divided
        level = optimum.certificate.level
        optimum = _judged(optimum.problem, optimum.values, optimum.attempts, meshes, level)
    return optimum


def _made_useful(optimum: Optimum, meshes: list[MeshSolution], options: Options) -> Optimum:
    """Search again on a mesh of half the intervals' length where the solution of a quick certificate is none.

    There is no going on from it: a cycle that lives on what the mesh does not see may lead to a worse local optimum.
    One that can be flown, and leaves limits only between points, is kept, and the mesh divided there.
    """
    problem, values = optimum.problem, optimum.values
    optimum = _within_limits(optimum, meshes, options)
    for _ in range(QUICK_REFINEMENTS):
        failures = {check.name for check in optimum.certificate.failures}
        if not failures or not failures <= USELESS:
            break
        finer = optimum.formulation.refined()
        try:
            attempts = search(values, finer, options, explained=False)
        except SolveError:
            break
        solver = cycle_solver(values.structure, finer, options)
        meshes = [MeshSolution(finer, solver, best_of(attempts).solution, halved=False)]
        optimum = _within_limits(_judged(problem, values, attempts, meshes, "quick"), meshes, options)
    return optimum


def _better_adapted(mesh: MeshSolution, values: ParameterValues) -> bool:
    """Whether a second halving is dear and will not do: it takes away half of what a kink owes."""
    if mesh.formulation.points <= CHEAP_POINTS:
        return False
    owed = sum(np.sum(np.abs(phase.gap) + phase.excess) for phase in mesh.errors(values).values())
    return bool(owed > 2.0 * certify.MESH_TOLERANCE)


def _adapted(
    start: MeshSolution, first: Mapping[str, PhaseMesh], values: ParameterValues, options: Options
) -> list[MeshSolution]:
    """Adapt the mesh step by step until its intervals owe no more than `refinement.TARGET`, or it gets too large.

    No interval becomes longer than those of the first mesh.
    """
    found: list[MeshSolution] = []
    for _ in range(ADAPTING_STEPS):
        last = (found or [start])[-1]
        errors = last.errors(values)
        if sum(phase.total.sum() for phase in errors.values()) <= TARGET:
            break
        mesh = {
            name: adapted_mesh(phase, errors[name].total, longest=max(first[name].interval_fractions))
            for name, phase in last.formulation.mesh.items()
        }
        formulation = last.formulation.on_mesh(mesh)
        # It has to be halved afterwards.
        if 2 * formulation.points > MOST_POINTS:
            break
        finer = last.on(formulation, values, options)
        if finer is None:
            break
        found.append(finer)
    return found


def _judged(
    problem: Problem,
    values: ParameterValues,
    attempts: Sequence[Attempt],
    meshes: Sequence[MeshSolution],
    level: Level,
) -> Optimum:
    """Read the solution on the last mesh and run all checks on it."""
    solver, solution = meshes[-1].solver, meshes[-1].solution
    cycle = OptimalCycle.of(solver.program, solution, values)
    checks = [
        certify.solver_check(solution, meshes[-1].name),
        certify.kkt_check(solver.program, solution),
        certify.objective_check(meshes[-1].mean_power_W, cycle, problem.optimisation.objective),
    ]
    facts: dict[str, Any] = {}
    if level != "none":
        resimulation, flown, facts["resimulation"] = certify.resimulation_check(cycle, level)
        margins = certify.limit_margins(cycle, flown)
        facts["limit_margins"] = {item.key: {"phase": item.phase, "margin": item.margin} for item in margins}
        checks += [certify.limits_check(margins), resimulation]
    if level == "full":
        checks.append(_mesh_check(meshes, values))
    failed = {attempt.start: attempt.solution.status for attempt in attempts if not attempt.solution.success}
    checks.append(certify.starts_check([attempt.mean_power_W for attempt in attempts], failed))
    checks.append(certify.jumps_check(cycle, problem.optimisation.speed_jumps == "limited"))
    return Optimum(
        problem,
        values,
        meshes[-1].formulation,
        solver,
        tuple(attempts),
        solution,
        cycle,
        Certificate(level, tuple(checks)),
        {**facts, "meshes": [mesh.to_dict() for mesh in meshes]},
    )


def _mesh_check(meshes: Sequence[MeshSolution], values: ParameterValues) -> Check:
    """Compare the last mesh, if it halves another, with that; where they differ, say what differs if that is known."""
    if not meshes[-1].halved:
        return certify.mesh_check([], [])
    check = certify.mesh_check([mesh.mean_power_W for mesh in meshes[-2:]], [mesh.name for mesh in meshes[-2:]])
    text = check.text
    if meshes[-1].formulation.interval_fractions is not None:
        text += f", its shortest interval {meshes[-1].shortest_interval_s:.2g} s"
    if not check.passed:
        remark = passed_limit(meshes[-1].errors(values), meshes[-1].formulation.mesh)
        text += f"; {remark}" if remark else ""
    return replace(check, text=text)
