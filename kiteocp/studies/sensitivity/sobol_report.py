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
from kiteocp.studies.sensitivity.open_loop import KeptCycle
from kiteocp.studies.sensitivity.sampling import USUAL_DEVIATION, Sample

#: Quantiles that are told, in percent.
QUANTILES = (5, 50, 95)

#: Bars of the histogram at most; fewer where there are few samples, the square root of their number.
MOST_BINS = 24

#: Every status a sample and a kept schedule can have, so that zeros are told too.
STATUSES = ("solved", "infeasible", "failed", "invalid")
KEPT_STATUSES = ("flown", "not_flown", "not_closed")

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
    nominal_kept: KeptCycle | None,
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
    nominal_kept
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
        "reoptimising": _reoptimising(independent, nominal_kept),
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


def _reoptimising(samples: Sequence[Sample], nominal: KeptCycle | None) -> dict[str, Any]:
    """Compare the kept schedule with the re-solved optimum, on the samples that have both."""
    kept = [sample.kept for sample in samples if sample.kept is not None]
    pairs = [
        (sample.mean_power_W, sample.kept.mean_power_W, bool(sample.kept.exceeded))
        for sample in samples
        if sample.kept is not None and sample.kept.mean_power_W is not None and sample.mean_power_W is not None
    ]
    return {
        "kept_status": _counted((cycle.status for cycle in kept), KEPT_STATUSES),
        "kept_exceeds_a_limit": sum(bool(cycle.exceeded) for cycle in kept),
        "exceeded_limits": dict(Counter(key for cycle in kept for key in cycle.exceeded).most_common()),
        "nominal_kept_mean_power_W": None if nominal is None else nominal.mean_power_W,
        "within_limits": _value([pair[:2] for pair in pairs if not pair[2]]),
        "all_flown": _value([pair[:2] for pair in pairs]),
    }


def _value(pairs: Sequence[tuple[float, float]]) -> dict[str, Any]:
    names = ["reoptimised_mean_W", "kept_mean_W", "value_mean_W", *(f"value_quantile_{q}_W" for q in QUANTILES)]
    if not pairs:
        return {"samples": 0, **dict.fromkeys(names)}
    solved, kept = np.array(pairs).T
    numbers = [solved.mean(), kept.mean(), (solved - kept).mean(), *np.percentile(solved - kept, QUANTILES)]
    return {"samples": len(pairs), **{name: float(number) for name, number in zip(names, numbers, strict=True)}}


def format_global(summary: Mapping[str, Any]) -> str:
    """Return the table of ``details["global"]``."""
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
    lines += ["", *_index_table(summary), "", *_value_lines(summary["reoptimising"])]
    return "\n".join(lines)


def _index_table(summary: Mapping[str, Any]) -> list[str]:
    rows = sorted(summary["indices"], key=lambda row: -(row["total_order"] or 0.0))
    deviations = {row["key"]: row["standard_deviation"] for row in summary["uncertainties"]}
    width = max(len(row["key"]) for row in rows)
    confidence = f"{100 * summary['confidence']:g} %"
    lines = [f"{'key':<{width}}  {'sd':>9}  {'first order':>11}  {confidence:>15}  {'total':>6}  {confidence:>15}"]
    for row in rows:
        cells = [f"{row['key']:<{width}}", f"{deviations[row['key']]:>9.4g}"]
        for name, space in (("first_order", 11), ("total_order", 6)):
            if row[name] is None:
                cells += [f"{'-':>{space}}", f"{'-':>15}"]
            else:
                interval = f"{row[f'{name}_from']:.3f} .. {row[f'{name}_to']:.3f}"
                cells += [f"{row[name]:>{space}.3f}", f"{interval:>15}"]
        lines.append("  ".join(cells))
    return lines


def _value_lines(facts: Mapping[str, Any]) -> list[str]:
    status = facts["kept_status"]
    lines = [
        "value of re-optimising against keeping the nominal schedule (phases stretched to end where they did):",
        f"  kept schedule: {status['flown']} of {sum(status.values())} flown, of which {facts['kept_exceeds_a_limit']} "
        f"exceed a limit; {status['not_flown']} cannot be flown, {status['not_closed']} do not close",
    ]
    for name, words in (("within_limits", "flown within all limits"), ("all_flown", "all flown")):
        value = facts[name]
        if value["samples"]:
            lines.append(
                f"  {words} ({value['samples']}): re-optimised {value['reoptimised_mean_W']:.0f} W, kept "
                f"{value['kept_mean_W']:.0f} W; value {value['value_mean_W']:.0f} W on average "
                f"(5 %: {value['value_quantile_5_W']:.0f} W, 95 %: {value['value_quantile_95_W']:.0f} W)"
            )
    return lines
