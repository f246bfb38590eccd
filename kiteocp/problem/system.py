"""The blocks of the problem file that describe the kite system and the air around it."""

from typing import Annotated

import msgspec
from msgspec import UNSET, Struct, UnsetType

from kiteocp.problem.fields import quantity, section
from kiteocp.problem.wind import Wind


class Air(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Density of an isothermal atmosphere, ``rho = rho_0 exp(-z / H)``."""

    density_sea_level_kg_m3: Annotated[float, quantity("kg/m3", "air density at the ground", gt=0)] = 1.225
    density_scale_height_m: Annotated[float, quantity("m", "height over which the density falls to 1/e", gt=0)] = 8550.0


class Environment(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Wind, air and gravity."""

    wind: Annotated[Wind, section("wind speed over height; the keys depend on the profile")]
    air: Annotated[Air, section("air density over height")] = msgspec.field(default_factory=Air)
    gravity_m_s2: Annotated[float, quantity("m/s2", "acceleration of gravity; 0 leaves all weights out", ge=0)] = 9.81


class Aerodynamics(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Coefficients of the kite without the tether, for one power setting: the lift and one of the other two.

    In the problem file exactly one of ``lift_to_drag`` and ``drag_coefficient`` is given, the other is
    `msgspec.UNSET`; the properties give both.
    """

    lift_coefficient: Annotated[float, quantity("1", "lift coefficient of the kite", gt=0)]
    lift_to_drag: (
        Annotated[float, quantity("1", "lift-to-drag ratio of the kite without the tether", gt=0)] | UnsetType
    ) = UNSET
    drag_coefficient: (
        Annotated[float, quantity("1", "drag coefficient of the kite without the tether", gt=0)] | UnsetType
    ) = UNSET

    @property
    def kite_lift_to_drag(self) -> float:
        """Lift-to-drag ratio of the kite without the tether, whichever of the two keys was given."""
        if isinstance(self.lift_to_drag, UnsetType):
            return self.lift_coefficient / self.kite_drag_coefficient
        return self.lift_to_drag

    @property
    def kite_drag_coefficient(self) -> float:
        """Drag coefficient of the kite without the tether, whichever of the two keys was given."""
        if isinstance(self.drag_coefficient, UnsetType):
            return self.lift_coefficient / self.kite_lift_to_drag
        return self.drag_coefficient


class Kite(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The kite with its control unit."""

    projected_area_m2: Annotated[float, quantity("m2", "projected wing area, to which the coefficients refer", gt=0)]
    mass_kg: Annotated[float, quantity("kg", "mass of the kite including its control unit", gt=0)]
    powered: Annotated[Aerodynamics, section("coefficients in traction and transition")]
    depowered: Annotated[Aerodynamics, section("coefficients in retraction")]


class Tether(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The tether."""

    diameter_m: Annotated[float, quantity("m", "diameter", gt=0)]
    density_kg_m3: Annotated[float, quantity("kg/m3", "density of the braided tether", gt=0)]
    drag_coefficient: Annotated[float, quantity("1", "drag coefficient of the tether's cross-section", ge=0)]
    breaking_force_N: (
        Annotated[float, quantity("N", "force at which the tether breaks; only warned of", gt=0)] | None
    ) = None
