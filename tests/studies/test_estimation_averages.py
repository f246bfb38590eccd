"""Means of autocorrelated series: against processes whose mean and autocorrelation are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from kiteocp.numerics.averages import average, effective_samples

STEP_S = 0.1


def first_order(random: np.random.Generator, count: int, keep: float) -> np.ndarray:
    """A stationary process of first order with mean 0 and variance 1; tau_int is (1 + keep) / (1 - keep) / 2 steps."""
    noise = random.normal(size=count)
    noise[1:] *= np.sqrt(1.0 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], noise))


@pytest.mark.parametrize(("keep", "count", "gaps"), [(0.0, 200, False), (0.8, 600, False), (0.9, 1200, True)])
def test_intervals_cover_the_mean_as_often_as_they_say(keep: float, count: int, gaps: bool) -> None:
    random, repetitions, covered = np.random.default_rng(1), 400, 0
    time = STEP_S * np.arange(count)
    effective = []
    for _ in range(repetitions):
        series = 7.0 + first_order(random, count, keep)
        if gaps:
            series[count // 3 : count // 2] = np.nan
            series[random.random(count) < 0.05] = np.nan
        found = average(time, series)
        covered += found.low <= 7.0 <= found.high
        effective.append(found.effective_samples)
    # 95 % intervals from an estimated autocorrelation are known to cover a little less; 93 % is allowed for.
    low, high = binom.interval(0.998, repetitions, [0.93, 0.95])
    assert low[0] <= covered <= high[1]
    independent = np.count_nonzero(np.isfinite(series)) * (1 - keep) / (1 + keep)
    # A gap separates what lies on its sides: more independent samples for the same number of them, never fewer.
    assert np.median(effective) == pytest.approx(independent, rel=0.2)


def test_pretending_independence_would_cover_far_too_seldom() -> None:
    random, covered = np.random.default_rng(2), 0
    for _ in range(200):
        series = first_order(random, 1000, 0.95)
        covered += abs(series.mean()) <= 1.96 * series.std() / np.sqrt(series.size)
    assert covered < 0.5 * 200


def test_known_autocorrelation_time_comes_out() -> None:
    series = first_order(np.random.default_rng(3), 200_000, 0.9)
    found = average(STEP_S * np.arange(series.size), series)
    assert found.autocorrelation_time_s == pytest.approx(0.5 * 19.0 * STEP_S, rel=0.05)
    assert found.samples == series.size


def test_a_gap_is_neither_closed_nor_counted() -> None:
    series = first_order(np.random.default_rng(4), 4000, 0.9)
    time = STEP_S * np.arange(series.size)
    keep = (time < 100.0) | (time > 300.0)
    with_nan = average(time, np.where(keep, series, np.nan))
    without = average(time[keep], series[keep])
    assert with_nan.samples == without.samples == keep.sum()
    assert with_nan.mean == pytest.approx(without.mean)
    assert with_nan.effective_samples == pytest.approx(without.effective_samples, rel=1e-9)


def test_blocks_repeated_are_worth_one_each() -> None:
    values = np.repeat(np.random.default_rng(5).normal(size=400), 25)
    assert effective_samples(STEP_S * np.arange(values.size), values) == pytest.approx(400, rel=0.15)


def test_little_or_nothing_to_average() -> None:
    time = STEP_S * np.arange(5)
    none = average(time, np.full(5, np.nan))
    assert none.samples == 0
    assert np.isnan(none.mean)
    one = average(time, np.array([np.nan, 3.0, np.nan, np.nan, np.nan]))
    assert (one.mean, one.samples) == (3.0, 1)
    assert np.isnan(one.low)
    constant = average(time, np.full(5, 3.0))
    assert (constant.low, constant.mean, constant.high) == (3.0, 3.0, 3.0)
    empty = average(np.empty(0), np.empty(0))
    assert empty.samples == 0
