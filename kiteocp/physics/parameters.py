"""The numbers of a problem file as one vector of symbols, each addressed by its key path in the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from kiteocp.problem import Problem

#: Blocks of the problem file whose numbers are parameters of the model and of the optimal control problem.
BLOCKS = ("environment", "kite", "tether", "operation", "limits", "machine")


def _leaves(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(f"{prefix}.{key}", item)
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from _leaves(f"{prefix}[{index}]", item)
    elif value is not None:
        yield prefix, value


class Structure(msgspec.Struct, frozen=True):
    """What of a problem decides the shape of its expressions: which numbers it has, and its choices.

    Problems of one structure share all symbolic functions and differ only in the parameter vector.

    Attributes
    ----------
    keys
        Key paths of the numbers, in the order of the parameter vector.
    choices
        Key paths and values of the words (wind profile, force reference, ...).
    """

    keys: tuple[str, ...]
    choices: tuple[tuple[str, str], ...]

    def choice(self, key: str) -> str:
        """Return the word given for a key path."""
        return dict(self.choices)[key]


class ParameterValues(msgspec.Struct, frozen=True):
    """The structure of a problem and the values of its parameter vector, in the units of the file."""

    structure: Structure
    vector: np.ndarray

    def __getitem__(self, key: str) -> float:
        return float(self.vector[self.structure.keys.index(key)])

    def __contains__(self, key: str) -> bool:
        return key in self.structure.keys

    def kite_drag_coefficient(self, setting: str) -> float:
        """Drag coefficient of the kite without the tether, ``powered`` or ``depowered``, however the file gives it."""
        key = f"kite.{setting}.drag_coefficient"
        return (
            self[key]
            if key in self
            else self[f"kite.{setting}.lift_coefficient"] / self[f"kite.{setting}.lift_to_drag"]
        )

    def replaced(self, changes: Mapping[str, float]) -> ParameterValues:
        """Return the same with other numbers, without the checks of a problem file."""
        vector = self.vector.copy()
        for key, value in changes.items():
            vector[self.structure.keys.index(key)] = value
        return ParameterValues(self.structure, vector)


def parameter_values(problem: Problem, *, gravity: bool = True) -> ParameterValues:
    """Collect the numbers of a resolved problem.

    Parameters
    ----------
    problem
        The problem, every default filled in.
    gravity
        False sets the acceleration of gravity to zero: kite and tether without weight (section 2.3 of the paper).
    """
    content = problem.to_dict()
    numbers: dict[str, float] = {}
    choices: dict[str, str] = {}
    for block in BLOCKS:
        for key, value in _leaves(block, content.get(block)):
            if isinstance(value, str):
                choices[key] = value
            else:
                numbers[key] = float(value)
    # What phases there are is of the structure too.
    choices["optimisation.turn"] = str(content["optimisation"]["turn"])
    if not gravity:
        numbers["environment.gravity_m_s2"] = 0.0
    structure = Structure(tuple(numbers), tuple(sorted(choices.items())))
    return ParameterValues(structure, np.fromiter(numbers.values(), float, len(numbers)))


class Parameters:
    """Symbols of a structure's numbers: ``parameters["kite.mass_kg"]`` is one, ``parameters.vector`` all of them.

    Parameters
    ----------
    structure
        Of the problem.
    symbol
        What symbols are made of.
    keeps_derived
        Give symbols for what is derived from the numbers alone (`derived`), so that it can be computed once for many
        points; without, the expressions themselves.
    """

    def __init__(
        self, structure: Structure, symbol: type[ca.SX] | type[ca.MX] = ca.SX, *, keeps_derived: bool = False
    ) -> None:
        self.structure = structure
        self._symbol, self._keeps_derived = symbol, keeps_derived
        self._derived: dict[str, tuple[Any, Any]] = {}
        self.vector: Any = symbol.sym("p", len(structure.keys))
        self._symbols = dict(zip(structure.keys, ca.vertsplit(self.vector), strict=True))

    def __getitem__(self, key: str) -> Any:
        return self._symbols[key]

    def __contains__(self, key: str) -> bool:
        return key in self._symbols

    def derived(self, name: str, compute: Callable[[], Any]) -> Any:
        """Return what is computed from the numbers alone, a column; computed once for a name."""
        if name not in self._derived:
            expression = compute()
            symbols = self._symbol.sym(name, expression.numel()) if self._keeps_derived else expression
            self._derived[name] = symbols, expression
        return self._derived[name][0]

    @property
    def all_derived(self) -> tuple[Any, Any]:
        """Symbols of all that was derived so far, and their expressions, two columns."""
        nothing = self._symbol(0, 1)
        pairs = self._derived.values()
        return ca.vertcat(nothing, *(pair[0] for pair in pairs)), ca.vertcat(nothing, *(pair[1] for pair in pairs))

    def series(self, key: str) -> list[Any]:
        """Return the symbols of a list in the file, in its order."""
        return [symbol for name, symbol in self._symbols.items() if name.startswith(f"{key}[")]


@lru_cache(maxsize=32)
def parameters_of(structure: Structure) -> Parameters:
    """Return the symbols of a structure, the same ones at every call."""
    return Parameters(structure)
