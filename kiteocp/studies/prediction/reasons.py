"""Why a flight and the model differ: sentences from the numbers of a study, each only where they bear it out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from kiteocp.recording.cleaning import FloatArray
from kiteocp.studies.prediction.predictions import CycleComparison

if TYPE_CHECKING:
    from kiteocp.studies.prediction.study import FlightStudy

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
MAX_SPEED_ERROR_SHARE = 0.01

#: Coefficients of two estimates differ beyond so many standard errors, where these are no rounding (relative).
APART_SIGMAS, KNOWN_SHARE = 2.0, 1e-4

#: A phase of the machine that lasts so many times longer than the model's has more flown in it.
MIN_DURATION_RATIO = 2.0

#: Time over which a change of the kite's speed is taken.
SMOOTHED_S = 1.0

#: A force follows late where the delay is longer than this and raises the correlation by so much.
LATE_S, LATE_GAIN = 0.5, 0.2

#: Longest delay looked for (s), and samples below which none is.
LONGEST_DELAY_S, FEWEST = 5.0, 20

#: Relative standard deviation of the force within the traction beyond which it was not held constant.
MIN_FORCE_SPREAD_SHARE = 0.05


def reasons(study: FlightStudy) -> Iterator[str]:
    """Yield why flight and model differ, from the most general reason to the most special."""
    yield from _why_sensitive(study)
    yield from _why_coefficients(study)
    yield from _why_course(study)
    yield from _why_late(study)
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
    if matches and max(off) > MAX_SPEED_ERROR_SHARE:
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
        if below - above > 100 * MIN_FORCE_SPREAD_SHARE:
            line = (
                f"At the flown reeling speed the model's force is {below:+.0f} % off where the kite flies down and "
                f"{above:+.0f} % where it flies up"
            )
            taken = _inertia(study)
            if taken is not None:
                line += (
                    "; inertia, which a quasi-steady model leaves out, may be a part of that: flying down "
                    f"{100 * taken[0]:.0f} % of the kite's weight along its course went into acceleration, flying up "
                    f"{100 * taken[1]:.0f} % came out of it"
                )
            yield f"{line}."


def _why_late(study: FlightStudy) -> Iterator[str]:
    """Say by how much the flown force of the traction follows the model's, where that explains much."""
    found = []
    for cycle in _phase_pairs(study, "traction"):
        again = cycle.phases["traction"].replayed
        found.append(delay(again.path.time_s, again.force_N, again.path.force_N))
    delays = [part for part in found if part is not None]
    if not delays:
        return
    late, at_once, best = (float(np.mean(column)) for column in zip(*delays, strict=True))
    if late >= LATE_S and best - at_once > LATE_GAIN:
        yield (
            f"The flown force of the traction follows the model's at the flown reeling speed {late:.1f} s later "
            f"(correlation {best:.2f}, against {at_once:.2f} at once), as it would if the kite needed time to reach "
            "the speed of its equilibrium, which a quasi-steady one has at every instant."
        )


def delay(time_s: FloatArray, cause: FloatArray, effect: FloatArray) -> tuple[float, float, float] | None:
    """Return how much later one series follows another (s), and their correlation at once and then.

    None for series that are constant, too short, or missing for the most part.
    """
    if time_s.size < FEWEST or time_s[-1] - time_s[0] < 4.0 * LONGEST_DELAY_S or np.isfinite(cause).mean() < 0.5:
        return None
    step = float(np.median(np.diff(time_s)))
    grid = np.arange(time_s[0], time_s[-1], step)
    known = np.isfinite(cause)
    one, other = np.interp(grid, time_s[known], cause[known]), np.interp(grid, time_s, effect)
    if min(np.std(one) / abs(np.mean(one)), np.std(other) / abs(np.mean(other))) < 1e-3:
        return None
    shifts = range(round(LONGEST_DELAY_S / step) + 1)
    found = [float(np.corrcoef(one[: one.size - shift], other[shift:])[0, 1]) for shift in shifts]
    best = int(np.argmax(found))
    return best * step, found[0], found[best]


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
            [
                (ends[0] - ends[1]) / SMOOTHED_S,
                study.problem.environment.gravity_m_s2 * np.cos(np.radians(part.elevation_deg)) * down,
            ]
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
    if np.mean(measured) > MIN_DURATION_RATIO * np.mean(modelled):
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
    if spreads and np.mean(spreads) > MIN_FORCE_SPREAD_SHARE:
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
    if known and max(known.values()) > MIN_FORCE_SPREAD_SHARE:
        best = min(known, key=lambda law: known[law])
        parts = "; ".join(f"{LAW_WORDS[law]} {100 * error:.0f} %" for law, error in known.items())
        yield (
            f"The mean power of a cycle is off by ({parts}), so that the schedule {LAW_WORDS[best]} tells most of this "
            "flight."
        )
