"""The report: lines under a header that says on what they were measured, as a table and as JSON."""

from __future__ import annotations

import itertools
import json
import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import asdict

from benchmarks.timing import Line

PACKAGES = ("kiteocp", "casadi", "numpy", "scipy", "matplotlib")
_TIME_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"))


class Report(msgspec.Struct, frozen=True):
    """Measured lines and the machine they were measured on."""

    machine: dict[str, Any]
    versions: dict[str, str]
    lines: tuple[Line, ...]

    @classmethod
    def of(cls, lines: Sequence[Line]) -> Report:
        """Return the report of lines measured here."""
        machine = {
            "system": platform.system(),
            "processor": _processor(),
            "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
            # A machine at work makes every line longer: more than one process per core shows here.
            "load_average": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        }
        versions = {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
        return cls(machine, versions, tuple(lines))

    @classmethod
    def read(cls, path: Path) -> Report:
        """Return a report that `write` has written."""
        content = json.loads(path.read_text(encoding="utf-8"))
        lines = tuple(
            Line(**{key: item[key] for key in Line.__struct_fields__} | {"values": tuple(item["values"])})
            for item in content["lines"]
        )
        return cls(content["machine"], content["versions"], lines)

    def write(self, path: Path) -> None:
        """Write the report as JSON: times in s, memory in B."""
        lines = [
            {**asdict(line), "median": line.median, "quartiles": line.quartiles, "ratio": self.ratio(line)}
            for line in self.lines
        ]
        content = {"machine": self.machine, "versions": self.versions, "lines": lines}
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    def ratio(self, line: Line) -> float | None:
        """Return a line's median over that of the line it is compared with."""
        if line.relative_to is None:
            return None
        (other,) = (each for each in self.lines if (each.group, each.name) == (line.group, line.relative_to))
        return line.median / other.median

    def __str__(self) -> str:
        machine = self.machine
        load = "" if machine["load_average"] is None else f", load average {machine['load_average']:g}"
        rows: list[tuple[str, ...]] = [("", "median", "best", "quartiles", "ratio", "target")]
        for group, lines in itertools.groupby(self.lines, key=lambda line: line.group):
            rows += [(group, "", "", "", "", ""), *map(self._row, lines)]
        widths = [max(len(row[column]) for row in rows) for column in range(6)]
        table = [
            "  ".join(
                [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
            ).rstrip()
            for row in rows
        ]
        return "\n".join(
            [
                ", ".join(f"{name} {number}" for name, number in self.versions.items()),
                f"{machine['system']}, {machine['processor']}, {machine['cores']} cores{load}",
                "",
                *table,
            ]
        )

    def _row(self, line: Line) -> tuple[str, ...]:
        low, high = line.quartiles
        ratio, target = self.ratio(line), ""
        if line.target is not None:
            target = f"{_quantity(line.target, line.unit)} {'met' if line.median <= line.target else 'missed'}"
        return (
            f"  {line.name}",
            _quantity(line.median, line.unit),
            _quantity(min(line.values), line.unit),
            f"{_quantity(low, line.unit)} - {_quantity(high, line.unit)}",
            "" if ratio is None else f"{ratio:.3g} x",
            target,
        )


def _quantity(value: float, unit: str) -> str:
    """Return a time or a size with three digits and its unit."""
    if unit == "B":
        return f"{value / 2**20:.0f} MiB"
    scale, name = next(((scale, name) for scale, name in _TIME_UNITS if value >= scale), _TIME_UNITS[-1])
    number = value / scale
    return f"{number:.{max(0, 2 - len(str(int(number))) + 1)}f} {name}" if number < 100 else f"{number:.0f} {name}"


def _processor() -> str:
    """Return the name of the processor where the system tells, else its architecture."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            names = [line.partition(":")[2].strip() for line in stream if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.machine()
