"""The estimated kite as a problem file, for the other verbs."""

from __future__ import annotations

from typing import Any

import yaml

from kiteocp.errors import printable
from kiteocp.physics.parameters import parameter_values
from kiteocp.problem import Problem
from kiteocp.studies.estimation.estimates import Estimation
from kiteocp.studies.estimation.wind import wind_speeds

FILE = "estimated.yaml"

#: Digits of what is estimated; more would pretend.
DIGITS = 5


def estimated_problem(estimation: Estimation) -> Problem:
    """Return the problem with the estimated coefficients and wind, and with their standard errors as uncertainties."""
    fit = estimation.fit.fit
    changes: dict[str, Any] = {key: _rounded(value) for key, value in estimation.fit.changes().items()}
    errors = {key: fit.parameter(key.removeprefix("kite."))["standard_error"] for key in changes}
    wind = estimation.wind
    for key, speed in wind_speeds(parameter_values(estimation.problem)).items():
        changes[key] = _rounded(wind.scale * speed)
        # The entries of a table share one error, which the uncertainties of a problem file cannot say.
        if wind.total_standard_error is not None and not key.endswith("]"):
            errors[key] = wind.total_standard_error * speed
    uncertain = {
        f"uncertainty.{key}": {"standard_deviation": _rounded(error)} for key, error in errors.items() if error > 0
    }
    flight = printable(estimation.flight.name)
    names = {
        "name": f"{estimation.problem.name}-estimated"[:100],
        "source": f"estimated from the flight {flight}; the rest as {estimation.problem.name}",
    }
    return estimation.problem.with_values({**changes, **uncertain, **names})


def problem_yaml(estimation: Estimation) -> str:
    """Return the content of `FILE`."""
    wind = estimation.wind
    # The name of a file may hold a line break, which would end the comment.
    flight = printable(estimation.flight.name)
    lines = [
        f"# {estimation.problem.name} with what the flight {flight} shows: coefficients by the fit,",
        f"# wind by {wind.source} (it blows {wind.direction_offset_deg:+.1f} deg from the azimuth zero of the flight).",
        "# The standard errors are those of the estimate, that of the wind with its profile, sensor height and gauge;",
        "# what the model leaves out is not in them.",
        "",
    ]
    given = estimated_problem(estimation).origin.given
    return "\n".join(lines) + yaml.safe_dump(dict(given), sort_keys=False, allow_unicode=True, width=110)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
