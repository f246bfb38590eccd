"""The estimated aerodynamics on cycles that they do not come from, without the equilibrium."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from kiteocp.physics.aerodynamics import resultant_coefficient
from kiteocp.studies.estimation.inversion import invert

if TYPE_CHECKING:
    from kiteocp.studies.prediction.study import FlightStudy

#: Samples below which a traction is left out, and the least relative variation for a correlation.
FEWEST, VARYING = 20, 0.05


class ForceCheck(msgspec.Struct, frozen=True):
    """Aerodynamic force of the traction by wind, measured velocity and estimated coefficients, over the measured one.

    Attributes
    ----------
    deviations
        Relative deviation of the mean, for each predicted cycle.
    correlations
        Sample by sample, for the cycles whose force varies.
    """

    deviations: tuple[float, ...]
    correlations: tuple[float, ...]


def check_forces(study: FlightStudy) -> ForceCheck:
    """Hold the force that follows from wind and velocity of the kite against the measured one (eq:F_a_magnitude2).

    The measured force is that at the ground with the weights (eq:aeroforcer_fromexp). The model's equilibrium has no
    part in it: what agrees here, and not by the laws, differs in the speed at which the model's kite flies.
    """
    deviations, correlations = [], []
    lift, kite_drag = (
        study.kite.fit.coefficients("powered") if "powered" in study.kite.fit.samples else (np.nan, np.nan)
    )
    for cycle in study.cycles:
        wind = cycle.wind.estimate
        part = wind.turned(study.flight).select([cycle.measured.number], "traction")
        found = invert(part, wind.applied(study.kite.base)).quantities
        tether_drag = (
            found["exact.lift_coefficient"] / found["exact.lift_to_drag"] - found["exact.kite_drag_coefficient"]
        )
        force = found["aerodynamic_force_N"]
        # The same speed on both sides: the forces are as the coefficients.
        resultant = np.asarray(resultant_coefficient(lift, kite_drag + tether_drag), dtype=float).ravel()
        predicted = force * resultant / found["exact.resultant_coefficient"]
        known = np.isfinite(predicted)
        if np.count_nonzero(known) < FEWEST:
            continue
        deviations.append(float(np.mean(predicted[known]) / np.mean(force[known])) - 1.0)
        if np.std(force[known]) > VARYING * np.mean(force[known]):
            correlations.append(float(np.corrcoef(predicted[known], force[known])[0, 1]))
    return ForceCheck(tuple(deviations), tuple(correlations))
