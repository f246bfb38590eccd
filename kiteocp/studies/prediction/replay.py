"""The model along the path that was flown: at every sample the force predicts the reeling speed, and the other way.

Position, course and power setting are the measured ones. With the force given the state is the closed form of the
equilibrium; with the reeling speed given the force is found on it by bisection, since more force means less speed. The
same holds for a winch that lets out the faster the harder the kite pulls: its law gives both.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import casadi as ca
import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.cycle.motion import at_ground_force, motion
from kiteocp.cycle.phases import TRACTION
from kiteocp.physics.kinematics import radians
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameters_of
from kiteocp.physics.wind import in_wind
from kiteocp.recording.cleaning import FloatArray
from kiteocp.recording.data import FlightData
from kiteocp.studies.prediction.measured import model_lengths, time_mean

#: Forces between which that of a reeling speed is looked for (N), and halvings of their ratio on the way.
FORCES_N, HALVINGS = (1.0, 1e6), 30

#: A winch has a law of its own where force and reeling speed of the traction correlate more than this, and the force is
#: not held: its standard deviation is more than a share of its mean.
LAWFUL, STEADY = 0.8, 0.02

#: Factors on the wind between which the matching one is looked for.
MATCH = (0.7, 1.5)

#: The speed of the force found may differ from that given by so much (m/s); more means that there is no equilibrium.
SPEED_TOLERANCE_M_S = 1e-6


class Path(msgspec.Struct, frozen=True):
    """Samples of a phase as the model takes them.

    Attributes
    ----------
    phase
        Its name.
    time_s
        Shape (n,).
    places
        Tether length (m), elevation, azimuth, course (deg) and power setting (0 to 1), shape (5, n).
    force_N, reeling_speed_m_s
        Measured at the ground, shape (n,).
    """

    phase: str
    time_s: FloatArray
    places: FloatArray
    force_N: FloatArray
    reeling_speed_m_s: FloatArray


class Replay(msgspec.Struct, frozen=True):
    """A phase flown again along its path.

    Attributes
    ----------
    reeling_speed_m_s, kite_speed_m_s
        By the measured force, nan where there is no equilibrium, shape (n,).
    force_N
        By the measured reeling speed, nan likewise.
    winch_force_N, winch_speed_m_s
        By the law of the winch, nan where there is none.
    """

    path: Path
    reeling_speed_m_s: FloatArray
    kite_speed_m_s: FloatArray
    force_N: FloatArray
    winch_force_N: FloatArray
    winch_speed_m_s: FloatArray

    def summary(self, duration_s: float) -> dict[str, float]:
        """Return what the phase would have been like, with the force and with the speed as flown.

        Means are over the samples that have an equilibrium; ``force_without`` and ``speed_without`` count the others.
        The measured means over those same samples (``..._measured``) are what to compare with.
        """
        time, path = self.path.time_s, self.path
        there = np.isfinite(self.reeling_speed_m_s)
        speed = time_mean(time, self.reeling_speed_m_s)
        held = np.isfinite(self.force_N)
        ruled = np.isfinite(self.winch_force_N)

        def masked(values: FloatArray, mask: NDArray[np.bool_]) -> float:
            return time_mean(time, np.where(mask, values, np.nan))

        found = {
            "force.reeled_length_m": speed * duration_s,
            "force.reeled_length_measured_m": masked(path.reeling_speed_m_s, there) * duration_s,
            "force.mean_power_W": time_mean(time, path.force_N * self.reeling_speed_m_s),
            "force.mean_power_measured_W": masked(path.force_N * path.reeling_speed_m_s, there),
            "force.mean_kite_speed_m_s": time_mean(time, self.kite_speed_m_s),
            "force.without": float(np.count_nonzero(~there)),
            "speed.mean_force_N": time_mean(time, self.force_N),
            "speed.mean_force_measured_N": masked(path.force_N, held),
            "speed.mean_power_W": time_mean(time, self.force_N * path.reeling_speed_m_s),
            "speed.mean_power_measured_W": masked(path.force_N * path.reeling_speed_m_s, held),
            "speed.without": float(np.count_nonzero(~held)),
        }
        if ruled.any():
            found |= {
                "winch.mean_force_N": time_mean(time, self.winch_force_N),
                "winch.mean_force_measured_N": masked(path.force_N, ruled),
                "winch.mean_power_W": time_mean(time, self.winch_force_N * self.winch_speed_m_s),
                "winch.mean_power_measured_W": masked(path.force_N * path.reeling_speed_m_s, ruled),
                "winch.reeled_length_m": time_mean(time, self.winch_speed_m_s) * duration_s,
                "winch.reeled_length_measured_m": masked(path.reeling_speed_m_s, ruled) * duration_s,
                "winch.without": float(np.count_nonzero(~ruled)),
            }
        return found


class FlownWinchLaw(msgspec.Struct, frozen=True):
    """How a winch reeled out over force: ``speed = speed_m_s + slope_m_s_per_N (force - force_N)``.

    Attributes
    ----------
    force_N, speed_m_s
        A point of the line: the means of the samples it was fitted to.
    slope_m_s_per_N
        Not negative.
    correlation
        Of force and speed; 1 where the winch did nothing else.
    """

    force_N: float
    speed_m_s: float
    slope_m_s_per_N: float
    correlation: float

    def speed(self, force_N: FloatArray) -> FloatArray:
        """Return the reeling speed (m/s) at forces (N)."""
        return self.speed_m_s + self.slope_m_s_per_N * (force_N - self.force_N)


def winch_law(flight: FlightData) -> FlownWinchLaw | None:
    """Return the law that the tractions of a flight show; None where speed and force do not go together."""
    among = (flight.phase == "traction") & np.isfinite(flight.tether_force_ground_N * flight.reeling_speed_m_s)
    force, speed = flight.tether_force_ground_N[among], flight.reeling_speed_m_s[among]
    if force.size < 3 or np.std(force) <= STEADY * np.mean(force) or np.std(speed) == 0:
        return None
    correlation = float(np.corrcoef(force, speed)[0, 1])
    slope = correlation * float(np.std(speed) / np.std(force))
    if correlation < LAWFUL:
        return None
    return FlownWinchLaw(float(force.mean()), float(speed.mean()), slope, correlation)


def path_of(flight: FlightData, cycle: int, phase: str, setting: tuple[float, float]) -> Path:
    """Return the path of a phase of a cycle, samples with a missing value left out.

    Parameters
    ----------
    flight
        In the frame of its wind.
    cycle, phase
        Which samples.
    setting
        Measured power setting that the depowered and the powered coefficients belong to. In retraction and traction
        the kite has the coefficients of that phase; on the way between them those of the setting measured, powered
        where none is.
    """
    among = (flight.cycle == cycle) & (flight.phase == phase)
    if phase in ("retraction", "traction"):
        power = np.full(len(flight), 0.0 if phase == "retraction" else 1.0)
    else:
        low, high = setting
        scaled = (flight.power_setting - low) / (high - low) if high > low else np.full(len(flight), np.nan)
        power = np.where(np.isfinite(scaled), np.clip(scaled, 0.0, 1.0), 1.0)
    places = np.stack([model_lengths(flight), flight.elevation_deg, flight.azimuth_deg, flight.course_deg, power])
    force, speed = flight.tether_force_ground_N, flight.reeling_speed_m_s
    among &= np.all(np.isfinite(places), axis=0) & np.isfinite(force) & np.isfinite(speed)
    return Path(phase, flight.time_s[among], places[:, among], force[among], speed[among])


def replay(path: Path, values: ParameterValues, law: FlownWinchLaw | None = None) -> Replay:
    """Fly a path again in the model of given numbers, by force, by speed and, in reel-out, by the law of the winch."""
    function = _state_function(values.structure).map(path.time_s.size)

    def state(force: FloatArray) -> tuple[FloatArray, FloatArray]:
        speed, kite_speed = np.asarray(function(np.vstack([path.places, force]), values.vector))
        return speed, kite_speed

    def force_at(wanted: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the force at which the model reels as fast as the winch wants to, which does not fall with force."""
        low, high = (np.full(path.time_s.size, np.log(force)) for force in FORCES_N)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            force = np.exp(middle)
            # Too little force to fly with counts as too fast.
            more = ~(state(force)[0] <= wanted(force))
            low, high = np.where(more, middle, low), np.where(more, high, middle)
        force = np.exp(high)
        off = np.abs(state(force)[0] - wanted(force))
        return np.where(off <= SPEED_TOLERANCE_M_S, force, np.nan)

    speed, kite_speed = state(path.force_N)
    by_speed = force_at(lambda force: path.reeling_speed_m_s)
    missing = np.full(path.time_s.size, np.nan)
    by_winch = force_at(law.speed) if law is not None and path.phase == "traction" else missing
    return Replay(path, speed, kite_speed, by_speed, by_winch, missing if law is None else law.speed(by_winch))


