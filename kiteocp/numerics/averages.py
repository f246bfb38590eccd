"""Means of autocorrelated time series, with confidence intervals that know how few samples are independent.

The variance of the mean of n samples is ``sum over i, j of gamma(|i - j|) / n^2``, gamma the autocovariance, and
n_eff = gamma(0) / variance = n / (2 tau_int) is the number of independent samples that would tell as much. The sum is
cut at the automatic window of Sokal (*Monte Carlo Methods in Statistical Mechanics*, 1997): the smallest lag M of at
least `WINDOW` integrated autocorrelation times. Only pairs that were measured count, at the lag they have in time, so
that gaps (and the other phases between two stretches of one phase) neither join nor part what they separate.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

FloatArray = NDArray[np.float64]

#: Integrated autocorrelation times that the window spans; 4 to 6 balance what is cut off against noise.
WINDOW = 5.0

#: Largest share of the variance that removing the sample's own mean may have taken away within the window.
LARGEST_LOSS = 0.5

#: Probability that an interval covers the true value.
CONFIDENCE = 0.95


class Average(msgspec.Struct, frozen=True):
    """A mean with its confidence interval.

    Attributes
    ----------
    mean, standard_error
        In the unit of the series; nan without samples.
    low, high
        Ends of the interval of confidence `CONFIDENCE`, by Student's t of n_eff - 1 degrees of freedom.
    samples
        Finite samples averaged.
    effective_samples
        Independent samples that would tell as much, n_eff.
    autocorrelation_time_s
        Integrated autocorrelation time tau_int.
    """

    mean: float
    standard_error: float
    low: float
    high: float
    samples: int
    effective_samples: float
    autocorrelation_time_s: float

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return {
            "mean": self.mean,
            "standard_error": self.standard_error,
            "interval": [self.low, self.high],
            "samples": self.samples,
            "effective_samples": self.effective_samples,
            "autocorrelation_time_s": self.autocorrelation_time_s,
        }


def average(time_s: FloatArray, values: FloatArray) -> Average:
    """Average a series; nan entries are gaps.

    Parameters
    ----------
    time_s, values
        Times, ascending, and what was measured then, shape (n,).
    """
    finite = np.isfinite(values)
    count = int(np.count_nonzero(finite))
    if count == 0:
        return Average(np.nan, np.nan, np.nan, np.nan, 0, 0.0, np.nan)
    step = sampling_time(time_s)
    mean = float(np.mean(values[finite]))
    spread = float(np.std(values[finite]))
    if count == 1:
        return Average(mean, np.nan, np.nan, np.nan, 1, 1.0, np.nan)
    effective = effective_samples(time_s, values)
    # The spread about the sample's own mean is less than that about the true one.
    error = spread / np.sqrt(max(effective - 1.0, 0.5))
    half = error * quantile(effective)
    return Average(
        mean, float(error), float(mean - half), float(mean + half), count, effective, 0.5 * count / effective * step
    )


def quantile(effective: float) -> float:
    """Half width of an interval of confidence `CONFIDENCE` in standard errors, by Student's t (1 degree at least)."""
    return float(stdtrit(max(effective - 1.0, 1.0), 0.5 * (1.0 + CONFIDENCE)))


def sampling_time(time_s: FloatArray) -> float:
    """Return the usual time between two samples, s; 1 where there are fewer than two."""
    steps = np.diff(time_s)
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else 1.0


def effective_samples(time_s: FloatArray, values: FloatArray) -> float:
    """Return n_eff of a series about its mean, between 1 and the number of finite samples; nan entries are gaps."""
    finite = np.isfinite(values)
    count = int(np.count_nonzero(finite))
    if count < 3:
        # Two samples about their own mean tell nothing of their correlation.
        return float(min(count, 1))
    deviation = values[finite] - np.mean(values[finite])
    if not np.max(np.abs(deviation)) > 1e-12 * np.max(np.abs(values[finite])):
        # A constant: what differs is rounding.
        return float(count)
    place = np.rint((time_s[finite] - time_s[finite][0]) / sampling_time(time_s)).astype(int)
    length = int(place[-1]) + 1
    series, there = np.zeros(length), np.zeros(length)
    series[place], there[place] = deviation, 1.0
    products, pairs = _lagged_sums(series), _lagged_sums(there)
    # What is summed up to each lag, over n^2: the variance of the mean, and how much of a constant covariance the
    # removal of the mean takes away from it (the expectation of a product is less by just that variance).
    weight = np.full(length, 2.0)
    weight[0] = 1.0
    variance = np.cumsum(weight * products) / count**2
    loss = np.cumsum(weight * pairs) / count**2
    inside = loss < LARGEST_LOSS
    corrected = variance[inside] / (1.0 - loss[inside])
    # A mean cannot vary less than that of independent samples does when neighbours resemble each other.
    corrected = np.maximum(corrected, products[0] / count**2)
    effective = np.clip((products[0] / count + corrected) / corrected, 1.0, count)
    times = 0.5 * count / effective
    wide = np.flatnonzero(np.arange(times.size) >= WINDOW * times)
    return float(effective[wide[0]] if wide.size else np.min(effective))


def _lagged_sums(series: FloatArray) -> FloatArray:
    """Return the sum of ``series[i] * series[i + k]`` for every lag k, shape (n,)."""
    size = 1 << (2 * series.size - 1).bit_length()
    spectrum = np.fft.rfft(series, size)
    sums: FloatArray = np.fft.irfft(np.abs(spectrum) ** 2, size)[: series.size]
    return sums
