"""Simulated cycles of the shipped problems, each flown once."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import pytest

import kiteocp

Simulated = Callable[..., kiteocp.Result]


@lru_cache
def _simulated(name: str, gravity: bool) -> kiteocp.Result:
    return kiteocp.simulate(kiteocp.load_problem(name), gravity=gravity)


@pytest.fixture(scope="session")
def simulated() -> Simulated:
    """``simulated(problem name, gravity=True)``."""
    return lambda name, gravity=True: _simulated(name, gravity)


@pytest.fixture(scope="session")
def problem() -> kiteocp.Problem:
    return kiteocp.load_problem("strong-wind")
