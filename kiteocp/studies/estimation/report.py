"""The estimates in words: wind, table by phase and way, the fit, and the bias of the paper's formulas."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from kiteocp.report.document import Document, Lines
from kiteocp.report.table import Cell, Column, Table
from kiteocp.result import Result
from kiteocp.studies.estimation.bias import COMPARED
from kiteocp.studies.estimation.fit import PART_POWERED, SETTING_OF_PHASE
from kiteocp.studies.estimation.inversion import COEFFICIENTS, REASONS

#: Headings of `COEFFICIENTS`.
HEADINGS = ("C_R", "L/D", "C_L", "C_D,k", "L/D_k")

#: Why a sample was not used, beside `REASONS`.
OTHER_REASONS = {
    "outlier": "a coefficient far off the others of its phase",
    PART_POWERED: "a powered phase, but the kite not yet fully powered",
}

#: What is not known of the wind, in words.
_UNKNOWNS = {"profile": "profile", "sensor_height": "height of the sensor", "airspeed_gauge": "gauge of the airspeed"}


def estimates_document(result: Result) -> Document:
    """Return what a result of the verb ``estimate`` says."""
    found = result.details["estimates"]
    cycles = ", ".join(map(str, found["cycles"])) or "not numbered"
    reading = f"{found['samples']} samples, cycles {cycles}{_reading(found['repaired_or_dropped_in_reading'])}"
    legend = [
        "mean and half width of its 95 % interval (phases: the wind as given; fit: the error of the wind included)",
        "n_eff: independent samples that C_L is worth",
        "paper: sections 3.3 and 3.4; exact: the model's own equilibrium; fit: all samples at once, robust",
    ]
    notes = [*_bias(found["round_trip"], result.problem.name), *(f"note: {text}" for text in found["notes"])]
    return Document(
        f"{found['flight']}: aerodynamics of {result.problem.name}",
        [
            Lines([reading], joined=True),
            Lines(_wind(found)),
            Lines(legend),
            _table(found),
            Lines(_wind_effect(found), joined=True),
            Lines(_rejections(found)),
            Lines([*notes, *(f"warning: {text}" for text in result.warnings)]),
        ],
    )


def _reading(counts: Mapping[str, int]) -> str:
    parts = [f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count]
    return f" (in reading: {', '.join(parts)})" if parts else ""


def _wind(found: Mapping[str, Any]) -> list[str]:
    wind, fit = found["wind"], found["fit_with_wind"]
    speed, height, scale = wind["reference_speed_m_s"], wind["reference_height_m"], wind["scale"]
    text = f"wind by {wind['source']}: {speed:.2f} m/s at {height:g} m"
    if wind["scale_total_interval"]:
        low, high = (end / scale * speed for end in wind["scale_total_interval"])
        text += f" (95 %: {low:.2f} to {high:.2f})"
    text += f", {scale:.3f} of the problem's, towards an azimuth of {wind['direction_offset_deg']:+.1f} deg"
    if wind["direction_interval_deg"]:
        low, high = wind["direction_interval_deg"]
        text += f" ({low:+.1f} to {high:+.1f})"
    lines = [text]
    if wind["systematic_shares"]:
        low, high = (end / scale * speed for end in wind["scale_interval"])
        parts = [f"{_UNKNOWNS[name]} {100 * share:.2g} %" for name, share in wind["systematic_shares"].items()]
        lines.append(f"  by the scatter of the samples alone {low:.2f} to {high:.2f}; not known: {', '.join(parts)}")
    if wind["airspeed_gain"] is not None:
        error = wind["airspeed_gain_standard_error"]
        lines.append(f"  the airspeed sensor shows {wind['airspeed_gain']:.3f} +- {error:.3f} of the airspeed")
    if len(found["wind_by_cycle"]) > 1:
        speeds = ", ".join(f"{cycle}: {of['reference_speed_m_s']:.1f}" for cycle, of in found["wind_by_cycle"].items())
        lines.append(f"  by cycle (m/s): {speeds}")
    factor = fit["wind_scale"]
    low, high = (end * speed if wind["source"] != "fit" else end for end in factor["interval"])
    correlations = fit["correlation_of_wind_scale"]
    strongest = max((name for name in correlations if "lift" in name), key=lambda name: abs(correlations[name]))
    of = f"correlation with {strongest} {correlations[strongest]:+.2f}, condition {fit['condition']:.1f}"
    if wind["source"] == "fit":
        lines.append(f"  {of}")
    elif fit["wind_identified"]:
        lines.append(
            f"  by the equilibrium alone: {factor['value'] * speed:.2f} m/s (95 %: {low:.2f} to {high:.2f}; {of})"
        )
    else:
        lines.append(f"  the equilibrium alone does not tell the wind from the coefficients ({of})")
    return lines


def _table(found: Mapping[str, Any]) -> Table:
    words = [Column(left=True, once=True), Column(left=True)]
    columns = [*words, *map(Column, HEADINGS), Column("n_eff", digits=".0f"), Column("used")]
    rows: list[list[Cell]] = []
    for phase, ways in found["phases"].items():
        for way, estimate in ways.items():
            cells = [_measured(estimate[name]["mean"], estimate[name]["interval"]) for name in COEFFICIENTS]
            effective = estimate["lift_coefficient"]["effective_samples"]
            rows.append([phase, way, *cells, effective, f"{estimate['used']} of {estimate['samples']}"])
    rules = {0, len(rows)}
    for setting, estimate in found["fit"]["settings"].items():
        fitted = (estimate[name] for name in ("lift_coefficient", "drag_coefficient", "lift_to_drag"))
        cells = [_measured(one["value"], one["interval_with_wind_error"]) for one in fitted]
        used, samples = estimate["samples"] - estimate["outliers"], estimate["samples"]
        told = f"{used} of {samples + sum(estimate['rejected'].values())}"
        rows.append([setting, "fit", "", "", *cells, estimate["lift_coefficient"]["effective_samples"], told])
    return Table(columns, rows, rules)


def _measured(mean: float | None, interval: Sequence[float | None]) -> str:
    if mean is None or interval[0] is None or interval[1] is None or math.isnan(mean):
        return "-"
    return f"{mean:.3f} +-{0.5 * (interval[1] - interval[0]):.3f}"


def _wind_effect(found: Mapping[str, Any]) -> list[str]:
    if not found["wind_effect"]:
        return []
    share = 100.0 * found["wind"]["scale_total_standard_error"] / found["wind"]["scale"]
    changes: dict[str, list[str]] = {}
    for name, change in found["wind_effect"].items():
        setting, _, coefficient = name.partition(".")
        changes.setdefault(setting, []).append(f"{'C_L' if 'lift' in coefficient else 'C_D,k'} {change:+.3f}")
    told = "; ".join(f"{setting} {', '.join(parts)}" for setting, parts in changes.items())
    return [f"within the intervals of the fit: {share:.1f} % more wind (its standard error) changes {told}"]


def _rejections(found: Mapping[str, Any]) -> list[str]:
    """Return a line for each phase, way or setting of which samples were not used, and what the reasons mean."""
    parts: dict[str, Mapping[str, int]] = {
        f"{phase}, {way}": estimate["rejected"]
        for phase, ways in found["phases"].items()
        for way, estimate in ways.items()
    }
    for setting, estimate in found["fit"]["settings"].items():
        phases = " and ".join(phase for phase, of in SETTING_OF_PHASE.items() if of == setting)
        without_weight = {"without_weight": estimate["outliers"]} if estimate["outliers"] else {}
        parts[f"{setting} ({phases}), fit"] = {**estimate["rejected"], **without_weight}
    told = {name: counts for name, counts in parts.items() if counts}
    if not told:
        return ["every sample was used"]
    width = max(map(len, told))
    lines = ["not used:"]
    for name, counts in told.items():
        lines.append(f"  {name.ljust(width)}  {', '.join(f'{count} {reason}' for reason, count in counts.items())}")
    met = {reason for counts in told.values() for reason in counts}
    meanings = {**REASONS, **OTHER_REASONS}
    lines += [f"  {reason}: {meaning}" for reason, meaning in meanings.items() if reason in met]
    return lines


def _bias(trip: Mapping[str, Any] | None, name: str) -> list[str]:
    if trip is None:
        return []
    lines = [f"bias of the paper's formulas for {name}, from a simulated cycle of the estimated kite without noise:"]
    for phase, biases in trip["paper_relative_bias"].items():
        shown = [
            f"{heading} {100.0 * biases[key]:+.1f} %"
            for key, heading in zip(COMPARED, ("C_L", "C_D,k", "L/D_k"), strict=True)
        ]
        lines.append(f"  {phase.ljust(10)}  {', '.join(shown)}")
    error = trip["exact_largest_relative_error"]
    lines.append(f"  the exact inversion gives all of them back within {max(error, 1e-15):.0e}")
    return lines
