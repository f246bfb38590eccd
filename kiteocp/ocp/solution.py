"""The optimal pumping cycle of a problem: the best solution found, refined until its certificate passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kiteocp.ocp import certificate as certify
from kiteocp.ocp.certificate import Certificate, Level
from kiteocp.ocp.formulation import Formulation
from kiteocp.ocp.limits import SCALES
from kiteocp.ocp.nlpsolver import Solution, Solver
from kiteocp.ocp.optimum import OptimalCycle
from kiteocp.ocp.search import Attempt, best_of, cycle_solver, search, solver_options
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem

#: Times that the full certificate halves the mesh at most, and the collocation points that it goes up to.
REFINEMENTS = 4
MOST_POINTS = 500


@dataclass(frozen=True)
class Optimum:
    """An optimal cycle with all that is known about it.

    Attributes
    ----------
    problem, values
        What was solved.
    solver
        The solver of the mesh that the solution is on.
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
    solver: Solver
    attempts: tuple[Attempt, ...]
    solution: Solution
    cycle: OptimalCycle
    certificate: Certificate
    facts: dict[str, Any]

    @property
    def mean_power_W(self) -> float:
        """Mean power of the objective."""
        return -self.solution.f * SCALES["power"]


def optimise(problem: Problem, *, certificate: Level = "full") -> Optimum:
    """Find and certify the optimal cycle; `kiteocp.ocp.solve` puts it into a result.

    Raises
    ------
    InfeasibleError, SolveError
        As `kiteocp.ocp.solve`.
    """
    values = parameter_values(problem)
    formulation = Formulation.of(problem)
    options = solver_options(problem)
    solver = cycle_solver(values.structure, formulation, options)
    attempts = search(values, formulation, options)
    solution = best_of(attempts).solution
    powers, meshes = [-solution.f * SCALES["power"]], [str(formulation.intervals)]
    optimum = None
    for _ in range(REFINEMENTS if certificate == "full" else 0):
        formulation = formulation.refined()
        if formulation.points > MOST_POINTS and len(powers) > 1:
            break
        finer = cycle_solver(values.structure, formulation, options)
        start = finer.program.pack(solver.program.unpack(solution.x, values.vector))
        refined = finer.solve(start, values.vector, near=True)
        if not refined.success:
            refined = finer.solve(start, values.vector)
        if not refined.success:
            break
        solver, solution = finer, refined
        powers.append(-solution.f * SCALES["power"])
        meshes.append(str(formulation.intervals))
        optimum = _judged(problem, values, solver, attempts, solution, powers, meshes, certificate)
        if optimum.certificate.passed:
            break
    return optimum or _judged(problem, values, solver, attempts, solution, powers, meshes, certificate)


def _judged(
    problem: Problem,
    values: ParameterValues,
    solver: Solver,
    attempts: Sequence[Attempt],
    solution: Solution,
    powers: Sequence[float],
    meshes: Sequence[str],
    level: Level,
) -> Optimum:
    """Read a solution and run all checks on it."""
    cycle = OptimalCycle.of(solver.program, solution, values)
    resimulation, flown, facts = certify.resimulation_check(cycle, level)
    margins = certify.limit_margins(cycle, flown)
    checks = [
        certify.solver_check(solution),
        certify.kkt_check(solver.program, solution),
        certify.limits_check(margins),
        resimulation,
    ]
    if problem.optimisation.objective == "mechanical":
        # Behind generator and motor the objective is another power than the cycle's.
        checks.insert(2, certify.objective_check(-solution.f * SCALES["power"], cycle))
    if level == "full":
        checks.append(certify.mesh_check(powers, meshes))
    checks.append(certify.starts_check([attempt.mean_power_W for attempt in attempts]))
    checks.append(certify.jumps_check(cycle, problem.optimisation.speed_jumps == "limited"))
    return Optimum(
        problem,
        values,
        solver,
        tuple(attempts),
        solution,
        cycle,
        Certificate(level, tuple(checks)),
        {
            "resimulation": facts,
            "limit_margins": {item.key: {"phase": item.phase, "margin": item.margin} for item in margins},
            "meshes": [
                {"intervals": mesh, "mean_power_W": power} for mesh, power in zip(meshes, powers, strict=True)
            ],
        },
    )
