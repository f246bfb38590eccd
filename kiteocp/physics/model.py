"""The flight state of the kite in a problem's environment: the paper's sections 2.1 to 2.7 put together.

A `FlightState` is a bundle of expressions. It takes the radial ground force and the inflow angle (the angle of the
apparent wind to the tether, arctangent of the kinematic ratio) as given; its ``residual`` vanishes at equilibrium.
Who knows the force solves the residual for the angle; who knows the reeling speed uses `state_at_reeling_speed`, where
the force follows from the angle.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import msgspec

from kiteocp.physics import aerodynamics, atmosphere, kinematics, machine, tether
from kiteocp.physics.kinematics import Course
from kiteocp.physics.parameters import Parameters
from kiteocp.physics.wind import profile_of


class Coefficients(msgspec.Struct, frozen=True):
    """Aerodynamic coefficients of the kite without the tether."""

    lift: Any
    kite_drag: Any


class Position(msgspec.Struct, frozen=True):
    """Where the kite is and where it heads: tether length in m, angles in rad."""

    tether_length: Any
    elevation: Any
    azimuth: Any
    course: Course


class LocalConditions(msgspec.Struct, frozen=True):
    """All of a flight state that does not depend on speed or force."""

    height: Any
    wind_speed: Any
    wind: kinematics.WindComponents
    air_density: Any
    lift_coefficient: Any
    drag_coefficient: Any
    resultant_coefficient: Any
    tether_mass: Any
    sag: Any
    tether_weight_along: Any
    weight_along: Any
    weight_across: Any

    @property
    def wind_along_tether(self) -> Any:
        """Component of the wind along the tether, m/s."""
        return self.wind.radial

    @property
    def wind_across_course(self) -> Any:
        """Component of the wind across course and tether, m/s."""
        return self.wind.across_course


class FlightState(msgspec.Struct, frozen=True):
    """A quasi-steady flight state, in SI units; ``residual`` is zero at equilibrium."""

    conditions: LocalConditions
    inflow_angle: Any
    radial_ground_force: Any
    reeling_speed: Any
    tangential_speed: Any
    apparent_wind_speed: Any
    radial_apparent_wind_speed: Any
    aerodynamic_force: Any
    tether_force_kite: Any
    tether_force_ground: Any
    power: Any
    electrical_power: Any
    residual: Any

    @property
    def kinematic_ratio(self) -> Any:
        """Tangential over radial apparent wind speed, kappa."""
        return ca.tan(self.inflow_angle)

    @property
    def reeling_factor(self) -> Any:
        """Reeling speed over wind speed (eq:reeloutfactor)."""
        return self.reeling_speed / self.conditions.wind_speed

    @property
    def tangential_speed_factor(self) -> Any:
        """Tangential kite speed over wind speed, lambda (eq:lambda_definition)."""
        return self.tangential_speed / self.conditions.wind_speed

    @property
    def forward_airspeed_ratio(self) -> Any:
        """Airspeed along the course over wind speed: the root of the discriminant of lambda (eq:lambda_definition)."""
        return (self.tangential_speed - self.conditions.wind.along_course) / self.conditions.wind_speed

    @property
    def kite_speed(self) -> Any:
        """Magnitude of the kite's velocity, m/s."""
        return kinematics.kite_speed(self.reeling_speed, self.tangential_speed)


