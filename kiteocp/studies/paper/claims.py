"""What the paper concludes from its tables, held against the numbers computed here."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from kiteocp.studies.paper.published import CASES
from kiteocp.studies.paper.tables import Comparison, Row

#: Returns the comparison of a case with or without gravity.
Lookup = Callable[[str, bool], Comparison]


class Claim(msgspec.Struct, frozen=True):
    """A conclusion of the paper.

    Attributes
    ----------
    case
        The case it is held against.
    text
        The conclusion, in short.
    holds
        Whether the numbers computed here bear it out.
    numbers
        Those numbers, in words.
    """

    case: str
    text: str
    holds: bool
    numbers: str


def check_claims(lookup: Lookup) -> tuple[Claim, ...]:
    """Hold the conclusions of section Traction Power against the comparisons."""
    claims = []
    for case in CASES:
        without, included = lookup(case, False), lookup(case, True)
        claims += [_retraction_within_tenth(case, included), *_gravity_improves(case, without, included)]
        claims += [_traction_overestimated(case, included), _retraction_shorter(case, without, included)]
    claims.append(_measured_between("strong-wind", lookup))
    claims.append(_neglecting_is_closer("moderate-wind", lookup))
    return tuple(claims)


def _retraction_within_tenth(case: str, included: Comparison) -> Claim:
    rows = _rows(included, "retraction")
    return Claim(
        case,
        "with gravity, power and duration of the retraction are within 10 % of the measured ones",
        all(abs(row.experiment_percent) <= 10 for row in rows),
        f"{_off(rows)} off the experiment",
    )


def _gravity_improves(case: str, without: Comparison, included: Comparison) -> list[Claim]:
    claims = []
    for phase in ("retraction", "traction"):
        before, after = _rows(without, phase), _rows(included, phase)
        holds = all(abs(a.experiment_percent) < abs(b.experiment_percent) for a, b in zip(after, before, strict=True))
        claims.append(
            Claim(
                case,
                f"power and duration of the {phase} are closer to the measured ones with gravity than without",
                holds,
                f"{_off(after)} off with gravity, {_off(before)} without",
            )
        )
    return claims


def _traction_overestimated(case: str, included: Comparison) -> Claim:
    power, time = _rows(included, "traction")
    return Claim(
        case,
        "even with gravity the traction gives more power than measured, in less time",
        power.experiment_percent > 0 > time.experiment_percent,
        f"{_off((power, time))} off the experiment",
    )


def _retraction_shorter(case: str, without: Comparison, included: Comparison) -> Claim:
    times = [comparison.row("retraction.duration_s") for comparison in (without, included)]
    return Claim(
        case,
        "gravity turns an overestimated retraction time into a slightly underestimated one",
        times[0].experiment_percent > 0 > times[1].experiment_percent > -10,
        f"{times[0].simulated:.1f} s without, {times[1].simulated:.1f} s with, "
        f"{times[0].experiment.value:g} s measured",
    )


def _measured_between(case: str, lookup: Lookup) -> Claim:
    low, high = sorted(lookup(case, gravity).row("cycle.mean_power_W").simulated for gravity in (False, True))
    measured = lookup(case, True).row("cycle.mean_power_W").experiment.value
    return Claim(
        case,
        "the measured cycle power lies between the simulations with and without gravity",
        low <= measured <= high,
        f"{1e-3 * low:.2f} and {1e-3 * high:.2f} kW simulated, {1e-3 * measured:.2f} kW measured",
    )


def _neglecting_is_closer(case: str, lookup: Lookup) -> Claim:
    without, included = (lookup(case, gravity).row("cycle.mean_power_W") for gravity in (False, True))
    return Claim(
        case,
        "the cycle power without gravity is closer to the measured one",
        abs(without.experiment_percent) < abs(included.experiment_percent),
        f"{without.experiment_percent:+.0f} % off without gravity, {included.experiment_percent:+.0f} % with",
    )


def _rows(comparison: Comparison, phase: str) -> tuple[Row, Row]:
    return comparison.row(f"{phase}.mean_power_W"), comparison.row(f"{phase}.duration_s")


def _off(rows: tuple[Row, Row]) -> str:
    power, time = rows
    return f"power {power.experiment_percent:+.0f} %, duration {time.experiment_percent:+.0f} %"
