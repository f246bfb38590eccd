"""Least squares that outliers cannot bend, with the covariance of correlated residuals (an MM-estimator).

Residuals come in columns; each has one scale for each group of samples. From the start, least squares with the
Cauchy loss gives residuals and with them the scales (median absolute deviation). With the scales held, the
parameters are found again with Tukey's biweight, which gives a residual beyond 4.7 scales no weight at all: a wrong
sample then has no influence, where a convex loss (Huber's, or ``soft_l1``) leaves each a bounded one, in proportion to
its derivatives, which a wrong speed makes large. The first stage keeps the second from a wrong minimum.

The covariance is the sandwich ``A^-1 B A^-1`` of M-estimation; the influence of the samples on a parameter is a time
series, whose variance of the sum takes its autocorrelation into account as in `averages`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from kiteocp.numerics.averages import effective_samples, quantile

FloatArray = NDArray[np.float64]

#: From parameters (k,) to residuals (n, m) and their derivatives (n, m, k).
Residuals = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

#: Tukey's constant: 95 % as efficient as least squares where all residuals are normal.
TUKEY = 4.685

#: Standard deviations in a median absolute deviation of normal residuals.
NORMAL = 1.4826

#: Scales below this (in the unit of the residuals, m/s here) are rounding of the arithmetic.
SMALLEST_SCALE = 1e-9

#: Least mean curvature of the loss over good residuals; it is 0.79 where they are normal.
SMALLEST_CURVATURE = 0.1

#: Rounds of the two stages; the second stops when no parameter moves by more than this share of itself, or where no
#: step of at least this share of the proposed one lowers the loss.
FIRST_ROUNDS, SECOND_ROUNDS, TOLERANCE, SMALLEST_SHARE = 3, 50, 1e-8, 1e-3


class RobustFit(msgspec.Struct, frozen=True):
    """Parameters with their uncertainty.

    Attributes
    ----------
    names, values
        The parameters, shape (k,).
    standard_errors, effective_samples
        Of each parameter, shape (k,).
    correlation
        Of their errors, shape (k, k).
    condition
        Ratio of the largest to the smallest singular value of the weighted derivatives with columns of length 1: large
        where parameters cannot be told apart.
    residuals
        At the solution, shape (n, m).
    outliers
        Samples whose residual in some column has no weight, shape (n,).
    scales
        Standard deviation of good residuals, shape (groups, m).
    """

    names: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    effective_samples: FloatArray
    correlation: FloatArray
    condition: float
    residuals: FloatArray
    outliers: NDArray[np.bool_]
    scales: FloatArray

    def value(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.values[self.names.index(name)])

    def interval(self, name: str) -> tuple[float, float]:
        """Return the ends of a parameter's confidence interval (Student's t of n_eff - 1 degrees of freedom)."""
        index = self.names.index(name)
        half = float(self.standard_errors[index]) * quantile(float(self.effective_samples[index]))
        return float(self.values[index]) - half, float(self.values[index]) + half

    def parameter(self, name: str) -> dict[str, Any]:
        """Return a parameter with the keys of the summary."""
        index = self.names.index(name)
        return {
            "value": float(self.values[index]),
            "standard_error": float(self.standard_errors[index]),
            "interval": list(self.interval(name)),
            "effective_samples": float(self.effective_samples[index]),
        }

    def correlation_of(self, first: str, second: str) -> float:
        """Return the correlation of the errors of two parameters."""
        return float(self.correlation[self.names.index(first), self.names.index(second)])


def robust_fit(
    names: Sequence[str],
    residuals: Residuals,
    start: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    time_s: FloatArray,
    groups: NDArray[np.int64],
) -> RobustFit:
    """Fit parameters to residuals.

    Parameters
    ----------
    names, start, lower, upper
        The parameters, where to start, and their bounds, shape (k,).
    residuals
        The residuals in one unit, every entry finite.
    time_s
        Time of each sample, ascending, shape (n,).
    groups
        Group of each sample, 0 to the number of groups less 1, each with samples; shape (n,).
    """
    count = int(groups.max()) + 1

    def scales_of(found: FloatArray) -> FloatArray:
        parts = [NORMAL * np.median(np.abs(found[groups == group]), axis=0) for group in range(count)]
        scales: FloatArray = np.maximum(np.stack(parts), SMALLEST_SCALE)
        return scales

    values = np.clip(start, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower))
    for _ in range(FIRST_ROUNDS):
        values = _softly_fitted(residuals, values, scales_of(residuals(values)[0])[groups], lower, upper)
    scales = scales_of(residuals(values)[0])
    values = _reweighted(residuals, values, TUKEY * scales[groups], lower, upper)
    return _with_covariance(tuple(names), residuals, values, time_s, groups, scales)


def _softly_fitted(
    residuals: Residuals, start: FloatArray, scale: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Least squares of scaled residuals with the Cauchy loss."""
    last: dict[str, Any] = {}

    # Derivatives are mostly asked for where the residuals just were.
    def scaled(at: FloatArray) -> FloatArray:
        found, slopes = residuals(at)
        last["slopes"] = (slopes / scale[:, :, None]).reshape(-1, at.size)
        last["at"] = at.copy()
        return np.asarray(found / scale).ravel()

    def derivatives(at: FloatArray) -> Any:
        if not np.array_equal(last["at"], at):
            scaled(at)
        return last["slopes"]

    result = least_squares(
        scaled,
        start,
        jac=derivatives,
        bounds=(lower, upper),
        loss="cauchy",
        x_scale="jac",
        ftol=1e-6,
        xtol=1e-6,
    )
    found: FloatArray = result.x
    return found