def matching_wind(path: Path, values: ParameterValues) -> float | None:
    """Return the factor on the wind with which the flown force makes the path reel out as far as measured.

    None where no factor in `MATCH` does.
    """
    function = _state_function(values.structure).map(path.time_s.size)
    inputs, measured = np.vstack([path.places, path.force_N]), time_mean(path.time_s, path.reeling_speed_m_s)

    def excess(factor: float) -> float:
        found = np.asarray(function(inputs, in_wind(values, factor).vector))[0]
        # Without an equilibrium there is too little wind.
        return (time_mean(path.time_s, found) if np.isfinite(found).all() else -np.inf) - measured

    if not (excess(MATCH[0]) < 0 < excess(MATCH[1])):
        return None
    low, high = MATCH
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excess(middle) > 0 else (middle, high)
    return high


@lru_cache(maxsize=16)
def _state_function(structure: Structure) -> ca.Function:
    """Build (once) ``((place, ground force), p) -> reeling speed, speed across the tether``, stacked."""
    parameters, inputs = parameters_of(structure), ca.SX.sym("inputs", 6)
    model = Model(parameters)
    length, elevation, azimuth, course, setting, tension = ca.vertsplit(inputs)
    state = motion(
        model,
        TRACTION,
        length,
        radians(elevation),
        at_ground_force(tension),
        power_setting=setting,
        course=radians(course),
        azimuth=radians(azimuth),
    ).flight
    outputs = ca.vertcat(state.reeling_speed, state.tangential_speed)
    return ca.Function("state", [inputs, parameters.vector], [ca.densify(outputs)])
