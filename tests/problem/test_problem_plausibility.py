"""Values that no kite has are warned of, each with its slip; no kite from 2 to 1000 m2 is."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiteocp.problem import Problem, load_problem, problem_from_dict, shipped_problems
from kiteocp.problem.plausibility import implausible_values


def implausible(problem: Problem) -> list[str]:
    return implausible_values(problem.to_dict(), (problem.limits.height_min_m, problem.limits.height_max_m))


@pytest.mark.parametrize("name", list(shipped_problems()))
def test_no_shipped_problem_is_implausible(name: str) -> None:
    assert load_problem(name).warnings() == []


#: Forces in kgf: the limits and prescribed forces of v3-kite over 9.80665.
KGF = {
    "limits.tether_force_min_N": 30.6,
    "limits.tether_force_max_N": 510.0,
    "operation.traction.tether_force_N": 408.0,
    "operation.retraction.tether_force_N": 51.0,
}
FACTORS = {"profile": "table", "heights_m": [0, 100, 500], "speeds_m_s": [0.3, 1.0, 1.3]}


@pytest.mark.parametrize(
    ("values", "key", "slip"),
    [
        ({"tether.diameter_m": 4}, "tether.diameter_m", "mm"),
        ({"kite.mass_kg": 22800}, "kite.mass_kg", "in g"),
        ({"limits.generator_power_max_W": 40}, "limits.generator_power_max_W", "kW"),
        ({"environment.air.density_sea_level_kg_m3": 1225}, "environment.air.density_sea_level_kg_m3", "g/m3"),
        ({"tether.density_kg_m3": 0.724}, "tether.density_kg_m3", "g/cm3"),
        (KGF, "limits.tether_force_max_N", "kgf"),
        ({"environment.wind.roughness_length_m": 99.9}, "environment.wind.roughness_length_m", "height"),
        ({"environment.wind": FACTORS}, "environment.wind.speeds_m_s", "reference speed"),
        ({"kite.projected_area_m2": 25}, "kite.projected_area_m2", "flat area"),
        ({"operation.traction.elevation_deg": 0.47}, "operation.traction.elevation_deg", "rad"),
        ({"kite.powered.lift_coefficient": 90}, "kite.powered.lift_coefficient", "percent"),
    ],
)
def test_a_slip_is_one_sentence_with_its_key(values: dict[str, Any], key: str, slip: str) -> None:
    (warning,) = [text for text in implausible(load_problem("v3-kite", values)) if text.startswith(f"{key} ")]
    assert slip in warning
    assert "\n" not in warning


def test_the_forces_of_every_shipped_kite_in_kgf_are_noticed() -> None:
    for name in shipped_problems():
        problem = load_problem(name)
        limits, operation = problem.limits, problem.operation
        forces = {
            "limits.tether_force_min_N": limits.tether_force_min_N,
            "limits.tether_force_max_N": limits.tether_force_max_N,
            "operation.traction.tether_force_N": operation.traction.tether_force_N,
            "operation.retraction.tether_force_N": operation.retraction.tether_force_N,
        }
        wrong = problem.with_values({key: force / 9.80665 for key, force in forces.items()})
        assert any("kgf" in text for text in wrong.warnings()), name


def test_the_flat_area_of_a_kite_that_states_it_is_noticed() -> None:
    for name, area in {"strong-wind": 14.0, "moderate-wind": 25.0, "v3-kite": 25.0, "v9-kite": 60.0}.items():
        assert any("flat area" in text for text in load_problem(name, {"kite.projected_area_m2": area}).warnings())


def test_a_step_in_the_wind_table_is_named() -> None:
    table = {"profile": "table", "heights_m": [0, 120, 121, 600], "speeds_m_s": [11, 11, 5, 5]}
    (warning,) = load_problem("v3-kite", {"environment.wind": table}).warnings()
    assert "from 11 to 5 m/s between 120 and 121 m" in warning
    # Where the kite does not fly, and over a height that a jet needs, it is none.
    for heights in ([0, 20, 21, 600], [0, 120, 180, 600]):
        assert load_problem("v3-kite", {"environment.wind": {**table, "heights_m": heights}}).warnings() == []


@given(
    area=st.floats(2.0, 1000.0),
    mass=st.floats(0.3, 60.0),
    load=st.floats(100.0, 12000.0),
    power=st.floats(50.0, 20000.0),
    wind=st.floats(3.0, 30.0),
)
def test_no_kite_from_2_to_1000_m2_is_implausible(
    area: float, mass: float, load: float, power: float, wind: float
) -> None:
    """Soft and rigid kites: mass, force and power grow with the area, the tether with the force (0.5 GPa).

    The force stops where a tether of today does, at 3 MN and a diameter of 87 mm.
    """
    force = min(load * area, 3e6)
    problem = problem_from_dict(
        {
            "name": "any",
            "environment": {"wind": {"profile": "uniform", "reference_speed_m_s": wind}},
            "kite": {
                "projected_area_m2": area,
                "mass_kg": mass * area,
                "powered": {"lift_coefficient": 0.8, "lift_to_drag": 5},
                "depowered": {"lift_coefficient": 0.2, "drag_coefficient": 0.1},
            },
            "tether": {"diameter_m": (force / 4e8) ** 0.5, "density_kg_m3": 970, "drag_coefficient": 1.1},
            "limits": {"tether_force_max_N": force, "generator_power_max_W": power * area},
        }
    )
    assert implausible(problem) == []
