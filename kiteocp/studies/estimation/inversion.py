"""Coefficients of every sample of a flight: the model's own equilibrium solved for them, and the paper's way.

The force balance gives the aerodynamic force from the tether force at the ground and the weights, as in
`Model.state_at_force`; wind and velocity of the kite give the apparent wind. *Exact*: the magnitude of the force is
that of C_R, the cosine of its angle to the apparent wind is C_D / C_R (the residual of `FlightState`), at any place and
course. *Paper* (sections 3.3 and 3.4): the same C_R; L/D from the kinematic ratio by the balance in the direction of
flight alone, which neglects the wind across the course. Both take the drag of the tether away at the end.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from numpy.typing import NDArray

from kiteocp.physics import aerodynamics
from kiteocp.physics.kinematics import DOWN, radians
from kiteocp.physics.model import Coefficients, LocalConditions, Model, Position
from kiteocp.physics.parameters import Parameters, Structure, parameter_values, parameters_of
from kiteocp.physics.tether import force_at_kite
from kiteocp.problem import Problem
from kiteocp.recording import FlightData

FloatArray = NDArray[np.float64]

#: What a sample gives to the estimation, attributes of `FlightData`, in this order.
MEASURED = (
    "distance_m",
    "elevation_deg",
    "azimuth_deg",
    "course_deg",
    "radial_speed_m_s",
    "polar_speed_m_s",
    "azimuthal_speed_m_s",
    "tether_force_ground_N",
)

#: Coefficients by either way: with the tether's drag ``resultant_coefficient`` and ``lift_to_drag``, without it
#: ``kite_drag_coefficient`` and ``kite_lift_to_drag``.
COEFFICIENTS = (
    "resultant_coefficient",
    "lift_to_drag",
    "lift_coefficient",
    "kite_drag_coefficient",
    "kite_lift_to_drag",
)

#: Updates of the lift-to-drag ratio after the first guess: the paper uses G_3.
PAPER_UPDATES = 2

#: Why a sample has no answer, in the order in which it is asked.
REASONS: Mapping[str, str] = {
    "missing": "a value is missing",
    "slack": "the tether force does not even carry the sag of the tether",
    "no_radial_wind": "the kite moves outwards faster than the wind, so that no air pulls the tether",
    "no_drag": "the force would point against the apparent wind",
    "tether_drag": "the tether alone would have more drag",
}


class ApparentWind(msgspec.Struct, frozen=True):
    """Force and apparent wind of a measured sample, spherical components (radial, polar, azimuthal).

    Attributes
    ----------
    around
        LocalConditions of the sample with coefficients of zero: its drag coefficient is that of the tether.
    velocity
        Apparent wind, m/s (eq:Vapp_definition2).
    speed
        Its magnitude, m/s.
    force
        Aerodynamic force, N (eq:aeroforcer_fromexp, eq:F_a_theta); the azimuthal component is zero.
    force_magnitude
        eq:aeroforce_fromexp, N.
    """

    around: LocalConditions
    velocity: tuple[Any, Any, Any]
    speed: Any
    force: tuple[Any, Any]
    force_magnitude: Any

    @property
    def force_angle(self) -> Any:
        """Angle between aerodynamic force and apparent wind, rad, whose cosine is C_D / C_R (eq:F_a_projection)."""
        (radial, polar, azimuthal), (force_radial, force_polar) = self.velocity, self.force
        along = force_radial * radial + force_polar * polar
        across = ca.sqrt(
            (force_polar * azimuthal) ** 2
            + (force_radial * azimuthal) ** 2
            + (force_radial * polar - force_polar * radial) ** 2
        )
        return ca.atan2(across, along)


def apparent_wind(model: Model, measured: Any) -> ApparentWind:
    """Apparent wind and aerodynamic force of one sample, a column of `MEASURED` (symbols)."""
    length, elevation, azimuth, _, radial, polar, azimuthal, tension = ca.vertsplit(measured)
    # Heading straight down, the wind along the course is its polar component, and that across it the azimuthal one.
    position = Position(length, radians(elevation), radians(azimuth), DOWN)
    around = model.conditions(position, Coefficients(0.0, 0.0))
    velocity = around.wind.radial - radial, around.wind.along_course - polar, around.wind.across_course - azimuthal
    pull = model.radial_ground_force(around, tension, "ground") + around.weight_along
    force = pull, -around.weight_across
    return ApparentWind(
        around=around,
        velocity=velocity,
        speed=ca.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2),
        force=force,
        force_magnitude=ca.sqrt(force[0] ** 2 + force[1] ** 2),
    )


def turned_sample(measured: Any, angle_deg: Any) -> Any:
    """Return a column of `MEASURED` in the frame of a wind that blows towards an azimuth (symbols)."""
    rows = ca.vertsplit(measured)
    index = MEASURED.index("azimuth_deg")
    return ca.vertcat(*rows[:index], rows[index] - angle_deg, *rows[index + 1 :])


def _exact(wind: ApparentWind, resultant: Any) -> dict[str, Any]:
    """Coefficients by the model's own equilibrium, in the order of `COEFFICIENTS`."""
    angle, tether_drag = wind.force_angle, wind.around.drag_coefficient
    lift, drag = resultant * ca.sin(angle), resultant * ca.cos(angle)
    return _named(resultant, lift / drag, lift, drag - tether_drag)


