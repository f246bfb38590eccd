"""The table of a crosswind-resolved traction: the figure, its averages, and the representative course."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from kiteocp.report.document import Document, Lines, Part
from kiteocp.report.table import Column, Table
from kiteocp.result import Result

#: Title, channel, key of the average, key of the representative state, factor to the unit of the title, digits.
_ROWS: tuple[tuple[str, str, str, str, float, str], ...] = (
    ("power (kW)", "power_W", "mean_power_W", "power_W", 1e-3, ".2f"),
    ("reeling speed (m/s)", "reeling_speed_m_s", "mean_reeling_speed_m_s", "reeling_speed_m_s", 1.0, ".2f"),
    ("force at the kite (kN)", "tether_force_kite_N", "mean_tether_force_kite_N", "tether_force_kite_N", 1e-3, ".3f"),
    (
        "force at the ground (kN)",
        "tether_force_ground_N",
        "mean_tether_force_ground_N",
        "tether_force_ground_N",
        1e-3,
        ".3f",
    ),
    ("path speed (m/s)", "tangential_speed_m_s", "mean_path_speed_m_s", "path_speed_m_s", 1.0, ".1f"),
    ("kinematic ratio", "kinematic_ratio", "mean_kinematic_ratio", "kinematic_ratio", 1.0, ".2f"),
    ("wind speed (m/s)", "wind_speed_m_s", "mean_wind_speed_m_s", "wind_speed_m_s", 1.0, ".2f"),
)
NAMES: dict[str, str] = {
    "eight-up": "figure of eight, up at its sides",
    "eight-down": "figure of eight, down at its sides",
    "circle": "circle",
}


def crosswind_document(result: Result) -> Document:
    """Return what a result of verb ``crosswind`` says."""
    title = f"{result.problem.name}: {result.problem.description}".removesuffix(": ")
    status = f"crosswind: {result.status}"
    if "crosswind" not in result.details:
        return Document(title, [Lines([f"{status} - {result.details.get('message', '')}".rstrip(" -")], joined=True)])
    study = result.details["crosswind"]
    comparison = study["comparison"]
    share = 100.0 * (1.0 - comparison["resolved_power_W"] / comparison["resolved_weightless_power_W"])
    lost = f" ({share:.1f} %)" if math.isfinite(share) else ""
    ratio = f"{comparison['power_ratio']:.3f}" if math.isfinite(comparison["power_ratio"]) else "no such state"
    figure = [
        _describe(study),
        f"one figure: {study['period_s']:.1f} s, {study['path_length_m']:.0f} m, smallest turning radius "
        f"{study['turning_radius_min_m']:.0f} m ({study['turning_radius_over_root_of_area']:.1f} times the root of the "
        f"kite's area), turn rate up to {study['turn_rate_max_deg_s']:.0f} deg/s",
    ]
    place = (
        f"representative: {comparison['elevation_deg']:.1f} deg elevation, {comparison['azimuth_deg']:.1f} deg azimuth "
        f"(averaged cosines), course {comparison['problem_course_deg']:.1f} deg"
    )
    found = [
        f"mean power of the figure over that of the representative state: {ratio}",
        f"representative course with the power of the figure: {_course(comparison, '')}",
        f"representative course with its loss to gravity{lost}: {_course(comparison, 'gravity_')}",
        f"mean course of the figure (mean cosine over time): {comparison['mean_course_deg']:.1f} deg",
        _length_line(study),
    ]
    return Document(
        title,
        [
            Lines([status], joined=True),
            Lines(figure),
            _numbers(result, study),
            Lines([place], joined=True),
            Lines(found),
            *_sweep("tether (m)", "tether_length_m", {study["path"]: study["lengths"]}),
            *_sweep("kite (kg)", "mass_kg", study["masses"]),
        ],
    )


def _numbers(result: Result, study: dict[str, Any]) -> Table:
    """Return the quantities of the figure beside those of the representative state."""
    heads = ("figure", "least", "largest", "representative")
    rows = []
    for title, channel, average, key, factor, digits in _ROWS:
        values = result[channel]
        numbers = (study[average], np.min(values), np.max(values), study["representative"][key])
        rows.append((title, *(Column(factor=factor, digits=digits).text(float(number)) for number in numbers)))
    return Table([Column(left=True), *map(Column, heads)], rows)


def _describe(study: dict[str, Any]) -> str:
    centre, up = study["centre_elevation_deg"], study["elevation_amplitude_deg"]
    if study["path"] == "circle":
        size = f"angular radius {up:.1f} deg about {centre:.1f} deg of elevation"
    else:
        size = f"azimuth +-{study['azimuth_amplitude_deg']:.1f} deg, elevation {centre:.1f} +-{up:.1f} deg"
    value = study["control_value"]
    if study["control"] == "reeling_speed":
        held = f"{value:g} m/s of reeling speed"
    else:
        held = f"{value:g} N at the {study['control'].removeprefix('tether_force_')}"
    weight = "" if study["gravity"] else ", without weight"
    return f"{NAMES[study['path']]}: {size}, {study['tether_length_m']:g} m of tether, {held}{weight}"


def _course(comparison: dict[str, Any], prefix: str) -> str:
    course, note = comparison[f"{prefix}course_deg"], comparison[f"{prefix}note"]
    if course is None:
        return str(note)
    return f"{course:.1f} deg" + (f" ({note})" if note else "")


def _length_line(study: dict[str, Any]) -> str:
    effect = study["relative_effect_of_length_change"]
    told = "" if effect is None else f"; reeling along changes the mean power by {100.0 * effect:+.2f} %"
    return f"the tether is held at its mean; in one figure it reels {study['tether_length_change_m']:+.0f} m{told}"


def _sweep(what: str, key: str, sweep: dict[str, list[dict[str, Any]]]) -> Iterator[Part]:
    """Yield the course of equal power over a quantity, every second column where there are many."""
    longest = max(sweep.values(), key=len)
    step = 2 if len(longest) > 9 else 1
    courses = {name: [row.get("course_deg") for row in rows[::step]] for name, rows in sweep.items()}
    heavy = {name: ["message" in row for row in rows[::step]] for name, rows in sweep.items()}
    columns = [Column(f"course (deg) over {what}", left=True)]
    columns += [Column(f"{row[key]:.4g}", digits=".1f", missing="-") for row in longest[::step]]
    rows = [
        (
            f"  {name}",
            *("heavy" if one and course is None else course for one, course in zip(heavy[name], found, strict=True)),
            *[""] * (len(columns) - 1 - len(found)),
        )
        for name, found in courses.items()
    ]
    yield Table(columns, rows)
    notes = []
    if any(cell is None for row in rows for cell in row):
        notes.append("  -: no course gives the power of the figure")
    if any("heavy" in row for row in rows):
        notes.append("  heavy: the figure cannot be flown")
    yield Lines(notes, joined=True)
