"""Global sensitivity: the distribution of the optimal mean power under the uncertainties of the problem file.

Every sample is a re-solved optimum (`kiteocp.studies.sensitivity.sampling`), so that all kinks and changes of active
limits are in the result. Indices are those of Sobol, estimated by `scipy.stats.sobol_indices`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from scipy import stats

from kiteocp.errors import InputError
from kiteocp.execution import one_at_a_time
from kiteocp.ocp.collocation import FloatArray
from kiteocp.optimum.refine import optimise
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.problem.uncertainty import Uncertainty
from kiteocp.processes import Processes
from kiteocp.report.table import Cell, Column, Table
from kiteocp.studies.sensitivity.sampling import (
    Resolver,
    Sample,
    quantiles,
    sample_in_process,
    start_process,
    uncertainties,
)
from kiteocp.studies.sensitivity.sobol_report import global_summary

SAMPLES_FILE = "global.csv"

#: Optima solved at most where no number is given, and base samples (each of keys + 2 optima) below which nothing is
#: worth printing.
SAMPLES, FEWEST_BASES = 2000, 8

#: Every so many samples one is also solved from all starts, as a check of the warm ones.
COLD_EVERY = 200

#: Samples that a process of the pool takes at a time.
CHUNK = 8

#: Resamples of the bootstrap, and its confidence.
RESAMPLES, CONFIDENCE = 999, 0.95

Progress = Callable[[int, int], None]


class GlobalStudy(msgspec.Struct, frozen=True):
    """Samples and what they say.

    Attributes
    ----------
    keys
        Uncertain keys.
    points
        Values of the keys, shape (samples, keys): base samples A, then B, then for each key A with that key of B.
    samples
        What became of each.
    summary
        Plain values for ``summary.json``, key ``global``.
    """

    keys: tuple[str, ...]
    points: FloatArray
    samples: tuple[Sample, ...]
    summary: dict[str, Any]

    def table(self) -> Table:
        """Return all samples, those without an optimum too."""
        names = (
            *self.keys,
            "status",
            "mean_power_W",
            "open_loop_status",
            "open_loop_mean_power_W",
            "open_loop_exceeds",
        )
        rows: list[tuple[Cell, ...]] = []
        for point, sample in zip(self.points, self.samples, strict=True):
            kept = sample.open_loop
            told = ("", None, "") if kept is None else (kept.status, kept.mean_power_W, " ".join(kept.exceeded))
            rows.append((*map(float, point), sample.status, sample.mean_power_W, *told))
        return Table([Column(key=name) for name in names], rows)


def base_samples(problem: Problem, samples: int) -> int:
    """Return how many base samples a budget of optima allows, a power of two.

    Raises
    ------
    InputError
        The budget is too small for the number of uncertain keys.
    """
    each = len(uncertainties(problem)[0]) + 2
    if samples < FEWEST_BASES * each:
        raise InputError(
            f"--samples {samples}: too few for {each - 2} uncertain keys; give at least {FEWEST_BASES * each}"
        )
    return 1 << int(np.log2(samples // each))


@one_at_a_time
def global_sensitivity(
    problem: Problem,
    *,
    samples: int = SAMPLES,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    keep: Callable[[GlobalStudy], None] | None = None,
) -> GlobalStudy:
    """Propagate the uncertainties of a problem to its optimal mean power.

    Parameters
    ----------
    problem
        Its ``uncertainty`` block says how far its numbers may be off, independently of each other; where it has none,
        5 % relative standard deviation of the numbers named in `uncertainties`.
    samples
        Optima solved at most; the largest power of two of base samples that fits is used.
    jobs
        Processes. More than one need a main module that can be imported (``if __name__ == "__main__"``).
    seed
        Of the scrambled Sobol points and of the bootstrap.
    progress
        Called with the optima solved and their number.
    keep
        Called if the study is interrupted, with the samples that are finished and an empty summary.

    Returns
    -------
    GlobalStudy

    Raises
    ------
    InputError
        If the budget is too small.
    InfeasibleError, SolveError
        If the problem itself has no optimum.

    Notes
    -----
    Points and estimators follow Saltelli et al., *Variance based sensitivity analysis of model output*, Computer
    Physics Communications 181(2), 2010. A base sample of which any optimum is missing is left out of the indices.
    """
    began = time.perf_counter()
    bases = base_samples(problem, samples)
    given, stated = uncertainties(problem)
    keys = tuple(given)
    nominal = optimise(problem, certificate="quick")
    points = sobol_points(problem, given, bases, seed)
    # The distribution and the open-loop schedule take A and B, which are independent; the rest serves the indices.
    open_loop = np.arange(len(points)) < 2 * bases
    cold = np.arange(len(points)) % COLD_EVERY == 0
    tell = progress or (lambda done, total: None)
    done: list[Sample | None] = [None] * len(points)
    try:
        if jobs == 1:
            resolver = Resolver.of(problem, keys, nominal.solution, nominal.formulation)
            for place, point in enumerate(points):
                done[place] = resolver.sample(point, open_loop=bool(open_loop[place]), cold=bool(cold[place]))
                tell(place + 1, len(points))
        else:
            places = [slice(first, first + CHUNK) for first in range(0, len(points), CHUNK)]
            tasks = [(points[s], open_loop[s].tolist(), cold[s].tolist()) for s in places]
            counted = 0
            start = problem, keys, nominal.solution, nominal.formulation
            with Processes(jobs, start_process, *start) as processes:
                for place, part in processes.run(sample_in_process, tasks):
                    done[places[place]] = part
                    counted += len(part)
                    tell(counted, len(points))
    except KeyboardInterrupt:
        if keep is not None:
            finished = [place for place, sample in enumerate(done) if sample is not None]
            keep(GlobalStudy(keys, points[finished], tuple(sample for sample in done if sample is not None), {}))
        raise
    found = [sample for sample in done if sample is not None]
    own = Resolver.of(problem, keys, nominal.solution, nominal.formulation)
    values = parameter_values(problem)
    at_nominal = own.sample([values[key] for key in keys], open_loop=True).open_loop
    power = np.array([np.nan if sample.mean_power_W is None else sample.mean_power_W for sample in found])
    f_a, f_b = power[:bases], power[bases : 2 * bases]
    indices = sobol_intervals(f_a, f_b, power[2 * bases :].reshape(len(keys), bases), seed)
    summary = global_summary(problem, given, stated, found, bases, indices, at_nominal)
    summary |= {
        "nominal_mean_power_W": nominal.mean_power_W,
        "nominal_status": nominal.certificate.status,
        "nominal_message": nominal.certificate.message or None,
        "confidence": CONFIDENCE,
        "seed": seed,
        "jobs": jobs,
        "time_s": time.perf_counter() - began,
    }
    return GlobalStudy(keys, points, tuple(found), summary)


def sobol_points(problem: Problem, given: dict[str, Uncertainty], bases: int, seed: int) -> FloatArray:
    """Return the points of A, of B, and of A with one key of B after the other, shape (bases * (keys + 2), keys)."""
    count = len(given)
    uniform = stats.qmc.Sobol(2 * count, seed=np.random.default_rng(seed), bits=64).random(bases)
    values = np.empty_like(uniform)
    for column, (key, uncertainty) in enumerate([*given.items(), *given.items()]):
        values[:, column] = quantiles(problem, key, uncertainty, uniform[:, column])
    a, b = values[:, :count], values[:, count:]
    mixed = []
    for column in range(count):
        mixed.append(a.copy())
        mixed[-1][:, column] = b[:, column]
    return np.concatenate((a, b, *mixed))


def sobol_intervals(f_a: FloatArray, f_b: FloatArray, f_ab: FloatArray, seed: int) -> list[dict[str, float]]:
    """Estimate Sobol indices with bootstrap intervals.

    Parameters
    ----------
    f_a, f_b, f_ab
        Function values at the base samples, shapes (n,), (n,) and (keys, n), not numbers where there is none.
    seed
        Of the bootstrap.

    Returns
    -------
    list of dict
        For each key ``first_order``, ``total_order`` and the ends of their intervals, ``_from`` and ``_to``; not
        numbers where fewer than two base samples are complete.
    """
    complete = np.isfinite(f_a) & np.isfinite(f_b) & np.isfinite(f_ab).all(axis=0)
    values = np.vstack((f_a, f_b, f_ab))[:, complete]
    count = values.shape[1]
    if count < 2:
        nothing = ("first_order", "first_order_from", "first_order_to")
        blank = {name.replace("first", which): np.nan for which in ("first", "total") for name in nothing}
        return [dict(blank) for _ in f_ab]
    found = _indices(values)
    generator = np.random.default_rng(seed)
    drawn = np.array([_indices(values[:, generator.integers(count, size=count)]) for _ in range(RESAMPLES)])
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(drawn, [tail, 1.0 - tail], axis=0)
    return [
        {
            f"{name}{suffix}": float(part[row, column])
            for row, name in enumerate(("first_order", "total_order"))
            for suffix, part in (("", found), ("_from", low), ("_to", high))
        }
        for column in range(len(f_ab))
    ]


def _indices(values: FloatArray) -> FloatArray:
    """First and total indices, shape (2, keys), from the values at A, B and the mixed points, shape (keys + 2, n)."""
    mean = float(np.mean(values[:2]))
    count = values.shape[1]
    # scipy wants a power of two. Values at the mean add nothing to any variance, so that they change no ratio.
    padded = np.full((values.shape[0], 1 << (count - 1).bit_length()), mean)
    padded[:, :count] = values
    # Of one key alone it would return numbers and not arrays: an inert one beside it does no harm.
    mixed = np.vstack((padded[2:], padded[:1]))
    found = stats.sobol_indices(
        func={"f_A": padded[:1], "f_B": padded[1:2], "f_AB": mixed[:, None, :]}, n=padded.shape[1]
    )
    return np.array([found.first_order[:-1], found.total_order[:-1]], dtype=float)
