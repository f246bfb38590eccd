"""The wind a flight had, as a factor on the wind profile of the problem and an angle to the flight's wind frame."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from kiteocp.errors import InputError
from kiteocp.numerics.averages import average
from kiteocp.numerics.robust import TUKEY, RobustFit, robust_fit, tukey_loss
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import ParameterValues, Structure, parameter_values, parameters_of
from kiteocp.physics.wind import ground_height, problem_in_wind, reference_height, scaled_wind, wind_function, wind_keys
from kiteocp.problem import Problem
from kiteocp.recording import FlightData
from kiteocp.studies.estimation.inversion import MEASURED, apparent_wind, measured_samples, turned_sample

FloatArray = NDArray[np.float64]

#: Where a factor on the wind speed is looked for, an angle (deg), and what an airspeed sensor shows of the airspeed.
FACTOR_RANGE, ANGLE_RANGE_DEG, GAIN_RANGE = (0.05, 20.0), (-120.0, 120.0), (0.3, 3.0)

#: Samples below which no wind is estimated.
FEWEST_SAMPLES = 20

PARAMETERS = ("scale", "direction_offset_deg", "airspeed_gain")


class WindEstimate(msgspec.Struct, frozen=True):
    """The wind of a flight: that of the problem at every height times `scale`, turned by `direction_offset_deg`.

    Attributes
    ----------
    source
        ``measured`` (at several heights), ``airspeed``, ``ground``, ``fit`` or ``problem``.
    scale
        Factor on the wind speed of the problem.
    direction_offset_deg
        Azimuth, in the frame of the flight, towards which the wind blows.
    scale_standard_error, direction_standard_error_deg, scale_interval, direction_interval_deg
        Their statistical uncertainty (95 % intervals); None where the source has none.
    scale_total_standard_error, scale_total_interval
        The same with what the samples do not tell (`kiteocp.studies.estimation.unknowns`); None where not asked for.
    systematic_shares
        By unknown, the share of the wind speed that it may be off by (one standard deviation).
    airspeed_gain, airspeed_gain_standard_error
        What the airspeed sensor shows of the airspeed, estimated along; None where it was not.
    correlation
        Of the errors of scale and direction; None where not both were estimated.
    samples, effective_samples, outliers
        Samples used, how many independent ones they are worth (for the scale), and those without weight.
    residual_m_s
        Standard deviation of the good residuals: gusts, and errors of the sensor.
    reference_speed_m_s, reference_height_m
        The estimated wind speed at the reference height of the problem's profile.
    """

    source: str
    scale: float
    direction_offset_deg: float = 0.0
    scale_standard_error: float | None = None
    direction_standard_error_deg: float | None = None
    scale_interval: tuple[float, float] | None = None
    direction_interval_deg: tuple[float, float] | None = None
    airspeed_gain: float | None = None
    airspeed_gain_standard_error: float | None = None
    correlation: float | None = None
    samples: int = 0
    effective_samples: float | None = None
    outliers: int = 0
    residual_m_s: float | None = None
    reference_speed_m_s: float | None = None
    reference_height_m: float | None = None
    scale_total_standard_error: float | None = None
    scale_total_interval: tuple[float, float] | None = None
    systematic_shares: Mapping[str, float] = msgspec.field(default_factory=dict)

    @property
    def total_standard_error(self) -> float | None:
        """Standard error of the scale, with what the samples do not tell where that is known."""
        total = self.scale_total_standard_error
        return self.scale_standard_error if total is None else total

    def applied(self, problem: Problem) -> Problem:
        """Return the problem with this wind speed."""
        return problem if self.scale == 1.0 else problem_in_wind(problem, self.scale)

    def turned(self, flight: FlightData) -> FlightData:
        """Return the flight in the frame of this wind: elevation, course and velocity stay, the azimuth counts anew."""
        if self.direction_offset_deg == 0.0:
            return flight
        azimuth = flight.azimuth_deg - self.direction_offset_deg
        # Azimuth grows against the clock, seen from above; bearings with it.
        bearing = (flight.downwind_bearing_deg - self.direction_offset_deg) % 360.0
        return replace(flight, azimuth_deg=azimuth, downwind_bearing_deg=bearing)

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        return asdict(self)


def wind_speeds(values: ParameterValues) -> dict[str, float]:
    """Return the numbers of the wind profile that are speeds, by key path."""
    return {key: values[key] for key in wind_keys(values.structure)}


def wind_of_problem(problem: Problem) -> WindEstimate:
    """Return the wind of the problem itself."""
    return _with_speed(WindEstimate("problem", 1.0), problem)


def wind_from_ground(flight: FlightData, problem: Problem, *, height_m: float | None = None) -> WindEstimate:
    """Extrapolate the mean wind measured at the ground by the profile of the problem (eq:windshear).

    The mean over the whole flight is taken, not each sample: what a gust at the ground does minutes later and hundreds
    of metres away is not known. The direction is the circular median of the vane.

    Parameters
    ----------
    flight, problem
        What was flown, and the wind profile.
    height_m
        Height of the sensor; `ground_height` where left out.

    Raises
    ------
    InputError
        The flight has no wind measured at the ground.
    """
    found = average(flight.time_s, flight.ground_wind_speed_m_s)
    if found.samples < FEWEST_SAMPLES:
        raise InputError(
            f"the flight has {found.samples} samples of the wind at the ground; choose --wind airspeed or problem",
            file=flight.name,
        )
    values = parameter_values(problem)
    height = float(ground_height(values)) if height_m is None else height_m
    speed = float(wind_function(values.structure)(height, values.vector))
    if not speed > 0:
        raise InputError(
            f"the wind profile has no wind at {height:g} m; give the height of the sensor", file=flight.name
        )
    scale = found.mean / speed
    estimate = WindEstimate(
        "ground",
        scale,
        direction_offset_deg=_vane_offset_deg(flight),
        scale_standard_error=found.standard_error / speed,
        scale_interval=(found.low / speed, found.high / speed),
        samples=found.samples,
        effective_samples=found.effective_samples,
        residual_m_s=float(np.nanstd(flight.ground_wind_speed_m_s)),
    )
    return _with_speed(estimate, problem)


def wind_from_heights(flight: FlightData, problem: Problem) -> WindEstimate:
    """Fit the problem's profile to the wind measured at several heights, as by a lidar: the factor and the direction.

    The heights where the kite flies count by the time that it spends nearest to them; the others do not.

    Raises
    ------
    InputError
        The flight has no wind measured at height.
    """
    measured = flight.wind_at_height
    if measured is None or np.isfinite(measured.speed_m_s).sum() < FEWEST_SAMPLES:
        raise InputError(
            "the flight has no wind measured at height; choose --wind airspeed, ground or problem", file=flight.name
        )
    values = parameter_values(problem)
    heights = measured.heights_m
    profile = np.array([float(wind_function(values.structure)(height, values.vector)) for height in heights])
    nearest = np.argmin(np.abs(flight.height_m[:, None] - heights), axis=1)
    known = np.isfinite(measured.speed_m_s).any(axis=0)
    time = np.bincount(nearest, minlength=heights.size) * (known & (profile > 0))
    if not time.any():
        raise InputError("the wind is measured at none of the heights that the kite flies at", file=flight.name)
    ratios = measured.speed_m_s[:, time > 0] / profile[time > 0]
    weights = np.isfinite(ratios) * time[time > 0]
    with np.errstate(invalid="ignore"):
        series = np.nansum(ratios * weights, axis=1) / weights.sum(axis=1)
    found = average(flight.time_s, series)
    speeds = np.nanmean(measured.speed_m_s[:, time > 0], axis=0)
    misfit = speeds - found.mean * profile[time > 0]
    offset = (flight.downwind_bearing_deg - (measured.direction_deg[:, time > 0] + 180.0) + 180.0) % 360.0 - 180.0
    estimate = WindEstimate(
        "measured",
        found.mean,
        direction_offset_deg=float(np.nanmedian(offset)) if np.isfinite(offset).any() else 0.0,
        scale_standard_error=found.standard_error,
        scale_interval=(found.low, found.high),
        samples=found.samples,
        effective_samples=found.effective_samples,
        residual_m_s=float(np.sqrt(np.average(misfit**2, weights=time[time > 0]))),
    )
    return _with_speed(estimate, problem)


def _vane_offset_deg(flight: FlightData) -> float:
    """Median angle of the vane to the frame of the flight, as an azimuth; 0 without a vane."""
    bearing = flight.ground_wind_direction_deg + 180.0
    offset = (flight.downwind_bearing_deg - bearing + 180.0) % 360.0 - 180.0
    return float(np.nanmedian(offset)) if np.any(np.isfinite(offset)) else 0.0


def wind_from_airspeed(flight: FlightData, problem: Problem, *, calibrate: bool = True) -> WindEstimate:
    """Find the wind that explains the apparent wind speed measured at the kite.

    The magnitude of wind minus velocity of the kite (eq:Vapp_definition) is fitted to the measured airspeed by one
    factor on the problem's wind speed and one direction, robustly. A kite that flies across the wind both ways and up
    and down sees the wind from all sides; one that flies straight tells little, and the errors say so. As the velocity
    of the kite is known, the gain of the sensor can be found along with the wind: without it a sensor that shows too
    little passes for a calm.

    Parameters
    ----------
    flight
        With an apparent wind speed; any stretch of it, also a single cycle (`FlightData.select`).
    problem
        The wind profile.
    calibrate
        False takes the sensor at its word (a gain of 1).

    Raises
    ------
    InputError
        Fewer than `FEWEST_SAMPLES` samples have an airspeed.
    """
    flight = flight.flying()
    samples = measured_samples(flight)
    # Force and course do not matter here, the rest must be there.
    needed = [*samples[: MEASURED.index("course_deg")], *samples[MEASURED.index("radial_speed_m_s") : -1]]
    usable = np.all(np.isfinite([*needed, flight.apparent_wind_speed_m_s]), axis=0)
    if usable.sum() < FEWEST_SAMPLES:
        raise InputError(
            f"only {usable.sum()} samples have an apparent wind speed; choose --wind ground or problem",
            file=flight.name,
        )
    values = parameter_values(problem)
    function = _airspeed_function(values.structure).map(int(usable.sum()))
    inputs = np.nan_to_num(np.vstack([samples[:, usable], flight.apparent_wind_speed_m_s[usable]]))

    def residuals(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        unknown = np.append(at, np.ones(3 - at.size))
        found, slopes = (np.asarray(part) for part in function(inputs, values.vector, unknown))
        return found.T, slopes.T[:, None, free]

    lower, upper = np.transpose([FACTOR_RANGE, ANGLE_RANGE_DEG, GAIN_RANGE])
    names = PARAMETERS if calibrate else PARAMETERS[:2]
    free = slice(len(names))
    fits = [
        robust_fit(
            names,
            residuals,
            np.array([scale, 0.0, 1.0])[free],
            lower[free],
            upper[free],
            flight.time_s[usable],
            np.zeros(int(usable.sum()), dtype=np.int64),
        )
        for scale in _starting_scales(values, flight)
    ]
    # The magnitude may have other minima, in which a whole phase passes for wrong samples: compare on equal terms.
    reach = TUKEY * max(float(fit.scales[0, 0]) for fit in fits)
    best = min(fits, key=lambda fit: tukey_loss(fit.residuals, reach))
    return _with_speed(_estimate_of(best, "airspeed", int(usable.sum())), problem)


def winds_by_cycle(flight: FlightData, problem: Problem, wind: WindEstimate) -> dict[int, WindEstimate]:
    """Estimate the wind of each cycle from its airspeed, with the gain of the sensor that the whole flight gave.

    Parameters
    ----------
    flight, problem
        As of `wind_from_airspeed`.
    wind
        What that found for the whole flight.
    """
    gain = wind.airspeed_gain or 1.0
    gauged = replace(flight, apparent_wind_speed_m_s=flight.apparent_wind_speed_m_s / gain)
    found = {}
    for cycle in flight.cycles():
        part = gauged.select([cycle])
        # A cycle without enough samples is left out.
        with suppress(InputError):
            found[cycle] = wind_from_airspeed(part, problem, calibrate=False)
    return found


def _starting_scales(values: ParameterValues, flight: FlightData) -> tuple[float, ...]:
    """Return the wind of the problem, and 4 and 12 m/s at the mean height of the flight, as scales."""
    height = float(np.nanmean(flight.distance_m * np.sin(np.radians(flight.elevation_deg))))
    speed = max(float(wind_function(values.structure)(height, values.vector)), 0.1)
    return 1.0, 4.0 / speed, 12.0 / speed


def _estimate_of(fit: RobustFit, source: str, samples: int) -> WindEstimate:
    scale, direction = fit.parameter("scale"), fit.parameter("direction_offset_deg")
    return WindEstimate(
        source,
        scale["value"],
        direction["value"],
        scale["standard_error"],
        direction["standard_error"],
        fit.interval("scale"),
        fit.interval("direction_offset_deg"),
        airspeed_gain=fit.value("airspeed_gain") if "airspeed_gain" in fit.names else None,
        airspeed_gain_standard_error=fit.parameter("airspeed_gain")["standard_error"]
        if "airspeed_gain" in fit.names
        else None,
        correlation=fit.correlation_of("scale", "direction_offset_deg"),
        samples=samples,
        effective_samples=scale["effective_samples"],
        outliers=int(fit.outliers.sum()),
        residual_m_s=float(fit.scales[0, 0]),
    )


def _with_speed(estimate: WindEstimate, problem: Problem) -> WindEstimate:
    values = parameter_values(problem)
    height = reference_height(values)
    speed = estimate.scale * float(wind_function(values.structure)(height, values.vector))
    return replace(estimate, reference_speed_m_s=speed, reference_height_m=height)


@lru_cache(maxsize=32)
def _airspeed_function(structure: Structure) -> ca.Function:
    """Build (once) ``((measured, airspeed), p, (scale, angle)) -> residual in m/s and its derivatives``."""
    parameters = parameters_of(structure)
    inputs, unknown = ca.SX.sym("inputs", len(MEASURED) + 1), ca.SX.sym("unknown", len(PARAMETERS))
    turned = turned_sample(inputs[:-1], unknown[1])
    speed = ca.Function("speed", [inputs, parameters.vector, unknown], [apparent_wind(Model(parameters), turned).speed])
    residual = unknown[2] * speed(inputs, scaled_wind(parameters, unknown[0]), unknown) - inputs[-1]
    return ca.Function(
        "airspeed",
        [inputs, parameters.vector, unknown],
        [residual, ca.densify(ca.jacobian(residual, unknown)).T],
    )
