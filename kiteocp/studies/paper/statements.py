"""What the validation shows, in sentences that are made from its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import TYPE_CHECKING

from kiteocp.report.words import listed
from kiteocp.studies.paper.claims import Claim
from kiteocp.studies.paper.published import CASES, PAPER_BAND_TIME_STEP, PAPER_STEPS, PAPER_TIME_STEP
from kiteocp.studies.paper.rounding import REEL_OUT_ENERGY, RETRACTION_FORCE
from kiteocp.studies.paper.tables import EXPLANATIONS, Comparison, Row

if TYPE_CHECKING:
    from kiteocp.studies.paper.paper import PaperValidation

#: How quantities are called and shown: unit, factor and decimals.
SHOWN: dict[str, tuple[str, float, int]] = {
    "mean_power_W": ("kW", 1e-3, 2),
    "duration_s": ("s", 1.0, 1),
    "energy_J": ("kJ", 1e-3, 0),
    "mean_force_N": ("N", 1.0, 1),
}
_NAMES = {"mean_power_W": "power", "duration_s": "duration", "energy_J": "energy", "mean_force_N": "force"}


def name_of(quantity: str) -> str:
    """Return what a quantity is called: ``transition power``."""
    part, _, name = quantity.partition(".")
    return f"{part.replace('_', ' ')} {_NAMES[name]}"


def text_of(quantity: str, value: float, *, unit: bool = True) -> str:
    """Return a value of a quantity with its unit, as a person reads it."""
    symbol, factor, digits = SHOWN[quantity.partition(".")[2]]
    # No minus before a zero.
    number = f"{round(factor * value, digits) + 0.0:.{digits}f}"
    return f"{number} {symbol}" if unit else number


def statements(study: PaperValidation) -> dict[str, list[str]]:
    """Return what the study shows by topic, a list of sentences each."""
    return {
        "In short": _in_short(study),
        "What the rounding of the inputs explains": _on_rounding(study),
        "What lies outside": _on_outside(study),
        "Where the tether force is held": _on_reference(study),
        "Beside the experiment": _on_experiment(study),
        "The conclusions of the paper": _on_claims(study),
        "The finite-difference scheme": _on_scheme(study),
        "The published numbers themselves": _on_publication(study),
    }


def _in_short(study: PaperValidation) -> list[str]:
    own = _own(study)
    rows = [row for comparison in own for row in comparison.published_rows]
    counts = {kind: sum(row.explained == kind for row in rows) for kind in EXPLANATIONS}
    transitions = [comparison.row("transition.mean_power_W") for comparison in own]
    outside = sum(row.explained == "no" for row in transitions)
    energies = [comparison.row(REEL_OUT_ENERGY).deviation_percent for comparison in own]
    included = [row for comparison in own if comparison.gravity for row in comparison.published_rows]
    nearer = sum(_nearer(row) for row in included)
    holding = {reference: sum(claim.holds for claim in claims) for reference, claims in study.claims.items()}
    claims = len(next(iter(study.claims.values())))
    begins = [begin for begin in study.convergence.band_time_steps.values() if math.isfinite(begin)]
    sentences = [
        f"Of the {len(rows)} published numbers of the simulation, rounding of the measured inputs explains "
        f"{counts['likely'] + counts['at worst']}, {counts['nominal sizes']} more if tether diameter and mast height "
        f"were rounded too, and {counts['no']} not at all; among these {outside} of the {len(transitions)} transition "
        f"powers. The energy of transition and traction together is {_range(energies)} % off.",
        f"With gravity, {nearer} of {len(included)} numbers are nearer to the experiment than the published ones.",
        f"Of {claims} conclusions that the paper draws from its tables, "
        + listed([f"{count} hold with the force held at the {where}" for where, count in holding.items()], "and")
        + ".",
    ]
    if begins:
        sentences.append(
            f"The finite-difference scheme needs a nondimensional time step below {min(begins):.3f} to stay within 3 % "
            f"(the paper: {PAPER_BAND_TIME_STEP:g}), and converges to the adaptive integrator that is used here."
        )
    return sentences


def _on_rounding(study: PaperValidation) -> list[str]:
    sentences = []
    for comparison in _own(study):
        by_class = {
            kind: [row.quantity for row in comparison.published_rows if row.explained == kind]
            for kind in ("likely", "at worst", "nominal sizes")
        }
        explained = by_class["likely"] + by_class["at worst"]
        count = len(comparison.published_rows)
        text = f"{_title(comparison)}: rounding explains {len(explained)} of {count} numbers"
        text += f" ({listed([name_of(one) for one in explained], 'and')})" if explained else ""
        if by_class["nominal sizes"]:
            names = listed([name_of(one) for one in by_class["nominal sizes"]], "and")
            text += f", and {names} if tether diameter and mast height were rounded too"
        sentences.append(f"{text}.")
    widths = [
        (row.nominal_band.high - row.nominal_band.low) / (row.band.high - row.band.low)
        for comparison in _own(study)
        for row in comparison.published_rows
    ]
    sentences.append(
        "Tether diameter and mast height, sizes by name, are held; if they were rounded to a whole millimetre and "
        f"metre, the bands would be {min(widths):.1f} to {max(widths):.1f} times as wide."
    )
    sentences.append(
        "Each number is judged alone: that one set of inputs within the rounding explains all of them at once is not "
        "claimed."
    )
    return sentences


def _on_outside(study: PaperValidation) -> list[str]:
    sentences = []
    for comparison in _own(study):
        outside = [row for row in comparison.published_rows if row.explained == "no"]
        if outside:
            told = [
                f"{name_of(row.quantity)} {text_of(row.quantity, row.simulated)} for "
                f"{text_of(row.quantity, row.published.value, unit=False)} published "
                f"({text_of(row.quantity, row.outside)} beyond)"
                for row in outside
            ]
            numbers = listed(told, "and")
            sentences.append(f"{_title(comparison)}: {numbers}.")
        else:
            sentences.append(f"{_title(comparison)}: nothing.")
    sentences += [_on_transition(comparison) for comparison in _own(study) if comparison.gravity]
    shares = [(comparison.row("traction.duration_s"), comparison.row(REEL_OUT_ENERGY)) for comparison in _own(study)]
    sentences.append(
        "What the transition does not reel out is left to the traction: duration of the traction "
        f"{_range(duration.deviation_percent for duration, _ in shares)} % off the published one, energy of both "
        f"phases together {_range(energy.deviation_percent for _, energy in shares)} %."
    )
    return sentences


def _on_transition(comparison: Comparison) -> str:
    row = comparison.row("transition.mean_power_W")
    force = comparison.result.problem.operation.traction.tether_force_N
    speed = comparison.result.channel("reeling_speed_m_s", "transition")
    phase = comparison.result.phases["transition"]
    mean = (phase["tether_length_end_m"] - phase["tether_length_start_m"]) / phase["duration_s"]
    return (
        f"{_title(comparison)}: the published transition power needs at least "
        f"{row.published.value / force:.1f} m/s of reeling on average, at no more than the {force:.0f} N that the "
        f"phase is limited to; the transition as the paper describes it begins at {speed[0] + 0.0:.1f} m/s and ends at "
        f"{speed[-1]:.1f} m/s, {mean:.1f} m/s on average."
    )


def _on_reference(study: PaperValidation) -> list[str]:
    sentences = []
    for case in CASES:
        kite, ground = (study.comparison(case, reference, gravity=True) for reference in ("kite", "ground"))
        means = [_mean_deviation(comparison.published_rows) for comparison in (kite, ground)]
        nearer = "kite" if means[0] < means[1] else "ground"
        sentences.append(
            f"{CASES[case].capitalize()}, gravity included: the eight published numbers are off by {means[0]:.1f} % on "
            f"average with the force held at the kite and by {means[1]:.1f} % with it held at the ground; the "
            f"{nearer} is nearer."
        )
        falls = {}
        for reference in ("kite", "ground"):
            rows = [
                study.comparison(case, reference, gravity=gravity).row(RETRACTION_FORCE) for gravity in (False, True)
            ]
            falls[reference] = rows[0].simulated - rows[1].simulated
            published = rows[0].published.value - rows[1].published.value
            rounding = rows[0].published.half_unit + rows[1].published.half_unit
        likelier = min(falls, key=lambda reference: abs(falls[reference] - published))
        sentences.append(
            f"{CASES[case].capitalize()}: retraction energy per metre falls by {published:.0f} N (at most "
            f"{rounding:.0f} N of it rounding of the table) from gravity excluded to included in the paper, here by "
            f"{falls['kite'] + 0.0:.0f} N with the force held at the kite and {abs(falls['ground']):.0f} N at the "
            f"ground, which speaks for the {likelier}."
        )
    sentences.append("Without gravity the tether has no weight, and both are the same.")
    return sentences


def _on_experiment(study: PaperValidation) -> list[str]:
    sentences = []
    for comparison in _own(study):
        rows = comparison.published_rows
        theirs = [abs(row.published_experiment_percent) for row in rows]
        ours = [abs(row.experiment_percent) for row in rows]
        nearer = sum(map(_nearer, rows))
        cycle = comparison.row("cycle.mean_power_W")
        sentences.append(
            f"{_title(comparison)}: {nearer} of {len(rows)} numbers are nearer to the experiment than the published "
            f"simulation is ({fmean(ours):.0f} % off on average, the published simulation "
            f"{fmean(theirs):.0f} %); the cycle power is {cycle.experiment_percent:+.0f} % off the "
            f"measured one."
        )
    return sentences


def _on_claims(study: PaperValidation) -> list[str]:
    sentences = []
    for reference, claims in study.claims.items():
        failing = [claim for claim in claims if not claim.holds]
        sentences.append(
            f"With the force held at the {reference} {len(claims) - len(failing)} of {len(claims)} hold"
            + ("." if not failing else f"; not that, {_failing(failing)}.")
        )
    return sentences


def _failing(claims: Sequence[Claim]) -> str:
    return "; nor, ".join(f"{CASES[claim.case]}, {claim.text} ({claim.numbers})" for claim in claims)


def _on_scheme(study: PaperValidation) -> list[str]:
    found = study.convergence
    begins = [found.band_time_steps[name] for name in found.curves]
    known = [begin for begin in begins if math.isfinite(begin)]
    distance = max(abs(curve.accurate_ratio / curve.limit_ratio - 1) for curve in found.curves.values())
    orders = sorted(f"{curve.order:.2f}" for curve in found.curves.values())
    order = orders[0] if orders[0] == orders[-1] else f"{orders[0]} to {orders[-1]}"
    steps = found.paper_steps["strong wind, gravity included"]
    sentences = [
        f"It converges with order {order}; extrapolated to a vanishing time step it is "
        f"within {distance:.0e} of the adaptive integrator, an independent method.",
    ]
    if known:
        meets = "as the paper says" if min(known) >= PAPER_BAND_TIME_STEP else "the paper says below"
        sentences.append(
            f"It stays within 3 % of its value at the smallest time step below {min(known):.3f} to {max(known):.3f}, "
            f"by the curve; {meets} {PAPER_BAND_TIME_STEP:g}."
        )
    off = [100 * deviation for deviation in found.paper_deviations.values()]
    sentences.append(
        f"At the paper's time step of {PAPER_TIME_STEP:g} the harvesting factor is {_range(off)} % off, and the strong "
        f"case with gravity takes {steps} steps (the paper says {PAPER_STEPS})."
    )
    for case in CASES:
        row = study.comparison(case, study.reference, gravity=False).row(RETRACTION_FORCE)
        published = row.published
        explains = abs(row.stepped - published.value) <= published.half_unit
        sentences.append(
            f"{CASES[case].capitalize()}, gravity excluded: the published retraction takes {published.value:.0f} N "
            f"(+/- {published.half_unit:.0f} N) per metre, but {row.simulated:.0f} N are held; the scheme at that time "
            f"step takes {row.stepped:.0f} N, which "
            f"{'agrees with it' if explains else 'does not explain it'}."
        )
    return sentences


def _on_publication(study: PaperValidation) -> list[str]:
    checks, tables = study.printed_checks, study.table_checks
    agreeing = sum(check.agrees for check in checks)
    consistent = sum(check.agrees for check in tables)
    sentences = [
        f"{agreeing} of {len(checks)} printed results of the inputs (altitude and wind of the traction, resultant "
        "coefficients) follow from the inputs used here.",
        f"In {consistent} of {len(tables)} published columns the phases add up to the cycle but for rounding.",
    ]
    for effect in study.errata:
        erratum = effect.erratum
        sentences.append(
            f"{CASES[erratum.case].capitalize()}, {erratum.what}: {erratum.paper}, used here {erratum.used}: "
            f"{erratum.why}. The other reading would change the retraction duration by "
            f"{effect.change_percent('retraction.duration_s') + 0.0:+.1f} % and the cycle power by "
            f"{effect.change_percent('cycle.mean_power_W'):+.1f} %."
        )
    return sentences


def _own(study: PaperValidation) -> list[Comparison]:
    """Return the comparisons with the force held where the problem files say."""
    return [study.comparison(case, study.reference, gravity=gravity) for case in CASES for gravity in (False, True)]


def _nearer(row: Row) -> bool:
    """Whether a number is nearer to the experiment than the published simulation."""
    return abs(row.experiment_percent) < abs(row.published_experiment_percent)


def _title(comparison: Comparison) -> str:
    gravity = "included" if comparison.gravity else "excluded"
    return f"{CASES[comparison.case].capitalize()}, gravity {gravity}"


def _mean_deviation(rows: Sequence[Row]) -> float:
    return fmean(abs(row.deviation_percent) for row in rows)


def _range(numbers: Iterable[float]) -> str:
    known = sorted(numbers)
    return f"{known[0]:+.1f} to {known[-1]:+.1f}"
