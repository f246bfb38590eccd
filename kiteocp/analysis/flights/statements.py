"""What agrees between a flight and the model, what does not, and why: sentences made from the numbers of a study."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from kiteocp.analysis.flights.comparison import CycleComparison, Prediction
from kiteocp.analysis.flights.data import FLIGHT_PHASES
from kiteocp.analysis.flights.optimum import MANOEUVRES, VARYING, largest
from kiteocp.analysis.flights.study import FlightStudy

#: Laws and quantities in words.
LAW_WORDS = {
    "constant_force": "at constant force",
    "force_schedule": "with the flown force",
    "speed_schedule": "with the flown reeling speed",
    "winch_law": "by the winch's law",
}
QUANTITY_WORDS = {
    "duration_s": "duration",
    "mean_force_N": "mean force",
    "mean_power_W": "mean power",
    "reeled_length_m": "reeled length",
    "elevation_end_deg": "final elevation",
    "mean_kite_speed_m_s": "speed across the tether",
}

#: A prediction of power moves by so many per cent for each per cent of wind before it is called sensitive.
SENSITIVE = 5.0

#: A wind that matches a traction within this share of the estimated one is the estimated one.
MATCHED = 0.01

#: Coefficients of two estimates differ beyond so many standard errors, where these are no rounding (relative).
APART_SIGMAS, KNOWN_SHARE = 2.0, 1e-4

#: A phase of the machine that lasts so many times longer than the model's has more flown in it.
LONGER = 2.0

#: Time over which a change of the kite's speed is taken, and the acceleration of gravity that it is held against.
SMOOTHED_S, GRAVITY_M_S2 = 1.0, 9.81

#: Relative standard deviation of the force within the traction beyond which it was not held constant.
HELD = 0.05


@dataclass(frozen=True)
class Finding:
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
        "what agrees": list(_agreeing(found)),
        "what does not agree": list(_differing(found)),
        "why": list(_reasons(study)),
        "the optimum": list(_optimum(study)),
    }


def _shown(study: FlightStudy) -> Iterator[str]:
    kite, flight = study.kite, study.flight
    named = ", ".join(map(str, kite.cycles))
    wind = kite.wind
    error = "" if wind.scale_standard_error is None else f" +- {100 * wind.scale_standard_error / wind.scale:.1f} %"
    where = f"On cycle{'s' if len(kite.cycles) > 1 else ''} {named}"
    way = {"airspeed": "by the airspeed", "fit": "by the equilibrium of forces"}.get(wind.source, "by the problem")
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
        yield (
            f"The airspeed sensor reads {reads} what wind and velocity of the kite make, which it was gauged by; so "
            "gauged it tells the wind of the other cycles."
        )
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
    yield f"The predicted cycles ({numbers}) had {' and '.join(speeds)} m/s by the airspeed."
    if flight.counts:
        counted = ", ".join(f"{reason.replace('_', ' ')} {count}" for reason, count in flight.counts.items())
        yield f"Rejected or repaired in reading {len(flight)} samples: {counted}."


def _agreeing(found: list[Finding]) -> Iterator[str]:
    close = [finding.words for finding in found if finding.verdicts <= {"close"}]
    within = [finding.words for finding in found if finding.verdicts <= {"close", "within"} != finding.verdicts]
    within = [words for words in within if words not in close]
    if close:
        yield f"Within 10 % in every cycle: {'; '.join(close)}."
    if within:
        yield (
            "Further off, but inside the 95 % band that the errors of wind and coefficients leave, so that this flight "
            f"cannot tell: {'; '.join(within)}."
        )


def _differing(found: list[Finding]) -> Iterator[str]:
    every = [finding.words for finding in found if finding.verdicts == {"differs"}]
    some = [finding.words for finding in found if "differs" in finding.verdicts and len(finding.verdicts) > 1]
    if every:
        yield f"Outside its band in every cycle: {'; '.join(every)}."
    if some:
        yield f"Outside its band in some of the cycles: {'; '.join(some)}."
    if not every and not some:
        yield "Nothing lies outside its band."


def _reasons(study: FlightStudy) -> Iterator[str]:
    yield from _why_sensitive(study)
    yield from _why_coefficients(study)
    yield from _why_course(study)
    yield from _why_transition(study)
    yield from _why_turn(study)
    yield from _why_law(study)
    lost = {
        law: sum(phase.without_equilibrium[law] for cycle in study.cycles for phase in cycle.phases.values())
        for law in ("force_schedule", "speed_schedule")
    }
    samples = sum(p.replayed.path.time_s.size for cycle in study.cycles for p in cycle.phases.values())
    if any(lost.values()):
        yield (
            f"Of {samples} samples {lost['force_schedule']} have no equilibrium with the flown force and "
            f"{lost['speed_schedule']} none with the flown reeling speed; they are left out on both sides."
        )
    unflown = {message for cycle in study.cycles for p in cycle.phases.values() for message in p.unflown.values()}
    yield from (f"By its law: {message}." for message in sorted(unflown))


def _why_sensitive(study: FlightStudy) -> Iterator[str]:
    for phase, law in (("traction", "force_schedule"), ("retraction", "speed_schedule")):
        key = f"{law}.{phase}"
        slopes = [abs(cycle.wind_elasticity[key]) for cycle in study.cycles if key in cycle.wind_elasticity]
        if slopes and float(np.median(slopes)) > SENSITIVE:
            error = study.wind.scale_standard_error
            known = "" if not error else f", and the wind is known to {100 * error / study.wind.scale:.0f} %"
            yield (
                f"Per 1 % of wind the power of the {phase} {LAW_WORDS[law]} moves by {float(np.median(slopes)):.0f} %"
                f"{known}: speed and force there are small differences of large numbers."
            )
    matches = [cycle for cycle in study.cycles if cycle.matching_wind is not None]
    off = [abs((cycle.matching_wind or 1.0) - 1.0) for cycle in matches]
    if matches and max(off) > MATCHED:
        changes = " and ".join(
            f"{100 * ((cycle.matching_wind or 1.0) - 1.0):+.1f} %"
            + (f" ({cycle.matching_sigmas:.1f} standard errors)" if np.isfinite(cycle.matching_sigmas) else "")
            for cycle in matches
        )
        numbers = " and ".join(str(cycle.measured.number) for cycle in matches)
        yield (
            f"A wind {changes} other than that of the airspeed would let the model reel out as far as measured in the "
            f"traction of cycle {numbers} with the flown force."
        )


def _why_coefficients(study: FlightStudy) -> Iterator[str]:
    """Hold what each predicted cycle asks for by itself against the estimate."""
    estimated = study.kite.fit
    for setting in estimated.samples:
        for name, symbol in (("lift", "C_L"), ("drag", "C_D")):
            parameter = f"{setting}.{name}_coefficient"
            before = estimated.fit.parameter(parameter)
            own = [cycle.own for cycle in study.cycles if cycle.own is not None]
            after = [found.fit.parameter(parameter) for found in own if setting in found.samples]
            apart = [
                abs(found["value"] - before["value"]) / np.hypot(found["standard_error"], before["standard_error"])
                for found in after
                if found["standard_error"] > KNOWN_SHARE * abs(found["value"])
            ]
            if apart and max(apart) > APART_SIGMAS:
                values = " and ".join(f"{found['value']:.3f} +- {found['standard_error']:.3f}" for found in after)
                yield (
                    f"By themselves the predicted cycles ask for a {setting} {symbol} of {values} instead of "
                    f"{before['value']:.3f} +- {before['standard_error']:.3f}: the kite did not fly with the same "
                    "coefficients, or the wind was not that of the airspeed."
                )


def _why_course(study: FlightStudy) -> Iterator[str]:
    """Compare the force at the flown speed where the traction flies down and where it flies up."""
    ratios: dict[str, list[float]] = {"down": [], "up": []}
    for cycle in _phase_pairs(study, "traction"):
        again = cycle.phases["traction"].replayed
        down = np.cos(np.radians(again.path.places[3]))
        for way, found in ratios.items():
            among = (down > 0.5 if way == "down" else down < -0.5) & np.isfinite(again.force_N)
            if among.any():
                found.append(float(np.sum(again.force_N[among]) / np.sum(again.path.force_N[among])))
    if ratios["down"] and ratios["up"]:
        below, above = (100 * (float(np.mean(found)) - 1) for found in ratios.values())
        if below - above > 100 * HELD:
            line = (
                f"At the flown reeling speed the model's force is {below:+.0f} % off where the kite flies down and "
                f"{above:+.0f} % where it flies up"
            )
            taken = _inertia(study)
            if taken is not None:
                line += (
                    f": flying down {100 * taken[0]:.0f} % of the kite's weight along its course went into "
                    f"acceleration, flying up {100 * taken[1]:.0f} % came out of it, and a quasi-steady model has no "
                    "inertia"
                )
            yield f"{line}."


def _inertia(study: FlightStudy) -> tuple[float, float] | None:
    """Return which share of the weight along the course accelerates the kite, flying down and flying up in traction."""
    sums = {"down": np.zeros(2), "up": np.zeros(2)}
    for cycle in study.cycles:
        part = study.flight.select([cycle.measured.number], "traction")
        time, speed = part.time_s, np.hypot(part.polar_speed_m_s, part.azimuthal_speed_m_s)
        known = np.isfinite(speed)
        if np.count_nonzero(known) < 2 or time[-1] - time[0] < SMOOTHED_S:
            continue
        # The change of speed over a second, free of the noise of single samples.
        ends = [np.interp(time + sign * 0.5 * SMOOTHED_S, time[known], speed[known]) for sign in (1.0, -1.0)]
        down = np.cos(np.radians(part.course_deg))
        forces = np.stack(
            [(ends[0] - ends[1]) / SMOOTHED_S, GRAVITY_M_S2 * np.cos(np.radians(part.elevation_deg)) * down]
        )
        for way, among in (("down", down > 0.5), ("up", down < -0.5)):
            sums[way] += np.nansum(forces[:, among], axis=1)
    if not (sums["down"][1] and sums["up"][1]):
        return None
    return float(sums["down"][0] / sums["down"][1]), float(sums["up"][0] / sums["up"][1])


def _phase_pairs(study: FlightStudy, phase: str) -> list[CycleComparison]:
    return [cycle for cycle in study.cycles if phase in cycle.phases]


def _why_transition(study: FlightStudy) -> Iterator[str]:
    cycles = [cycle for cycle in _phase_pairs(study, "transition") if cycle.phases["transition"].law is not None]
    if not cycles:
        return
    measured, modelled, way, straight = [], [], [], []
    for cycle in cycles:
        phase, law = cycle.phases["transition"].measured, cycle.phases["transition"].law
        measured.append(phase.duration_s)
        modelled.append(float(law.time_s[-1]) if law is not None else np.nan)
        way.append(phase.mean_kite_speed_m_s * phase.duration_s)
        straight.append(
            np.radians(abs(phase.elevation_end_deg - phase.elevation_start_deg)) * phase.tether_length_start_m
        )
    if np.mean(measured) > LONGER * np.mean(modelled):
        yield (
            f"The model's transition flies straight down in {np.mean(modelled):.0f} s; the machine took "
            f"{np.mean(measured):.0f} s and flew {np.mean(way):.0f} m across the tether for {np.mean(straight):.0f} m "
            "down, reeling in and powering the kite on the way: the model has no such manoeuvre."
        )


def _why_turn(study: FlightStudy) -> Iterator[str]:
    cycles = _phase_pairs(study, "turn")
    if not cycles:
        return
    time = sum(c.phases["turn"].measured.duration_s for c in cycles) / sum(c.measured.duration_s for c in cycles)
    energy = sum(c.phases["turn"].measured.energy_J for c in cycles) / sum(
        abs(c.measured.mean_power_W) * c.measured.duration_s for c in cycles
    )
    yield (
        f"The turn from reel-out to reel-in takes {100 * time:.0f} % of the time and brings {100 * energy:.0f} % of "
        "the energy of a cycle; the model has no phase for it. Here it is a phase of its own, powered and straight up; "
        "in a closed cycle and in the optimum it belongs to the traction, since the winch still reels out."
    )


def _why_law(study: FlightStudy) -> Iterator[str]:
    spreads = []
    for cycle in _phase_pairs(study, "traction"):
        force = cycle.phases["traction"].replayed.path.force_N
        spreads.append(float(np.std(force) / np.mean(force)))
    if spreads and np.mean(spreads) > HELD:
        line = (
            f"In the traction the machine did not hold a constant force: it varies by {100 * np.mean(spreads):.0f} % "
            "about its mean"
        )
        law = study.kite.winch_law
        if law is not None:
            line += (
                f"; the winch reels out {1e3 * law.slope_m_s_per_N:.2f} m/s faster for each kN (correlation "
                f"{law.correlation:.2f} on the estimation cycles), and by that law force and speed follow from where "
                "its line meets the kite's"
            )
        yield line + "."
    errors = {
        law: float(
            np.mean([abs(cycle.power[law].deviation) for cycle in study.cycles if law in cycle.power] or [np.nan])
        )
        for law in LAW_WORDS
    }
    known = {law: error for law, error in errors.items() if np.isfinite(error)}
    if known and max(known.values()) > HELD:
        best = min(known, key=lambda law: known[law])
        parts = "; ".join(f"{LAW_WORDS[law]} {100 * error:.0f} %" for law, error in known.items())
        yield (
            f"The mean power of a cycle is off by ({parts}), so that the schedule {LAW_WORDS[best]} tells most of this "
            "flight."
        )


def _optimum(study: FlightStudy) -> Iterator[str]:
    optimum = study.optimum
    if optimum is None:
        yield f"There is no optimum under the limits of the flight: {study.optimum_message}."
        return
    gain = optimum.optimal_power_W - optimum.flown_power_W
    reason = largest(optimum.contributions, gain)
    yield (
        f"Flown {1e-3 * optimum.flown_power_W:.1f} kW, optimal {1e-3 * optimum.optimal_power_W:.1f} kW under the "
        f"limits it flew with, mostly because of {_reason_words(study, reason)} "
        f"({1e-3 * optimum.contributions[reason]:+.1f} kW of {1e-3 * gain:+.1f} kW)."
    )
    if optimum.prescribed_power_W is not None:
        yield (
            f"The model gives {1e-3 * optimum.prescribed_power_W:.1f} kW with the flown means, so that its own error "
            f"and what it leaves out ({MANOEUVRES}) make "
            f"{1e-3 * (optimum.prescribed_power_W - optimum.flown_power_W):+.1f} kW, and the schedule "
            f"{1e-3 * (optimum.optimal_power_W - optimum.prescribed_power_W):+.1f} kW."
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
    if optimum is None or reason in (MANOEUVRES, VARYING, "schedule"):
        return {MANOEUVRES: "manoeuvres that the model leaves out", "schedule": "the schedule"}.get(reason, reason)
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
