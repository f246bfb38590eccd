"""An optimal cycle read off a solution: schedules, dense records, active limits, and its re-simulation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import msgspec
import numpy as np

from kiteocp.cycle.limits import Limit, limits_of
from kiteocp.cycle.phases import KINDS, FlownPhase, PhaseName, pauses_after
from kiteocp.cycle.schedule import SCHEDULED, Schedule, fly_schedule, record_on_schedule
from kiteocp.cycle.summary import PhaseRecord
from kiteocp.ocp.collocation import PhaseMesh, continuous_nodes, radau_points
from kiteocp.ocp.entries import Variable
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution
from kiteocp.ocp.trajectory import PhaseTrajectory, Trajectory
from kiteocp.optimum.program import SPEED_JUMP
from kiteocp.physics.parameters import ParameterValues

#: A limit counts as active where its quantity is this near, relative to the size of the limit (`Limit.size`).
ACTIVE_WITHIN = 2e-3

#: Samples of a phase in records: about ten in each mesh interval of the default mesh.
SAMPLES = 121

#: Samples of a mesh interval where limits are checked and found active.
SAMPLES_OF_AN_INTERVAL = 20


class OptimalCycle(msgspec.Struct, frozen=True, dict=True):
    """A solution of the cycle problem in the words of the cycle.

    Attributes
    ----------
    values
        The problem's numbers.
    trajectory
        The collocation solution.
    schedules
        What a controller would hold, for each phase in order.
    records
        The phases sampled on the collocation polynomials, with the equilibrium solved at every sample.
    jumps_limited
        Whether the program limits the jumps of the reeling speed between phases.
    """

    values: ParameterValues
    trajectory: Trajectory
    schedules: tuple[Schedule, ...]
    records: tuple[PhaseRecord, ...]
    jumps_limited: bool = False

    @classmethod
    def of(cls, program: NonlinearProgram, solution: Solution, values: ParameterValues) -> OptimalCycle:
        """Read a solution."""
        trajectory = program.unpack(solution.x, solution.p)
        schedules = tuple(schedule_of(trajectory, KINDS[name].name) for name in trajectory.phases)  # type: ignore[index]
        records = tuple(_record(values, trajectory, schedule) for schedule in schedules)
        jumps_limited = any(link.name.startswith(SPEED_JUMP) for link in program.problem.links)
        return cls(values, trajectory, schedules, records, jumps_limited)

    @property
    def limits(self) -> list[Limit]:
        """The limits that the program kept: it does not bound the rate of an elevation that is linear in time."""
        return [limit for limit in limits_of(self.values.structure) if limit.quantity not in self._unbounded]

    @property
    def _unbounded(self) -> set[str]:
        return {"elevation_rate"}.intersection(self.trajectory.statics)

    def record(self, name: PhaseName) -> PhaseRecord:
        """Return the record of a phase."""
        return next(record for record in self.records if record.name == name)

    @cached_property
    def fine_records(self) -> tuple[PhaseRecord, ...]:
        """The phases sampled `SAMPLES_OF_AN_INTERVAL` times in each interval of the mesh, however short it is."""
        return tuple(_record(self.values, self.trajectory, schedule, fine=True) for schedule in self.schedules)

    def resimulate(self) -> list[FlownPhase]:
        """Fly the schedules by the independent integrator, each phase from where the last one ended.

        Raises
        ------
        CycleError
            A state on the way does not exist.
        """
        first = self.records[0]
        length, elevation = float(first.tether_length_m[0]), float(first.elevation_rad[0])
        flown = []
        for schedule in self.schedules:
            flown.append(fly_schedule(self.values, schedule, length, elevation))
            length, elevation = (float(v) for v in flown[-1].states[-1, 1:3])
        return flown


def schedule_of(trajectory: Trajectory, name: PhaseName) -> Schedule:
    """Read the schedule of a phase off a solution: the polynomial of every control in every mesh interval."""
    phase = trajectory[name]
    controls = {variable.name: variable for variable in phase.phase.controls}
    coefficients = {
        quantity: _coefficients(phase, controls[quantity]) for quantity in SCHEDULED if quantity in controls
    }
    if name == "traction" and "elevation_rate" in trajectory.statics:
        coefficients["elevation_rate"] = np.full((phase.mesh.intervals, 1), trajectory.statics["elevation_rate"])
    return Schedule(name, phase.mesh.borders * phase.duration, coefficients)


def _coefficients(phase: PhaseTrajectory, control: Variable) -> np.ndarray:
    """Coefficients of a control's polynomials, lowest first, in the share of the interval; shape (intervals, n)."""
    mesh, values = phase.mesh, phase.values[control.name]
    within = values.reshape(mesh.intervals, mesh.degree)
    inside = within @ np.linalg.inv(np.vander(radau_points(mesh.degree), increasing=True)).T
    if not control.continuous:
        return np.asarray(inside, dtype=np.float64)
    coefficients = np.column_stack([inside, np.zeros(mesh.intervals)])
    before = np.column_stack([within[:-1, -1], within[1:]])
    coefficients[1:] = before @ np.linalg.inv(np.vander(continuous_nodes(mesh.degree, False), increasing=True)).T
    return coefficients


