"""Wind profiles as objects: each is linear in its speeds, has words and a height, and knows how far it holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from kiteocp import load_problem
from kiteocp.physics.parameters import ParameterValues, parameter_values
from kiteocp.physics.wind import (
    PROFILES,
    in_wind,
    problem_in_wind,
    profile_of,
    reference_height,
    wind_function,
    wind_keys,
    wind_text,
)
from kiteocp.problem.catalogue import catalogue

WINDS: dict[str, dict[str, Any]] = {
    "logarithmic": {"reference_speed_m_s": 8.0, "reference_height_m": 100.0, "roughness_length_m": 0.03},
    "power-law": {"reference_speed_m_s": 8.0, "reference_height_m": 100.0, "exponent": 0.14},
    "uniform": {"reference_speed_m_s": 8.0},
    "table": {"heights_m": [0.0, 100.0, 500.0], "speeds_m_s": [4.0, 8.0, 11.0]},
}


def values_of(profile: str) -> ParameterValues:
    return parameter_values(load_problem("v3-kite", {"environment.wind": {"profile": profile, **WINDS[profile]}}))


def test_every_profile_of_the_problem_file_is_an_object() -> None:
    assert set(catalogue().children["environment"].children["wind"].variants) == set(PROFILES) == set(WINDS)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_is_linear_in_its_speeds(profile: str) -> None:
    values = values_of(profile)
    speed = wind_function(values.structure)
    heights = np.linspace(1.0, 600.0, 40)
    own, more = (np.array([float(speed(h, v.vector)) for h in heights]) for v in (values, in_wind(values, 1.3)))
    np.testing.assert_allclose(more, 1.3 * own, rtol=1e-13)
    problem = load_problem("v3-kite", {"environment.wind": {"profile": profile, **WINDS[profile]}})
    np.testing.assert_allclose(parameter_values(problem_in_wind(problem, 1.3)).vector, in_wind(values, 1.3).vector)
    assert len(wind_keys(values.structure)) == (3 if profile == "table" else 1)


@pytest.mark.parametrize("profile", ["logarithmic", "power-law", "uniform"])
def test_the_reference_speed_is_that_at_the_reference_height(profile: str) -> None:
    values = values_of(profile)
    assert float(wind_function(values.structure)(reference_height(values), values.vector)) == pytest.approx(8.0)


def test_words_and_how_far_a_profile_holds() -> None:
    words = {profile: wind_text(values_of(profile), 1.0) for profile in PROFILES}
    assert words["logarithmic"] == words["power-law"] == "8 m/s of wind at 100 m"
    assert words["uniform"] == "8 m/s of wind"
    assert words["table"] == "a wind of up to 11 m/s"
    remarks = {p: profile_of(values_of(p).structure).remark(values_of(p), 50.0, 520.0) for p in PROFILES}
    assert "meant for heights up to 500 m" in str(remarks["logarithmic"])
    assert "beyond the wind table (0 to 500 m)" in str(remarks["table"])
    assert remarks["power-law"] is remarks["uniform"] is None
