"""Laws a winch can hold: reeling speed as a function of the force it measures, or of tether length.

The force law follows the classical winch laws (R. H. Luchsinger, *Pumping cycle kite power*, in: Airborne Wind Energy,
Springer 2013; U. Fechner and R. Schmehl, *Feed-forward control of kite power systems*, J. Phys. Conf. Ser. 524, 2014):
speed rises with force, so that a gust is answered by reeling out. Because the force of a kite falls with the reeling
speed, a law that never falls meets it exactly once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import msgspec
import numpy as np
from scipy.optimize import least_squares

from kiteocp.cycle.phases import KINDS, PhaseName
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.physics.parameters import ParameterValues

Kind = Literal["force", "length"]

#: The steepest law takes the winch through its whole range of speeds within this share of the largest force: stiff
#: enough to hold a force within a few percent, and a finite gain, which a real winch needs.
FORCE_BAND = 0.05

#: Knots of a force law between the force limits, ends included, and of a length law.
FORCE_KNOTS = 7
LENGTH_KNOTS = 9

#: Weight of the optimum in another wind, relative to the one in the wind of the problem.
OFF_DESIGN_WEIGHT = 0.2

#: Weights, relative to the samples, of overstepping a force limit, of a winch that stands still at the smallest force,
#: and of the smoothness that decides where there is no sample.
OVERSTEP, STANDSTILL, SMOOTHNESS = 10.0, 0.02, 0.01


class WinchLaw(msgspec.Struct, frozen=True):
    """A piecewise linear law of the reeling speed in one phase, constant beyond its outer knots.

    Attributes
    ----------
    phase
        The phase it is for.
    kind
        ``force``, or ``length`` for a feed-forward.
    quantity
        What it takes: ``tether_force_ground_N``, ``tether_length_m`` or ``elevation_deg``.
    knots, reeling_speed_m_s
        The law, shape (n,); knots rise, and in a force law the speeds do not fall.
    valid
        Range of the quantity met in the optimum (of all winds it was fitted to).
    error_rms_m_s, error_max_m_s
        Difference in speed from the optimum over the time of the phase: at the same place for a length law, where the
        kite meets the law for a force law.
    """

    phase: PhaseName
    kind: Kind
    quantity: str
    knots: np.ndarray
    reeling_speed_m_s: np.ndarray
    valid: tuple[float, float]
    error_rms_m_s: float
    error_max_m_s: float

    def __call__(self, value: Any) -> Any:
        """Reeling speed (m/s) at values of the quantity, shape as given."""
        return np.interp(value, self.knots, self.reeling_speed_m_s)

    @property
    def steepest_slope(self) -> float:
        """Largest slope of the law, m/s per unit of the quantity."""
        return float(np.max(np.abs(np.diff(self.reeling_speed_m_s) / np.diff(self.knots))))

    def to_dict(self) -> dict[str, Any]:
        """Return the law as it is written to ``laws.json``."""
        return {
            "kind": self.kind,
            "quantity": self.quantity,
            "form": "piecewise linear between knots, constant beyond the outer ones",
            "knots": {self.quantity: self.knots.tolist(), "reeling_speed_m_s": self.reeling_speed_m_s.tolist()},
            "valid_from": self.valid[0],
            "valid_to": self.valid[1],
            "steepest_slope_m_s_per_unit": self.steepest_slope,
            "fit_error_rms_m_s": self.error_rms_m_s,
            "fit_error_max_m_s": self.error_max_m_s,
        }


def progress_of(record: PhaseRecord) -> tuple[str, np.ndarray]:
    """Return the quantity that tells how far a phase is, and its samples: elevation or tether length."""
    if KINDS[record.name].progress == "elevation":
        return "elevation_deg", np.degrees(record.elevation_rad)
    return "tether_length_m", record.tether_length_m


def is_monotone(samples: np.ndarray) -> bool:
    """Whether samples rise or fall throughout, so that a function of them is defined."""
    steps = np.diff(samples)
    return bool(np.all(steps > 0) or np.all(steps < 0))


def ground_force_limits(record: PhaseRecord, values: ParameterValues) -> tuple[float, float]:
    """Return the force limits as the ground measures them, N.

    A limit that acts at the kite is reduced by the largest difference of the two forces in the phase.
    """
    difference = record.output("tether_force_kite") - record.output("tether_force_ground")
    lowest, highest = values["limits.tether_force_min_N"], values["limits.tether_force_max_N"]
    if values.structure.choice("limits.tether_force_min_at") == "kite":
        lowest -= float(difference.min())
    if values.structure.choice("limits.tether_force_max_at") == "kite":
        highest -= float(difference.max())
    return lowest, highest


def fit_force_law(nominal: PhaseRecord, others: Sequence[PhaseRecord], values: ParameterValues) -> WinchLaw:
    """Fit a force law to the optimum of a phase.

    What is made small is the difference between the speed of the optimum and the speed at which the kite, its force
    falling with speed as the aerodynamic force does, would meet the law: a steep law misses a speed by little although
    it is far from it at the same force. Between the force limits the slope lies between zero and the steepest
    (`FORCE_BAND`); beyond them it is the steepest, up to the winch's fastest speeds.

    Parameters
    ----------
    nominal
        The phase in the wind of the problem.
    others
        The same phase of optima in other winds; they shape the law where the nominal one has no samples.
    values
        The problem's numbers.
    """
    fastest_in, fastest_out = values["limits.reel_in_speed_max_m_s"], values["limits.reel_out_speed_max_m_s"]
    lowest, highest = ground_force_limits(nominal, values)
    slope_max = (fastest_in + fastest_out) / (FORCE_BAND * values["limits.tether_force_max_N"])
    inner = _force_knots(nominal, lowest, highest)
    samples = [_Samples.of(nominal, 1.0), *(_Samples.of(record, OFF_DESIGN_WEIGHT) for record in others)]

    def law(unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Knots and speeds of a speed at the lowest force (m/s) and the slopes above it over the steepest."""
        speeds = unknowns[0] + np.r_[0.0, np.cumsum(slope_max * unknowns[1:] * np.diff(inner))]
        # Beyond the limits of force as steep as may be, up to the fastest speeds and past them.
        step = (fastest_in + fastest_out) / slope_max
        knots = np.r_[inner[0] - step, inner, inner[-1] + step]
        return knots, np.r_[speeds[0] - step * slope_max, speeds, speeds[-1] + step * slope_max]

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        knots, speeds = law(unknowns)
        parts = []
        for one in samples:
            met = one.met_force(knots, speeds)
            parts.append(one.weights * (met - one.force) / one.stiffness)
        met, first = samples[0].met_force(knots, speeds), samples[0]
        over = np.maximum(met - highest, 0.0) + np.maximum(lowest - met, 0.0)
        parts.append(OVERSTEP * first.weights * over / first.stiffness)
        if nominal.name == "traction":
            parts.append(STANDSTILL * speeds[1:2])
        parts.append(SMOOTHNESS * np.diff(unknowns[1:]) * (fastest_in + fastest_out))
        return np.concatenate(parts)

    bounds = np.r_[-fastest_in, np.zeros(inner.size - 1)], np.r_[fastest_out, np.ones(inner.size - 1)]
    speed = samples[0].speed
    starts = (
        np.r_[np.clip(speed.min(), -0.99 * fastest_in, 0.99 * fastest_out), np.full(inner.size - 1, share)]
        for share in (0.02, 0.3)
    )
    best = min((least_squares(residuals, start, bounds=bounds) for start in starts), key=lambda found: found.cost)
    knots, speeds = _saturated(*law(best.x), -fastest_in, fastest_out)
    force = np.concatenate([one.force for one in samples])
    return WinchLaw(
        nominal.name,
        "force",
        "tether_force_ground_N",
        knots,
        speeds,
        (float(force.min()), float(force.max())),
        *_errors(nominal, speed + (samples[0].force - samples[0].met_force(knots, speeds)) / samples[0].stiffness),
    )


