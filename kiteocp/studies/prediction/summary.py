"""The study of a flight as the output contract, and as a table a person reads."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from kiteocp.recording.data import FLIGHT_PHASES
from kiteocp.result import Result
from kiteocp.studies.prediction.predictions import LAWS, Prediction
from kiteocp.studies.prediction.reasons import QUANTITY_WORDS
from kiteocp.studies.prediction.statements import statements
from kiteocp.studies.prediction.study import FlightStudy

WIDTH = 118

#: Heads of the columns of the table, and their width.
HEADS = {
    "constant_force": "constant force",
    "force_schedule": "flown force",
    "speed_schedule": "flown speed",
    "winch_law": "winch's law",
}
CELL = 18

#: Unit and factor in which a quantity is shown, and its digits.
SHOWN = {
    "duration_s": ("s", 1.0, 1),
    "mean_force_N": ("kN", 1e-3, 2),
    "mean_power_W": ("kW", 1e-3, 2),
    "reeled_length_m": ("m", 1.0, 1),
    "elevation_end_deg": ("deg", 1.0, 1),
    "mean_kite_speed_m_s": ("m/s", 1.0, 1),
}

#: Marks of the verdicts.
MARKS = {"close": "=", "within": "~", "differs": "!", "unknown": "?"}
LEGEND = (
    "= within 10 % of the measured value; ~ further off, but inside the 95 % band of the prediction; ! outside; "
    "? inside a band too wide to tell. The band is that of the errors of wind and coefficients, to first order."
)


def result_of(study: FlightStudy) -> Result:
    """Return a study in the form of the output contract, all of it under ``flight_validation``."""
    return Result(
        verb="validate",
        problem=study.kite.problem,
        status="ok" if study.optimum is not None else "failed",
        warnings=study.warnings,
        details={
            **({} if study.optimum is not None else {"message": study.optimum_message}),
            "flight_validation": {
                "flight": study.flight.name,
                "samples": len(study.flight),
                "counts": dict(study.flight.counts),
                "notes": list(study.flight.notes),
                "downwind_bearing_deg": study.flight.downwind_bearing_deg,
                "estimation": study.kite.to_dict(),
                "cycles": [cycle.to_dict() for cycle in study.cycles],
                "optimum": study.optimum.to_dict() if study.optimum is not None else None,
                "statements": statements(study),
            },
        },
    )


def format_study(study: FlightStudy) -> str:
    """Return tables and sentences."""
    problem = study.problem
    title = problem.description or problem.name
    parts = [f"{study.flight.name} flown by {problem.name}: {title}"]
    parts += ["\n".join(_cycle_table(study, index)) for index in range(len(study.cycles))]
    parts.append(textwrap.fill(LEGEND, WIDTH))
    for topic, sentences in statements(study).items():
        lines = [textwrap.fill(text, WIDTH, initial_indent="- ", subsequent_indent="  ") for text in sentences]
        if lines:
            parts.append("\n".join([topic, *lines]))
    parts += [f"warning: {warning}" for warning in study.warnings]
    return "\n\n".join(parts)


def _cycle_table(study: FlightStudy, index: int) -> Iterator[str]:
    """Yield the lines of a cycle: phases by quantity, the flight and every law in columns."""
    cycle = study.cycles[index]
    speed, height = cycle.wind.estimate.reference_speed_m_s, cycle.wind.estimate.reference_height_m
    heads = "".join(HEADS[law].rjust(CELL) for law in LAWS)
    yield f"cycle {cycle.measured.number}, {speed:.1f} m/s of wind at {height:g} m"
    yield f"{'':39}{'flown':>8}{heads}"
    yield "-" * (47 + CELL * len(LAWS))
    for name in FLIGHT_PHASES:
        if name not in cycle.phases:
            continue
        phase = cycle.phases[name]
        label = name
        for quantity, (unit, factor, digits) in SHOWN.items():
            cells = [phase.predictions[law].get(quantity) for law in LAWS]
            if not any(cells):
                continue
            flown = getattr(phase.measured, quantity) * factor
            text = "".join(_cell(cell, factor, digits) for cell in cells)
            yield f"{label:12}{QUANTITY_WORDS[quantity]:23} {unit:>3}{flown:>8.{digits}f}{text}".rstrip()
            label = ""
    yield "-" * (47 + CELL * len(LAWS))
    unit, factor, digits = SHOWN["mean_power_W"]
    text = "".join(_cell(cycle.power.get(law), factor, digits) for law in LAWS)
    yield f"{'cycle':12}{'mean power':23} {unit:>3}{cycle.measured.mean_power_W * factor:>8.{digits}f}{text}".rstrip()


def _cell(prediction: Prediction | None, factor: float, digits: int) -> str:
    """Return prediction and deviation of a cell; blank where the law is given the quantity."""
    if prediction is None:
        return " " * CELL
    off = 100 * prediction.deviation
    shown = f"{round(off):+d} %" if abs(off) < 1000 else ">999 %"
    return f"{prediction.predicted * factor:>9.{digits}f}{shown:>7} {MARKS[prediction.verdict]}"
