"""What agrees between a flight and the model, what does not, and why: sentences made from the numbers of a study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from kiteocp.recording.data import FLIGHT_PHASES
from kiteocp.report.words import listed
from kiteocp.studies.prediction.aerodynamics import check_forces
from kiteocp.studies.prediction.optimum import LEFT_OUT, VARYING, largest
from kiteocp.studies.prediction.predictions import CLOSE, Prediction
from kiteocp.studies.prediction.reasons import LAW_WORDS, QUANTITY_WORDS, reasons

if TYPE_CHECKING:
    from kiteocp.studies.prediction.study import FlightStudy


class Finding(msgspec.Struct, frozen=True):
    """One quantity of one phase by one law, over all predicted cycles."""

    phase: str
    law: str
    quantity: str
    predictions: tuple[Prediction, ...]

    @property
    def verdicts(self) -> set[str]:
        """The verdicts of the cycles."""
        return {prediction.verdict for prediction in self.predictions}

    @property
    def words(self) -> str:
        """What is predicted, and how far off it is."""
        deviations = [100 * prediction.deviation for prediction in self.predictions]
        low, high = round(min(deviations)), round(max(deviations))
        off = f"{low:+d} %" if low == high else f"{low:+d} to {high:+d} %"
        return f"{QUANTITY_WORDS[self.quantity]} of the {self.phase} {LAW_WORDS[self.law]} ({off})"


def findings(study: FlightStudy) -> list[Finding]:
    """Return every predicted quantity over all predicted cycles, in the order of phases and laws."""
    found: dict[tuple[str, str, str], list[Prediction]] = {}
    for name in FLIGHT_PHASES:
        for cycle in study.cycles:
            if name in cycle.phases:
                for law, quantities in cycle.phases[name].predictions.items():
                    for quantity, prediction in quantities.items():
                        found.setdefault((name, law, quantity), []).append(prediction)
    return [Finding(*key, tuple(predictions)) for key, predictions in found.items()]


def statements(study: FlightStudy) -> dict[str, list[str]]:
    """Return sentences by topic: what the flight shows, what agrees, what does not, why, and the optimum."""
    found = findings(study)
    return {
        "what the flight shows": list(_shown(study)),
        "what agrees": [*_force(study, agrees=True), *_agreeing(found)],
        "what does not agree": [*_force(study, agrees=False), *_differing(found)],
        "why": list(reasons(study)),
        "the optimum": list(_optimum(study)),
    }


def _shown(study: FlightStudy) -> Iterator[str]:
    kite, flight = study.kite, study.flight
    named = ", ".join(map(str, kite.cycles))
    wind = kite.wind
    error = "" if wind.scale_standard_error is None else f" +- {100 * wind.scale_standard_error / wind.scale:.1f} %"
    where = f"On cycle{'s' if len(kite.cycles) > 1 else ''} {named}"
    ways = {
        "measured": "as measured at height",
        "airspeed": "by the airspeed",
        "fit": "by the equilibrium of forces",
    }
    way = ways.get(wind.source, "by the problem")
    yield (
        f"{where} the wind {way} is {wind.reference_speed_m_s:.1f} m/s{error} at {wind.reference_height_m:g} m, turned "
        f"by {wind.direction_offset_deg:+.0f} deg from the azimuth zero of the recording."
    )
    if kite.wind_by_forces is not None and wind.source == "airspeed":
        share = (wind.reference_speed_m_s or 0.0) / wind.scale
        yield (
            f"The equilibrium of forces alone, without the airspeed, asks for {share * kite.wind_by_forces[0]:.1f} +- "
            f"{share * kite.wind_by_forces[1]:.1f} m/s there."
        )
    if kite.airspeed_factor is not None:
        less = 100 * (1 - 1 / kite.airspeed_factor)
        verb = "less" if less > 0 else "more"
        reads = f"{abs(less):.1f} % {verb} than" if abs(less) >= 0.1 else "the same as"
        gauged = ", which it was gauged by; so gauged it tells the wind of the other cycles"
        use = "" if wind.source == "measured" else gauged
        yield f"The airspeed sensor reads {reads} what wind and velocity of the kite make{use}."
    for setting, (lift, drag) in {s: kite.fit.coefficients(s) for s in kite.fit.samples}.items():
        errors = [
            kite.fit.fit.parameter(f"{setting}.{name}_coefficient")["standard_error"] for name in ("lift", "drag")
        ]
        yield (
            f"The {setting} kite has C_L {lift:.3f} +- {errors[0]:.3f} and, without the tether, C_D {drag:.3f} +- "
            f"{errors[1]:.3f}."
        )
    speeds = [f"{cycle.wind.estimate.reference_speed_m_s:.1f}" for cycle in study.cycles]
    numbers = ", ".join(str(cycle.measured.number) for cycle in study.cycles)
    source = study.cycles[0].wind.estimate.source
    yield f"The predicted cycles ({numbers}) had {' and '.join(speeds)} m/s {ways.get(source, way)}."
    for note in flight.notes:
        yield f"{note[0].upper()}{note[1:]}."
    if flight.counts:
        counted = ", ".join(f"{reason.replace('_', ' ')} {count}" for reason, count in flight.counts.items())
        yield f"Rejected or repaired in reading {len(flight)} samples: {counted}."


def _force(study: FlightStudy, *, agrees: bool) -> Iterator[str]:
    """Say how well the aerodynamics hold, if that is what the topic is about."""
    check = check_forces(study)
    if not check.deviations or (max(map(abs, check.deviations)) <= CLOSE) != agrees:
        return
    low, high = round(100 * min(check.deviations)), round(100 * max(check.deviations))
    off = f"{low:+d} %" if low == high else f"{low:+d} to {high:+d} %"
    line = (
        "Wind, measured velocity and the estimated coefficients, without the equilibrium, give the mean aerodynamic "
        f"force of the traction ({off})"
    )
    if check.correlations:
        line += f", sample by sample with a correlation of {np.mean(check.correlations):.2f}"
    if agrees and any("differs" in finding.verdicts for finding in findings(study) if finding.phase == "traction"):
        line += ": what differs more in the traction is the speed at which the model's kite is in equilibrium"
    yield f"{line}."


def _agreeing(found: list[Finding]) -> Iterator[str]:
    close = [finding.words for finding in found if finding.verdicts == {"close"}]
    within = [f.words for f in found if "within" in f.verdicts and f.verdicts <= {"close", "within"}]
    unknown = [f.words for f in found if "unknown" in f.verdicts and "differs" not in f.verdicts]
    if close:
        yield f"Within 10 % in every cycle: {'; '.join(close)}."
    if within:
        yield (
            f"Inside the 95 % band that the errors of wind and coefficients leave, in every cycle: {'; '.join(within)}."
        )
    if unknown:
        yield f"This flight cannot tell, as the band is as wide as the prediction: {'; '.join(unknown)}."


def _differing(found: list[Finding]) -> Iterator[str]:
    every = [finding.words for finding in found if finding.verdicts == {"differs"}]
    some = [finding.words for finding in found if "differs" in finding.verdicts and len(finding.verdicts) > 1]
    if every:
        yield f"Outside its band in every cycle: {'; '.join(every)}."
    if some:
        yield f"Outside its band in some of the cycles: {'; '.join(some)}."
    if not every and not some:
        yield "Nothing lies outside its band."


def _optimum(study: FlightStudy) -> Iterator[str]:
    optimum = study.optimum
    if optimum is None:
        yield f"There is no optimum under the limits of the flight: {study.optimum_message}."
        return
    flown, optimal = 1e-3 * optimum.flown_power_W, 1e-3 * optimum.optimal_power_W
    # What the model leaves out of the flown cycle is no merit of the schedule.
    parts = {name: part for name, part in optimum.contributions.items() if name != LEFT_OUT}
    gain = 1e-3 * sum(parts.values())
    reason = largest(parts, gain)
    yield (
        f"Flown {flown:.1f} kW, optimal {optimal:.1f} kW under the limits it flew with, mostly because of "
        f"{_reason_words(study, reason)} ({1e-3 * parts[reason]:+.1f} kW of {gain:+.1f} kW that the schedule brings)."
    )
    if optimum.prescribed_power_W is not None:
        prescribed = 1e-3 * optimum.prescribed_power_W
        yield (
            f"The model gives {prescribed:.1f} kW with the flown means: its errors and the manoeuvres that it leaves "
            f"out make {prescribed - flown:+.1f} kW."
        )
    if optimum.widened:
        wider = listed(
            [
                f"{key.removeprefix('limits.')} from {value:.5g} to {optimum.limits[key]:.5g}"
                for key, value in optimum.widened.items()
            ],
            "and",
        )
        yield f"Limits are wider than the flight kept to, where the model flown with its means needs it: {wider}."
    pause = optimum.limits.get("limits.phase_change_time_s", 0.0)
    if pause:
        yield (
            f"Each of the three phase changes takes {pause:.1f} s: together the time by which the flown cycle lasts "
            "longer than the model's, which has no such manoeuvres."
        )
    sigmas = "" if optimum.wind_sigmas is None else f", {optimum.wind_sigmas:.1f} standard errors of the estimate"
    yield (
        f"For this the wind is matched so that the model's traction reels out as fast as measured: "
        f"{100 * (optimum.wind_factor - 1):+.1f} % of the estimate{sigmas}."
    )
    ends = [f"{1e-3 * power:.1f}" if power is not None else "no cycle" for power in optimum.optimal_band_W]
    yield f"With the wind a standard error weaker and stronger the optimum is {ends[0]} and {ends[1]} kW."
    if optimum.message:
        yield f"{optimum.message[0].upper()}{optimum.message[1:]}."


def _reason_words(study: FlightStudy, reason: str) -> str:
    """Return what brings most of the gain, with the numbers it goes from and to."""
    optimum = study.optimum
    if optimum is None or reason in (VARYING, "schedule"):
        return "the schedule as a whole" if reason == "schedule" else reason
    flown, best = optimum.problem.operation, optimum.best
    words = {
        "traction force": (flown.traction.tether_force_N, best["operation.traction.tether_force_N"], "kN", 1e-3),
        "retraction force": (flown.retraction.tether_force_N, best["operation.retraction.tether_force_N"], "kN", 1e-3),
        "traction elevation": (flown.traction.elevation_deg, best["operation.traction.elevation_deg"], "deg", 1.0),
        "tether lengths": (
            flown.tether_length_max_m - flown.tether_length_min_m,
            best["operation.tether_length_max_m"] - best["operation.tether_length_min_m"],
            "m",
            1.0,
        ),
    }
    before, after, unit, factor = words[reason]
    kind = reason if reason != "tether lengths" else "stroke"
    return f"{'more' if after > before else 'less'} {kind} ({factor * before:.3g} to {factor * after:.3g} {unit})"
