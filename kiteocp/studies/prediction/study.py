"""A flight against the model: estimate on some cycles, predict the others, find the optimum of the machine."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import msgspec
import numpy as np
from msgspec.structs import replace

from kiteocp.errors import InputError, SolveError
from kiteocp.execution import one_at_a_time
from kiteocp.problem import Problem
from kiteocp.recording.data import FlightData
from kiteocp.report.document import Document, Figure
from kiteocp.result import Result
from kiteocp.studies.estimation.wind import WindEstimate
from kiteocp.studies.prediction.comparison import compare_cycle
from kiteocp.studies.prediction.kite import EstimatedKite, estimate_kite
from kiteocp.studies.prediction.measured import measured_cycle
from kiteocp.studies.prediction.optimum import OptimumStudy, study_optimum
from kiteocp.studies.prediction.predictions import CycleComparison
from kiteocp.studies.prediction.report import flight_document, flight_figures

#: Lift coefficients that a kite may have.
CREDIBLE_LIFTS = {"powered": (0.25, 2.5), "depowered": (0.02, 1.5)}

#: Called with how many parts are done, and of how many.
Progress = Callable[[int, int], None]


class FlightStudy(msgspec.Struct, frozen=True):
    """What came out.

    Attributes
    ----------
    flight
        The recording.
    problem
        The problem as given.
    kite
        Coefficients and wind, from the estimation cycles.
    cycles
        The predicted cycles by every law.
    optimum
        The optimum beside them; None where there is none, for the reason in `optimum_message`.
    optimum_message
        Empty where there is an optimum.
    warnings
        What to know about data and estimate, one sentence each.
    """

    flight: FlightData
    problem: Problem
    kite: EstimatedKite
    cycles: tuple[CycleComparison, ...]
    optimum: OptimumStudy | None
    optimum_message: str
    warnings: tuple[str, ...]

    @property
    def wind(self) -> WindEstimate:
        """Mean wind of the predicted cycles."""
        return mean_wind([cycle.wind.estimate for cycle in self.cycles])

    def result(self) -> Result:
        """Return all numbers, under ``flight_validation``; it failed where there is no optimum."""
        optimum = self.optimum
        numbers = {
            "flight": self.flight.name,
            "samples": len(self.flight),
            "counts": dict(self.flight.counts),
            "notes": list(self.flight.notes),
            "downwind_bearing_deg": self.flight.downwind_bearing_deg,
            "estimation": self.kite.to_dict(),
            "cycles": [cycle.to_dict() for cycle in self.cycles],
            "optimum": None if optimum is None else optimum.to_dict(),
        }
        return Result(
            "validate",
            self.kite.problem,
            "failed" if optimum is None else "ok",
            warnings=self.warnings,
            details=({"message": self.optimum_message} if optimum is None else {}) | {"flight_validation": numbers},
        )

    def document(self) -> Document:
        """Return the tables of the cycles, and what agrees, what does not and why in sentences."""
        return flight_document(self)

    def files(self) -> Mapping[str, bytes]:
        """Return what is written beside the numbers: nothing."""
        return {}

    def figures(self) -> Sequence[Figure]:
        """Return two figures of each predicted cycle, the comparison, and the optimum where there is one."""
        return flight_figures(self)


@one_at_a_time
def validate_flight(
    flight: FlightData,
    problem: Problem,
    *,
    estimate_on: Collection[int] | None = None,
    progress: Progress | None = None,
) -> FlightStudy:
    """Fly the cycles of a recording again.

    Parameters
    ----------
    flight
        Of `load_flight`.
    problem
        Mass, area, tether and the shape of the wind profile of the system that flew; its coefficients, its wind speed,
        its prescribed cycle and its limits are replaced by what the flight shows.
    estimate_on
        Cycles to estimate on; the first half of the complete ones where left out. The other complete cycles are
        predicted, or, where there are no others, the same.
    progress
        Called as parts are done.

    Raises
    ------
    InputError
        There is no complete cycle, or no such cycle, or too few usable samples.
    """
    complete = [number for number in flight.cycles() if measured_cycle(flight, number).complete]
    estimation, predicted, warnings = _division(flight, complete, estimate_on)
    parts = len(predicted) + 2
    tell = progress or (lambda done, total: None)
    kite = estimate_kite(flight, problem, estimation)
    tell(1, parts)
    cycles = []
    for done, number in enumerate(predicted, start=2):
        cycles.append(compare_cycle(flight, kite, number))
        tell(done, parts)
    wind = mean_wind([cycle.wind.estimate for cycle in cycles])
    optimum, message = None, ""
    try:
        optimum = study_optimum(wind.turned(flight), [cycle.measured for cycle in cycles], kite.base, wind)
    except (SolveError, InputError) as error:
        message = str(error)
    tell(parts, parts)
    return FlightStudy(
        flight=flight,
        problem=problem,
        kite=kite,
        cycles=tuple(cycles),
        optimum=optimum,
        optimum_message=message,
        warnings=(*warnings, *flight.warnings, *kite.warnings, *_doubts(kite)),
    )


def _doubts(kite: EstimatedKite) -> Iterator[str]:
    """Yield what of the numbers looks like a wrong unit in the column map."""
    for setting in kite.fit.samples:
        lift, _ = kite.fit.coefficients(setting)
        least, most = CREDIBLE_LIFTS[setting]
        if not least < lift < most:
            yield (
                f"a {setting} lift coefficient of {lift:.3g} is not that of a kite; check units of force and speed in "
                "the column map, and area and mass of the problem"
            )


def _division(
    flight: FlightData, complete: Sequence[int], estimate_on: Collection[int] | None
) -> tuple[list[int], list[int], list[str]]:
    """Return the cycles to estimate on, those to predict, and what to warn of."""
    warnings = []
    partial = [number for number in flight.cycles() if number not in complete]
    if not complete:
        raise InputError(
            "holds no complete cycle with retraction, transition and traction; record one, or correct the phase labels "
            "of the column map",
            file=flight.name,
        )
    if partial:
        named = ", ".join(map(str, partial))
        warnings.append(f"cycle {named} is not complete and is left out")
    if estimate_on is None:
        estimation = list(complete[: max(1, len(complete) // 2)])
    else:
        unknown = sorted(set(estimate_on) - set(complete))
        if unknown or not estimate_on:
            raise InputError(
                f"--estimate-on {', '.join(map(str, unknown)) or 'nothing'}: the complete cycles of the flight are "
                f"{', '.join(map(str, complete))}",
                file=flight.name,
            )
        estimation = sorted(set(estimate_on))
    predicted = [number for number in complete if number not in estimation]
    if not predicted:
        predicted = estimation
        warnings.append("there is no other complete cycle: the cycles are compared that the coefficients come from")
    return estimation, predicted, warnings


def mean_wind(winds: Sequence[WindEstimate]) -> WindEstimate:
    """Return the mean of several estimates, its error that of one of them: they share most of it."""
    first = winds[0]
    errors = [wind.scale_standard_error for wind in winds if wind.scale_standard_error is not None]
    scale = float(np.mean([wind.scale for wind in winds]))
    reference = first.reference_speed_m_s
    return replace(
        first,
        scale=scale,
        direction_offset_deg=float(np.mean([wind.direction_offset_deg for wind in winds])),
        scale_standard_error=float(np.mean(errors)) if errors else None,
        scale_interval=None,
        direction_interval_deg=None,
        reference_speed_m_s=None if reference is None else reference * scale / first.scale,
    )
