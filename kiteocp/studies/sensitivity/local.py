"""Local sensitivity of the optimal mean power to every number of the problem file, exact, from one solution.

The optimum is polished on its active set and differentiated (`kiteocp.ocp.active_set`); how far the derivatives hold
is found by following it (`kiteocp.ocp.continuation`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from kiteocp.cycle.summary import cycle_summary, phase_summaries, validity_warnings
from kiteocp.execution import one_at_a_time
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.continuation import Reach
from kiteocp.ocp.nlp import Label
from kiteocp.optimum.cycle import active_limits
from kiteocp.optimum.refine import optimise
from kiteocp.problem import Problem
from kiteocp.problem.catalogue import Key, catalogue
from kiteocp.result import Result
from kiteocp.studies.sensitivity.derivatives import LocalStudy
from kiteocp.studies.sensitivity.report import design_warnings, shadow_prices

#: How far to follow a parameter, as a share of its value.
FARTHEST = 0.5

#: Change of a parameter, as a share of its value, where no uncertainty is stated.
USUAL_CHANGE = 0.01

#: The linear value misleads where it is off by this share of itself and by this share of the optimal power.
MISLEADING_SHARE, NEGLIGIBLE_SHARE = 0.1, 1e-4


@one_at_a_time
def sensitivities(problem: Problem, *, intervals: bool = True) -> Result:
    """Differentiate the optimal mean power with respect to every number of a problem.

    Parameters
    ----------
    problem
        The problem; its ``uncertainty`` block says how far its numbers may be off.
    intervals
        Also follow the optimum along every number until its active set changes, and re-solve at the ends of its
        uncertainty (1 % where none is stated).

    Returns
    -------
    Result
        Of verb ``sensitivity``, with ``details["sensitivities"]`` and ``details["shadow_prices"]``. Its status is that
        of the certificate: on the mesh of the problem file, or on a refinement where that does not pass.

    Raises
    ------
    InfeasibleError, SolveError
        As `kiteocp.optimum.solve.solve`; `SolveError` also where the optimum cannot be differentiated.

    Notes
    -----
    Derivatives of the optimum follow Fiacco, *Introduction to Sensitivity and Stability Analysis in Nonlinear
    Programming*, 1983.
    """
    began = time.perf_counter()
    optimum = optimise(problem, certificate="quick")
    judged = optimum if optimum.certificate.passed else optimise(problem, certificate="full")
    study = LocalStudy.of(optimum)
    rows = [_row(study, column, intervals) for column in range(len(study.keys))]
    cycle, values = optimum.cycle, optimum.values
    phases = phase_summaries(cycle.records, values)
    traction, pause = cycle.record("traction"), values["limits.phase_change_time_s"]
    elevation = float(np.trapezoid(traction.elevation_rad, traction.time_s)) / traction.duration_s
    altitude = 0.5 * float(traction.tether_length_m[0] + traction.tether_length_m[-1]) * float(np.sin(elevation))
    return Result(
        verb="sensitivity",
        problem=problem,
        status=judged.certificate.status,
        warnings=(*design_warnings(rows, _force_rules(study)), *validity_warnings(cycle.records, values)),
        phases=phases,
        cycle=dict(cycle_summary(values, phases, traction_altitude_m=altitude, phase_change_time_s=pause)),
        details={
            "objective": problem.optimisation.objective,
            "optimal_mean_power_W": study.mean_power_W,
            "sensitivities": rows,
            "shadow_prices": shadow_prices(study.keys, _prices(study), study.gradient_alone, study.followers),
            "active_limits": active_limits(cycle),
            "certificate": judged.certificate.to_dict(),
            "time_s": time.perf_counter() - began,
            **({} if judged.certificate.passed else {"message": judged.certificate.message}),
        },
    )


def _row(study: LocalStudy, column: int, intervals: bool) -> dict[str, Any]:
    """Return everything about one key, in the words of the summary."""
    key, value, power = study.keys[column], float(study.polished.p[column]), study.mean_power_W
    derivative = float(study.gradient[column])
    below, above = (float(side[column]) for side in study.sides)
    key_facts = _declared(key)
    stated = study.optimum.problem.uncertainty.get(key)
    usual = USUAL_CHANGE * abs(value)
    ends = stated.bounds(value) if stated else (value - usual, value + usual)
    slopes = [slope if np.isfinite(slope) else None for slope in (below, above)]
    changes = [None if slope is None else slope * (end - value) for slope, end in zip(slopes, ends, strict=True)]
    row: dict[str, Any] = {
        "key": key,
        "value": value,
        "unit": key_facts.unit or "1",
        "derivative": derivative,
        "followed_by": list(study.followers(column)),
        "derivative_alone": float(study.gradient_alone[column]),
        "elasticity": derivative * value / power if power else None,
        "derivative_below": slopes[0],
        "derivative_above": slopes[1],
        "second_derivative": study.curvature(column),
        "valid_from": None,
        "valid_to": None,
        "ended_below_by": None,
        "ended_above_by": None,
        "uncertainty_stated": stated is not None,
        "uncertainty_from": ends[0],
        "uncertainty_to": ends[1],
        "change_at_from_W": changes[0],
        "change_at_to_W": changes[1],
        "schedule": _schedule(study, column),
    }
    if intervals:
        row |= _interval(study, column, ends, changes)
        if value in (row["valid_from"], row["valid_to"]):
            row["second_derivative"] = None  # differs from side to side
    return row


def _interval(study: LocalStudy, column: int, ends: tuple[float, float], changes: list[float | None]) -> dict[str, Any]:
    """Find how far the active set holds, and what re-solving at the ends of the uncertainty gives."""
    value, power = float(study.polished.p[column]), study.mean_power_W
    way = FARTHEST * abs(value) or 1.0
    row: dict[str, Any] = {}
    misleading = False
    bounds = _domain(study.keys[column])
    for side, sign, end, linear in zip(("below", "above"), (-1.0, 1.0), ends, changes, strict=True):
        limit = bounds[0] if sign < 0 else bounds[1]
        farthest = sign * min(way, abs(limit - value))
        reach = study.reach(column, farthest) if farthest else Reach(0.0, None)
        place, name = ("valid_from", "from") if sign < 0 else ("valid_to", "to")
        row[place] = value + reach.step if np.isfinite(reach.step) else None
        row[f"ended_{side}_by"] = None if reach.ended_by is None else limit_name(reach.ended_by)
        still = not study.derivatives.x[:, column].any() and abs(end - value) <= abs(reach.step)
        outside = (end - limit) * sign > 0.0
        solved = power if still else None if outside else study.power_at(column, end - value)
        row[f"resolved_change_at_{name}_W"] = None if solved is None else solved - power
        if linear is not None and solved is not None and end != value:
            gap = abs(solved - power - linear)
            misleading |= gap > MISLEADING_SHARE * abs(linear) and gap > NEGLIGIBLE_SHARE * abs(power)
        elif end != value and not outside:
            misleading = True
    row["misleading"] = bool(misleading)
    return row


def limit_name(label: Label) -> str:
    """Return the phase and quantity of a bound in plain words."""
    name = label.name.removeprefix("limits.").replace("_", " ")
    return f"{name} in the {label.phase}" if label.phase else name


def _schedule(study: LocalStudy, column: int) -> dict[str, dict[str, float]]:
    """Differentiate durations, tether lengths, elevations and mean forces, per unit of a key, by phase."""
    program = study.optimum.solver.program
    change = study.derivatives.x[:, column] * program.scales
    found: dict[str, dict[str, float]] = {}
    statics = {label.name: change[index] for index, label in enumerate(program.variables) if label.kind == "static"}
    for phase in program.problem.phases:
        layout, mesh = program.layouts[phase.name], program.mesh[phase.name]
        states = {v.name: change[places] for v, places in zip(phase.states, layout.states, strict=True)}
        controls = {v.name: change[places] for v, places in zip(phase.controls, layout.controls, strict=True)}
        length = states["tether_length"]
        elevation = states.get("elevation", np.full(2, statics.get("elevation", 0.0)))
        found[phase.name] = {
            "duration_s": float(change[layout.duration]),
            "tether_length_start_m": float(length[0]),
            "tether_length_end_m": float(length[-1]),
            "elevation_start_deg": float(np.degrees(elevation[0])),
            "elevation_end_deg": float(np.degrees(elevation[-1])),
            "radial_ground_force_mean_N": float(mesh.weights @ controls["radial_ground_force"]),
        }
    return found


def _prices(study: LocalStudy) -> dict[str, FloatArray]:
    """Differentiate the optimal power through the active bounds, by phase, shape (keys,); the rest by itself."""
    pressing = np.concatenate((study.polished.lam_x, study.polished.lam_g))
    program = study.optimum.solver.program
    shares = -program.in_units(pressing[:, None] * study.derivatives.pressed)
    labels = (*program.variables, *program.rows)
    phases = [_phase_of(label, [phase.name for phase in program.problem.phases]) for label in labels]
    prices = {
        name: shares[[index for index, phase in enumerate(phases) if phase == name]].sum(axis=0)
        for name in dict.fromkeys(phases)
    }
    prices["cycle"] = study.gradient - sum(share for name, share in prices.items() if name != "cycle")
    return prices


def _phase_of(label: Label, phases: Sequence[str]) -> str:
    """Phase in which a bound presses, ``cycle`` for what holds between phases."""
    if label.phase is None:
        # The one elevation of the traction belongs to no other phase.
        return "traction" if label.kind == "static" else "cycle"
    # The start of a phase is the end of the one before, where it presses as well; one name for both.
    return phases[phases.index(label.phase) - 1] if label.point == 0 else label.phase


def _force_rules(study: LocalStudy) -> bool:
    """Whether the largest tether force is held in the traction."""
    column = study.keys.index("limits.tether_force_max_N")
    return bool(_prices(study)["traction"][column] > 0.0)


def _declared(key: str) -> Key:
    bare = key.partition("[")[0]
    return next(known for known in catalogue().walk() if known.path == bare)


def _domain(key: str) -> tuple[float, float]:
    """Least and greatest value that the problem file may give for a key."""
    bounds = _declared(key).bounds
    low, high = bounds.get("gt", bounds.get("ge", -np.inf)), bounds.get("lt", bounds.get("le", np.inf))
    return low, high
