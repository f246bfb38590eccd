"""What became of the problems of the robustness benchmark, and the report of it."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from kiteocp.optimum.infeasibility import NOTHING

#: A power this much below the best known, relative, is not the optimum.
SHORTFALL = 1e-3


def shortfall_of(power_W: float, reference_W: float) -> float:
    """Return the power missing to a reference, relative to it."""
    return (reference_W - power_W) / max(abs(reference_W), 1.0)


class Outcome(msgspec.Struct):
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
    attempts: dict[str, float | None] = msgspec.field(default_factory=dict)
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
    quick_failed_checks: list[str] = msgspec.field(default_factory=list)

    @property
    def feasible(self) -> bool:
        """Whether anything found a cycle."""
        return self.power_W is not None or self.found_by is not None

    @property
    def shortfall(self) -> float | None:
        """Power missing to the best that is known, relative to it; None where there is nothing to compare."""
        if self.power_W is None or self.reference_W is None:
            return None
        return shortfall_of(self.power_W, self.reference_W)

    @property
    def solved(self) -> bool:
        """Whether the best known cycle was found."""
        return self.power_W is not None and (self.shortfall is None or self.shortfall <= SHORTFALL)

    @property
    def recognised(self) -> bool:
        """Whether the elastic program agrees that there is no cycle."""
        return not self.feasible and self.elastic_sum is not None and self.elastic_sum > NOTHING


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
        f"problems                          {len(outcomes)}: {len(feasible)} feasible, {len(infeasible)} infeasible",
        f"solved to the best of ten random  {_share(len(solved), len(feasible))}, within {100 * SHORTFALL:g} %",
        f"infeasible, recognised as such    {_share(len(recognised), len(infeasible))}",
        f"time to say so                    {_spread(refusals_s)} s (median / 95 %)",
        f"solver time of the best start     {_spread(times_ms)} ms (median / 95 %)",
        f"solver time of all starts         {_spread(totals_ms)} ms",
        f"iterations of the best start      {_spread(iterations)}",
        f"starts that were needed           {_starts(found)}",
        f"error of the first mesh           {_spread([100 * e for e in errors], '.2g')} %, "
        f"largest {100 * max(errors, default=np.nan):.2g} % ({len(errors)} problems)",
        f"certified, full                   {_share(len(certified), len(sampled))}",
        f"certified, quick                  {_share(len(quick), len(found))}",
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