class Model:
    """The expressions of the model for one set of parameters (symbols of a structure)."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.structure = parameters.structure

    def coefficients(self, setting: Any) -> Coefficients:
        """Coefficients of the kite ``powered``, ``depowered``, or between them at a power setting of 0 to 1."""
        if isinstance(setting, str):
            return self._given_coefficients(setting)
        depowered, powered = self._given_coefficients("depowered"), self._given_coefficients("powered")
        return Coefficients(
            depowered.lift + setting * (powered.lift - depowered.lift),
            depowered.kite_drag + setting * (powered.kite_drag - depowered.kite_drag),
        )

    def _given_coefficients(self, setting: str) -> Coefficients:
        p, key = self.parameters, f"kite.{setting}"
        lift = p[f"{key}.lift_coefficient"]
        if f"{key}.drag_coefficient" in p:
            return Coefficients(lift, p[f"{key}.drag_coefficient"])
        return Coefficients(lift, lift / p[f"{key}.lift_to_drag"])

    def wind_speed(self, height: Any) -> Any:
        """Wind speed at a height, m/s."""
        return profile_of(self.structure).speed(height, self.parameters)

    def air_density(self, height: Any) -> Any:
        """Air density at a height, kg/m3."""
        p = self.parameters
        return atmosphere.air_density(
            height, p["environment.air.density_sea_level_kg_m3"], p["environment.air.density_scale_height_m"]
        )

    def conditions(self, position: Position, coefficients: Coefficients) -> LocalConditions:
        """Wind, air, coefficients and weights at a position."""
        p = self.parameters
        gravity, diameter = p["environment.gravity_m_s2"], p["tether.diameter_m"]
        height = position.tether_length * ca.sin(position.elevation)
        wind_speed = self.wind_speed(height)
        drag = aerodynamics.total_drag_coefficient(
            coefficients.kite_drag,
            p["kite.projected_area_m2"],
            position.tether_length,
            diameter,
            p["tether.drag_coefficient"],
        )
        mass = tether.tether_mass(position.tether_length, diameter, p["tether.density_kg_m3"])
        sag = tether.sag_force(mass, position.elevation, gravity)
        tether_weight_along = tether.weight_along(mass, position.elevation, gravity)
        return LocalConditions(
            height=height,
            wind_speed=wind_speed,
            wind=kinematics.wind_components(wind_speed, position.elevation, position.azimuth, position.course),
            air_density=self.air_density(height),
            lift_coefficient=coefficients.lift,
            drag_coefficient=drag,
            resultant_coefficient=aerodynamics.resultant_coefficient(coefficients.lift, drag),
            tether_mass=mass,
            sag=sag,
            tether_weight_along=tether_weight_along,
            weight_along=tether_weight_along + tether.weight_along(p["kite.mass_kg"], position.elevation, gravity),
            # The kite's whole weight and half the tether's act across the tether (eq:force_gravity).
            weight_across=sag + p["kite.mass_kg"] * gravity * ca.cos(position.elevation),
        )

    def aerodynamic_force(self, around: LocalConditions, apparent_wind_speed: Any) -> Any:
        """Magnitude of the aerodynamic force at an apparent wind speed, N."""
        return aerodynamics.aerodynamic_force(
            around.air_density,
            around.resultant_coefficient,
            apparent_wind_speed,
            self.parameters["kite.projected_area_m2"],
        )

    def apparent_wind_speed_of_force(self, around: LocalConditions, force: Any) -> Any:
        """Apparent wind speed at which the aerodynamic force has the given magnitude, m/s."""
        return aerodynamics.apparent_wind_speed_of_force(
            force, around.air_density, around.resultant_coefficient, self.parameters["kite.projected_area_m2"]
        )

    def radial_ground_force(self, around: LocalConditions, tether_force: Any, reference: str) -> Any:
        """Radial ground force of a tether force given at the ``kite`` or at the ``ground``, N."""
        if reference == "ground":
            return tether.radial_force_of_ground_force(tether_force, around.sag)
        return tether.radial_force_of_kite_force(tether_force, around.sag, around.tether_weight_along)

    def state_at_force(
        self, position: Position, around: LocalConditions, radial_ground_force: Any, inflow_angle: Any
    ) -> FlightState:
        """Flight state of a given radial ground force (N) and inflow angle (rad), the reeling speed following.

        The force balance alone gives the aerodynamic force (eq:force_equilibrium_gravity), and with it the apparent
        wind speed, before the direction of the apparent wind is known.
        """
        radial_force = radial_ground_force + around.weight_along
        force = ca.sqrt(radial_force**2 + around.weight_across**2)
        apparent_wind_speed = self.apparent_wind_speed_of_force(around, force)
        return self._state(
            position, around, radial_ground_force, radial_force, force, apparent_wind_speed, inflow_angle
        )

    def state_at_reeling_speed(
        self, position: Position, around: LocalConditions, reeling_speed: Any, inflow_angle: Any
    ) -> FlightState:
        """Flight state of a given reeling speed (m/s) and inflow angle (rad), the force following (eq:F_a_r)."""
        apparent_wind_speed = (around.wind.radial - reeling_speed) / ca.cos(inflow_angle)
        force = self.aerodynamic_force(around, apparent_wind_speed)
        radial_force = ca.sqrt(force**2 - around.weight_across**2)
        radial_ground_force = radial_force - around.weight_along
        return self._state(
            position, around, radial_ground_force, radial_force, force, apparent_wind_speed, inflow_angle
        )

    def _state(
        self,
        position: Position,
        around: LocalConditions,
        radial_ground_force: Any,
        radial_force: Any,
        force: Any,
        apparent_wind_speed: Any,
        inflow_angle: Any,
    ) -> FlightState:
        radial_wind = apparent_wind_speed * ca.cos(inflow_angle)
        tangential = kinematics.tangential_kite_speed(around.wind, apparent_wind_speed * ca.sin(inflow_angle))
        reeling_speed = around.wind.radial - radial_wind
        # Polar component of the apparent wind (eq:Vapp_definition2): the wind's is what its two parts have of it.
        polar_wind = (
            around.wind.along_course - tangential
        ) * position.course.cosine - around.wind.across_course * position.course.sine
        # Cosine of the angle between force and apparent wind against the drag's share of the force (eq:F_a_projection);
        # the force across the tether only balances the weight (eq:F_a_theta).
        cosine = (radial_force * radial_wind - around.weight_across * polar_wind) / (force * apparent_wind_speed)
        residual = cosine - around.drag_coefficient / around.resultant_coefficient
        ground_force = tether.force_at_ground(radial_ground_force, around.sag)
        power, p = ground_force * reeling_speed, self.parameters
        return FlightState(
            conditions=around,
            inflow_angle=inflow_angle,
            radial_ground_force=radial_ground_force,
            reeling_speed=reeling_speed,
            tangential_speed=tangential,
            apparent_wind_speed=apparent_wind_speed,
            radial_apparent_wind_speed=radial_wind,
            aerodynamic_force=force,
            tether_force_kite=tether.force_at_kite(radial_ground_force, around.sag, around.tether_weight_along),
            tether_force_ground=ground_force,
            power=power,
            electrical_power=machine.electrical_power(
                power, p["machine.generator_efficiency"], p["machine.motor_efficiency"]
            ),
            residual=residual,
        )