def tukey_loss(found: FloatArray, reach: FloatArray | float) -> float:
    """Sum of Tukey's loss: of each residual from 0 to 1 where it reaches the distance at which it has no weight."""
    inside = np.minimum((found / reach) ** 2, 1.0)
    return float(np.sum(1.0 - (1.0 - inside) ** 3))


def _reweighted(
    residuals: Residuals, start: FloatArray, reach: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Minimise Tukey's loss by reweighted Gauss-Newton steps, halved while they do not lower it."""
    values = start
    found, slopes = residuals(values)
    for _ in range(SECOND_ROUNDS):
        weight = np.maximum(1.0 - (found / reach) ** 2, 0.0) / reach
        rows = (slopes * weight[:, :, None]).reshape(-1, values.size)
        step = np.linalg.lstsq(rows, -(found * weight).ravel(), rcond=None)[0]
        now, share = tukey_loss(found, reach), 1.0
        while share > SMALLEST_SHARE:
            trial = np.clip(values + share * step, lower, upper)
            new, new_slopes = residuals(trial)
            if tukey_loss(new, reach) <= now:
                break
            share /= 2.0
        else:
            break
        values, found, slopes = trial, new, new_slopes
        if np.all(np.abs(share * step) <= TOLERANCE * np.maximum(np.abs(values), 1e-3)):
            break
    return values


def _with_covariance(
    names: tuple[str, ...],
    residuals: Residuals,
    values: FloatArray,
    time_s: FloatArray,
    groups: NDArray[np.int64],
    scales: FloatArray,
) -> RobustFit:
    found, slopes = residuals(values)
    scale = scales[groups]
    ratio = found / (TUKEY * scale)
    inside = np.abs(ratio) < 1.0
    score = np.where(inside, ratio * TUKEY * (1.0 - ratio**2) ** 2, 0.0)
    curvature = np.where(inside, (1.0 - ratio**2) * (1.0 - 5.0 * ratio**2), 0.0)
    # The mean curvature of the group instead of each sample's: it is never negative in sum. Samples without weight
    # have none, however large their derivatives are.
    mean_curvature = np.empty_like(curvature)
    for group, column in np.ndindex(scales.shape):
        good = (groups == group) & inside[:, column]
        mean_curvature[groups == group, column] = max(float(np.mean(curvature[good, column])), SMALLEST_CURVATURE)
    scaled = slopes / scale[:, :, None]
    weighted = scaled * np.sqrt(mean_curvature * inside)[:, :, None]
    stacked = weighted.reshape(-1, len(names))
    inverse = np.linalg.pinv(stacked.T @ stacked)
    influence = np.einsum("nm,nmk->nk", score, scaled) @ inverse
    freedom = len(found) / max(len(found) - len(names), 1)
    # Samples of another phase do not bear on a coefficient of this one: they are gaps in its series.
    series = np.where(np.abs(influence) > 1e-12 * np.max(np.abs(influence), axis=0), influence, np.nan)
    felt = np.count_nonzero(np.isfinite(series), axis=0)
    by_influence = np.array([effective_samples(time_s, column) for column in series.T])
    variance = freedom * np.sum(influence**2, axis=0) * felt / np.maximum(by_influence, 1.0)
    # Parameters that lean on a short stretch bend to the slow errors there, and little is left to see of them: the
    # autocorrelation of the residuals themselves is the other bound.
    repeats = np.ones_like(scales)
    for group, column in np.ndindex(scales.shape):
        part = np.where(groups == group, score[:, column], np.nan)
        repeats[group, column] = np.count_nonzero(np.isfinite(part)) / max(effective_samples(time_s, part), 1.0)
    parts = (score * np.sqrt(repeats[groups]))[:, :, None] * scaled @ inverse
    covariance = freedom * np.einsum("nmi,nmj->ij", parts, parts)
    by_residuals = felt * freedom * np.sum(influence**2, axis=0) / np.maximum(np.diag(covariance), 1e-300)
    errors = np.sqrt(np.maximum(variance, np.diag(covariance)))
    effective = np.clip(np.minimum(by_influence, by_residuals), 1.0, felt)
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    lengths = np.linalg.norm(stacked, axis=0)
    return RobustFit(
        names=names,
        values=values,
        standard_errors=errors,
        effective_samples=effective,
        correlation=covariance / np.outer(spread, spread),
        condition=float(np.linalg.cond(stacked / np.where(lengths > 0, lengths, 1.0))),
        residuals=found,
        outliers=np.any(~inside, axis=1),
        scales=scales,
    )
