"""The result of a calculation: phases, cycle and time series of one pumping cycle, with named channels."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from kiteocp._version import __version__
from kiteocp.problem import Problem
from kiteocp.report.document import Document
from kiteocp.result.channels import CYCLE_KEYS, PHASE_KEYS, PHASES, suggest, unit_of
from kiteocp.result.contract import HEAD_KEYS, OUTCOME_KEYS, SCHEMA_VERSION, STATUSES, SUCCESSFUL_STATUSES, to_plain
from kiteocp.result.storage import save_result
from kiteocp.result.table import result_document


class Result(msgspec.Struct, frozen=True, eq=False):
    """One pumping cycle, simulated or optimal: what every verb returns, prints and saves.

    ``result["tether_force_kite_N"]`` is the time series of a channel, ``print(result)`` a table.

    Attributes
    ----------
    verb : str
        The calculation that made it, as ``simulate`` or ``solve``.
    problem : Problem
        The resolved problem.
    status : str
        One of ``ok``, ``certified``, ``not_certified``, ``infeasible``, ``failed``, ``interrupted``.
    warnings : tuple of str
        What lies outside the validity of the model, one sentence each.
    phases : dict of str to dict of str to float
        Phase name to ``duration_s``, ``mean_power_W``, ``energy_J``, ``tether_length_start_m``,
        ``tether_length_end_m``, ``elevation_start_deg``, ``elevation_end_deg``.
    cycle : dict of str to float or None
        ``duration_s``, ``mean_power_W``, ``energy_J``, ``mean_harvesting_factor``,
        ``mean_traction_altitude_m``, ``wind_speed_at_mean_traction_altitude_m_s`` and more.
    channels : mapping of str to numpy.ndarray, shape (n,)
        Time series, all of one length n; ``phase`` holds strings, the others floats in the unit of their suffix.
    details : dict
        Keys of one verb beside these: ``solver``, ``active_limits``, ``message``, ...
    prescribed : Result or None
        The forward simulation of the same problem on equal terms, beside an optimum.

    Raises
    ------
    ValueError
        If the status is unknown, the channels differ in length, or a key of `details` is one of the contract's.

    """

    verb: str
    problem: Problem
    status: str = "ok"
    warnings: tuple[str, ...] = ()
    phases: dict[str, dict[str, float]] = msgspec.field(default_factory=dict)
    cycle: dict[str, float | None] = msgspec.field(default_factory=dict)
    channels: Mapping[str, npt.NDArray[Any]] = msgspec.field(default_factory=dict)
    details: dict[str, Any] = msgspec.field(default_factory=dict)
    prescribed: Result | None = None

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"status {self.status!r} is not one of {', '.join(STATUSES)}")
        taken = sorted((OUTCOME_KEYS | HEAD_KEYS).intersection(self.details))
        if taken:
            raise ValueError(f"details must not redefine the summary key {taken[0]!r}")
        channels: dict[str, npt.NDArray[Any]] = {}
        for name, values in self.channels.items():
            view = np.asarray(values, dtype=str if name == "phase" else float).view()
            view.flags.writeable = False
            channels[name] = view
        if len({array.shape for array in channels.values()}) > 1:
            shapes = ", ".join(f"{name} {array.shape}" for name, array in channels.items())
            raise ValueError(f"all channels must have one length, not {shapes}")
        msgspec.structs.force_setattr(self, "channels", channels)

    def __repr__(self) -> str:
        samples = len(next(iter(self.channels.values()), ()))
        return f"<Result {self.verb} of {self.problem.name}: {self.status}, {samples} samples>"

    def __str__(self) -> str:
        return self.document().text()

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """Return the time series of one channel, shape (n,); see `channel`."""
        return self.channel(name)

    @property
    def succeeded(self) -> bool:
        """True where the calculation did what it was asked to (exit status 0)."""
        return self.status in SUCCESSFUL_STATUSES

    def channel(self, name: str, phase: str | None = None) -> npt.NDArray[Any]:
        """Return the time series of one channel, of the cycle or of one phase.

        Parameters
        ----------
        name : str
            Name with its unit, as ``tether_force_kite_N``; `channels` lists them.
        phase : str, optional
            ``retraction``, ``transition`` or ``traction``; the whole cycle where left out.

        Returns
        -------
        numpy.ndarray, shape (n,)
            The values (read only where the whole cycle is asked for), in the unit that ends the name.

        Raises
        ------
        KeyError
            If there is no such channel or phase; the message names the nearest.

        """
        if name not in self.channels:
            raise KeyError(f"no channel '{name}'; {suggest(name, self.channels)}")
        values = self.channels[name]
        if phase is None:
            return values
        phase_of_sample = self.channels.get("phase", np.array([], dtype=str))
        known = list(dict.fromkeys(phase_of_sample.tolist()))
        if phase not in known:
            raise KeyError(f"no phase '{phase}'; {suggest(phase, known)}")
        return np.asarray(values[phase_of_sample == phase])

    def unit(self, name: str) -> str:
        """Return the unit of a channel, ``"1"`` where it has none.

        Raises
        ------
        KeyError
            If there is no such channel; the message names the nearest.

        """
        if name not in self.channels:
            raise KeyError(f"no channel '{name}'; {suggest(name, self.channels)}")
        return unit_of(name)

    def summary(self) -> dict[str, Any]:
        """Return the contents of ``summary.json``: SI units, finite numbers or None, the keys of schema version 1."""
        # Of what took part: reading versions from the metadata of packages takes longer than simulating a cycle.
        names = ("casadi", "numpy", "scipy")
        summary: dict[str, Any] = {
            "schema_version": SCHEMA_VERSION,
            "kiteocp_version": __version__,
            "versions": {
                "python": platform.python_version(),
                **{name: sys.modules[name].__version__ for name in names if name in sys.modules},
            },
            "verb": self.verb,
            "problem": self.problem.name,
            "input_sha256": self.problem.sha256,
            "input": self.problem.to_dict(),
            **self._outcome(),
            **self.details,
        }
        if self.prescribed is not None or self.verb == "solve":
            prescribed = self.prescribed
            summary["prescribed"] = prescribed and {**prescribed._outcome(), **prescribed.details}
        plain: dict[str, Any] = to_plain(summary)
        return plain

    def _outcome(self) -> dict[str, Any]:
        """Return what differs between two cycles of one problem, every key of the contract present."""
        phases = dict.fromkeys([*PHASES, *self.phases])
        return {
            "status": self.status,
            "warnings": list(self.warnings),
            "phases": {name: dict.fromkeys(PHASE_KEYS) | self.phases.get(name, {}) for name in phases},
            "cycle": dict.fromkeys(CYCLE_KEYS) | self.cycle,
        }

    def document(self) -> Document:
        """Return what it says to a person: the table, active limits, certificate and warnings."""
        return result_document(self)

    def save(self, directory: str | Path, files: Mapping[str, bytes] = MappingProxyType({})) -> list[Path]:
        """Write ``summary.json`` and, where there are channels, ``timeseries.csv`` into a directory.

        The files appear whole or not at all. Beside an optimum, ``timeseries_prescribed.csv`` holds the prescribed
        cycle. Time series and pictures of an earlier result in the same directory are removed.

        Parameters
        ----------
        directory : str or pathlib.Path
            Made where it does not exist.
        files : mapping of str to bytes
            What else belongs to the result, by file name.

        Returns
        -------
        list of pathlib.Path
            The files written, ``summary.json`` first.

        Raises
        ------
        InputError
            If the directory cannot be written to, or the disk is full; what was there is kept.

        """
        return save_result(self, Path(directory), files)
