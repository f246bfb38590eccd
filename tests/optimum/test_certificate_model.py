"""A transcription with another model than that of the simulation, or on too coarse a mesh, must not be certified.

The sabotage reaches the optimal control problem alone; the re-simulation flies with the model as it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from kiteocp import load_problem
from kiteocp.ocp.nlpsolver import Solver
from kiteocp.ocp.optimality import Optimality
from kiteocp.optimum import certificate as certify
from kiteocp.optimum import program as formulation
from kiteocp.optimum import refine as solution
from kiteocp.optimum import search
from kiteocp.optimum.program import Formulation
from kiteocp.optimum.refine import Optimum, optimise
from kiteocp.optimum.search import cycle_solver, solver_options
from kiteocp.physics.model import Coefficients, FlightState, LocalConditions, Model, Position
from kiteocp.physics.parameters import parameter_values


def failures(optimum: Optimum) -> set[str]:
    return {check.name for check in optimum.certificate.failures}


class WithoutTetherDrag(Model):
    def conditions(self, position: Position, coefficients: Coefficients) -> LocalConditions:
        around, kite_drag = super().conditions(position, coefficients), coefficients.kite_drag
        resultant = (coefficients.lift**2 + kite_drag**2) ** 0.5
        return replace(around, drag_coefficient=kite_drag, resultant_coefficient=resultant)


class WeightUpwards(Model):
    def conditions(self, position: Position, coefficients: Coefficients) -> LocalConditions:
        around = super().conditions(position, coefficients)
        return replace(around, weight_along=-around.weight_along)


class WithoutWeightAcross(Model):
    def conditions(self, position: Position, coefficients: Coefficients) -> LocalConditions:
        around = super().conditions(position, coefficients)
        return replace(around, weight_across=0.0 * around.weight_across)


class WindOnePercentStronger(Model):
    def wind_speed(self, height: Any) -> Any:
        return 1.01 * super().wind_speed(height)


class LiftToDragOfTheResidualOff(Model):
    """An equilibrium that balances two per cent less drag than there is."""

    def state_at_force(self, position: Position, around: LocalConditions, force: Any, angle: Any) -> FlightState:
        state = super().state_at_force(position, around, force, angle)
        return replace(state, residual=state.residual + 0.02 * around.drag_coefficient / around.resultant_coefficient)


class PowerOfTheKite(Model):
    """The force at the kite times the speed of the tether: without what the weight of the tether takes."""

    def state_at_force(self, position: Position, around: LocalConditions, force: Any, angle: Any) -> FlightState:
        state = super().state_at_force(position, around, force, angle)
        return replace(state, power=state.tether_force_kite * state.reeling_speed)


class ClimbsFaster(Model):
    def state_at_force(self, position: Position, around: LocalConditions, force: Any, angle: Any) -> FlightState:
        state = super().state_at_force(position, around, force, angle)
        return replace(state, tangential_speed=1.02 * state.tangential_speed)


@pytest.fixture
def fresh_programs() -> Iterator[None]:
    """Let no program of another model outlive a test, in either direction."""
    caches = (formulation.cycle_program, formulation._declared, search.cycle_solver)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


@pytest.mark.usefixtures("fresh_programs")
@pytest.mark.parametrize(
    "sabotage",
    [
        WithoutTetherDrag,
        WeightUpwards,
        WithoutWeightAcross,
        WindOnePercentStronger,
        LiftToDragOfTheResidualOff,
        PowerOfTheKite,
        ClimbsFaster,
    ],
)
def test_another_model_in_the_transcription_fails_the_re_simulation(
    sabotage: type[Model], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(formulation, "Model", sabotage)
    optimum = optimise(load_problem("v3-kite"), certificate="quick")
    assert "re-simulation" in failures(optimum)
    assert "the check of re-simulation failed" in optimum.certificate.message
    # To the solver the wrong problem is a problem like any other.
    assert not {"solver", "optimality"} & failures(optimum)


@pytest.mark.usefixtures("fresh_programs")
def test_refining_the_mesh_does_not_repair_another_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formulation, "Model", WindOnePercentStronger)
    monkeypatch.setattr(solution, "REFINEMENTS", 2)
    assert "re-simulation" in failures(optimise(load_problem("v3-kite"), certificate="full"))


@pytest.mark.parametrize("objective", ["mechanical", "electrical"])
@pytest.mark.parametrize("name", ["strong-wind", "v3-kite"])
def test_the_objective_is_the_mean_power_of_the_cycle(name: str, objective: str) -> None:
    lossy = {"machine.generator_efficiency": 0.9, "machine.motor_efficiency": 0.8}
    optimum = optimise(load_problem(name, {"optimisation.objective": objective, **lossy}), certificate="quick")
    pauses = 3 * optimum.values["limits.phase_change_time_s"]
    records = optimum.cycle.records
    energies = [r.energy_J if objective == "mechanical" else r.electrical_energy_J for r in records]
    duration = sum(record.duration_s for record in records) + pauses
    # Both are the same Radau quadrature; only rounding remains.
    assert optimum.mean_power_W == pytest.approx(sum(energies) / duration, rel=1e-9)
    # The check is there for both, and sees a program that maximised something else.
    assert "objective" in [check.name for check in optimum.certificate.checks]
    assert certify.objective_check(optimum.mean_power_W, optimum.cycle, objective).passed
    other = "electrical" if objective == "mechanical" else "mechanical"
    assert not certify.objective_check(optimum.mean_power_W, optimum.cycle, other).passed


def coarse(degree: int) -> dict[str, int]:
    intervals = {f"optimisation.mesh.{phase}_intervals": 1 for phase in ("retraction", "transition", "traction")}
    return {**intervals, "optimisation.mesh.degree": degree}


@pytest.mark.parametrize("name", ["strong-wind", "v3-kite"])
@pytest.mark.parametrize("degree", [1, 2])
def test_too_coarse_a_mesh_is_not_certified_as_it_is(name: str, degree: int) -> None:
    optimum = optimise(load_problem(name, coarse(degree)), certificate="quick")
    assert failures(optimum) & {"re-simulation", "limits"}
    assert not failures(optimum) & {"solver", "optimality"}


@pytest.mark.parametrize("name", ["strong-wind", "v3-kite"])
def test_refinement_repairs_a_coarse_mesh(name: str) -> None:
    optimum = optimise(load_problem(name, coarse(3)), certificate="full")
    assert optimum.certificate.status == "certified", optimum.certificate.message
    assert len(optimum.facts["meshes"]) > 2
    # Twice what the certificate allows: it compares neighbouring meshes, and the default one is as near as that itself.
    reference = optimise(load_problem(name), certificate="full").mean_power_W
    assert optimum.mean_power_W == pytest.approx(reference, rel=2 * certify.MESH_TOLERANCE)


def test_a_mesh_that_stays_too_coarse_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solution, "REFINEMENTS", 1)
    optimum = optimise(load_problem("strong-wind", coarse(1)), certificate="full")
    assert "mesh" in failures(optimum)
    assert "the check of mesh failed" in optimum.certificate.message


def test_no_refinement_is_no_mesh_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """A finer mesh that cannot be solved proves nothing."""
    honest, default = Solver.solve, Formulation.of(load_problem("strong-wind")).intervals

    def solve(self: Solver, *arguments: Any, **options: Any) -> Any:
        found = honest(self, *arguments, **options)
        mesh = tuple(phase.intervals for phase in self.program.mesh.values())
        return found if mesh == default else replace(found, success=False)

    monkeypatch.setattr(Solver, "solve", solve)
    assert failures(optimise(load_problem("strong-wind"), certificate="full")) == {"mesh"}


#: Ten numbers that enter in every way: through the model, through bounds of variables and of rows, and the objective.
GRADIENT_KEYS = (
    "environment.wind.reference_speed_m_s",
    "environment.wind.roughness_length_m",
    "kite.mass_kg",
    "kite.projected_area_m2",
    "kite.powered.lift_coefficient",
    "tether.diameter_m",
    "tether.drag_coefficient",
    "limits.tether_force_max_N",
    "limits.tether_length_max_m",
    "limits.phase_change_time_s",
)


@pytest.mark.parametrize("name", ["strong-wind", "moderate-wind"])
def test_gradient_of_the_optimum_against_solving_again(name: str) -> None:
    problem = load_problem(name)
    values = parameter_values(problem)
    solver = cycle_solver(values.structure, Formulation.of(problem), solver_options(problem))
    best = optimise(problem, certificate="quick").solution
    gradient = Optimality(solver.program).parametric_gradient(best)
    # Large enough for the solver's 1e-8 in the objective, small enough for the active set to stay: the error of the
    # difference is then of the order of the step squared.
    step = 1e-3
    for key in GRADIENT_KEYS:
        index, ends = values.structure.keys.index(key), []
        for sign in (-1.0, 1.0):
            moved = values.replaced({key: values[key] * (1 + sign * step)})
            again = solver.solve(best.x, moved.vector)
            assert again.success
            ends.append(again.f)
        difference = (ends[1] - ends[0]) / (2 * step * values[key])
        # The last term is the solver's tolerance over the step.
        tolerance = 1e-3 * abs(difference) + 2e-8 / (step * values[key])
        assert gradient[index] == pytest.approx(difference, abs=tolerance), key
    assert np.all(np.isfinite(gradient))
