"""Why there is no cycle: which limits are in conflict, and how far each would have to move.

Every question is the same one, "can these alone make a cycle possible, and by how little?", put to the elastic
version of the cycle problem (`kiteocp.ocp.elastic`): the limits that may move have weight 1, everything else a large
one. The wind speed may move as well, at a large weight, so that the program always has a feasible point.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.elastic import ElasticSolution
from kiteocp.ocp.trajectory import Trajectory
from kiteocp.optimum.conflict import Conflict, Infeasibility, sentence_of
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.relaxations import HEAVY, WIND_DOWN, WIND_UP, elastic_program, loosening, penalty_of, unit_of
from kiteocp.optimum.starts import STARTS, Start, guess_of, rescue_starts
from kiteocp.physics.parameters import ParameterValues
from kiteocp.physics.wind import in_wind, wind_keys

#: Mesh of the elastic program. The slacks differ from those of finer meshes by 1e-3 or less, but for cycles of a few
#: seconds at the edge of feasibility, where it is up to 4 %.
INTERVALS, DEGREE = (3, 2, 2, 2), 3

#: Below this a slack is no relaxation: a thousandth of a limit is below its margin in a certificate, and the solver's
#: own rest is 1e-6.
NOTHING = 1e-4

#: Starts that a joint optimum is sought from, and how many are drawn to get them; fewer where the two best agree on the
#: sum of slacks to this share.
STARTS_WANTED, STARTS_TRIED = 5, 8
SAME_TOTAL = 1e-3

#: Factors of the wind at which a cycle is looked for where there is none to begin with.
WIND_FACTORS = (2.0, 4.0, 8.0, 16.0, 32.0)

#: A limit that saves less has no part in the conflict.
NO_PART = 1e-3

#: A limit bites at the points that save this share of the most.
BITES = 0.1


def explain(values: ParameterValues, formulation: Formulation, *, conflict: bool = True) -> Infeasibility:
    """Say why no cycle was found; to be asked only after every start has failed.

    Parameters
    ----------
    values
        The problem's numbers.
    formulation
        Its choices; the mesh is replaced by a coarse one, and the equilibrium is the implicit one, which forgives more.
    conflict
        Look for the limits in conflict; without, only whether there is a cycle.

    Returns
    -------
    Infeasibility
        With a `start` if the elastic optimum vanishes, that is if a cycle exists after all; where no solution is
        found from it either, `kiteocp.optimum.relaxations.penalised_optimum` finds one.
    """
    return _Search(values, formulation).answer(conflict)


class _Repair(msgspec.Struct):
    """The cheapest relaxation found with some terms, and whether these alone sufficed."""

    found: ElasticSolution
    complete: bool


class _Search:
    """The questions asked of one problem."""

    def __init__(self, values: ParameterValues, formulation: Formulation) -> None:
        self.values = values
        intervals = INTERVALS[: len(formulation.phases)]
        coarse = replace(formulation, equilibrium="implicit", intervals=intervals, degree=DEGREE)
        self.elastic = elastic_program(values.structure, coarse)
        self.limits = [r.name for r in self.elastic.terms if r.name not in (WIND_UP, WIND_DOWN)]
        self.starts = 0

    def answer(self, with_conflict: bool) -> Infeasibility:
        """Find the joint optimum, the limits in conflict, what each alone would need, and the wind."""
        joint = self.joint()
        if joint is None:
            return Infeasibility("no cycle found, and no relaxation of the limits or the wind found either", ())
        total = sum(joint.found.slacks.values())
        if total < NOTHING:
            return Infeasibility(
                "no cycle found, although the limits seem to leave room for one",
                (),
                elastic_sum=total,
                starts=self.starts,
                start=self.trajectory(joint.found),
            )
        if not with_conflict:
            sentence = "no cycle keeps all limits (kiteocp solve says which of them are in conflict)"
            return Infeasibility(sentence, (), elastic_sum=total, starts=self.starts)
        # What the limits cannot repair together is not their conflict.
        alone, keys = self.smallest_conflict(joint.found) if joint.complete else ({}, [])
        conflict = sorted(
            (self.conflict(key, alone.get(key), joint.found) for key in keys),
            key=lambda c: (not c.alone, abs(c.relative_change or 0.0)),
        )
        factor = self.wind_factor(joint.found)
        relaxation = {
            key: self.moved(key, slack)
            for key, slack in joint.found.slacks.items()
            if joint.complete and key in self.limits and slack > NOTHING
        }
        return Infeasibility(
            sentence_of(self.values, conflict, factor, relaxation),
            tuple(conflict),
            wind_factor=factor,
            wind_needed_m_s=self.wind_speed(factor),
            relaxation=relaxation,
            elastic_sum=total,
            starts=self.starts,
        )

    def joint(self) -> _Repair | None:
        """Relax all limits together, from several starts, and keep the cheapest."""
        found: list[_Repair] = []
        calm = False
        for start in [*STARTS, *rescue_starts()][:STARTS_TRIED]:
            repair = None if calm else self.repair(self.limits, self.packed(start))
            if repair is None and (calm or not found):
                # In a calm the crude starts are too far from any cycle; one that flies in more wind is nearer.
                repair = self.from_more_wind(start)
                calm = calm or repair is not None
            if repair is not None:
                found.append(repair)
            totals = sorted(sum(one.found.slacks.values()) for one in found)
            agreed = len(totals) > 1 and totals[1] <= (1.0 + SAME_TOTAL) * totals[0]
            if len(found) == STARTS_WANTED or agreed or (totals and totals[0] < NOTHING):
                break
        self.starts = len(found)
        return min(found, key=lambda r: (not r.complete, sum(r.found.slacks.values())), default=None)

    def from_more_wind(self, start: Start) -> _Repair | None:
        """Relax all limits together from a cycle in as many times the wind as one needs; None where none is found."""
        penalties = {term.name: penalty_of(term, self.values, 1.0) for term in self.elastic.terms}
        for factor in WIND_FACTORS:
            found = self.elastic.solve(self.packed(start), in_wind(self.values, factor).vector, penalties)
            if found.success:
                more = factor * (1 + found.slacks.get(WIND_UP, 0.0)) - 1
                return self.repair(self.limits, found.x, slacks={**found.slacks, WIND_UP: more})
        return None

    def repair(
        self,
        allowed: Collection[str],
        x0: FloatArray,
        weights: Sequence[float] = HEAVY,
        slacks: Mapping[str, float] | None = None,
    ) -> _Repair | None:
        """Relax some limits as little as possible, the others only if these do not suffice; None if IPOPT failed."""
        repair = None
        for heavy in weights:
            penalties = {
                term.name: penalty_of(term, self.values, 1.0 if term.name in allowed else heavy)
                for term in self.elastic.terms
            }
            found = self.elastic.solve(x0, self.values.vector, penalties, slacks=slacks)
            if found.success:
                rest = sum(slack for name, slack in found.slacks.items() if name not in allowed)
                repair = _Repair(found, rest < NOTHING)
                if repair.complete:
                    break
                x0, slacks = found.x, found.slacks
        return repair

    def suffices(
        self, allowed: Collection[str], near: ElasticSolution, *, thorough: bool = True
    ) -> ElasticSolution | None:
        """Relaxation of these limits that makes a cycle possible, sought near another and, thoroughly, from afar."""
        # Far from the default start of the slacks only the wind can be, in a calm: keep to it.
        slacks = near.slacks if near.slacks.get(WIND_UP, 0.0) > 1.0 else None
        repair = self.repair(allowed, near.x, HEAVY[1:], slacks)
        if thorough and not (repair is not None and repair.complete):
            repair = self.repair(allowed, self.packed(STARTS[0]))
        return repair.found if repair is not None and repair.complete else None

    def smallest_conflict(self, joint: ElasticSolution) -> tuple[dict[str, ElasticSolution], list[str]]:
        """Find the limits that alone can repair, and a smallest set in conflict, of which these must be part.

        The rest of the set is found by deletion: a limit is needed if without it and those already deleted there is
        no conflict.
        """
        savings = {key: float(np.sum(self.elastic.savings(joint, key))) for key in self.limits}
        candidates = sorted((key for key in self.limits if savings[key] > NO_PART), key=lambda key: savings[key])
        alone = {key: found for key in candidates if (found := self.suffices([key], joint)) is not None}
        # What a relaxation moved repairs: no deletion may cover it. A repair that was overlooked shows up later.
        repairs: list[set[str]] = []
        others = [key for key in self.limits if key not in alone]
        if not self.repairs(others, joint, repairs):
            return alone, list(alone)
        # Those without a part in the joint optimum mostly go in one piece.
        idle = [key for key in others if savings[key] <= NO_PART]
        pieces = [[key] for key in sorted(others, key=lambda key: savings[key]) if key not in idle]
        pieces = [[key] for key in idle] + pieces if self.repairs(idle, joint, repairs) else [idle, *pieces]
        deleted: list[str] = []
        needed: list[str] = []
        pending = list(pieces)
        while pending:
            piece = pending.pop(0)
            if not self.repairs([*deleted, *piece], joint, repairs):
                deleted += piece
            elif any(repair <= set(deleted) for repair in repairs):
                deleted, needed, pending = [], [], [[key] for piece in pieces for key in piece]
            else:
                needed += piece
        return alone, [*alone, *needed]

    def repairs(self, deleted: Collection[str], near: ElasticSolution, known: list[set[str]]) -> bool:
        """Whether a cycle exists without these limits; remembers which of them had to move."""
        if any(repair <= set(deleted) for repair in known):
            return True
        found = self.suffices(deleted, near, thorough=False)
        if found is not None:
            known.append({key for key in deleted if found.slacks[key] > NOTHING})
        return found is not None

    def conflict(self, key: str, alone: ElasticSolution | None, joint: ElasticSolution) -> Conflict:
        """Say what a limit of the conflict alone would have to be, and where it bites."""
        slack = None if alone is None else alone.slacks[key]
        phase, elevation, length = self.place(key, alone or joint)
        return Conflict(
            key,
            self.values[key],
            needed=None if slack is None else self.moved(key, slack),
            relative_change=None if slack is None else loosening(key) * slack,
            phase=phase,
            elevation_deg=elevation,
            tether_length_m=length,
        )

    def place(
        self, key: str, found: ElasticSolution
    ) -> tuple[str | None, tuple[float, float] | None, tuple[float, float] | None]:
        """Phase, elevations and tether lengths at the points through which a limit saves most."""
        savings = self.elastic.savings(found, key)
        if not np.max(savings) > 0:
            return None, None, None
        by_phase: dict[str | None, float] = {}
        for label, saving in zip(self.elastic.rows, savings, strict=True):
            # The elevation of the traction, where it is one number, and the stroke belong to no point.
            phase = label.phase or ("traction" if label.kind == "static" or label.name == key else None)
            by_phase[phase] = by_phase.get(phase, 0.0) + max(float(saving), 0.0)
        name = max(by_phase, key=lambda phase: by_phase[phase])
        if name is None:
            return None, None, None
        points = [
            label.point
            for label, saving in zip(self.elastic.rows, savings, strict=True)
            if label.phase == name and label.point is not None and saving > BITES * np.max(savings)
        ]
        trajectory = self.trajectory(found)
        states = trajectory[name].values
        elevations = np.atleast_1d(np.degrees(states.get("elevation", trajectory.statics.get("elevation", np.nan))))
        lengths = states["tether_length"]
        if points and elevations.size > 1:
            elevations = elevations[points]
        lengths = lengths[points] if points else lengths
        return name, _range(elevations), _range(lengths)

    def wind_factor(self, joint: ElasticSolution) -> float | None:
        """Nearest factor of the wind speed at which a cycle exists with all limits as they are."""
        factors = []
        for name, sign in ((WIND_UP, 1), (WIND_DOWN, -1)):
            found = self.suffices([name], joint)
            if found is not None:
                factors.append(1 + sign * found.slacks[name])
        return min(factors, key=lambda factor: abs(factor - 1), default=None)

    def wind_speed(self, factor: float | None) -> float | None:
        """Return the reference wind speed at a factor, the largest speed of a table."""
        if factor is None:
            return None
        return factor * max(self.values[key] for key in wind_keys(self.values.structure))

    def moved(self, key: str, slack: float) -> float:
        """Value of a limit after a slack."""
        return self.values[key] + loosening(key) * slack * unit_of(self.values[key])

    def trajectory(self, found: ElasticSolution) -> Trajectory:
        """Read the cycle of a relaxation."""
        return self.elastic.program.unpack(found.x, found.p)

    def packed(self, start: Start) -> FloatArray:
        """Return a crude start for the elastic program."""
        return self.elastic.program.pack(guess_of(start, self.values, self.elastic.program))


def _range(numbers: Any) -> tuple[float, float] | None:
    low, high = float(np.min(numbers)), float(np.max(numbers))
    return (low, high) if np.isfinite(low) else None
