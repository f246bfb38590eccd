"""The optimal pumping cycle by dynamic programming on a grid: a global method that shares nothing with collocation.

Mean power P of a cycle is optimal where the best net gain ``E - P T`` over all cycles vanishes (Dinkelbach, On
nonlinear fractional programming, Management Science 13, 1967). For a given P, elevation and last length
of the traction:

* traction: at every tether length the control of the largest gain per metre, a quadrature. Going back over a length
  in crosswind flight cannot pay: the force of a state falls with its reeling speed, so it costs more than it gave;
* transition: the elevation always falls, row by row of the grid, the tether length interpolated;
* retraction: value iteration in tether length and elevation, with every control at every node, among them standing
  still in elevation; it may turn into a transition anywhere.

The control is a share of the interval of forces that the limits leave at a node, so that limits are ridden exactly.
The acceleration of the winch is left out and a shortest traction is a price on its duration (weak duality), both of
which can only raise the bound; interpolation on the grid is what remains, and shrinks with it. Only the flight states
come from the package: the closed form that the re-simulation flies with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiteocp.cycle.limits import path_limits
from kiteocp.cycle.phases import PHASE_CHANGES, PhaseName
from kiteocp.cycle.schedule import schedule_functions
from kiteocp.physics.equilibrium import OUTPUTS
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.problem import Problem

Array = NDArray[np.float64]

#: Levels and bisections by which the feasible forces at a node are found.
SCAN, BISECTIONS = 24, 30

#: Prices on the duration of the traction, as shares of P, for its shortest duration.
DURATION_PRICES = (0.0, 0.1, 0.3, 1.0, 3.0)

#: Elevation rows that a step of the retraction crosses at most.
STEP_ROWS = 2.0

#: Sweeps of the value iteration at most, and the change of value at which it ends.
SWEEPS, SETTLED_J = 400, 1.0

#: Elevation row and index of the last tether length of a traction.
Case = tuple[int, int]

#: Value where there is no way on: large, and finite so that zero weights of an interpolation leave no trace of it.
NOWHERE = -1e12


@dataclass(frozen=True)
class Grid:
    """Tether lengths (m) and elevations (rad), and how many controls a node has."""

    lengths: Array
    elevations: Array
    controls: int

    @classmethod
    def of(cls, values: ParameterValues, lengths: int, step_deg: float, controls: int) -> Grid:
        """Grid over the whole range of lengths and from the lowest traction to the highest elevation."""
        low, top = values["limits.traction_elevation_min_deg"], values["limits.elevation_max_deg"]
        return cls(
            np.linspace(values["limits.tether_length_min_m"], values["limits.tether_length_max_m"], lengths),
            np.radians(np.linspace(low, top, round((top - low) / step_deg) + 1)),
            controls,
        )


@dataclass(frozen=True)
class Rates:
    """Of a phase at every node and control, shape (lengths, elevations, controls); NaN where there is no state."""

    reeling_speed: Array
    elevation_rate: Array
    power: Array


def node_rates(values: ParameterValues, grid: Grid, phase: PhaseName) -> Rates:
    """Rates over the interval of forces that the limits leave at each node, its ends included."""
    length, elevation = (a.ravel() for a in np.meshgrid(grid.lengths, grid.elevations, indexing="ij"))
    function = schedule_functions(values.structure, phase, ("radial_ground_force",)).outputs.map(length.size)
    rows = {name: OUTPUTS.index(name) for name in OUTPUTS}
    limits = [limit for limit in path_limits(values.structure) if phase in limit.phases and limit.quantity in OUTPUTS]

    def outputs(force: Array) -> Array:
        return np.asarray(function(length[None, :], elevation[None, :], force[None, :], values.vector))

    def allowed(found: Array) -> NDArray[np.bool_]:
        ok = np.isfinite(found).all(axis=0)
        for limit in limits:
            sign, bound = (1.0 if limit.side == "lower" else -1.0), float(limit.bound(values))
            # Forces are held at their limits by the function itself, to rounding.
            ok &= sign * (found[rows[limit.quantity]] - bound) >= -1e-9 * max(abs(bound), 1.0)
        if phase != "traction":
            ok &= found[rows["forward_airspeed_ratio"]] >= values["limits.forward_airspeed_ratio_min"]
        return ok

    ends = [outputs(np.full(length.size, force))[rows["radial_ground_force"]] for force in (0.0, 1e9)]
    # Where the lowest force flies no state the function gives none, and the limits themselves bracket the forces.
    low = np.where(np.isfinite(ends[0]), ends[0], 0.0)
    high = np.where(np.isfinite(ends[1]), ends[1], values["limits.tether_force_max_N"])
    forces = low + np.linspace(0.0, 1.0, SCAN)[:, None] * (high - low)
    scan = np.array([allowed(outputs(force)) for force in forces])
    nodes = np.arange(length.size)
    first, last = scan.argmax(axis=0), SCAN - 1 - scan[::-1].argmax(axis=0)
    interval = []
    for index, beyond in ((first, np.maximum(first - 1, 0)), (last, np.minimum(last + 1, SCAN - 1))):
        inside, outside = forces[index, nodes], forces[beyond, nodes]
        for _ in range(BISECTIONS):
            middle = 0.5 * (inside + outside)
            ok = allowed(outputs(middle))
            inside, outside = np.where(ok, middle, inside), np.where(ok, outside, middle)
        interval.append(inside)
    shape = (grid.lengths.size, grid.elevations.size, grid.controls)
    speed, rate, power = (np.full((length.size, grid.controls), np.nan) for _ in range(3))
    climb = 1.0 if phase == "retraction" else -1.0
    for column, share in enumerate(np.linspace(0.0, 1.0, grid.controls)):
        found = np.where(scan.any(axis=0), outputs(interval[0] + share * (interval[1] - interval[0])), np.nan)
        speed[:, column], power[:, column] = found[rows["reeling_speed"]], found[rows["power"]]
        rate[:, column] = climb * found[rows["tangential_speed"]] / length
    return Rates(speed.reshape(shape), rate.reshape(shape), power.reshape(shape))


def with_hovering(rates: Rates) -> Rates:
    """Add the control, between two of the others, at which the elevation stands still."""
    rate = rates.elevation_rate
    crosses = (rate[:, :, :-1] <= 0) & (rate[:, :, 1:] > 0)
    index = np.where(crosses.any(axis=2), crosses.argmax(axis=2), 0)[:, :, None]

    def pick(a: Array, shift: int) -> Array:
        return np.take_along_axis(a, index + shift, axis=2)

    below, above = pick(rate, 0), pick(rate, 1)
    with np.errstate(invalid="ignore"):
        share = np.where(crosses.any(axis=2)[:, :, None], -below / (above - below), np.nan)
    columns = [pick(a, 0) + share * (pick(a, 1) - pick(a, 0)) for a in (rates.reeling_speed, rate, rates.power)]
    columns[1] = 0.0 * share
    pairs = zip((rates.reeling_speed, rate, rates.power), columns, strict=True)
    return Rates(*(np.concatenate(pair, axis=2) for pair in pairs))


def cells(axis: Array, wanted: Array) -> tuple[NDArray[np.intp], Array]:
    """Left neighbours of points on an even axis and the shares of the right ones; points are drawn inside."""
    place = np.clip((wanted - axis[0]) / (axis[1] - axis[0]), 0.0, axis.size - 1.0)
    left = np.minimum(place.astype(np.intp), axis.size - 2)
    return left, place - left


@dataclass(frozen=True)
class GlobalOptimum:
    """Best cycle of a grid: mean power, duration with phase changes, elevation and last length of the traction."""

    mean_power_W: float
    duration_s: float
    traction_elevation_deg: float
    tether_length_end_m: float


class CycleSearch:
    """Best net gain of a cycle on a grid, and the largest mean power by it.

    Parameters
    ----------
    problem
        With constant elevation in traction and fixed power setting.
    lengths, step_deg, controls
        The grid.
    """

    def __init__(self, problem: Problem, lengths: int, step_deg: float, controls: int) -> None:
        self.values = parameter_values(problem)
        self.grid = Grid.of(self.values, lengths, step_deg, controls)
        self.traction = node_rates(self.values, self.grid, "traction")
        self.transition = node_rates(self.values, self.grid, "transition")
        highest = np.radians(self.values["limits.traction_elevation_max_deg"])
        self.rows = [j for j, elevation in enumerate(self.grid.elevations) if elevation <= highest + 1e-9]
        self._plan(with_hovering(node_rates(self.values, self.grid, "retraction")))
        self._descents = [self._descent(j) for j in range(1, self.grid.elevations.size)]

    def _plan(self, rates: Rates) -> None:
        """Where each control of the retraction leads in a step, by the midpoint rule, and what it takes and gives."""
        lengths, elevations = self.grid.lengths, self.grid.elevations
        r, b = lengths[:, None, None], elevations[None, :, None]
        dr, db = lengths[1] - lengths[0], elevations[1] - elevations[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            v, w = rates.reeling_speed, rates.elevation_rate
            # One row of lengths at most, and not out of the grid: a step that starts on its edge must lead inwards.
            spans = [dr / np.abs(v), STEP_ROWS * db / np.abs(w)]
            spans.append(np.where(v < 0, (lengths[0] - r) / v, (lengths[-1] - r) / v))
            spans.append(np.where(w < 0, (elevations[0] - b) / w, (elevations[-1] - b) / w))
            step = np.fmin.reduce(spans)
        usable = np.isfinite(v) & np.isfinite(step) & (step > 1e-9)
        step = np.where(usable, step, 0.0)
        i, s = cells(lengths, np.where(usable, r + 0.5 * step * v, r))
        j, t = cells(elevations, np.where(usable, b + 0.5 * step * w, b))
        k = np.broadcast_to(np.arange(v.shape[2]), v.shape)
        middle = [
            (1 - s) * ((1 - t) * a[i, j, k] + t * a[i, j + 1, k])
            + s * ((1 - t) * a[i + 1, j, k] + t * a[i + 1, j + 1, k])
            for a in (v, w, rates.power)
        ]
        # Beside the edge of the possible the start of the step is all there is.
        v, w, power = (np.where(np.isfinite(m), m, a) for m, a in zip(middle, (v, w, rates.power), strict=True))
        i, s = cells(lengths, np.where(usable, r + step * v, r))
        j, t = cells(elevations, np.where(usable, b + step * w, b))
        columns = elevations.size
        corner = i * columns + j
        self._targets = np.stack([corner, corner + 1, corner + columns, corner + columns + 1])
        self._weights = np.stack([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t])
        self._step, self._gain = step, np.where(usable, step * power, NOWHERE)

    def _descent(self, j: int) -> tuple[NDArray[np.intp], Array, Array, Array]:
        """Transition from elevation row j to the one below: target cells, shares, duration and energy, by control."""
        lengths, elevations = self.grid.lengths, self.grid.elevations
        drop, r = elevations[j] - elevations[j - 1], lengths[:, None]
        of_nodes = (self.transition.reeling_speed, self.transition.elevation_rate, self.transition.power)
        v, w, power = (a[:, j] for a in of_nodes)
        below = [a[:, j - 1] for a in of_nodes]
        k = np.broadcast_to(np.arange(v.shape[1]), v.shape)
        # Heun's rule: the rates of the row below at the length where those of this row lead.
        ahead = r - drop * v / w
        i, s = cells(lengths, np.where(np.isfinite(ahead), ahead, r))
        v2, w2, power2 = ((1 - s) * a[i, k] + s * a[i + 1, k] for a in below)
        v2, w2, power2 = (np.where(np.isfinite(b), b, a) for a, b in ((v, v2), (w, w2), (power, power2)))
        target = r - 0.5 * drop * (v / w + v2 / w2)
        inside = (target >= lengths[0] - 1e-9) & (target <= lengths[-1] + 1e-9)
        i, s = cells(lengths, np.where(inside, target, r))
        duration = -0.5 * drop * (1 / w + 1 / w2)
        energy = -0.5 * drop * (power / w + power2 / w2)
        return i, s, np.where(inside, duration, 0.0), np.where(inside, energy, NOWHERE)

    def traction_gain(self, power_W: float, row: int, end: int) -> Array:
        """Net gain of a traction from every length to a last one, NOWHERE where there is none."""
        speed, power = self.traction.reeling_speed[:, row], self.traction.power[:, row]
        shortest = self.values["limits.traction_duration_min_s"]
        best = np.full(self.grid.lengths.size, np.inf)
        for share in DURATION_PRICES:
            reward = share * power_W
            with np.errstate(invalid="ignore", divide="ignore"):
                density = np.where(speed > 0, (power - power_W + reward) / speed, NOWHERE).max(axis=1)
            pieces = 0.5 * (density[1:] + density[:-1]) * np.diff(self.grid.lengths)
            to_go = np.append(np.cumsum(pieces[:end][::-1])[::-1], 0.0) - reward * shortest
            best[: end + 1] = np.minimum(best[: end + 1], to_go)
        best[end + 1 :] = NOWHERE
        return np.maximum(best, NOWHERE)

    def transition_gains(self, power_W: float, row: int, end: int) -> Array:
        """Net gain of a transition and the traction after it, from every node, shape (lengths, elevations)."""
        gains = np.full((self.grid.lengths.size, self.grid.elevations.size), NOWHERE)
        column = self.traction_gain(power_W, row, end)
        for j in range(row + 1, self.grid.elevations.size):
            i, s, duration, energy = self._descents[j - 1]
            ahead = energy - power_W * duration + (1 - s) * column[i] + s * column[i + 1]
            column = np.max(np.where(ahead > NOWHERE, ahead, NOWHERE), axis=1)
            gains[:, j] = column
        return gains

    def net_gains(self, power_W: float, cases: Sequence[Case]) -> Array:
        """Best ``E - P T`` of the cycles of each case at a mean power P, J, shape (cases,)."""
        n, m = self.grid.lengths.size, self.grid.elevations.size
        pause = power_W * self.values["limits.phase_change_time_s"]
        turn = np.stack([self.transition_gains(power_W, *case) for case in cases], axis=2) - pause
        value = turn.reshape(n * m, -1).copy()
        gain = (self._gain - power_W * self._step)[..., None]
        for _ in range(SWEEPS):
            before = value.copy()
            # The tether shortens in retraction: from the shortest on, most of the way is done in the first sweep.
            for i in range(n):
                ahead = gain[i] + np.sum(self._weights[:, i, ..., None] * value[self._targets[:, i]], axis=0)
                value[i * m : (i + 1) * m] = np.maximum(np.maximum(ahead.max(axis=1), turn[i]), NOWHERE)
            if np.max(np.abs(value - before)) < SETTLED_J:
                break
        starts = value.reshape(n, m, -1)
        gains = np.array([starts[end, row, index] for index, (row, end) in enumerate(cases)])
        return gains - (PHASE_CHANGES - 1) * pause

    def cases(self, ends: int) -> list[Case]:
        """Every elevation of the traction with some last tether lengths, evenly spread up to the longest."""
        last = self.grid.lengths.size - 1
        return [(row, round(last * (k + 1) / ends)) for row in self.rows for k in range(ends)]

    def best_cycle(self, guess_W: float, cases: Sequence[Case]) -> GlobalOptimum:
        """Find the mean power at which the best net gain vanishes, by Newton steps from a guess.

        The best net gain is convex in P and falls by the duration of the best cycle, so that the steps converge from
        the first one on from below (Dinkelbach).
        """
        power_W = guess_W
        for _ in range(6):
            gains, lower = self.net_gains(power_W, cases), self.net_gains((1 - 1e-3) * power_W, cases)
            best = int(np.argmax(gains))
            duration = float(lower[best] - gains[best]) / (1e-3 * power_W)
            change = float(gains[best]) / duration
            power_W += change
            if abs(change) < 1e-6 * power_W:
                break
        row, end = cases[best]
        return GlobalOptimum(
            power_W, duration, float(np.degrees(self.grid.elevations[row])), float(self.grid.lengths[end])
        )
