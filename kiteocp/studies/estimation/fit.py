"""Lift and drag of each setting of the kite, and the wind, from a whole flight at once.

A sample is in equilibrium where its apparent wind has the magnitude that the measured force asks for and the angle to
that force which the coefficients ask for. What remains is a speed (m/s) in two directions: along the apparent wind,
``|v_a| - sqrt(2 F_a / (rho C_R S))``, and across it, ``|v_a| (angle - atan2(C_L, C_D))``. Together they are the
smallest change of the wind at the kite that would put the sample in equilibrium: a gust. That is why the fit goes this
way around. A gust enters both residuals as itself, of like size in all phases, and every sample has them; the force
that a reeling speed predicts would be the square of a small difference of wind and reeling speed, and the speed that a
force predicts the root of what a gust may make negative. The noise of a speed always counts as more apparent wind: C_R
comes out too small by some ``2 (noise / v_a)^2``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.errors import InputError
from kiteocp.numerics.robust import RobustFit, robust_fit
from kiteocp.physics.aerodynamics import resultant_coefficient
from kiteocp.physics.model import Model
from kiteocp.physics.parameters import Structure, parameter_values, parameters_of
from kiteocp.physics.wind import scaled_wind
from kiteocp.problem import Problem
from kiteocp.recording import FlightData
from kiteocp.recording.power_setting import FULLY_POWERED
from kiteocp.studies.estimation.inversion import MEASURED, Inversion, apparent_wind, measured_samples, turned_sample
from kiteocp.studies.estimation.wind import ANGLE_RANGE_DEG, FACTOR_RANGE, WindEstimate, wind_of_problem

FloatArray = NDArray[np.float64]

Setting = Literal["powered", "depowered"]

#: Which setting of the kite the phases of a flight tell of. The turn to reel-in, with the kite on its way from one
#: setting to the other, tells of neither.
SETTING_OF_PHASE: Mapping[str, Setting] = {
    "retraction": "depowered",
    "transition": "powered",
    "traction": "powered",
}
SETTINGS: tuple[Setting, ...] = ("powered", "depowered")

#: Why a sample of a powered phase does not count.
PART_POWERED = "part_powered"

#: Where coefficients are looked for.
LIFTS, DRAGS = (0.01, 5.0), (1e-4, 3.0)

#: Samples of a setting below which it is not fitted.
FEWEST_SAMPLES = 20

#: What is unknown of the wind.
WIND = ("wind_scale", "wind_direction_offset_deg")

#: A wind scale is taken as known where its 95 % interval is narrower than this share of it to either side.
USEFUL_SHARE = 0.25

#: Beyond this condition number of scaled derivatives parameters are collinear by the rule of Belsley, Kuh and Welsch
#: (*Regression Diagnostics*, 1980): the fit then follows the noise, with errors that are not to be believed.
LARGEST_CONDITION = 30.0


class CoefficientFit(msgspec.Struct, frozen=True):
    """Coefficients of each setting, and of the wind what was asked for.

    Attributes
    ----------
    fit
        Parameters ``powered.lift_coefficient``, ``powered.drag_coefficient`` (the kite without the tether), the same of
        ``depowered``, ``wind_scale`` and ``wind_direction_offset_deg``, with covariance; residuals along and across the
        apparent wind.
    samples, outliers
        By setting: samples fitted, and those of them without weight.
    rejected
        By setting, samples that were not fitted, by reason.
    wind_identified
        Whether the wind scale was known well enough to be used; None where it was not asked for.
    """

    fit: RobustFit
    samples: Mapping[str, int]
    outliers: Mapping[str, int]
    rejected: Mapping[str, Mapping[str, int]]
    wind_identified: bool | None = None

    def coefficients(self, setting: str) -> tuple[float, float]:
        """Return lift and drag coefficient of the kite without the tether."""
        return self.fit.value(f"{setting}.lift_coefficient"), self.fit.value(f"{setting}.drag_coefficient")

    def changes(self) -> dict[str, float]:
        """Return the keys of a problem file with the fitted coefficients."""
        return {f"kite.{name}": self.fit.value(name) for name in self.fit.names if name.endswith("_coefficient")}

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        settings: dict[str, Any] = {}
        for setting in self.samples:
            lift, drag = (f"{setting}.{name}_coefficient" for name in ("lift", "drag"))
            settings[setting] = {
                "lift_coefficient": self.fit.parameter(lift),
                "drag_coefficient": self.fit.parameter(drag),
                "lift_to_drag": self._lift_to_drag(lift, drag),
                "correlation": self.fit.correlation_of(lift, drag),
                "samples": self.samples[setting],
                "outliers": self.outliers[setting],
                "rejected": dict(self.rejected[setting]),
            }
        summary: dict[str, Any] = {
            "settings": settings,
            "condition": self.fit.condition,
            "residual_m_s": self.fit.scales.tolist(),
        }
        for name in WIND:
            if name in self.fit.names:
                summary[name] = self.fit.parameter(name)
        if WIND[0] in self.fit.names:
            summary["wind_identified"] = self.wind_identified
            summary["correlation_of_wind_scale"] = {
                name: self.fit.correlation_of(WIND[0], name) for name in self.fit.names if name != WIND[0]
            }
        return summary

    def _lift_to_drag(self, lift: str, drag: str) -> dict[str, Any]:
        """Ratio of both with its standard error, to first order."""
        a, b = self.fit.parameter(lift), self.fit.parameter(drag)
        shares = a["standard_error"] / a["value"], b["standard_error"] / b["value"]
        variance = shares[0] ** 2 + shares[1] ** 2 - 2 * shares[0] * shares[1] * self.fit.correlation_of(lift, drag)
        ratio = a["value"] / b["value"]
        return {"value": ratio, "standard_error": ratio * float(np.sqrt(max(variance, 0.0)))}


def fit_coefficients(
    flight: FlightData,
    problem: Problem,
    inversion: Inversion,
    *,
    fit_wind: bool = False,
) -> CoefficientFit:
    """Fit the coefficients of both settings to a flight.

    Parameters
    ----------
    flight
        In the frame of the wind.
    problem
        Wind, air, kite and tether.
    inversion
        Of the same flight and problem: its medians are where the fit starts, and it says which samples are usable.
    fit_wind
        Also fit the factor on the wind speed and the direction. Both come from the same equilibrium: a stronger wind
        and smaller coefficients look much alike where the kite flies one way only.

    Raises
    ------
    InputError
        No setting has enough samples.
    """
    samples = measured_samples(flight)
    setting_of = np.array([SETTING_OF_PHASE.get(str(phase), "") for phase in flight.phase])
    # What the fit cannot use is missing or slack; the rest has residuals, and a wrong sample large ones.
    broken = np.isin(inversion.reasons["exact"], ["missing", "slack"])
    partly = (setting_of == "powered") & (flight.power_setting < FULLY_POWERED)
    unusable = broken | partly
    counts = {setting: int(np.count_nonzero((setting_of == setting) & ~unusable)) for setting in SETTINGS}
    fitted = [setting for setting in SETTINGS if counts[setting] >= FEWEST_SAMPLES]
    if not fitted:
        raise InputError(
            f"there are {counts['powered']} powered and {counts['depowered']} depowered samples to fit coefficients "
            f"to; at least {FEWEST_SAMPLES} of one are needed",
            file=flight.name,
        )
    used = np.isin(setting_of, fitted) & ~unusable
    groups = np.array([fitted.index(setting) for setting in setting_of[used]], dtype=np.int64)
    names = [f"{setting}.{name}_coefficient" for setting in fitted for name in ("lift", "drag")]
    start, bounds = [], []
    for setting in fitted:
        start += _median_coefficients(inversion, setting_of == setting)
        bounds += [LIFTS, DRAGS]
    if fit_wind:
        names, start, bounds = [*names, *WIND], [*start, 1.0, 0.0], [*bounds, FACTOR_RANGE, ANGLE_RANGE_DEG]
    residuals = _residuals(problem, samples[:, used], groups, len(fitted), fit_wind)
    lower, upper = np.transpose(bounds)
    fit = robust_fit(names, residuals, np.array(start), lower, upper, flight.time_s[used], groups)
    identified = None
    if fit_wind:
        low, high = fit.interval(WIND[0])
        narrow = high - low < 2.0 * USEFUL_SHARE * fit.value(WIND[0])
        inside = np.all((fit.values > lower) & (fit.values < upper))
        identified = bool(narrow and inside and fit.condition < LARGEST_CONDITION)
    return CoefficientFit(
        fit,
        {setting: counts[setting] for setting in fitted},
        {setting: int(fit.outliers[groups == index].sum()) for index, setting in enumerate(fitted)},
        {setting: _rejections(inversion, setting_of == setting, broken, partly) for setting in fitted},
        identified,
    )


def fitted_wind(fit: CoefficientFit, start: WindEstimate, problem: Problem) -> WindEstimate:
    """Return the wind of a fit with the wind free, relative to the problem; `start` is the wind it was fitted from."""
    scale, direction = (fit.fit.parameter(name) for name in WIND)
    interval, angles = fit.fit.interval(WIND[0]), fit.fit.interval(WIND[1])
    reference = wind_of_problem(problem)
    total = start.scale * scale["value"]
    return WindEstimate(
        "fit",
        total,
        start.direction_offset_deg + direction["value"],
        start.scale * scale["standard_error"],
        direction["standard_error"],
        (start.scale * interval[0], start.scale * interval[1]),
        (start.direction_offset_deg + angles[0], start.direction_offset_deg + angles[1]),
        correlation=fit.fit.correlation_of(*WIND),
        samples=sum(fit.samples.values()),
        effective_samples=scale["effective_samples"],
        outliers=sum(fit.outliers.values()),
        residual_m_s=float(np.max(fit.fit.scales)),
        reference_speed_m_s=total * (reference.reference_speed_m_s or 0.0),
        reference_height_m=reference.reference_height_m,
    )


def _rejections(
    inversion: Inversion, among: NDArray[np.bool_], broken: NDArray[np.bool_], partly: NDArray[np.bool_]
) -> dict[str, int]:
    counts = inversion.counts("exact", among & broken)
    part = int(np.count_nonzero(among & partly & ~broken))
    return counts | ({PART_POWERED: part} if part else {})


def _median_coefficients(inversion: Inversion, among: NDArray[np.bool_]) -> list[float]:
    """Return where to start: the medians of the exact inversion."""
    start = []
    for name, fallback, (low, high) in (("lift_coefficient", 0.5, LIFTS), ("kite_drag_coefficient", 0.1, DRAGS)):
        values = inversion.quantities[f"exact.{name}"][among]
        values = values[np.isfinite(values)]
        start.append(float(np.clip(np.median(values) if values.size else fallback, 2 * low, 0.5 * high)))
    return start


def _residuals(problem: Problem, samples: FloatArray, groups: NDArray[np.int64], settings: int, fit_wind: bool) -> Any:
    """Return the function that `robust_fit` asks for."""
    values = parameter_values(problem)
    function = _residual_function(values.structure).map(samples.shape[1])
    rows = np.arange(samples.shape[1])

    def residuals(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        coefficients = at[: 2 * settings].reshape(settings, 2)[groups]
        wind = at[2 * settings :] if fit_wind else np.array([1.0, 0.0])
        unknown = np.column_stack([coefficients, np.tile(wind, (rows.size, 1))])
        found, slopes = (np.asarray(part) for part in function(samples, values.vector, unknown.T))
        # The derivatives come by unknown: lift, drag, scale, angle, two residuals each.
        local = slopes.T.reshape(rows.size, 4, 2).transpose(0, 2, 1)
        full = np.zeros((rows.size, 2, at.size))
        full[rows, :, 2 * groups] = local[:, :, 0]
        full[rows, :, 2 * groups + 1] = local[:, :, 1]
        if fit_wind:
            full[:, :, -2:] = local[:, :, 2:]
        return found.T, full

    return residuals


@lru_cache(maxsize=32)
def _residual_function(structure: Structure) -> ca.Function:
    """Build (once) ``(measured, p, (lift, drag, scale, angle)) -> residuals in m/s, their derivatives stacked``."""
    parameters = parameters_of(structure)
    model = Model(parameters)
    measured, unknown = ca.SX.sym("measured", len(MEASURED)), ca.SX.sym("unknown", 4)
    wind = apparent_wind(model, turned_sample(measured, unknown[3]))
    lift, drag = unknown[0], unknown[1] + wind.around.drag_coefficient
    required = ca.sqrt(
        2.0
        * wind.force_magnitude
        / (wind.around.air_density * resultant_coefficient(lift, drag) * parameters["kite.projected_area_m2"])
    )
    residuals = ca.vertcat(wind.speed - required, wind.speed * (wind.force_angle - ca.atan2(lift, drag)))
    plain = ca.Function("plain", [measured, parameters.vector, unknown], [residuals])
    scaled = plain(measured, scaled_wind(parameters, unknown[2]), unknown)
    return ca.Function(
        "residuals",
        [measured, parameters.vector, unknown],
        [scaled, ca.densify(ca.vec(ca.jacobian(scaled, unknown)))],
    )
