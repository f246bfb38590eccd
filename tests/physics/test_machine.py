"""The electrical machine: power behind it, and the energy moved through it either way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from kiteocp.physics.machine import ROUNDING_W, electrical, electrical_power, energy_moved


def test_power_counts_as_its_efficiency_says() -> None:
    assert electrical(1000.0, 1000.0, 0.9, 0.8) == pytest.approx(900.0, rel=1e-14)
    assert electrical(-1000.0, 1000.0, 0.9, 0.8) == pytest.approx(-1250.0, rel=1e-14)
    # Without losses nothing is rounded.
    assert float(electrical_power(3.0, 1.0, 1.0)) == 3.0


def test_the_rounding_is_what_its_comment_says() -> None:
    assert float(electrical_power(0.0, 0.9, 0.8)) == pytest.approx(-1.75, rel=1e-12)
    assert ROUNDING_W == 10.0
    assert float(electrical_power(1000.0, 0.9, 0.8)) == pytest.approx(900.0 - 0.00875, abs=1e-5)


# Coefficients next to zero have roots next to infinity.
COEFFICIENTS = st.floats(-5e3, 5e3).filter(lambda number: number == 0.0 or abs(number) > 1e-3)


@given(st.lists(COEFFICIENTS, min_size=3, max_size=3), st.integers(2, 30))
def test_the_energy_moved_of_a_parabola_is_exact(coefficients: list[float], steps: int) -> None:
    """Within a step of one change of sign; with so many steps, two changes in one step are small."""
    power = np.polynomial.Polynomial(coefficients)
    energy = power.integ()
    time = np.linspace(0.0, 2.0, 40 * steps)
    roots = [float(root.real) for root in power.roots() if abs(root.imag) < 1e-12 and 0.0 < root.real < 2.0]
    points = [0.0, *sorted(roots), 2.0]
    exact = sum(abs(float(energy(b) - energy(a))) for a, b in pairwise(points))
    assert energy_moved(time, power(time), energy(time)) == pytest.approx(exact, rel=1e-6, abs=1e-3)


def test_a_change_of_sign_within_a_step_is_found() -> None:
    exact = quad(lambda t: abs(np.sin(3.0 * t)), 0.0, 2.0, points=[np.pi / 3], limit=200)[0]
    # No step ends where the sign changes. Neglecting the change would cost 0.5 %.
    time = np.linspace(0.0, 2.0, 21)
    coarse = energy_moved(time, np.sin(3.0 * time), (1.0 - np.cos(3.0 * time)) / 3.0)
    assert coarse == pytest.approx(exact, rel=2e-5)
    fine = np.linspace(0.0, 2.0, 201)
    assert energy_moved(fine, np.sin(3 * fine), (1 - np.cos(3 * fine)) / 3) == pytest.approx(exact, rel=1e-7)
