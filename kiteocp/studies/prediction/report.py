"""What a flight beside the model says: sentences, a table of each predicted cycle, and what the figures show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from kiteocp.recording.data import FLIGHT_PHASES
from kiteocp.report.document import Bullets, Document, Figure, Heading, Lines, Paragraph, Part
from kiteocp.report.table import Cell, Column, Table
from kiteocp.studies.prediction.predictions import BAND_SIGMAS, LAWS, CycleComparison, Prediction
from kiteocp.studies.prediction.reasons import QUANTITY_WORDS
from kiteocp.studies.prediction.statements import statements

if TYPE_CHECKING:
    from kiteocp.studies.prediction.study import FlightStudy

#: Laws as they stand above the columns of a table.
HEADS = {
    "constant_force": "constant force",
    "force_schedule": "flown force",
    "speed_schedule": "flown speed",
    "winch_law": "winch's law",
}

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

_METHOD = (
    "The wind of the estimation cycles is the one that explains the airspeed, whose sensor is gauged along with it. In "
    "that wind lift and drag coefficients of both settings of the kite are fitted through the equilibrium of forces, "
    "robustly and with a covariance that counts only independent samples and the errors of the wind. The gauged "
    "airspeed alone then tells the wind of the predicted cycles, whose forces take no part.",
    "Constant force: each phase of a predicted cycle from the tether length and elevation where it began, with its "
    "mean force, to where it ended, by the paper's laws; its traction is one representative state from averaged "
    "cosines.",
    "Flown force, flown speed: the model at every sample of the flown path, given the measured force (the reeling "
    "speed follows) or the measured reeling speed (the force follows).",
    "Winch's law: the line of reeling speed over force of the estimation cycles; force and speed of the traction both "
    "follow.",
    "The turn from reel-out to reel-in has no phase in the model. It is flown as a phase of its own, powered and "
    "straight up; in a closed cycle it belongs to the traction.",
    "Bands are 95 % of what the errors of coefficients and wind leave, to first order.",
    "The optimum: limits are what the flight kept to (robust quantiles), the wind is matched so that the model's "
    "traction reels out as fast as measured. The contributions are means over all orders in which the ingredients of "
    "the flown cycle are replaced by those of the optimum (Shapley values).",
)

#: How the wind of a predicted cycle is known, where it is its own.
_WIND_SOURCES = {"airspeed": ", by the gauged airspeed", "measured": ", as measured at height"}

#: What the figures show; those of a cycle have its number behind their name.
_CYCLE_CAPTIONS = {
    "cycle": "One cycle as flown, and as the model flies it: each phase at constant force from where it began, and "
    "along the flown path with the flown force, the flown reeling speed and the law of the winch.",
    "side_view": "Side view: height over the distance downwind, as flown and by the paper's laws.",
}
_COMPARISON_CAPTION = (
    "Deviation of the model from the flight, by phase and quantity; one mark for each cycle, its line the 95 % band of "
    "the prediction. Dashed: 10 %."
)
_OPTIMUM_CAPTION = "From the flown to the optimal mean cycle power: what brings the difference."


def flight_figures(study: FlightStudy) -> list[Figure]:
    """Return the figures: two of each predicted cycle, all of them compared, and the optimum where there is one."""
    numbers = [cycle.measured.number for cycle in study.cycles]
    return [
        *(Figure(f"{kind}_{n}", f"Cycle {n}. {text}") for n in numbers for kind, text in _CYCLE_CAPTIONS.items()),
        Figure("comparison", _COMPARISON_CAPTION),
        *([] if study.optimum is None else [Figure("optimum", _OPTIMUM_CAPTION)]),
    ]


def flight_document(study: FlightStudy) -> Document:
    """Return sentences and tables; the page also has the bands, the way to the optimum, and how it is done."""
    problem, flight = study.problem, study.flight
    said = statements(study)
    optimum = "the optimum"
    parts: list[Part] = [
        Lines(
            [
                f"flown by {problem.name}: {problem.description or problem.name}",
                f"{len(flight)} samples, cycles {', '.join(map(str, flight.cycles()))}",
            ],
            joined=True,
        ),
        *_topic("warnings", study.warnings),
        *_topic(optimum, said.pop(optimum)),
        *_optimum(study),
        *(part for topic, sentences in said.items() for part in _topic(topic, sentences)),
    ]
    for cycle in study.cycles:
        wind = cycle.wind.estimate
        parts += [
            Heading(f"Cycle {cycle.measured.number}"),
            Paragraph(
                f"{wind.reference_speed_m_s:.1f} m/s of wind at {wind.reference_height_m:g} m"
                f"{_WIND_SOURCES.get(wind.source, '')}."
            ),
            _cycle(cycle),
        ]
    parts += [Heading("How it is done", detail=True), Bullets(_METHOD, detail=True), Paragraph(LEGEND, small=True)]
    return Document(f"{flight.name} beside the quasi-steady model of {problem.name}", parts, page=True)


def _topic(topic: str, sentences: Sequence[str]) -> list[Part]:
    """Return a section, none without sentences."""
    return [Heading(topic[0].upper() + topic[1:]), Bullets(sentences)] if sentences else []


def _cycle(cycle: CycleComparison) -> Table:
    """Return phases by quantity, the flight and every law in columns."""
    columns = [
        Column("phase", left=True, once=True),
        Column("quantity", left=True),
        Column("", left=True),
        Column("flown"),
    ]
    for law in LAWS:
        group = HEADS[law]
        columns += [
            Column("model", group=group),
            Column("+- 95 %", group=group, detail=True),
            Column("off", group=group),
        ]
    rows: list[list[Cell]] = []
    for name in FLIGHT_PHASES:
        if name not in cycle.phases:
            continue
        phase = cycle.phases[name]
        for quantity in SHOWN:
            found = [phase.predictions[law].get(quantity) for law in LAWS]
            if any(found):
                rows.append(_row(name, quantity, getattr(phase.measured, quantity), found))
    found = [cycle.power.get(law) for law in LAWS]
    rows.append(_row("cycle", "mean_power_W", cycle.measured.mean_power_W, found))
    return Table(columns, rows, rules=(0, len(rows) - 1))


def _row(name: str, quantity: str, measured: float, predictions: Sequence[Prediction | None]) -> list[Cell]:
    unit, factor, digits = SHOWN[quantity]
    row: list[Cell] = [name, QUANTITY_WORDS[quantity], unit, f"{measured * factor:.{digits}f}"]
    for prediction in predictions:
        if prediction is None:  # the law is given the quantity
            row += [""] * 3
            continue
        band = BAND_SIGMAS * prediction.standard_error * factor
        off = 100 * prediction.deviation
        shown = f"{off:+.0f} %" if abs(off) < 1000 else ">999 %"
        row += [
            f"{prediction.predicted * factor:.{digits}f}",
            f"{band:.{digits}f}",
            f"{shown} {MARKS[prediction.verdict]}",
        ]
    return row


def _optimum(study: FlightStudy) -> Iterator[Table]:
    optimum = study.optimum
    if optimum is None:
        return
    rows: list[list[Cell]] = [["flown", f"{1e-3 * optimum.flown_power_W:.2f}"]]
    rows += [[name, f"{1e-3 * part:+.2f}"] for name, part in optimum.contributions.items()]
    rows.append(["optimal", f"{1e-3 * optimum.optimal_power_W:.2f}"])
    yield Table([Column("from flown to optimal", left=True), Column("kW")], rows, detail=True)
    limits = [(key.removeprefix("limits."), value) for key, value in optimum.limits.items()]
    yield Table([Column("limit", left=True), Column("value", digits=".5g")], limits, detail=True)
