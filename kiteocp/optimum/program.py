"""The optimal pumping cycle as an optimal control problem of three phases, or four with a turn.

States are tether length and elevation, the control is the radial tether force at the ground, and the inflow angle of
the equilibrium is an algebraic variable whose residual must vanish at every collocation point. All numbers of the
problem file are parameters: the program is built once for a structure and solved for any numbers.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import msgspec
from msgspec.structs import replace

from kiteocp.cycle.limits import SCALES, rarely_active
from kiteocp.cycle.objective import POWERS
from kiteocp.cycle.phases import (
    KINDS,
    PHASE_CHANGES,
    PHASES,
    RETRACTION,
    TRACTION,
    PhaseKind,
    PhaseName,
    pauses_after,
    phases_with,
)
from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.declaration import Link, OptimalControlProblem, Phase, Static
from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.transcription import transcribe
from kiteocp.optimum.phases import PhaseBuilder
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import Parameters, Structure
from kiteocp.problem import Problem

#: What the links that limit jumps of the reeling speed are called, before the phase.
SPEED_JUMP = "speed jump"


class Formulation(msgspec.Struct, frozen=True):
    """What beside the structure of the problem shapes the program: the choices of its ``optimisation`` block.

    Attributes
    ----------
    objective
        ``mechanical`` or ``electrical`` mean power.
    traction_elevation
        ``constant``, ``linear``, ``course-coupled`` or ``free``.
    power_setting
        ``fixed``, ``traction`` or ``all``.
    speed_jumps
        ``free``, or ``limited`` to what the winch can do in the phase-change time.
    equilibrium
        ``implicit``: the inflow angle is a variable and its residual a constraint; ``explicit``: the closed form of the
        force-controlled state takes their place, fewer variables for the same optimum.
    phases
        Phases of the cycle in their order.
    intervals
        Mesh intervals of each phase.
    degree
        Collocation points per interval.
    interval_fractions
        Shares of the intervals in each of these phases, where they are not equal.
    """

    objective: str
    traction_elevation: str
    power_setting: str
    speed_jumps: str
    equilibrium: str
    phases: tuple[PhaseName, ...]
    intervals: tuple[int, ...]
    degree: int
    interval_fractions: tuple[tuple[float, ...], ...] | None = None

    @classmethod
    def of(cls, problem: Problem) -> Formulation:
        """Formulation that a problem file asks for."""
        given, mesh = problem.optimisation, problem.optimisation.mesh
        phases = phases_with(given.turn)
        return cls(
            given.objective,
            given.traction_elevation,
            given.power_setting,
            given.speed_jumps,
            given.equilibrium,
            phases,
            tuple(getattr(mesh, f"{name}_intervals") for name in phases),
            mesh.degree,
        )

    @property
    def points(self) -> int:
        """Collocation points of the whole mesh."""
        return sum(self.intervals) * self.degree

    def plain(self) -> Formulation:
        """Return the formulation of least freedom: constant elevation, fixed power setting, no turn."""
        count, fractions = len(PHASES), self.interval_fractions
        return replace(
            self,
            traction_elevation="constant",
            power_setting="fixed",
            phases=PHASES,
            intervals=self.intervals[:count],
            interval_fractions=None if fractions is None else fractions[:count],
        )

    def refined(self) -> Formulation:
        """Return the same on a mesh of half the intervals' length."""
        if self.interval_fractions is not None:
            return self.on_mesh({name: mesh.refined() for name, mesh in self.mesh.items()})
        return replace(self, intervals=tuple(2 * count for count in self.intervals))

    def on_mesh(self, mesh: Mapping[str, PhaseMesh]) -> Formulation:
        """Return the same on any mesh, of intervals of any length."""
        fractions = tuple(mesh[name].interval_fractions for name in self.phases)
        return replace(self, intervals=tuple(map(len, fractions)), interval_fractions=fractions)

    @property
    def mesh(self) -> dict[str, PhaseMesh]:
        """Mesh of each phase."""
        if self.interval_fractions is not None:
            return {
                name: PhaseMesh(self.degree, fractions)
                for name, fractions in zip(self.phases, self.interval_fractions, strict=True)
            }
        return {
            name: PhaseMesh.uniform(intervals=count, degree=self.degree)
            for name, count in zip(self.phases, self.intervals, strict=True)
        }

    def schedules_power_setting(self, kind: PhaseKind) -> bool:
        """Whether the kite's power setting is a control of the phase."""
        return self.power_setting != "fixed" and (
            kind is TRACTION or (kind is RETRACTION and self.power_setting == "all")
        )


