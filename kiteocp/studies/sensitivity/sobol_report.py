"""The global sensitivity in plain values and in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.problem.uncertainty import Uncertainty
from kiteocp.report.document import Lines, Part
from kiteocp.report.table import Cell, Column, Table
from kiteocp.studies.sensitivity.open_loop import OpenLoopCycle
from kiteocp.studies.sensitivity.sampling import USUAL_DEVIATION, Sample

#: Quantiles that are told, in percent.
QUANTILES = (5, 50, 95)

#: Bars of the histogram at most; fewer where there are few samples, the square root of their number.
MOST_BINS = 24

#: Every status a sample and a open-loop schedule can have, so that zeros are told too.
STATUSES = ("solved", "infeasible", "failed", "invalid")
OPEN_LOOP_STATUSES = ("flown", "not_flown", "not_closed")

NO_UNCERTAINTY = (
    "the problem file states no uncertainty: a relative standard deviation of "
    f"{100 * USUAL_DEVIATION:g} % of each key listed was assumed"
)


def global_summary(
    problem: Problem,
    given: Mapping[str, Uncertainty],
    stated: bool,
    samples: Sequence[Sample],
    bases: int,
    indices: Sequence[Mapping[str, float]],
    nominal_open_loop: OpenLoopCycle | None,
) -> dict[str, Any]:
    """Return what the samples say.

    Parameters
    ----------
    problem, given, stated
        The problem, its uncertain keys, and whether it states them.
    samples
        At A, at B, and at the mixed points, ``bases`` each.
    bases
        Number of base samples.
    indices
        For each key, of `kiteocp.studies.sensitivity.sobol.sobol_intervals`.
    nominal_open_loop
        The nominal schedule flown on the nominal numbers.
    """
    values = parameter_values(problem)
    independent = samples[: 2 * bases]
    powers = [sample.mean_power_W for sample in independent if sample.mean_power_W is not None]
    columns = np.array([sample.mean_power_W is not None for sample in samples]).reshape(-1, bases)
    cold = [sample.cold_better for sample in samples if sample.cold_better is not None]
    return {
        "uncertainty_stated": stated,
        "note": None if stated else NO_UNCERTAINTY,
        "uncertainties": [_uncertainty(key, values[key], entry) for key, entry in given.items()],
        "samples": len(samples),
        "sample_status": _counted((sample.status for sample in samples), STATUSES),
        "base_samples": bases,
        "base_samples_complete": int(columns.all(axis=0).sum()),
        "solved_from_all_starts_too": len(cold),
        "better_from_all_starts": sum(cold),
        "distribution": {"samples": len(independent), **_distribution(powers)},
        "histogram": _histogram(powers),
        "indices": [
            {"key": key, **{name: _finite(number) for name, number in row.items()}}
            for key, row in zip(given, indices, strict=True)
        ],
        "reoptimising": _reoptimising(independent, nominal_open_loop),
    }


def _uncertainty(key: str, value: float, entry: Uncertainty) -> dict[str, Any]:
    uniform = isinstance(entry.range, tuple)
    low, high = entry.bounds(value)
    return {
        "key": key,
        "value": value,
        "distribution": "uniform" if uniform else "normal, cut off at the values a problem file may have",
        "standard_deviation": entry.deviation(value),
        "from": low if uniform else None,
        "to": high if uniform else None,
    }


def _counted(words: Any, known: Sequence[str]) -> dict[str, int]:
    counts = Counter(words)
    return {word: counts[word] for word in known}


def _distribution(powers: Sequence[float]) -> dict[str, Any]:
    names = ["mean_W", "standard_deviation_W", *(f"quantile_{q}_W" for q in QUANTILES)]
    if len(powers) < 2:
        return {"solved": len(powers), **dict.fromkeys(names)}
    numbers = [np.mean(powers), np.std(powers, ddof=1), *np.percentile(powers, QUANTILES)]
    return {"solved": len(powers), **{name: float(number) for name, number in zip(names, numbers, strict=True)}}


def _histogram(powers: Sequence[float]) -> dict[str, list[float]]:
    if not powers:
        return {"edges_W": [], "counts": []}
    counts, edges = np.histogram(powers, bins=min(math.ceil(math.sqrt(len(powers))), MOST_BINS))
    return {"edges_W": [float(edge) for edge in edges], "counts": [int(count) for count in counts]}


def _finite(number: float) -> float | None:
    return number if np.isfinite(number) else None


def _reoptimising(samples: Sequence[Sample], nominal: OpenLoopCycle | None) -> dict[str, Any]:
    """Compare the open-loop schedule with the re-solved optimum, on the samples that have both."""
    flown = [sample.open_loop for sample in samples if sample.open_loop is not None]
    pairs = [
        (sample.mean_power_W, sample.open_loop.mean_power_W, bool(sample.open_loop.exceeded))
        for sample in samples
        if sample.open_loop is not None
        and sample.open_loop.mean_power_W is not None
        and sample.mean_power_W is not None
    ]
    return {
        "open_loop_status": _counted((cycle.status for cycle in flown), OPEN_LOOP_STATUSES),
        "open_loop_exceeds_a_limit": sum(bool(cycle.exceeded) for cycle in flown),
        "exceeded_limits": dict(Counter(key for cycle in flown for key in cycle.exceeded).most_common()),
        "nominal_open_loop_mean_power_W": None if nominal is None else nominal.mean_power_W,
        "within_limits": _value([pair[:2] for pair in pairs if not pair[2]]),
        "all_flown": _value([pair[:2] for pair in pairs]),
    }


def _value(pairs: Sequence[tuple[float, float]]) -> dict[str, Any]:
    names = ["reoptimised_mean_W", "open_loop_mean_W", "value_mean_W", *(f"value_quantile_{q}_W" for q in QUANTILES)]
    if not pairs:
        return {"samples": 0, **dict.fromkeys(names)}
    solved, flown = np.array(pairs).T
    numbers = [solved.mean(), flown.mean(), (solved - flown).mean(), *np.percentile(solved - flown, QUANTILES)]
    return {"samples": len(pairs), **{name: float(number) for name, number in zip(names, numbers, strict=True)}}


def global_parts(summary: Mapping[str, Any]) -> list[Part]:
    """Return what ``details["global"]`` says."""
    spread, lines = summary["distribution"], ["global sensitivity of the optimal mean power:"]
    if summary["note"]:
        lines.append(f"  {summary['note']}")
    if summary["nominal_message"]:
        lines.append(
            f"  warning: on the mesh of the file {summary['nominal_message']}; refine optimisation.mesh before "
            "trusting the value of re-optimising"
        )
    missing = {word: count for word, count in summary["sample_status"].items() if count and word != "solved"}
    lines.append(
        f"  {summary['sample_status']['solved']} of {summary['samples']} samples solved"
        + "".join(f", {count} {word}" for word, count in missing.items())
        + f" ({summary['time_s']:.0f} s); {summary['base_samples_complete']} of {summary['base_samples']} base samples "
        "are complete and serve the indices"
    )
    lines.append(
        f"  of {summary['solved_from_all_starts_too']} samples solved from all starts too, "
        f"{summary['better_from_all_starts']} came out better than warm"
    )
    if spread["mean_W"] is not None:
        told = ", ".join(f"{q} %: {spread[f'quantile_{q}_W']:.0f}" for q in QUANTILES)
        lines.append(
            f"  mean {spread['mean_W']:.0f} W (nominal {summary['nominal_mean_power_W']:.0f} W), "
            f"standard deviation {spread['standard_deviation_W']:.0f} W; quantiles in W: {told}"
        )
    return [Lines(lines), _index_table(summary), Lines(_value_lines(summary["reoptimising"]))]


def _index_table(summary: Mapping[str, Any]) -> Table:
    deviations = {row["key"]: row["standard_deviation"] for row in summary["uncertainties"]}
    interval = f"{100 * summary['confidence']:g} %"
    columns = [Column("key", left=True), Column("sd", digits=".4g")]
    for title in ("first order", "total"):
        columns += [Column(title, digits=".3f", missing="-"), Column(interval)]
    rows: list[list[Cell]] = []
    for row in sorted(summary["indices"], key=lambda row: -(row["total_order"] or 0.0)):
        cells: list[Cell] = [row["key"], deviations[row["key"]]]
        for name in ("first_order", "total_order"):
            ends = "-" if row[name] is None else f"{row[f'{name}_from']:.3f} .. {row[f'{name}_to']:.3f}"
            cells += [row[name], ends]
        rows.append(cells)
    return Table(columns, rows)


def _value_lines(facts: Mapping[str, Any]) -> list[str]:
    status = facts["open_loop_status"]
    lines = [
        "value of re-optimising over flying the nominal schedule open loop (phases stretched to end where they did):",
        f"  open-loop schedule: {status['flown']} of {sum(status.values())} flown, of which "
        f"{facts['open_loop_exceeds_a_limit']} exceed a limit; "
        f"{status['not_flown']} cannot be flown, {status['not_closed']} do not close",
    ]
    for name, words in (("within_limits", "flown within all limits"), ("all_flown", "all flown")):
        value = facts[name]
        if value["samples"]:
            lines.append(
                f"  {words} ({value['samples']}): re-optimised {value['reoptimised_mean_W']:.0f} W, open loop "
                f"{value['open_loop_mean_W']:.0f} W; value {value['value_mean_W']:.0f} W on average "
                f"(5 %: {value['value_quantile_5_W']:.0f} W, 95 %: {value['value_quantile_95_W']:.0f} W)"
            )
    return lines
