"""Values that no kite has, each with the slip that probably made it: a wrong unit, a wrong reference.

Every row of `CHECKS` spans all kites from 2 to 1000 m2, soft and rigid, with room to spare, so that a warning is never
about a design, only about a mistake. Loads and powers are judged by area, which is what they grow with.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from kiteocp.problem.reading import show
from kiteocp.problem.wind import Wind

Block = Mapping[str, Any]

#: Nominal sizes of kites are flat areas. Those that go by a name, in m2.
FLAT_AREA_M2 = {"v3": 25.0, "v9": 60.0}

_AREA = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?)\s*(?:m2|m\u00b2|m\^2|sqm|square met)", re.IGNORECASE)


class Check(msgspec.Struct, frozen=True):
    """The plausible range of a number, or of the number over the projected area, and the slip outside of it."""

    key: str
    low: float
    high: float
    slip: str
    by_area: bool = False
    zero_is_meant: bool = False

    def warnings(self, content: Block) -> Iterator[str]:
        """Yield a sentence where the number is there and outside the range."""
        value = _value(content, self.key)
        if value is None or (value == 0.0 and self.zero_is_meant):
            return
        judged = abs(value) / content["kite"]["projected_area_m2"] if self.by_area else abs(value)
        if not self.low <= judged <= self.high:
            ratio = f", {show(float(f'{judged:.3g}'))} for each m2 of the kite" if self.by_area else ""
            yield (
                f"{self.key} is {show(value)}{ratio}; plausible is {show(self.low)} to {show(self.high)}"
                f"{' for each m2' if self.by_area else ''}: {self.slip}"
            )


CHECKS = (
    Check("environment.wind.reference_speed_m_s", 1.0, 60.0, "is it a factor, or in another unit than m/s?"),
    Check("environment.wind.reference_height_m", 1.0, 1000.0, "is it in km or ft instead of m?"),
    # Open sea has 0.0001 m, a city centre 2 m.
    Check("environment.wind.roughness_length_m", 1e-7, 5.0, "is it a height, or in mm instead of m? Grass has 0.03 m"),
    Check("environment.air.density_sea_level_kg_m3", 0.6, 1.6, "is it in g/m3? Air has about 1.225 kg/m3"),
    Check("environment.air.density_scale_height_m", 2000.0, 20000.0, "is it in km instead of m?"),
    Check("environment.gravity_m_s2", 1.0, 30.0, "is it in another unit than m/s2?", zero_is_meant=True),
    Check("kite.projected_area_m2", 0.5, 3000.0, "is it in cm2 or ft2 instead of m2?"),
    # Ram-air wings have 0.3 kg/m2, rigid wings with generators on board 50 kg/m2.
    Check("kite.mass_kg", 0.05, 150.0, "is it in g or t instead of kg?", by_area=True),
    Check("kite.powered.lift_coefficient", 0.05, 5.0, "is it in percent, or of another area?"),
    Check("kite.powered.drag_coefficient", 0.002, 3.0, "is it in percent, or of another area?"),
    Check("kite.powered.lift_to_drag", 0.5, 80.0, "is it drag over lift, or in percent?"),
    Check("kite.depowered.lift_coefficient", 0.005, 5.0, "is it in percent, or of another area?"),
    Check("kite.depowered.drag_coefficient", 0.002, 3.0, "is it in percent, or of another area?"),
    Check("kite.depowered.lift_to_drag", 0.02, 80.0, "is it drag over lift, or in percent?"),
    Check("tether.diameter_m", 0.0003, 0.1, "is it in mm or cm instead of m?"),
    # Braided fibre has 700 to 1000, with conductors up to 3000, steel 7850.
    Check("tether.density_kg_m3", 300.0, 9000.0, "is it in g/cm3 instead of kg/m3? Braided fibre has about 724 kg/m3"),
    Check("tether.drag_coefficient", 0.05, 3.0, "a cylinder across the flow has about 1.1", zero_is_meant=True),
    # A soft kite is loaded with 100 to 600 N/m2, a rigid one with 10000.
    Check("limits.tether_force_max_N", 60.0, 50000.0, "is it in kgf, daN or kN instead of N?", by_area=True),
    Check("operation.traction.tether_force_N", 20.0, 50000.0, "is it in kgf, daN or kN instead of N?", by_area=True),
    Check("tether.breaking_force_N", 60.0, 5e5, "is it in kgf, daN or kN instead of N?", by_area=True),
    # Soft kites are sold with 500 to 3000 W/m2, rigid ones with 20000.
    Check("limits.generator_power_max_W", 20.0, 2e5, "is it in kW instead of W?", by_area=True),
    Check("limits.motor_power_max_W", 10.0, 2e5, "is it in kW instead of W?", by_area=True),
    Check("operation.tether_length_max_m", 10.0, 20000.0, "is it in km instead of m?"),
    Check("limits.tether_length_max_m", 10.0, 20000.0, "is it in km instead of m?"),
    Check("operation.traction.elevation_deg", 2.0, 90.0, "is it in rad instead of deg?"),
    Check("operation.traction.course_deg", 6.3, 360.0, "is it in rad instead of deg?", zero_is_meant=True),
    Check("limits.traction_elevation_min_deg", 1.6, 90.0, "is it in rad instead of deg?"),
    Check("limits.traction_elevation_max_deg", 2.0, 90.0, "is it in rad instead of deg?"),
    Check("limits.elevation_max_deg", 3.2, 180.0, "is it in rad instead of deg?"),
)


def implausible_values(content: Block, altitudes_m: tuple[float, float]) -> list[str]:
    """Return a sentence for each value that is probably a slip.

    Parameters
    ----------
    content : mapping
        The resolved problem.
    altitudes_m : tuple of float
        Lowest and highest altitude of the flight in m.
    """
    found = [warning for check in CHECKS for warning in check.warnings(content)]
    found += _flat_area(content)
    found += msgspec.convert(content["environment"]["wind"], Wind).warnings(*altitudes_m)
    return found


def _value(content: Block, key: str) -> float | None:
    block: Any = content
    for part in key.split("."):
        block = block.get(part) if isinstance(block, Mapping) else None
    return None if block is None else float(block)


def _flat_area(content: Block) -> Iterator[str]:
    """Compare the projected area with the size by which the file itself calls the kite, which is the flat area."""
    area = content["kite"]["projected_area_m2"]
    texts = " ".join((content["name"], content["description"], content["source"]))
    if "projected" in texts.lower():
        return
    named = {size for name, size in FLAT_AREA_M2.items() if re.search(rf"(?<![a-z\d]){name}(?!\d)", texts.lower())}
    stated = {float(number) for number in _AREA.findall(texts)}
    if any(abs(area - size) < 1e-3 * size for size in named | stated):
        yield (
            f"kite.projected_area_m2 is {show(area)}, the size by which the kite goes: that is usually the flat area, "
            "and the projected one some 20 % smaller; give the area to which the coefficients refer"
        )