def _paper(wind: ApparentWind, resultant: Any, course: Any) -> dict[str, Any]:
    """Coefficients by the paper's formulas, in the order of `COEFFICIENTS`, and the stages of its iteration."""
    around = wind.around
    # eq:v_a_inertial_solved
    kappa = ca.sqrt((wind.speed / wind.velocity[0]) ** 2 - 1)
    stages = [kappa]
    for _ in range(PAPER_UPDATES):
        # eq:tangential_force_balance_iterate
        weight = around.weight_across * ca.cos(radians(course)) / wind.force_magnitude
        stages.append(kappa - ca.sqrt(1 + kappa**2) * weight * ca.sqrt(1 + stages[-1] ** 2))
    ratio = stages[-1]
    drag = resultant / ca.sqrt(1 + ratio**2)
    named = _named(resultant, ratio, drag * ratio, drag - around.drag_coefficient)
    return {"kinematic_ratio": kappa, "lift_to_drag_second": stages[1], **named}


def _named(resultant: Any, ratio: Any, lift: Any, kite_drag: Any) -> dict[str, Any]:
    return dict(zip(COEFFICIENTS, (resultant, ratio, lift, kite_drag, lift / kite_drag), strict=True))


@lru_cache(maxsize=32)
def _inversion(structure: Structure) -> tuple[ca.Function, tuple[str, ...]]:
    """Build (once) ``(measured, p) -> outputs, stacked``, and the names of the outputs."""
    parameters: Parameters = parameters_of(structure)
    model, measured = Model(parameters), ca.SX.sym("measured", len(MEASURED))
    wind = apparent_wind(model, measured)
    resultant = wind.force_magnitude / aerodynamics.aerodynamic_force(
        wind.around.air_density, 1.0, wind.speed, parameters["kite.projected_area_m2"]
    )
    outputs = {
        "wind_speed_m_s": wind.around.wind_speed,
        "apparent_wind_speed_m_s": wind.speed,
        "radial_apparent_wind_speed_m_s": wind.velocity[0],
        "aerodynamic_force_N": wind.force_magnitude,
        "tether_force_kite_N": force_at_kite(
            wind.force[0] - wind.around.weight_along, wind.around.sag, wind.around.tether_weight_along
        ),
        "force_angle_rad": wind.force_angle,
        **{f"exact.{name}": value for name, value in _exact(wind, resultant).items()},
        **{f"paper.{name}": value for name, value in _paper(wind, resultant, measured[3]).items()},
    }
    stacked = ca.densify(ca.vertcat(*outputs.values()))
    return ca.Function("inversion", [measured, parameters.vector], [stacked]), tuple(outputs)


class Inversion(msgspec.Struct, frozen=True):
    """Coefficients of every sample of a flight.

    Attributes
    ----------
    quantities
        By name, shape (n,): wind, force and angle, and ``exact.`` and ``paper.`` with the names of `COEFFICIENTS`
        (the paper's also ``kinematic_ratio`` and ``lift_to_drag_second``, the first two stages of its iteration);
        nan where the sample has no answer by that way.
    reasons
        By way, the reason of `REASONS` for every sample, empty where it has an answer; shape (n,).
    """

    quantities: Mapping[str, FloatArray]
    reasons: Mapping[str, NDArray[np.str_]]

    def counts(self, way: str, among: NDArray[np.bool_]) -> dict[str, int]:
        """Return how many samples of a mask have no answer, by reason."""
        reasons = self.reasons[way][among]
        return {name: count for name in REASONS if (count := int(np.count_nonzero(reasons == name)))}


def measured_samples(flight: FlightData) -> FloatArray:
    """Return what the estimation uses of a flight, rows in the order of `MEASURED`, shape (8, n)."""
    return np.stack([np.asarray(getattr(flight, name), dtype=float) for name in MEASURED])


def invert(flight: FlightData, problem: Problem) -> Inversion:
    """Solve every sample of a flight for the aerodynamic coefficients.

    Parameters
    ----------
    flight
        In the frame of the wind.
    problem
        Wind, air, kite and tether; its coefficients and its prescribed cycle do not matter.
    """
    values = parameter_values(problem)
    function, names = _inversion(values.structure)
    samples = measured_samples(flight)
    table = np.asarray(function.map(samples.shape[1])(samples, values.vector)) if samples.size else np.empty((0, 0))
    quantities = dict(zip(names, table, strict=True)) if samples.size else {name: np.empty(0) for name in names}
    common = [
        ("missing", ~np.all(np.isfinite(samples), axis=0)),
        ("slack", ~np.isfinite(quantities["aerodynamic_force_N"])),
        ("no_radial_wind", ~(quantities["radial_apparent_wind_speed_m_s"] > 0)),
    ]
    reasons = {}
    for way in ("exact", "paper"):
        checks = [
            *common,
            ("no_drag", ~(quantities[f"{way}.lift_to_drag"] > 0)),
            ("tether_drag", ~(quantities[f"{way}.kite_drag_coefficient"] > 0)),
        ]
        found = np.select([mask for _, mask in checks], [name for name, _ in checks], default="")
        reasons[way] = found
        for name in names:
            if name.startswith(f"{way}."):
                quantities[name] = np.where(found == "", quantities[name], np.nan)
    return Inversion(quantities, reasons)
