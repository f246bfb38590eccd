"""The optimum once more, by a second formulation that shares only the flight state with the package.

Here the reeling speed is the control and the equilibrium is solved by `casadi.rootfinder` inside the program, so that
there is no algebraic variable; the discretisation is Hermite-Simpson instead of Radau. It is slower and less robust,
and so it starts near the optimum (each quantity 5 % off): it says that this is an optimum, and of the same power.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import kiteocp
from kiteocp.cycle.phases import PHASES
from kiteocp.physics.equilibrium import equilibrium_functions
from kiteocp.physics.parameters import ParameterValues, parameter_values

#: Hermite-Simpson intervals of each phase.
INTERVALS = {"retraction": 7, "transition": 5, "traction": 3}
COURSES = {"retraction": 180.0, "transition": 0.0}


def flight_function(values: ParameterValues, phase: str) -> ca.Function:
    """``(length / 100 m, elevation, speed / 10 m/s) -> elevation rate, power, force at kite, at ground, height``."""
    functions = equilibrium_functions(values.structure, "reeling_speed")
    setting = "depowered" if phase == "retraction" else "powered"
    lift, drag = values[f"kite.{setting}.lift_coefficient"], values.kite_drag_coefficient(setting)
    x = ca.MX.sym("x", 3)
    azimuth, course = (0.0, COURSES[phase]) if phase in COURSES else (
        values["operation.traction.azimuth_deg"], values["operation.traction.course_deg"]
    )  # fmt: skip
    length, elevation = 100 * x[0], x[1]
    arguments = ca.vertcat(values.vector, length, elevation * (180 / np.pi), azimuth, course, lift, drag, 10 * x[2])
    state = functions.state(angle=functions.solve(np.arctan(0.75 * lift / drag), arguments), arguments=arguments)
    sign = {"retraction": 1.0, "transition": -1.0, "traction": 0.0}[phase]
    rows = [state["power"], state["tether_force_kite"], state["tether_force_ground"], state["height"]]
    return ca.Function("flight", [x], [ca.vertcat(sign * state["tangential_speed"] / length, *rows)])


def optimal_power(values: ParameterValues, start: kiteocp.Result) -> float:
    """Solve the second formulation from a disturbed optimum; return its mean power, W."""
    opti = ca.Opti()
    limit = {key.removeprefix("limits."): values[key] for key in values.structure.keys if key.startswith("limits.")}
    energy: Any = 0.0
    time: Any = 3 * limit["phase_change_time_s"]
    ends = []
    for phase in PHASES:
        count = 2 * INTERVALS[phase] + 1
        place, duration = opti.variable(3, count), opti.variable()
        length, elevation, speed = place[0, :], place[1, :], place[2, :]
        rates = flight_function(values, phase).map(count)(place)
        step = 10 * duration / INTERVALS[phase]
        slopes = ca.vertcat(speed / 10, rates[0, :])
        for k in range(0, count - 2, 2):
            before, middle, after = place[:2, k], place[:2, k + 1], place[:2, k + 2]
            opti.subject_to(after - before == step / 6 * (slopes[:, k] + 4 * slopes[:, k + 1] + slopes[:, k + 2]))
            opti.subject_to(middle == (before + after) / 2 + step / 8 * (slopes[:, k] - slopes[:, k + 2]))
            energy += step / 6 * (rates[1, k] + 4 * rates[1, k + 1] + rates[1, k + 2])
        time += 10 * duration
        shortest = limit[f"{phase}_duration_min_s"]
        lowest, highest = 0.0, np.radians(limit["elevation_max_deg"])
        if phase == "traction":
            lowest, highest = (np.radians(limit[f"traction_elevation_{side}_deg"]) for side in ("min", "max"))
        acceleration = limit["reeling_acceleration_max_m_s2"]
        # Quantity, its bounds and its scale. In the traction the elevation is constant: its rate is zero.
        bounds = [
            (ca.diff(10 * speed, 1, 1) / (step / 2), -acceleration, acceleration, 1),
            (rates[2, :], 0, limit["tether_force_max_N"], 1000),
            (rates[3, :], limit["tether_force_min_N"], 1e6, 1000),
            (rates[4, :], limit["height_min_m"], limit["height_max_m"], 100),
            (10 * speed, -limit["reel_in_speed_max_m_s"], limit["reel_out_speed_max_m_s"], 10),
            (100 * length, limit["tether_length_min_m"], limit["tether_length_max_m"], 100),
            (elevation[0] if phase == "traction" else elevation, lowest, highest, 1),
            (10 * duration, shortest, 1000, 10),
        ]
        for quantity, lower, upper, scale in bounds:
            opti.subject_to(opti.bounded(lower / scale, ca.vec(quantity) / scale, upper / scale))
        ends.append((place[:2, 0], place[:2, count - 1]))
        known = [
            start.channel(name, phase) for name in ("time_s", "tether_length_m", "elevation_deg", "reeling_speed_m_s")
        ]
        at = np.linspace(known[0][0], known[0][-1], count)
        r, beta, v = (np.interp(at, known[0], channel) for channel in known[1:])
        opti.set_initial(length, 0.95 * r / 100)
        opti.set_initial(elevation, 1.05 * np.radians(beta))
        opti.set_initial(speed, 0.95 * v / 10)
        opti.set_initial(duration, 1.05 * (at[-1] - at[0]) / 10)
    for (_, end), (begin, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        opti.subject_to(end == begin)
    opti.minimize(-energy / time / 1e4)
    quiet = {"ipopt.print_level": 0, "print_time": False, "show_eval_warnings": False, "ipopt.sb": "yes"}
    opti.solver("ipopt", {**quiet, "ipopt.max_iter": 300, "ipopt.tol": 1e-7})
    solution = opti.solve()
    return float(solution.value(energy / time))


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind"])
def test_same_optimum_with_the_rootfinder_in_the_program(name: str) -> None:
    """1e-4 of the mean power, the tolerance of the mesh of either; measured 7e-6."""
    problem = kiteocp.load_problem(name)
    result = kiteocp.solve(problem)
    power = optimal_power(parameter_values(problem), result)
    assert power == pytest.approx(result.cycle["mean_power_W"], rel=1e-4)
