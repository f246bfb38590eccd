"""The table of a crosswind-resolved traction: the figure, its averages, and the representative course."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kiteocp.result import Result

#: Title, channel, key of the average, key of the representative state, factor to the unit of the title, decimals.
_ROWS: tuple[tuple[str, str, str, str, float, int], ...] = (
    ("power (kW)", "power_W", "mean_power_W", "power_W", 1e-3, 2),
    ("reeling speed (m/s)", "reeling_speed_m_s", "mean_reeling_speed_m_s", "reeling_speed_m_s", 1.0, 2),
    ("force at the kite (kN)", "tether_force_kite_N", "mean_tether_force_kite_N", "tether_force_kite_N", 1e-3, 3),
    (
        "force at the ground (kN)",
        "tether_force_ground_N",
        "mean_tether_force_ground_N",
        "tether_force_ground_N",
        1e-3,
        3,
    ),
    ("path speed (m/s)", "tangential_speed_m_s", "mean_path_speed_m_s", "path_speed_m_s", 1.0, 1),
    ("kinematic ratio", "kinematic_ratio", "mean_kinematic_ratio", "kinematic_ratio", 1.0, 2),
    ("wind speed (m/s)", "wind_speed_m_s", "mean_wind_speed_m_s", "wind_speed_m_s", 1.0, 2),
)
NAMES: dict[str, str] = {
    "eight-up": "figure of eight, up at its sides",
    "eight-down": "figure of eight, down at its sides",
    "circle": "circle",
}


def format_crosswind(result: Result) -> str:
    """Return the table of a result of verb ``crosswind``."""
    if "crosswind" not in result.details:
        return f"{_head(result)} - {result.details.get('message', '')}"
    study = result.details["crosswind"]
    comparison = study["comparison"]
    lines = [
        _head(result),
        "",
        _describe(study),
        f"one figure: {study['period_s']:.1f} s, {study['path_length_m']:.0f} m, smallest turning radius "
        f"{study['turning_radius_min_m']:.0f} m ({study['turning_radius_over_root_of_area']:.1f} times the root of the "
        f"kite's area), turn rate up to {study['turn_rate_max_deg_s']:.0f} deg/s",
        "",
        f"{'':26}{'figure':>9}{'least':>9}{'largest':>9}{'representative':>16}",
    ]
    for title, channel, average, key, factor, decimals in _ROWS:
        values = factor * result[channel]
        numbers = (factor * study[average], float(np.min(values)), float(np.max(values)))
        lines.append(
            title.ljust(26)
            + "".join(f"{number:9.{decimals}f}" for number in numbers)
            + f"{factor * study['representative'][key]:16.{decimals}f}"
        )
    share = 100.0 * (1.0 - comparison["resolved_power_W"] / comparison["resolved_weightless_power_W"])
    lost = f" ({share:.1f} %)" if math.isfinite(share) else ""
    ratio = f"{comparison['power_ratio']:.3f}" if math.isfinite(comparison["power_ratio"]) else "no such state"
    lines += [
        f"representative: {comparison['elevation_deg']:.1f} deg elevation, {comparison['azimuth_deg']:.1f} deg azimuth "
        f"(averaged cosines), course {comparison['problem_course_deg']:.1f} deg",
        "",
        f"mean power of the figure over that of the representative state: {ratio}",
        f"representative course with the power of the figure: {_course(comparison, '')}",
        f"representative course with its loss to gravity{lost}: {_course(comparison, 'gravity_')}",
        f"mean course of the figure (mean cosine over time): {comparison['mean_course_deg']:.1f} deg",
        _length_line(study),
        "",
        *_sweep_lines("tether (m)", "tether_length_m", {study["path"]: study["lengths"]}),
        "",
        *_sweep_lines("kite (kg)", "mass_kg", study["masses"]),
    ]
    return "\n".join(lines)


def _head(result: Result) -> str:
    described = f": {result.problem.description}" if result.problem.description else ""
    return f"{result.problem.name}{described}\ncrosswind: {result.status}"


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


def _sweep_lines(what: str, key: str, sweep: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Return the course of equal power over a quantity, every second column where there are many."""
    longest = max(sweep.values(), key=len)
    step = 2 if len(longest) > 9 else 1
    lines = [f"course (deg) over {what}".ljust(28) + "".join(f"{row[key]:8.4g}" for row in longest[::step])]
    for name, rows in sweep.items():
        cells = []
        for row in rows[::step]:
            course = row.get("course_deg")
            cells.append(f"{course:8.1f}" if course is not None else f"{'heavy' if 'message' in row else '-':>8}")
        lines.append(f"  {name}".ljust(28) + "".join(cells))
    if any("-" in line.split()[1:] for line in lines[1:]):
        lines.append("  -: no course gives the power of the figure")
    if any("heavy" in line for line in lines[1:]):
        lines.append("  heavy: the figure cannot be flown")
    return lines
