"""The report of an export in words: when to switch, the laws, and what they lose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from kiteocp.cycle.phases import PhaseName
from kiteocp.problem import Problem
from kiteocp.result import unit_of
from kiteocp.studies.winch.evaluation import LawEvaluation
from kiteocp.studies.winch.flight import Switching
from kiteocp.studies.winch.law import Kind, WinchLaw

#: Violations named for each cycle; the others are counted.
NAMED = 3


def format_report(
    problem: Problem,
    certified: bool,
    switching: Switching,
    laws: Mapping[Kind, Mapping[PhaseName, WinchLaw]],
    evaluations: Sequence[LawEvaluation],
) -> str:
    """Return the report, several lines without a newline at the end."""
    lines = [f"to the winch: {problem.name}"]
    if not certified:
        lines.append("the optimum is NOT certified: do not fly these set points")
    turn = []
    if switching.turn_elevation_deg is not None:
        turn.append(f"  turn        at {switching.turn_elevation_deg:.2f} deg elevation")
    lines += [
        "phases end:",
        f"  retraction  at {switching.retraction_length_m:.1f} m of tether, or at "
        f"{switching.elevation_max_deg:.1f} deg elevation",
        f"  transition  at {switching.transition_elevation_deg:.2f} deg elevation",
        f"  traction    at {switching.traction_length_m:.1f} m of tether",
        *turn,
        "force laws, reeling speed (m/s) at a tether force at the ground (N):",
    ]
    for name in laws["force"]:
        law = laws["force"][name]
        pairs = ", ".join(
            f"{round(v, 2) + 0.0:.2f} at {f:.0f}" for f, v in zip(law.knots, law.reeling_speed_m_s, strict=True)
        )
        lines.append(f"  {name:<11} {pairs}")
        lines.append(
            f"  {'':<11} met in the optimum from {law.valid[0]:.0f} to {law.valid[1]:.0f} N; "
            f"error {law.error_rms_m_s:.2f} m/s rms, {law.error_max_m_s:.2f} m/s at most"
        )
    for kind in laws:
        flown = [one for one in evaluations if one.kind == kind]
        if not flown:
            missing = ", ".join(name for name in laws["force"] if name not in laws[kind])
            lines.append(f"{kind} laws: none for the {missing}, where it is no function of tether length; not flown")
            continue
        losses = [f"{_loss(one)} ({_wind(one.wind_factor)})" for one in flown]
        lines.append(f"{kind} laws lose {', '.join(losses)} of the optimal power of that wind")
        for one in flown:
            lines += [f"  {_wind(one.wind_factor)}: {text}" for text in _remarks(one)]
    lines.append(
        "The kite holds its elevation and power setting as in the optimum of the problem's wind, in every wind; "
        "phase changes count in the means, without motion or energy."
    )
    return "\n".join(lines)


def _wind(factor: float) -> str:
    return "nominal" if factor == 1.0 else f"wind {100 * (factor - 1):+.0f} %"


def _loss(one: LawEvaluation) -> str:
    loss = one.loss_percent
    # No minus before a zero.
    return "unknown" if loss is None else f"{round(loss, 2) + 0.0:.2f} %"


def _remarks(one: LawEvaluation) -> list[str]:
    """Say what a reader of the loss must know: no flight, no optimum, force overshoot, limits left."""
    if one.message is not None:
        return [f"the laws cannot fly the cycle: {one.message}"]
    remarks = []
    if one.optimal_mean_power_W is None:
        remarks.append("no optimal cycle was found in this wind to compare with")
    if one.force_overshoot_percent is not None and one.force_overshoot_percent > 0.05:
        remarks.append(f"the tether force goes {one.force_overshoot_percent:.1f} % over its limit")
    for violation in one.violations[:NAMED]:
        unit = unit_of(violation["limit"])
        remarks.append(
            f"{violation['limit']} ({violation['value']:g} {unit}) is left in the {violation['phase']}: "
            f"{violation['reached']:.4g} {unit}"
        )
    if len(one.violations) > NAMED:
        remarks.append(f"{len(one.violations) - NAMED} more in laws.json")
    if one.loss_percent is not None and one.loss_percent < -0.01:
        remarks.append("more power than the optimum only because limits are left")
    return remarks