@lru_cache(maxsize=64)
def _sampling(mesh: PhaseMesh, fine: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return fractions of a phase, increasing, and the matrix from its states at the points to those there."""
    if not fine:
        fractions = np.linspace(0.0, 1.0, SAMPLES)
    else:
        parts = np.arange(SAMPLES_OF_AN_INTERVAL) / SAMPLES_OF_AN_INTERVAL
        inside = mesh.borders[:-1, None] + np.diff(mesh.borders)[:, None] * parts
        fractions = np.append(inside.ravel(), 1.0)
    return fractions, mesh.state_matrix(fractions)


def _record(values: ParameterValues, trajectory: Trajectory, schedule: Schedule, *, fine: bool = False) -> PhaseRecord:
    """Sample a phase `SAMPLES` times, or `SAMPLES_OF_AN_INTERVAL` times in each interval of its mesh."""
    phase = trajectory[schedule.name]
    fractions, states = _sampling(phase.mesh, fine)
    time = fractions * phase.duration
    length = states @ phase.values["tether_length"]
    if "elevation" in phase.values:
        elevation = states @ phase.values["elevation"]
    else:
        elevation = np.full(time.size, trajectory.statics["elevation"])
    energies = phase.integrals["power"], phase.integrals["electrical_power"]
    return record_on_schedule(values, schedule, time, (length, elevation), energies)


def active_limits(cycle: OptimalCycle) -> dict[str, list[dict[str, Any]]]:
    """List for each phase the limits it runs into, with the share of its time, longest first.

    A limit of the phase as a whole (its shortest duration, the stroke) has a share of 1.
    """
    values = cycle.values
    found: dict[str, list[dict[str, Any]]] = {}
    # A rate changes within an interval of the mesh, however short that is.
    for record, fine in zip(cycle.records, cycle.fine_records, strict=True):
        entries: list[dict[str, Any]] = [
            {"limit": limit.key, "value": values[limit.key], "share": share}
            for limit in cycle.limits
            if (share := limit.share(fine if limit.rate else record, values, ACTIVE_WITHIN)) is not None
        ]
        entries += _jump_limit(cycle, record)
        # In thousandths: how many samples a single instant takes differs by rounding.
        found[record.name] = sorted(entries, key=lambda entry: -round(entry["share"], 3))
    return found


def _jump_limit(cycle: OptimalCycle, record: PhaseRecord) -> list[dict[str, Any]]:
    """Return what limits the jump of the reeling speed after a phase: the time that the winch has for it."""
    key = "limits.phase_change_time_s"
    jump = next(jump for jump in speed_jumps(cycle.records, cycle.values) if jump["from_phase"] == record.name)
    if cycle.jumps_limited and abs(jump["jump_m_s"]) >= (1 - ACTIVE_WITHIN) * jump["allowed_m_s"]:
        return [{"limit": key, "value": cycle.values[key], "share": 0.0}]
    return []


def speed_jumps(records: Sequence[PhaseRecord], values: ParameterValues) -> list[dict[str, Any]]:
    """Compare the change of reeling speed between phases with what the winch can do in the phase-change time."""
    pauses = pauses_after([record.name for record in records], values["limits.phase_change_time_s"])
    jumps = []
    for before, after, pause in zip(records, [*records[1:], records[0]], pauses, strict=True):
        allowed = values["limits.reeling_acceleration_max_m_s2"] * pause
        jump = float(after.output("reeling_speed")[0] - before.output("reeling_speed")[-1])
        jumps.append(
            {
                "from_phase": before.name,
                "to_phase": after.name,
                "jump_m_s": jump,
                "allowed_m_s": allowed,
                "time_needed_s": abs(jump) / values["limits.reeling_acceleration_max_m_s2"],
            }
        )
    return jumps
