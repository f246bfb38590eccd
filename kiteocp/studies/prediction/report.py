"""The study of a flight as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Sequence

from kiteocp._version import __version__
from kiteocp.recording.data import FLIGHT_PHASES
from kiteocp.report.html import Picture, bullets, figures, page, paragraph, section, table
from kiteocp.studies.prediction.predictions import BAND_SIGMAS, LAWS, Prediction
from kiteocp.studies.prediction.reasons import QUANTITY_WORDS
from kiteocp.studies.prediction.statements import statements
from kiteocp.studies.prediction.study import FlightStudy
from kiteocp.studies.prediction.summary import HEADS, LEGEND, MARKS, SHOWN

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


def report_html(study: FlightStudy, pictures: Sequence[Picture] = ()) -> str:
    """Return the report.

    Parameters
    ----------
    study
        What was computed.
    pictures
        The figures, in their order.
    """
    title = f"{study.flight.name} beside the quasi-steady model of {study.problem.name}"
    said, cycles = statements(study), ", ".join(map(str, study.flight.cycles()))
    body = [
        paragraph(f"{len(study.flight)} samples, cycles {cycles}. kiteocp {__version__}."),
        section("The optimum", bullets(said["the optimum"]) + _optimum(study)),
        *(section(topic[0].upper() + topic[1:], bullets(said[topic])) for topic in list(said)[:-1]),
        *(section(f"Cycle {cycle.measured.number}", _cycle(study, index)) for index, cycle in enumerate(study.cycles)),
        section("How it is done", bullets(_METHOD) + paragraph(LEGEND, "small")),
        figures(pictures),
    ]
    if study.warnings:
        body.insert(1, section("Warnings", bullets(study.warnings)))
    return page(title, body)


def _cycle(study: FlightStudy, index: int) -> str:
    cycle = study.cycles[index]
    head = ["phase", "quantity", "unit", "flown", *(HEADS[law] for law in LAWS)]
    rows = []
    for name in FLIGHT_PHASES:
        if name not in cycle.phases:
            continue
        phase = cycle.phases[name]
        for quantity, (unit, factor, digits) in SHOWN.items():
            cells = [phase.predictions[law].get(quantity) for law in LAWS]
            if any(cells):
                flown = f"{getattr(phase.measured, quantity) * factor:.{digits}f}"
                rows.append([name, QUANTITY_WORDS[quantity], unit, flown, *(_cell(c, factor, digits) for c in cells)])
    unit, factor, digits = SHOWN["mean_power_W"]
    whole = [_cell(cycle.power.get(law), factor, digits) for law in LAWS]
    rows.append(["cycle", "mean power", unit, f"{cycle.measured.mean_power_W * factor:.{digits}f}", *whole])
    wind = cycle.wind.estimate
    text = f"{wind.reference_speed_m_s:.1f} m/s of wind at {wind.reference_height_m:g} m, by the gauged airspeed."
    return paragraph(text) + table(head, rows, numeric_from=3)


def _cell(prediction: Prediction | None, factor: float, digits: int) -> str:
    if prediction is None:
        return ""
    band = BAND_SIGMAS * prediction.standard_error * factor
    return (
        f"{prediction.predicted * factor:.{digits}f} ± {band:.{digits}f} ({100 * prediction.deviation:+.0f} %) "
        f"{MARKS[prediction.verdict]}"
    )


def _optimum(study: FlightStudy) -> str:
    optimum = study.optimum
    if optimum is None:
        return ""
    rows = [["flown", f"{1e-3 * optimum.flown_power_W:.2f}"]]
    rows += [[name, f"{1e-3 * part:+.2f}"] for name, part in optimum.contributions.items()]
    rows.append(["optimal", f"{1e-3 * optimum.optimal_power_W:.2f}"])
    limits = [[key.removeprefix("limits."), f"{value:.5g}"] for key, value in optimum.limits.items()]
    return table(["from flown to optimal", "kW"], rows, numeric_from=1) + table(
        ["limit", "value"], limits, numeric_from=1
    )
