"""Where a mesh is too coarse: the error of each interval in terms of the optimal power, and the mesh that it asks for.

Between the collocation points nothing holds the model. How much the optimal power owes to that is estimated from the
multipliers, which say what a unit of each gap is worth (dual weighted residuals [1]_):

- the schedule of an interval, flown over the states of the solution, ends at another tether length and elevation and
  has done another work;
- a limit that acts at the points is exceeded between them, or at the start of a phase, which is no point.

Neither sees what a polynomial of the control costs that cannot follow a kink without breaking the model. The highest
of its coefficients does [2]_; it is no estimate of the power, only a sign of where a kink may be.

References
----------
.. [1] R. Becker and R. Rannacher, "An optimal control approach to a posteriori error estimation in finite element
   methods", Acta Numerica 10 (2001) 1-102.
.. [2] F. Liu, W. W. Hager and A. V. Rao, "Adaptive mesh refinement method for optimal control using nonsmoothness
   detection and mesh size reduction", Journal of the Franklin Institute 352 (2015) 4081-4106.

"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.polynomial import legendre

from kiteocp.cycle.limits import path_limits
from kiteocp.cycle.phases import PHASE_CHANGES
from kiteocp.cycle.schedule import Schedule, schedule_functions
from kiteocp.ocp.collocation import FloatArray, PhaseMesh, radau_points, radau_weights
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution
from kiteocp.ocp.trajectory import PhaseTrajectory
from kiteocp.optimum.cycle import OptimalCycle
from kiteocp.physics.wind import prepared

#: Samples of an interval: Gauss points between its ends, exact far beyond the degrees in use.
SAMPLES = 12

#: Share of the power that the intervals of an adapted mesh may owe to their length, all together.
TARGET = 5e-5

#: An interval is divided where it owes more than this share of the target ...
WORST_SHARE = 0.025

#: ... into at most so many parts at a time.
MOST_PARTS = 4

#: What the highest coefficient of a control may cost of the power, as a share of its range and of the cycle's time.
KINK_COST = 0.1


class IntervalErrors(msgspec.Struct, frozen=True):
    """What the intervals of one phase may contribute to the error of the power, as shares of it, shapes (intervals,).

    Attributes
    ----------
    gap
        By the flight between the points; positive where the true power is higher.
    excess
        By limits exceeded between the points; at least zero, the true power is lower.
    kink
        By controls that their polynomials do not resolve; at least zero, no estimate but a sign.
    limits
        Key of the limit that most of the excess comes from, empty where there is none.
    """

    gap: FloatArray
    excess: FloatArray
    kink: FloatArray
    limits: tuple[str, ...]

    @property
    def total(self) -> FloatArray:
        """All together, shape (intervals,)."""
        return np.asarray(np.abs(self.gap) + self.excess + self.kink, dtype=np.float64)


def interval_errors(program: NonlinearProgram, solution: Solution, cycle: OptimalCycle) -> dict[str, IntervalErrors]:
    """Estimate what each mesh interval contributes to the error of the optimal power.

    Parameters
    ----------
    program, solution
        A solved program of the cycle.
    cycle
        The same solution as a cycle.

    Returns
    -------
    dict
        By phase.
    """
    found: dict[str, IntervalErrors] = {}
    for schedule in cycle.schedules:
        samples = _Samples.of(cycle, schedule)
        gained = _excess(program, solution, cycle, samples)
        keys = ["", *gained]
        table = np.nan_to_num([np.zeros(samples.phase.mesh.intervals), *gained.values()])
        gap = _gap(program, solution, cycle, samples)
        found[schedule.name] = IntervalErrors(
            # Where there is no steady state between the points, the interval is as bad as can be.
            np.where(np.isfinite(gap), gap, np.inf),
            table.sum(axis=0),
            _kink(cycle, schedule),
            tuple(keys[index] for index in table.argmax(axis=0)),
        )
    return found


class _Samples(msgspec.Struct, frozen=True):
    """A phase between its collocation points: places on the polynomials of the solution, interval by interval.

    Attributes
    ----------
    schedule, phase
        The controls and the solution.
    times_s, tether_length_m, elevation_rad
        Shape (intervals * samples,).
    weights
        Quadrature weights of the samples of an interval, summing to 1.
    """

    schedule: Schedule
    phase: PhaseTrajectory
    times_s: FloatArray
    tether_length_m: FloatArray
    elevation_rad: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, cycle: OptimalCycle, schedule: Schedule) -> _Samples:
        phase = cycle.trajectory[schedule.name]
        nodes, weights = legendre.leggauss(SAMPLES)
        # A border belongs to the interval that ends there; just behind it the polynomials of the next one hold.
        local = np.concatenate(([1e-9], (nodes + 1.0) / 2.0))
        borders = phase.mesh.borders
        fractions = (borders[:-1, None] + np.diff(borders)[:, None] * local).ravel()
        matrix = phase.mesh.state_matrix(fractions)
        if "elevation" in phase.values:
            elevation = matrix @ phase.values["elevation"]
        else:
            elevation = np.full(fractions.size, cycle.trajectory.statics["elevation"])
        return cls(
            schedule,
            phase,
            fractions * phase.duration,
            matrix @ phase.values["tether_length"],
            elevation,
            np.concatenate(([0.0], weights / 2.0)),
        )

    @property
    def widths_s(self) -> FloatArray:
        """Lengths of the intervals."""
        return np.diff(self.phase.mesh.borders) * self.phase.duration

    def by_interval(self, samples: FloatArray) -> FloatArray:
        """Arrange samples as (..., intervals, samples)."""
        return samples.reshape(*samples.shape[:-1], -1, self.weights.size)


def _gap(program: NonlinearProgram, solution: Solution, cycle: OptimalCycle, samples: _Samples) -> FloatArray:
    """Return what flight and work between the points are worth that the points do not know of; work as mechanical."""
    phase, schedule, values = samples.phase, samples.schedule, cycle.values
    count, degree = phase.mesh.intervals, phase.mesh.degree
    rates = schedule_functions(values.structure, schedule.name, schedule.quantities).rates
    numbers = prepared(values)
    pieces = [np.concatenate([numbers, schedule.piece(index)]) for index in range(count)]
    state = np.array([samples.times_s, samples.tether_length_m, samples.elevation_rad, 0.0 * samples.times_s])
    sampled = np.asarray(rates.map(state.shape[1])(state, np.repeat(pieces, samples.weights.size, axis=0).T))
    flown = (samples.by_interval(sampled) @ samples.weights) * samples.widths_s
    work = (phase.values["power"].reshape(count, degree) @ radau_weights(degree)) * samples.widths_s
    gain = (flown[3] - work) / _cycle_time_s(cycle) / _unit(program)
    for index, name in ((1, "tether_length"), (2, "elevation")):
        if name in phase.values:
            rows = program.find_rows(phase=schedule.name, kind="defect", name=name)
            # The same at all points of an interval moves its end by as much.
            worth = solution.lam_g[rows].reshape(count, degree).sum(axis=1) / program.rows[int(rows[0])].scale
            gain = gain + worth * (flown[index] - np.diff(phase.values[name][::degree]))
    return np.asarray(gain / _size(program, solution), dtype=np.float64)


def _excess(
    program: NonlinearProgram, solution: Solution, cycle: OptimalCycle, samples: _Samples
) -> dict[str, FloatArray]:
    """Return what is gained by passing limits where there is no point, by the key of the limit."""
    schedule, values = samples.schedule, cycle.values
    count, degree = samples.phase.mesh.intervals, samples.phase.mesh.degree
    # As the program sees it: a winch that cuts the force off at its limits, as the re-simulated one, would hide them.
    sampled = samples.phase.evaluate(np.clip(samples.times_s / samples.phase.duration, 0.0, 1.0))
    gained: dict[str, FloatArray] = {}
    for limit in path_limits(values.structure):
        multipliers, labels = solution.lam_x, program.variables
        entries = program.find_variables(phase=schedule.name, name=limit.quantity)
        if entries.size and labels[int(entries[0])].kind == "state":
            entries = entries[1:]
        elif not entries.size:
            multipliers, labels = solution.lam_g, program.rows
            entries = program.find_rows(phase=schedule.name, kind="path", name=limit.quantity)
        # An elevation that is one number for the phase has no points to pass between.
        if schedule.name not in limit.phases or entries.size == 0:
            continue
        for upwards in {"lower": (-1.0,), "upper": (1.0,), "both": (-1.0, 1.0)}[limit.side]:
            bound = (upwards if limit.side == "both" else 1.0) * limit.bound(values)
            past = np.maximum(upwards * (sampled[limit.quantity] - bound), 0.0)
            beyond = samples.by_interval(past).max(axis=-1)
            worth = np.maximum(upwards * multipliers[entries], 0.0).reshape(count, degree).sum(axis=1)
            gain = worth * beyond / labels[int(entries[0])].scale / _size(program, solution)
            gained[limit.key] = gain + gained.get(limit.key, 0.0)
    return gained


def _kink(cycle: OptimalCycle, schedule: Schedule) -> FloatArray:
    """Return the highest Legendre coefficients of the controls, times the share of the interval in the cycle."""
    phase, values = cycle.trajectory[schedule.name], cycle.values
    degree = phase.mesh.degree
    inverse = np.linalg.inv(legendre.legvander(2.0 * radau_points(degree) - 1.0, degree - 1))
    ranges = {
        "radial_ground_force": values["limits.tether_force_max_N"],
        "power_setting": 1.0,
        "elevation_rate": np.radians(values["limits.traction_elevation_rate_max_deg_s"]),
        "course": np.pi,
    }
    highest = np.zeros(phase.mesh.intervals)
    for variable in phase.phase.controls:
        coefficients = phase.values[variable.name].reshape(-1, degree) @ inverse[-1]
        highest = np.maximum(highest, np.abs(coefficients) / ranges[variable.name])
    share = np.diff(phase.mesh.borders) * phase.duration / _cycle_time_s(cycle)
    return np.asarray(KINK_COST * highest * share, dtype=np.float64)


def _unit(program: NonlinearProgram) -> float:
    """Watts in an objective of one."""
    return float(abs(program.in_units(1.0)))


def _size(program: NonlinearProgram, solution: Solution) -> float:
    """Size of the objective, at least that of 1 W."""
    return max(abs(solution.f), 1.0 / _unit(program))


def _cycle_time_s(cycle: OptimalCycle) -> float:
    pauses = PHASE_CHANGES * cycle.values["limits.phase_change_time_s"]
    return sum(record.duration_s for record in cycle.records) + pauses


def adapted_mesh(mesh: PhaseMesh, errors: FloatArray, target: float = TARGET, longest: float = 1.0) -> PhaseMesh:
    """Divide the intervals that owe much of the error, and join neighbours that owe next to nothing.

    Parameters
    ----------
    mesh
        Mesh of a phase.
    errors
        Error of each interval, shape (intervals,).
    target
        What all intervals of all phases may owe together.
    longest
        Share of the phase that joined intervals do not exceed: an optimum may hide from the points of long intervals.

    Returns
    -------
    PhaseMesh
    """
    allowed = WORST_SHARE * target
    shares, divided = np.asarray(mesh.interval_fractions), errors > allowed
    # A kink may move a little: beside one that is being resolved nothing gets coarser.
    beside = divided | np.append(divided[1:], False) | np.append(False, divided[:-1])
    fractions: list[float] = []
    run: list[int] = []
    for index, share in enumerate(shares):
        if divided[index]:
            # What a jump costs goes with the length of the interval.
            parts = int(np.clip(np.ceil(errors[index] / allowed), 2, MOST_PARTS))
            fractions += [share / parts] * parts
            run = []
            continue
        longer = [] if beside[index] else [*run, index]
        width = shares[longer].sum()
        # A smooth error grows with this power of the length, or a higher one.
        fits = len(longer) > 1 and width <= longest * (1.0 + 1e-9)
        if fits and np.sum(errors[longer] * (width / shares[longer]) ** mesh.degree) <= allowed:
            fractions[-1] = float(width)
            run = longer
        else:
            fractions.append(float(share))
            run = [] if beside[index] else [index]
    return PhaseMesh(mesh.degree, tuple(fractions))


def passed_limit(errors: Mapping[str, IntervalErrors], mesh: Mapping[str, PhaseMesh]) -> str | None:
    """Say which limit the solution passes where the mesh has no point, if that is what most of the error comes from."""
    owed = [(float(total), name, index) for name, phase in errors.items() for index, total in enumerate(phase.total)]
    _, name, index = max(owed)
    phase = errors[name]
    if 2.0 * phase.excess[index] < phase.total[index]:
        return None
    start, end = mesh[name].borders[index : index + 2]
    return (
        f"the optimum goes beyond {phase.limits[index]} between two points of the mesh, in the {name} at "
        f"{100 * start:.3g} to {100 * end:.3g} % of its time, and what that gains depends on where the points are"
    )
