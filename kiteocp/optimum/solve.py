"""An optimum in the form of the output contract: summary, time series, and the prescribed cycle beside it."""

from __future__ import annotations

import time

import numpy as np

from kiteocp.cycle.phases import PHASES
from kiteocp.cycle.simulation import simulate
from kiteocp.cycle.summary import channels_of, cycle_summary, phase_summaries, validity_warnings
from kiteocp.errors import CycleError
from kiteocp.execution import one_at_a_time
from kiteocp.optimum.certificate import Level
from kiteocp.optimum.cycle import OptimalCycle, active_limits, speed_jumps
from kiteocp.optimum.refine import Optimum, optimise
from kiteocp.optimum.search import best_of
from kiteocp.problem import Problem
from kiteocp.result import Result

#: An optimum is called degenerate where its stroke is less than this share of what the limits allow (in the family of
#: `benchmarks.robustness` only cycles of next to no power have less) ...
DEGENERATE_STROKE_SHARE = 0.1

#: ... and retraction and transition together are shorter than three changes of phase at their default of 2 s each: the
#: model has steady flight only, and there is hardly any.
DEGENERATE_TIME_S = 6.0


@one_at_a_time
def solve(problem: Problem, *, certificate: Level = "full") -> Result:
    """Find the pumping cycle of largest mean power under the limits of a problem.

    Calls from several threads of a process take turns (CasADi and IPOPT are not safe otherwise): their results are
    those of one call after another, and processes are what uses more than one core. Ctrl-C raises KeyboardInterrupt
    once CasADi can be left.

    Parameters
    ----------
    problem
        The problem; its ``limits`` bound the cycle, its ``optimisation`` block says what is free.
    certificate
        ``full`` refines the mesh until the optimal power no longer changes by more than 1e-4; ``quick`` judges the
        solution on the mesh of the problem file, and starts the solver once where that gives no reason to look for
        another optimum; ``none`` checks the first-order conditions and the objective alone.

    Returns
    -------
    Result
        With status ``certified``, or ``not_certified`` and the failed checks in ``details["certificate"]``;
        ``prescribed`` is the forward simulation of the same problem, its mean power on equal terms (the same
        phase-change time), or None where the prescribed cycle cannot be flown.

    Raises
    ------
    InfeasibleError
        No start led to a cycle, and limits are in conflict.
    SolveError
        No start led to a cycle, for no reason that could be found.
    """
    began = time.perf_counter()
    return result_of(optimise(problem, certificate=certificate), time.perf_counter() - began)


def result_of(optimum: Optimum, total_time_s: float, *, compared: bool = True) -> Result:
    """Put an optimum into the form of the output contract, beside the prescribed cycle unless it is not asked for."""
    cycle, values, problem = optimum.cycle, optimum.values, optimum.problem
    phases = phase_summaries(cycle.records, values)
    pause = values["limits.phase_change_time_s"]
    traction = cycle.record("traction")
    mean_elevation = float(np.trapezoid(traction.elevation_rad, traction.time_s)) / traction.duration_s
    # eq:meantractionaltitude with the lengths and the mean elevation that were flown.
    altitude = 0.5 * float(traction.tether_length_m[0] + traction.tether_length_m[-1]) * float(np.sin(mean_elevation))
    summary = cycle_summary(values, phases, traction_altitude_m=altitude, phase_change_time_s=pause)
    solver_time = sum(attempt.solution.time_s for attempt in optimum.attempts)
    best = best_of(optimum.attempts)
    prescribed, unflown = prescribed_cycle(problem) if compared else (None, None)
    return Result(
        verb="solve",
        problem=problem,
        status=optimum.certificate.status,
        # One that both the problem and its cycle give is said once.
        warnings=tuple(
            dict.fromkeys(
                (
                    *problem.warnings(),
                    *validity_warnings(cycle.records, values),
                    *jump_warnings(cycle),
                    *degeneracy_warnings(cycle),
                    *([] if unflown is None else [f"no comparison: {unflown}"]),
                )
            )
        ),
        phases=phases,
        cycle=dict(summary),
        channels=channels_of(cycle.records, values, pause),
        details={
            "solver": {
                "name": optimum.solution.method.lower(),
                "status": optimum.solution.status,
                "iterations": best.solution.iterations,
                "time_s": best.solution.time_s,
                "starts_time_s": solver_time,
                "total_time_s": total_time_s,
                "starts": len(optimum.attempts),
                "start": best.start,
                "variables": len(optimum.solver.program.variables),
                "rows": len(optimum.solver.program.rows),
            },
            "objective": problem.optimisation.objective,
            "certificate": optimum.certificate.to_dict(),
            **({} if optimum.certificate.status == "certified" else {"message": optimum.certificate.message}),
            "starts": [
                {
                    "start": attempt.start,
                    "status": attempt.solution.status,
                    "mean_power_W": attempt.mean_power_W,
                    "iterations": attempt.solution.iterations,
                    "time_s": attempt.solution.time_s,
                }
                for attempt in optimum.attempts
            ],
            "active_limits": active_limits(cycle),
            "speed_jumps": speed_jumps(cycle.records, values),
            **({} if unflown is None else {"prescribed_message": unflown}),
            **optimum.facts,
        },
        prescribed=prescribed,
    )


def jump_warnings(cycle: OptimalCycle) -> list[str]:
    """Say where the winch needs longer for a change of speed between phases than the phase-change time gives it."""
    return [
        f"from {jump['from_phase']} to {jump['to_phase']} the reeling speed jumps by {jump['jump_m_s']:+.1f} m/s, "
        + (
            f"more than the winch can do in limits.phase_change_time_s ({jump['allowed_m_s']:g} m/s); "
            if jump["allowed_m_s"] > 0.0
            else "and no time passes between these phases (limits.phase_change_time_s is not for them); "
        )
        + "optimisation.speed_jumps: limited keeps to that"
        for jump in speed_jumps(cycle.records, cycle.values)
        if abs(jump["jump_m_s"]) > jump["allowed_m_s"] * (1 + 1e-6)
    ]


def degeneracy_warnings(cycle: OptimalCycle) -> list[str]:
    """Say where the optimum hardly is a pumping cycle: a small share of the stroke, reeled in within moments."""
    values = cycle.values
    retraction, transition, traction = (cycle.record(name) for name in PHASES)
    stroke = float(traction.tether_length_m[-1] - traction.tether_length_m[0])
    allowed = values["limits.tether_length_max_m"] - values["limits.tether_length_min_m"]
    inwards = retraction.duration_s + transition.duration_s
    if stroke >= DEGENERATE_STROKE_SHARE * allowed or inwards >= DEGENERATE_TIME_S:
        return []
    return [
        f"the optimum is degenerate: its stroke of {stroke:.3g} m is {100 * stroke / allowed:.2g} % of the "
        f"{allowed:.4g} m that the limits allow, and retraction and transition together take {inwards:.2g} s; most "
        "of such a cycle is change of phase, which the model leaves out. The wind hardly carries a cycle here; "
        "limits.stroke_min_m asks for a longer one"
    ]


def prescribed_cycle(problem: Problem) -> tuple[Result | None, str | None]:
    """Simulate the prescribed cycle of the same problem, with the optimum's phase-change time in its means.

    Returns
    -------
    result, message
        One of them is None: the message says why the cycle cannot be flown, and so has no result.
    """
    try:
        return simulate(problem, phase_change_time_s=problem.limits.phase_change_time_s), None
    except CycleError as error:
        return None, f"{error}; kiteocp simulate says with which numbers it would fly"