@lru_cache(maxsize=16)
def cycle_program(structure: Structure, formulation: Formulation) -> NonlinearProgram:
    """Build (once) the nonlinear program of the optimal cycle."""
    return transcribe(cycle_problem(structure, formulation), formulation.mesh)


def cycle_problem(structure: Structure, formulation: Formulation) -> OptimalControlProblem:
    """Declare the optimal control problem: phases, links between them, and the mean power to be maximised.

    All meshes share one declaration, and so the derivatives of its points.
    """
    return _declared(structure, replace(formulation, intervals=(), degree=0, interval_fractions=None))


@lru_cache(maxsize=16)
def _declared(structure: Structure, formulation: Formulation) -> OptimalControlProblem:
    builder = PhaseBuilder(Model(Parameters(structure, keeps_derived=True)), formulation)
    phases: list[Phase] = []
    statics: list[Static] = []
    ends: dict[str, tuple[Any, Any]] = {}
    for name in formulation.phases:
        if name == TRACTION.name:
            phase, statics = builder.traction_phase()
            ends[name] = (builder.traction_start, builder.traction_end)
        else:
            phase = builder.plane_phase(KINDS[name])
            ends[name] = (phase.start["elevation"], phase.end["elevation"])
        phases.append(phase)
    following = list(itertools.pairwise([*phases, phases[0]]))
    links = [
        Link(
            f"tether length at the end of the {before.name}",
            after.start["tether_length"] - before.end["tether_length"],
            scale=SCALES["tether_length"],
        )
        for before, after in following
    ]
    links += [
        Link(f"elevation at the end of the {before.name}", ends[after.name][0] - ends[before.name][1])
        for before, after in following
    ]
    p = builder.parameters
    links += [
        Link(
            limit.key,
            phase.end["tether_length"] - phase.start["tether_length"],
            *limit.bounds(p),
            scale=SCALES["stroke"],
        )
        for limit in builder.limits
        for phase in phases
        if limit.quantity == "stroke" and phase.name in limit.phases
    ]
    if formulation.speed_jumps == "limited":
        pauses = pauses_after(formulation.phases, p["limits.phase_change_time_s"])
        allowed = [p["limits.reeling_acceleration_max_m_s2"] * pause for pause in pauses]
        links += [
            Link(
                f"{SPEED_JUMP} after the {before.name}",
                after.first["reeling_speed"] - before.end["reeling_speed"],
                -most,
                most,
                scale=SCALES["reeling_speed"],
            )
            for (before, after), most in zip(following, allowed, strict=True)
        ]
    energy = sum(phase.integral[POWERS[formulation.objective]] for phase in phases)
    time = sum(phase.duration for phase in phases) + PHASE_CHANGES * p["limits.phase_change_time_s"]
    # The mean power is to be as large as possible.
    unit = -SCALES["power"]
    return OptimalControlProblem(
        phases,
        energy / time / unit,
        links=links,
        statics=statics,
        parameters=p.vector,
        objective_unit=unit,
        derived=p.all_derived,
    )


def deferred_rows(program: NonlinearProgram, structure: Structure) -> list[int]:
    """Return the rows that a first solution may leave out: those of limits that are rarely active."""
    rows = list(program.find_rows(kind="rate"))
    for phase in program.problem.phases:
        for name in rarely_active(structure, KINDS[phase.name].name):  # type: ignore[index]
            rows += list(program.find_rows(phase=phase.name, kind="path", name=name))
    return sorted(int(row) for row in rows)
