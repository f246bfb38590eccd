"""The wind in the problem file: the keys of each profile, what contradicts in them and what is probably a slip.

What a profile means for the flight (its speed, its words, where it holds) is in `kiteocp.physics.wind`.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated

from msgspec import Struct

from kiteocp.problem.fields import quantity
from kiteocp.problem.reading import show

#: Above this altitude a logarithmic wind profile no longer holds (model-notes, validity of the wind model).
LOGARITHMIC_LAW_HEIGHT_MAX_M = 500.0

#: Largest plausible change of the wind with height in 1/s from `SHEAR_HEIGHT_M` upwards. A logarithmic wind of 15 m/s
#: at 10 m over a roughness of 0.1 m has 0.33 there, and less above; low-level jets have some 0.1.
SHEAR_MAX_1_S, SHEAR_HEIGHT_M = 0.5, 10.0

_PATH = "environment.wind"

_Speed = Annotated[float, quantity("m/s", "wind speed at the reference height", gt=0, example=8.0)]
_Height = Annotated[float, quantity("m", "reference height above ground", gt=0, example=100.0)]


class Profile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="profile"):
    """The keys of a wind profile."""

    def mistakes(self, lowest_m: float, highest_m: float) -> Iterator[tuple[str, str]]:
        """Yield key and sentence for each contradiction in the keys.

        Parameters
        ----------
        lowest_m, highest_m : float
            Altitudes between which the kite flies.
        """
        return iter(())

    def warnings(self, lowest_m: float, highest_m: float) -> Iterator[str]:
        """Yield a sentence for each value that is probably a slip, or where the profile does not hold.

        Parameters
        ----------
        lowest_m, highest_m : float
            Altitudes between which the kite flies.
        """
        return iter(())


class LogarithmicWind(Profile, frozen=True, tag="logarithmic"):
    """Wind of a neutral boundary layer, ``v = v_ref ln(z / z_0) / ln(z_ref / z_0)``."""

    reference_speed_m_s: _Speed
    reference_height_m: _Height
    roughness_length_m: Annotated[float, quantity("m", "roughness length z_0 of the ground", gt=0, example=0.03)]

    def mistakes(self, lowest_m: float, highest_m: float) -> Iterator[tuple[str, str]]:
        """Yield a roughness that is not below the reference height."""
        if self.roughness_length_m >= self.reference_height_m:
            yield (
                f"{_PATH}.roughness_length_m",
                f"{_PATH}.roughness_length_m is {show(self.roughness_length_m)} m, not less than the reference height "
                f"({show(self.reference_height_m)} m); grass has about 0.03 m",
            )

    def warnings(self, lowest_m: float, highest_m: float) -> Iterator[str]:
        """Yield that the kite may fly above the layer in which the law holds."""
        if highest_m > LOGARITHMIC_LAW_HEIGHT_MAX_M:
            yield (
                f"the kite may fly up to {show(highest_m)} m, where the logarithmic wind profile no longer holds "
                f"(above {show(LOGARITHMIC_LAW_HEIGHT_MAX_M)} m); lower limits.height_max_m or give a wind table"
            )


class PowerLawWind(Profile, frozen=True, tag="power-law"):
    """Wind of a power law, ``v = v_ref (z / z_ref)**exponent``."""

    reference_speed_m_s: _Speed
    reference_height_m: _Height
    exponent: Annotated[float, quantity("1", "shear exponent", ge=0, le=1, example=0.14)]


class UniformWind(Profile, frozen=True, tag="uniform"):
    """The same wind at all heights."""

    reference_speed_m_s: Annotated[float, quantity("m/s", "wind speed at all heights", gt=0, example=8.0)]


class TableWind(Profile, frozen=True, tag="table"):
    """Wind measured or computed at given heights, interpolated smoothly between them."""

    heights_m: Annotated[
        tuple[Annotated[float, quantity("m", "height above ground", ge=0)], ...],
        quantity(
            "m",
            "heights above ground, strictly increasing, covering the flight altitude",
            min_length=2,
            example=[0.0, 50.0, 100.0, 200.0, 500.0],
        ),
    ]
    speeds_m_s: Annotated[
        tuple[Annotated[float, quantity("m/s", "wind speed", ge=0)], ...],
        quantity("m/s", "wind speeds at these heights", min_length=2, example=[0.0, 7.0, 8.0, 9.0, 10.0]),
    ]

    def mistakes(self, lowest_m: float, highest_m: float) -> Iterator[tuple[str, str]]:
        """Yield lists of two lengths, heights out of order, a calm, and a table that ends where the kite flies."""
        heights, speeds = self.heights_m, self.speeds_m_s
        if len(heights) != len(speeds):
            yield (
                f"{_PATH}.speeds_m_s",
                f"{_PATH} has {len(heights)} heights_m and {len(speeds)} speeds_m_s; give one speed for each height",
            )
        for index, (low, high) in enumerate(pairwise(heights), start=1):
            if not low < high:
                entry = f"{_PATH}.heights_m[{index}]"
                yield entry, f"{entry} is {show(high)} m after {show(low)} m; give the heights strictly increasing"
        if not any(speeds):
            yield (
                f"{_PATH}.speeds_m_s",
                f"{_PATH}.speeds_m_s are all 0 m/s; a kite needs wind, give the speeds measured",
            )
        if heights[0] > lowest_m or heights[-1] < highest_m:
            yield (
                f"{_PATH}.heights_m",
                f"{_PATH}.heights_m covers {show(heights[0])} to {show(heights[-1])} m, but the kite flies between "
                f"{lowest_m:.5g} and {highest_m:.5g} m; extend the table, or narrow limits.height_min_m, "
                "limits.height_max_m and the tether lengths",
            )

    def warnings(self, lowest_m: float, highest_m: float) -> Iterator[str]:
        """Yield speeds that are factors or of another unit, and steps where the kite flies."""
        path, speeds = f"{_PATH}.speeds_m_s", self.speeds_m_s
        if max(speeds) < 2.5:
            yield (
                f"{path} are {show(max(speeds))} m/s at most, in which no kite flies: are they factors of a reference "
                "speed? Multiply them by it"
            )
        if max(speeds) > 80.0:
            yield f"{path} reach {show(max(speeds))} m/s, more than any storm: are they in another unit than m/s?"
        for (low, high), (below, above) in zip(pairwise(self.heights_m), pairwise(speeds), strict=True):
            steep = abs(above - below) > SHEAR_MAX_1_S * (high - low)
            if steep and low >= SHEAR_HEIGHT_M and high > lowest_m and low < highest_m:
                yield (
                    f"{path} steps from {show(below)} to {show(above)} m/s between {show(low)} and {show(high)} m, "
                    "where the kite may fly: no wind changes so fast, and an optimum can hang on such a step or not be "
                    "found; check the table or smooth the step"
                )


#: All profiles, told apart by the word of ``environment.wind.profile``. A new one is its class above and a place here.
Wind = LogarithmicWind | PowerLawWind | UniformWind | TableWind