class _Samples(msgspec.Struct, frozen=True):
    """Ground force (N), speed (m/s), fall of the force with the speed (N s/m) and weight of samples, shape (n,)."""

    force: np.ndarray
    speed: np.ndarray
    stiffness: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, record: PhaseRecord, weight: float) -> _Samples:
        # The aerodynamic force goes with the square of the apparent wind, whose radial part the reeling takes away.
        force = record.output("tether_force_ground")
        stiffness = 2 * force / np.maximum(record.output("radial_apparent_wind_speed"), 0.1)
        return cls(force, record.output("reeling_speed"), stiffness, np.full(force.size, np.sqrt(weight / force.size)))

    def met_force(self, knots: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Force at which the kite near each sample meets a law that does not fall, N."""
        slopes = np.diff(speeds) / np.diff(knots)
        # Along the kite's line the law's speed less the kite's rises with the force: the zero lies in one piece.
        excess = speeds + (knots - self.force[:, None]) / self.stiffness[:, None] - self.speed[:, None]
        piece = np.clip(np.sum(excess < 0, axis=1) - 1, 0, slopes.size - 1)
        here = np.take_along_axis(excess, piece[:, None], axis=1)[:, 0]
        met: np.ndarray = knots[piece] - here / (slopes[piece] + 1 / self.stiffness)
        return met


def _saturated(knots: np.ndarray, speeds: np.ndarray, slowest: float, fastest: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut a rising law off at two speeds, with knots where it reaches them."""
    rising = speeds + 1e-9 * np.arange(speeds.size)
    ends = np.interp([slowest, fastest], rising, knots)
    keep = (speeds > slowest + 1e-6) & (speeds < fastest - 1e-6)
    return np.r_[ends[0], knots[keep], ends[1]], np.r_[slowest, speeds[keep], fastest]


def fit_length_law(nominal: PhaseRecord) -> WinchLaw | None:
    """Fit the speed over the progress of a phase (tether length; elevation in the transition) by least squares.

    None where the progress is not monotone, so that no function of it exists.
    """
    quantity, progress = progress_of(nominal)
    if not is_monotone(progress):
        return None
    speed = nominal.output("reeling_speed")
    knots = np.linspace(progress.min(), progress.max(), LENGTH_KNOTS)
    basis = _basis(progress, knots)
    fitted = np.linalg.lstsq(basis, speed, rcond=None)[0]
    speeds = _basis(knots, knots) @ fitted
    return WinchLaw(
        nominal.name,
        "length",
        quantity,
        knots,
        speeds,
        (float(knots[0]), float(knots[-1])),
        *_errors(nominal, np.interp(progress, knots, speeds)),
    )


def _force_knots(nominal: PhaseRecord, lowest: float, highest: float) -> np.ndarray:
    """Knots at the limits, half a force band inside them, and spread between evenly over the forces met."""
    band = 0.5 * FORCE_BAND * highest
    if highest - lowest <= 3 * band:
        return np.linspace(lowest, highest, FORCE_KNOTS)
    inner = (lowest + band, highest - band)
    force = np.clip(nominal.output("tether_force_ground"), *inner)
    between = np.linspace(force.min(), force.max(), FORCE_KNOTS - 2)[1:-1]
    if between[-1] - between[0] < band:
        between = np.linspace(*inner, FORCE_KNOTS - 2)[1:-1]
    return np.array([lowest, inner[0], *between, inner[1], highest])


def _basis(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Matrix of a piecewise linear function in its first value and its slopes, constant beyond the outer knots."""
    ramps = np.clip(x[:, None], knots[:-1], knots[1:]) - knots[:-1]
    basis: np.ndarray = np.column_stack([np.ones(x.size), ramps])
    return basis


def _errors(record: PhaseRecord, speed: np.ndarray) -> tuple[float, float]:
    error = speed - record.output("reeling_speed")
    mean_square = np.trapezoid(error**2, record.time_s) / record.duration_s
    return float(np.sqrt(mean_square)), float(np.max(np.abs(error)))
