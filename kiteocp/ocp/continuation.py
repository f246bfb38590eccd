"""Following a polished solution along a direction of the parameters until its active set changes.

The derivatives of slacks and multipliers say to first order where the next bound comes into play or lets go; Newton's
method on the same active set confirms it, and secants enclose it. One-sided derivatives at the point itself come from
the set of multipliers: where active bounds depend on each other it has more than one member, and the optimum a kink
(Gauvin, Dubeau, "Differential properties of the marginal function in mathematical programming", 1982).
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.ocp.active_set import ActiveSetMethod
from kiteocp.ocp.active_solution import ActiveSetError, Derivatives, PolishedSolution
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlp import Label

#: Bounds nearer than this (scaled units of the program) are taken to sit exactly at a change of the active set.
AT_A_CHANGE = 1e-7

#: The border is found where the critical slack or multiplier has shrunk to this share of itself ...
CLOSED = 1e-4

#: ... or where the enclosure is this narrow, relative to the farthest way.
ENCLOSED = 1e-4

#: Trial points on the way; some 3 to 6 are used.
TRIALS = 40

#: Singular values below this, of active gradients of length one, mean that one depends on the others.
DEPENDENT = 1e-8


class Reach(msgspec.Struct, frozen=True):
    """How far a solution follows a direction on one active set.

    Attributes
    ----------
    step
        Multiple of the direction at which the active set changes, or the farthest one asked for.
    ended_by
        The bound that comes into play or lets go there, None where the active set holds all the way.
    """

    step: float
    ended_by: Label | None


def follow(
    method: ActiveSetMethod, polished: PolishedSolution, tangent: Derivatives, direction: FloatArray, farthest: float
) -> Reach:
    """Follow a solution along a direction of the parameters until its active set changes.

    Parameters
    ----------
    method, polished
        The method, and the solution to start from.
    tangent
        Derivatives of the solution along the direction, one column.
    direction
        Shape (parameters,).
    farthest
        Multiple of the direction, of either sign, to go to at most; infinite where `tangent` says that nothing but
        bounds moves.
    """
    start = np.minimum(*method.margins(polished))
    labels = (*method.program.variables, *method.program.rows)
    sign = float(np.sign(farthest))
    rate = _rates(polished, tangent) * sign
    at_once = (start < AT_A_CHANGE) & (rate * min(abs(farthest), 1e9) < -AT_A_CHANGE)
    if at_once.any():
        return Reach(0.0, labels[int(np.argmin(np.where(at_once, rate, np.inf)))])
    if not np.isfinite(farthest):
        return _straight(start, rate, sign, labels)
    good, base, here, bad = 0.0, polished, start, farthest
    missed: FloatArray | None = None
    trial = _ratio(here, rate, good, sign, farthest)
    ended_by: Label | None = None
    for _ in range(TRIALS):
        found = _moved(method, base, tangent, trial - good, polished.p + trial * direction)
        if found is None:
            bad, missed = trial, None
            trial = 0.5 * (good + bad)
        else:
            margin = np.minimum(*method.margins(found))
            # What duplicates an active bound keeps a slack of zero, give or take rounding, and says nothing.
            margin = np.where((start < AT_A_CHANGE) & (margin > -AT_A_CHANGE), np.inf, margin)
            worst = int(np.argmin(margin))
            if abs(margin[worst]) <= CLOSED * start[worst]:
                return Reach(trial, labels[worst])
            if margin[worst] > 0.0:
                if trial == farthest:
                    return Reach(farthest, None)
                good, base, here = trial, found, margin
                tangent = method.derivatives(found, direction[:, None])
                ahead = _ratio(here, _rates(found, tangent) * sign, good, sign, farthest)
                trial = ahead if bad == farthest or abs(ahead) < abs(bad) else 0.5 * (good + bad)
            else:
                bad, missed, ended_by = trial, margin, labels[worst]
                trial = _secant(good, bad, here, missed)
        if abs(bad - good) <= ENCLOSED * abs(farthest):
            break
    return Reach(good, ended_by)


def _rates(polished: PolishedSolution, tangent: Derivatives) -> FloatArray:
    """Change of slacks and pressures (as in `ActiveSetMethod.margins`) along the direction of a tangent."""
    active = np.concatenate((polished.active.variables, polished.active.rows))
    value, lower, upper, multiplier = (
        part[:, 0] for part in (tangent.values, tangent.lower, tangent.upper, tangent.multipliers)
    )
    return np.asarray(
        np.where(active == 0, np.where(polished.nearer_lower, value - lower, upper - value), active * multiplier)
    )


def _straight(start: FloatArray, rate: FloatArray, sign: float, labels: tuple[Label, ...]) -> Reach:
    """Where only bounds move, and these along straight lines, the first of them to be met."""
    closing = rate < -1e-14
    if not closing.any():
        return Reach(sign * np.inf, None)
    steps = np.where(closing, -start / np.where(closing, rate, -1.0), np.inf)
    first = int(np.argmin(steps))
    return Reach(sign * float(steps[first]), labels[first])


def _ratio(here: FloatArray, rate: FloatArray, good: float, sign: float, farthest: float) -> float:
    """Where the next bound changes sides to first order, at most the farthest point."""
    closing = (here >= AT_A_CHANGE) & (rate < 0.0) & np.isfinite(here)
    steps = np.where(closing, -here / np.where(closing, rate, -1.0), np.inf)
    step = float(np.min(steps, initial=np.inf))
    return good + sign * step if step < abs(farthest - good) else farthest


def _secant(good: float, bad: float, here: FloatArray, missed: FloatArray) -> float:
    """Where the first of the bounds that fail at `bad` vanishes on a straight line from `good`, safely inside."""
    failing = (missed < -AT_A_CHANGE) & np.isfinite(here)
    if not failing.any():
        return 0.5 * (good + bad)
    inside = np.maximum(here[failing], 0.0)
    share = float(np.min(inside / (inside - missed[failing])))
    return good + min(max(share, 0.1), 0.98) * (bad - good)


def _moved(
    method: ActiveSetMethod, base: PolishedSolution, tangent: Derivatives, step: float, p: FloatArray
) -> PolishedSolution | None:
    """Solution at other parameters on the same active set, or None where Newton's method finds none."""
    multipliers = tangent.multipliers[:, 0] * step
    predicted = replace(
        base,
        x=base.x + tangent.x[:, 0] * step,
        lam_x=base.lam_x + multipliers[: method.nx],
        lam_g=base.lam_g + multipliers[method.nx :],
    )
    try:
        return method.polish(predicted, base.active, p)
    except (ActiveSetError, ValueError):
        return None


