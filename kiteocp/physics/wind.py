"""The wind of a problem as a whole: its numbers, the same times a factor, and its name in a sentence."""

from __future__ import annotations

from kiteocp.physics.parameters import ParameterValues, Structure
from kiteocp.report.words import rounded

#: Stands for the wind speed where keys are named; of a table it is all its speeds.
WIND = "environment.wind"


def wind_keys(structure: Structure) -> list[str]:
    """Keys of the numbers that scale the wind speed: the reference speed, or the speeds of a table."""
    prefixes = ("environment.wind.reference_speed_m_s", "environment.wind.speeds_m_s[")
    return [key for key in structure.keys if key.startswith(prefixes)]


def in_wind(values: ParameterValues, factor: float) -> ParameterValues:
    """Return the same with the wind speed times a factor; every profile is linear in its speeds."""
    return values.replaced({name: factor * values[name] for name in wind_keys(values.structure)})


def wind_text(values: ParameterValues, factor: float) -> str:
    """Name the wind of a problem at a factor, as its file does; a changed one rounded away from the given."""
    speed = factor * value_of(values, WIND)
    number = f"{speed:.4g}" if factor == 1.0 else rounded(speed, up=factor > 1.0)
    if values.structure.choice("environment.wind.profile") == "table":
        return f"a wind of up to {number} m/s"
    height = "environment.wind.reference_height_m"
    return f"{number} m/s of wind" + (f" at {values[height]:g} m" if height in values else "")


def value_of(values: ParameterValues, key: str) -> float:
    """Return the number of a key; of the wind its reference speed, or the largest speed of a table."""
    return max(values[name] for name in wind_keys(values.structure)) if key == WIND else values[key]
