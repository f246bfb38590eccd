"""Convergence of the paper's finite-difference scheme (section Convergence Study): harvesting factor over time step."""

from __future__ import annotations

from dataclasses import dataclass

from kiteocp.ocp.collocation import FloatArray


@dataclass(frozen=True)
class Curve:
    """Mean harvesting factor of one cycle over the nondimensional time step of the paper's scheme.

    Attributes
    ----------
    time_steps
        Nondimensional time steps, falling, shape (n,).
    ratios
        Mean harvesting factor over that of the smallest time step, shape (n,); not a number where the scheme failed.
    accurate_ratio
        The same for the adaptive integrator.
    steps
        Steps of the whole cycle, shape (n,); not a number where the scheme failed.
    """

    time_steps: FloatArray
    ratios: FloatArray
    accurate_ratio: float
    steps: FloatArray


@dataclass(frozen=True)
class Convergence:
    """The convergence study.

    Attributes
    ----------
    curves
        By the case and the treatment of gravity, as ``strong wind, gravity included``.
    """

    curves: dict[str, Curve]
