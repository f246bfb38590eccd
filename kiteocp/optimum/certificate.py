"""What is known about an optimum: every claim recomputed from the numbers, none taken from the solver's word alone.

A certificate is a list of checks. Those that must pass decide the status; the others inform. ``quick`` judges a
solution on its own mesh; ``full`` has also solved a refinement of the mesh and compared; ``none`` certifies nothing.
The checks of the solution of the program are here, those of the cycle it stands for in `kiteocp.optimum.checks`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from kiteocp.ocp.nlp import NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution
from kiteocp.ocp.optimality import Optimality
from kiteocp.optimum.check import Check, Level
from kiteocp.optimum.checks import (
    ELEVATION_TOLERANCE_DEG,
    MARGIN_TOLERANCE,
    intervals_beyond,
    jumps_check,
    limit_margins,
    limits_check,
    objective_check,
    resimulation_check,
)
from kiteocp.report.words import listed

__all__ = [
    "ELEVATION_TOLERANCE_DEG",
    "KKT_TOLERANCE",
    "MARGIN_TOLERANCE",
    "MESH_TOLERANCE",
    "Certificate",
    "Check",
    "Level",
    "intervals_beyond",
    "jumps_check",
    "kkt_check",
    "limit_margins",
    "limits_check",
    "mesh_check",
    "objective_check",
    "optimality_of",
    "resimulation_check",
    "solver_check",
    "starts_check",
]

#: First-order residuals in the scaled units of the program; the solver is asked for 1e-8.
KKT_TOLERANCE = 1e-6

#: Relative change of the optimal power from a mesh to its refinement.
MESH_TOLERANCE = 1e-4

#: Powers nearer than this, relative, are one local optimum.
SAME_OPTIMUM = 1e-4


class Certificate(msgspec.Struct, frozen=True):
    """All checks of one optimum."""

    level: Level
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return not self.failures

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if check.passed is False)

    @property
    def status(self) -> str:
        """``certified`` or ``not_certified``."""
        return "certified" if self.passed and self.level != "none" else "not_certified"

    @property
    def message(self) -> str:
        """Why there is no certificate, in one sentence; empty where there is one."""
        if self.passed and self.level == "none":
            return "no certificate was asked for: limits between the mesh points and the re-simulation are not checked"
        return "; ".join(f"the check of {check.name} failed: {check.text}" for check in self.failures)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values for the summary."""
        return {
            "level": self.level,
            "passed": self.passed,
            "failures": [check.name for check in self.failures],
            "checks": [check.to_dict() for check in self.checks],
        }


@lru_cache(maxsize=16)
def optimality_of(program: NonlinearProgram) -> Optimality:
    """Return the (once built) derivatives that judge solutions of a program."""
    return Optimality(program)


def solver_check(solution: Solution, mesh: str | None = None) -> Check:
    """Check what the solver says of itself, on the mesh of this name."""
    where = f" on mesh {mesh}" if mesh is not None else ""
    text = f"{solution.method}: {solution.status}{where} after {solution.iterations} iterations"
    return Check("solver", solution.success, None, None, text)


def kkt_check(program: NonlinearProgram, solution: Solution) -> Check:
    """Recompute the first-order conditions, and the objective, from the numbers of the solution."""
    optimality = optimality_of(program)
    kkt = optimality.residuals(solution)
    misstated = abs(optimality.objective(solution) - solution.f)
    # The largest of numbers among which one is missing may be any of them.
    numbers = np.array([kkt.stationarity, kkt.primal_feasibility, kkt.complementarity, misstated])
    largest = float(np.max(numbers))
    passed = bool(largest <= KKT_TOLERANCE)
    text = (
        f"stationarity {kkt.stationarity:.1e}, feasibility {kkt.primal_feasibility:.1e}, "
        f"complementarity {kkt.complementarity:.1e}"
    )
    if not passed:
        text += f"; worst at {kkt.worst_variable} and {kkt.worst_row}"
    if not misstated <= KKT_TOLERANCE:
        text += f"; the objective is not the one claimed, by {misstated:.1e}"
    return Check("optimality", passed, largest if np.isfinite(largest) else None, KKT_TOLERANCE, text)


def mesh_check(powers_W: Sequence[float], meshes: Sequence[str]) -> Check:
    """Compare the optimal powers of a mesh and its refinements, coarse to fine."""
    if len(powers_W) < 2:
        return Check("mesh", False, None, MESH_TOLERANCE, "no refinement of the mesh could be solved")
    change = abs(powers_W[-1] - powers_W[-2]) / max(abs(powers_W[-1]), 1.0)
    text = f"the optimal power changes by {100 * change:.2g} % from mesh {meshes[-2]} to {meshes[-1]}"
    return Check("mesh", bool(change <= MESH_TOLERANCE), change, MESH_TOLERANCE, text)


def starts_check(powers_W: Sequence[float | None], failed: Mapping[str, str] = MappingProxyType({})) -> Check:
    """Count the local optima that the starts led to.

    Parameters
    ----------
    powers_W
        Mean power that each start led to; None where it led to no optimum.
    failed
        Starts that led to no optimum, and IPOPT's word for how each of them ended.
    """
    reached = [power for power in powers_W if power is not None]
    optima: list[float] = []
    for power in sorted(reached, reverse=True):
        if not optima or abs(power - optima[-1]) > SAME_OPTIMUM * max(abs(optima[-1]), 1.0):
            optima.append(power)
    spread = (optima[0] - optima[-1]) / max(abs(optima[0]), 1.0) if optima else None
    word = "optimum" if len(optima) == 1 else "optima"
    text = f"{len(reached)} of {len(powers_W)} starts led to {len(optima)} local {word}"
    if len(powers_W) == len(reached) == 1:
        text = "solved from one start; a full certificate has a second opinion"
    if len(optima) > 1 and spread is not None:
        text += f", {100 * spread:.2g} % apart in power; the best is kept"
    if failed:
        text += "; none from " + listed([f"'{start}' ({status})" for start, status in failed.items()], "and")
    return Check("starts", None if reached else False, spread, None, text)