def one_sided(
    method: ActiveSetMethod, polished: PolishedSolution, derivatives: Derivatives, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Differentiate the optimal objective to either side, where several multipliers satisfy the same conditions.

    Parameters
    ----------
    method, polished, derivatives
        The solution and its derivatives along the directions.
    directions
        Shape (parameters, directions).

    Returns
    -------
    below, above : ndarray, shape (directions,)
        Slopes of the objective against the direction and along it: equal where the optimum is smooth, infinite where
        no solution exists on that side.
    """
    below, above = derivatives.objective.copy(), derivatives.objective.copy()
    gradients, slopes, given, signs, held = method.pressing(polished, directions, AT_A_CHANGE)
    if held.all():
        return below, above
    size = np.maximum(np.linalg.norm(gradients[~held], axis=1), 1e-12)
    rest, shares = method.combinations(polished, gradients[~held].T / size)
    _, values, rows = np.linalg.svd(rest)
    alone = rows[int(np.sum(values > DEPENDENT)) :].T
    # Combinations of multipliers that change nothing in the gradient of the Lagrangian.
    free = np.zeros((held.size, alone.shape[1]))
    free[held], free[~held] = -shares @ alone, alone / size[:, None]
    change = free.T @ slopes
    for column in np.flatnonzero(np.max(np.abs(change), axis=0, initial=0.0) > AT_A_CHANGE * _size(slopes)):
        lowest, highest = _extremes(change[:, column], free, given, signs)
        below[column] += lowest
        above[column] += highest
    return below, above


def _size(slopes: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.max(np.abs(slopes), axis=0, initial=0.0), 1e-12))


def _extremes(change: FloatArray, free: FloatArray, given: FloatArray, signs: FloatArray) -> Iterator[float]:
    """Least and greatest change of the slope over all multipliers of the right sign."""
    from scipy.optimize import linprog  # noqa: PLC0415  (a slow import, needed at kinks only)

    one = signs != 0
    limit = np.maximum(signs[one] * given[one], 0.0)
    for direction in (1.0, -1.0):
        found = linprog(
            direction * change, A_ub=-signs[one, None] * free[one], b_ub=limit, bounds=[(None, None)] * change.size
        )
        yield direction * float(found.fun or 0.0) if found.status == 0 else -direction * np.inf
