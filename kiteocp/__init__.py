"""Optimal pumping cycles of kite power systems: model, forward simulation and optimal control.

>>> import kiteocp
>>> problem = kiteocp.load_problem("strong-wind")
>>> result = kiteocp.simulate(problem)
>>> force = result["tether_force_kite_N"]

Importing the package loads neither NumPy nor CasADi; each name is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kiteocp._version import __version__ as __version__

if TYPE_CHECKING:
    from kiteocp import errors as errors
    from kiteocp import plots as plots
    from kiteocp.cycle import simulate as simulate
    from kiteocp.cycle.fast.batch import BatchResult as BatchResult
    from kiteocp.cycle.fast.batch import simulate_batch as simulate_batch
    from kiteocp.errors import CycleError as CycleError
    from kiteocp.errors import InputError as InputError
    from kiteocp.errors import KiteocpError as KiteocpError
    from kiteocp.errors import NoEquilibriumError as NoEquilibriumError
    from kiteocp.errors import SolveError as SolveError
    from kiteocp.optimum.many import solve_many as solve_many
    from kiteocp.optimum.solve import solve as solve
    from kiteocp.physics.flight import flight_state as flight_state
    from kiteocp.problem import Problem as Problem
    from kiteocp.problem import load_problem as load_problem
    from kiteocp.problem import shipped_problems as shipped_problems
    from kiteocp.recording import FlightData as FlightData
    from kiteocp.recording import load_flight as load_flight
    from kiteocp.result import Result as Result
    from kiteocp.result import load_result as load_result
    from kiteocp.studies.crosswind.study import crosswind as crosswind
    from kiteocp.studies.crosswind.study import representative_course as representative_course
    from kiteocp.studies.estimation.study import estimate as estimate
    from kiteocp.studies.paper.paper import validate_paper as validate_paper
    from kiteocp.studies.prediction.study import validate_flight as validate_flight
    from kiteocp.studies.sensitivity.local import sensitivities as sensitivities
    from kiteocp.studies.winch.export import export_schedule as export_schedule

#: Modules that are used by their names, as ``kiteocp.plots.draw``.
_MODULES = ("errors", "plots")

_HOMES: dict[str, str] = {
    "BatchResult": "kiteocp.cycle.fast.batch",
    "CycleError": "kiteocp.errors",
    "FlightData": "kiteocp.recording",
    "InputError": "kiteocp.errors",
    "KiteocpError": "kiteocp.errors",
    "NoEquilibriumError": "kiteocp.errors",
    "Problem": "kiteocp.problem",
    "Result": "kiteocp.result",
    "SolveError": "kiteocp.errors",
    "crosswind": "kiteocp.studies.crosswind.study",
    "estimate": "kiteocp.studies.estimation.study",
    "export_schedule": "kiteocp.studies.winch.export",
    "flight_state": "kiteocp.physics.flight",
    "load_flight": "kiteocp.recording",
    "load_problem": "kiteocp.problem",
    "load_result": "kiteocp.result",
    "representative_course": "kiteocp.studies.crosswind.study",
    "shipped_problems": "kiteocp.problem",
    "sensitivities": "kiteocp.studies.sensitivity.local",
    "simulate": "kiteocp.cycle",
    "simulate_batch": "kiteocp.cycle.fast.batch",
    "solve": "kiteocp.optimum.solve",
    "solve_many": "kiteocp.optimum.many",
    "validate_flight": "kiteocp.studies.prediction.study",
    "validate_paper": "kiteocp.studies.paper.paper",
}

__all__ = ["__version__", *_MODULES, *_HOMES]  # noqa: PLE0604  (names, by the tables above)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    import importlib  # noqa: PLC0415  (kept out of `import kiteocp`)

    value: Any
    if name in _MODULES:
        value = importlib.import_module(f"kiteocp.{name}")
    elif name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module 'kiteocp' has no attribute '{name}'")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
