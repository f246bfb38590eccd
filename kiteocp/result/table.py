"""The table a person reads: phases as rows, an optimum beside the prescribed cycle of the same problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from kiteocp.report.document import Document, Lines, Part
from kiteocp.report.table import Cell, Column, Table
from kiteocp.result.channels import DIMENSIONLESS, MEAN_POWERS, unit_of

if TYPE_CHECKING:
    from kiteocp.result.container import Result

#: The energy that belongs to a mean power.
ENERGIES = {"mean_power_W": "energy_J", "mean_electrical_power_W": "electrical_energy_J"}
#: Share of the time of a phase from which on a limit holds, not just touches.
LASTING_SHARE = 0.005


def result_document(result: Result) -> Document:
    """Return what a result says to a person, of any verb and status: plain ASCII beside what the problem file holds."""
    title = result.problem.name
    description = getattr(result.problem, "description", None)
    status = f"{result.verb}: {result.status}"
    if message := result.details.get("message"):
        status += f" - {message}"
    parts: list[Part] = [Lines([status], joined=True)]
    if result.phases or (result.prescribed is not None and result.prescribed.phases):
        parts += [_cycles(result), Lines(_format_facts(result))]
    notes = _format_active_limits(result.details.get("active_limits") or {})
    if solver := result.details.get("solver"):
        notes.append(f"solver: {_format_solver(solver, result.details.get('meshes') or [])}")
    notes += _format_certificate(result.details.get("certificate") or {})
    notes += [f"warning: {text}" for text in result.warnings]
    return Document(f"{title}: {description}" if description else title, [*parts, Lines(notes, joined=True)])


def _cycles(result: Result) -> Table:
    """Return the table proper: a block of rows for each phase, one row for each cycle compared."""
    cycles = {"": result}
    if result.prescribed is not None:
        cycles = {"optimal": result, "prescribed": result.prescribed}
    power, title = mean_power_of(result)
    columns = (
        Column(left=True, once=True),
        Column(left=True),
        Column("duration", "s", digits="z.1f"),
        Column(title, "kW", 1e-3, "z.2f"),
        Column("energy", "kJ", 1e-3, "z.1f"),
        Column("tether length", "m"),
        Column("elevation", "deg"),
    )

    def row(name: str, label: str, values: Mapping[str, float | None]) -> tuple[Cell, ...]:
        ranges = (
            _range(*(values.get(f"{quantity}_{end}_{unit}") for end in ("start", "end")))
            for quantity, unit in (("tether_length", "m"), ("elevation", "deg"))
        )
        return name, label, values.get("duration_s"), values.get(power), values.get(ENERGIES[power]), *ranges

    names = dict.fromkeys(name for cycle in cycles.values() for name in cycle.phases)
    rows = [row(name, label, cycle.phases.get(name, {})) for name in names for label, cycle in cycles.items()]
    if any(cycle.cycle.get("phase_change_time_total_s") for cycle in cycles.values()):
        rows += [
            row("phase changes", label, {"duration_s": cycle.cycle.get("phase_change_time_total_s")})
            for label, cycle in cycles.items()
        ]
    rules = {0, len(rows)}
    rows += [row("cycle", label, cycle.cycle) for label, cycle in cycles.items()]
    return Table(columns, rows, rules)


def _range(start: float | None, end: float | None) -> str:
    if start is None and end is None:
        return ""
    column = Column(digits="z.1f", missing="-")
    return f"{column.text(start)} -> {column.text(end):>5}"


def _format_facts(result: Result) -> list[str]:
    """Return what describes the cycle as a whole, and the gain over the prescribed one."""
    lines = describe_cycle(result)
    if result.prescribed is not None:
        lines.append(_format_gain(result, result.prescribed))
    return lines


def mean_power_of(result: Result) -> tuple[str, str]:
    """Return the key of the mean power that a result maximises, and what to call it; else the mechanical one."""
    return MEAN_POWERS[result.details.get("objective", "mechanical")]


def describe_cycle(result: Result) -> list[str]:
    """Return the harvesting factor and the traction altitude with its wind in one line, or no line."""
    cycle = result.cycle
    facts = []
    if (factor := cycle.get("mean_harvesting_factor")) is not None:
        facts.append(f"mean harvesting factor {factor:.2f}")
    if (altitude := cycle.get("mean_traction_altitude_m")) is not None:
        facts.append(f"mean traction altitude {altitude:.0f} m")
    if (wind_speed := cycle.get("wind_speed_at_mean_traction_altitude_m_s")) is not None:
        facts.append(f"wind speed there {wind_speed:.1f} m/s")
    return [", ".join(facts)] if facts else []


def _format_gain(result: Result, prescribed: Result) -> str:
    key, title = mean_power_of(result)
    power, reference = result.cycle.get(key), prescribed.cycle.get(key)
    if power is None or reference is None:
        message = prescribed.details.get("message", f"its simulation is {prescribed.status}")
        return f"no comparison with the prescribed cycle: {message}"
    gain = f" ({100.0 * (power / reference - 1.0):+.1f} %)" if reference > 0.0 else ""
    left = prescribed.details.get("outside_limits") or []
    outside = f"; the prescribed cycle is outside {', '.join(left)}" if left else ""
    return (
        f"{title.replace('power', 'cycle power')} {power / 1e3:.2f} kW, prescribed {reference / 1e3:.2f} kW: "
        f"{(power - reference) / 1e3:+.2f} kW{gain}{outside}"
    )


def _format_active_limits(active: Mapping[str, list[dict[str, Any]]]) -> list[str]:
    """Return a heading and a line for each active limit, or no lines."""
    rows = [
        (phase if index == 0 else "", limit) for phase, limits in active.items() for index, limit in enumerate(limits)
    ]
    if not rows:
        return []
    width = max(len(phase) for phase, _ in rows)
    lines = [f"  {phase.ljust(width)}  {describe_limit(limit)}" for phase, limit in rows]
    return ["active limits (share of the time of the phase)", *lines]


def describe_limit(limit: Mapping[str, Any]) -> str:
    """Return one active limit as ``limits.tether_force_max_N = 3008 N (93 %)``, without what is not known of it."""
    text = str(limit["limit"])
    if (value := limit.get("value")) is not None:
        unit = unit_of(text)
        # Four digits, but never an exponent for a force or a length.
        text += f" = {value:.0f}" if abs(value) >= 1e4 else f" = {value:.4g}"
        text += "" if unit == DIMENSIONLESS else f" {unit}"
    if (share := limit.get("share")) is not None:
        # A limit met at one moment, as the longest tether at the end of traction, holds for no time at all.
        text += f" ({100.0 * share:.0f} %)" if share >= LASTING_SHARE else " (at a point)"
    return text


def _format_certificate(certificate: Mapping[str, Any]) -> list[str]:
    """Return a heading and a line for each check, or no lines."""
    checks = certificate.get("checks") or []
    if not checks:
        return []
    words = {True: "ok", False: "FAILED", None: "note"}
    width = max(len(check["name"]) for check in checks)
    verdict = "every check passed" if certificate.get("passed") else "NOT certified"
    lines = [f"  {words[check['passed']].ljust(6)}  {check['name'].ljust(width)}  {check['text']}" for check in checks]
    return [f"certificate ({certificate.get('level')}): {verdict}", *lines]


def _format_solver(solver: Mapping[str, Any], meshes: Sequence[Mapping[str, Any]]) -> str:
    """Say what the best start took on the mesh of the problem file, then what each finer mesh took from there."""
    parts = [str(solver.get("status", "unknown status"))]
    if (iterations := solver.get("iterations")) is not None:
        parts.append(f"{iterations} iterations")
    if (time := solver.get("time_s")) is not None:
        parts.append(f"solved in {_duration(time)}")
    if (build_time := solver.get("build_time_s")) is not None:
        parts.append(f"built in {_duration(build_time)}")
    if (starts := solver.get("starts")) is not None:
        count = starts if isinstance(starts, int) else len(starts)
        parts.append(f"{count} start{'' if count == 1 else 's'}")
    if further := [str(mesh["iterations"]) for mesh in meshes[1:] if mesh.get("iterations") is not None]:
        parts.append(f"then {' and '.join(further)} iterations on finer meshes")
    return ", ".join(parts)


def _duration(time_s: float) -> str:
    return f"{1e3 * time_s:.0f} ms" if time_s < 1.0 else f"{time_s:.1f} s"
