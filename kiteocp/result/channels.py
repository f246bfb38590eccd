"""Names and units of the quantities a result carries; the unit is read off the suffix every name ends in."""

from __future__ import annotations

from collections.abc import Iterable

#: The columns every ``timeseries.csv`` starts with, in this order; a result may add others behind them.
TIME_SERIES_CHANNELS: tuple[str, ...] = (
    "time_s",
    "phase",
    "tether_length_m",
    "elevation_deg",
    "azimuth_deg",
    "height_m",
    "reeling_speed_m_s",
    "kite_speed_m_s",
    "wind_speed_m_s",
    "apparent_wind_speed_m_s",
    "kinematic_ratio",
    "tether_force_kite_N",
    "tether_force_ground_N",
    "power_W",
)

#: The keys every phase and the cycle have in ``summary.json``; a missing value is null.
PHASE_KEYS: tuple[str, ...] = (
    "duration_s",
    "mean_power_W",
    "mean_electrical_power_W",
    "energy_J",
    "electrical_energy_J",
    "tether_length_start_m",
    "tether_length_end_m",
    "elevation_start_deg",
    "elevation_end_deg",
)
CYCLE_KEYS: tuple[str, ...] = (
    "duration_s",
    "mean_power_W",
    "mean_electrical_power_W",
    "energy_J",
    "electrical_energy_J",
    "mean_harvesting_factor",
    "mean_traction_altitude_m",
    "wind_speed_at_mean_traction_altitude_m_s",
)
PHASES: tuple[str, ...] = ("retraction", "transition", "traction")

#: Key of the summary, and what to call it, of the mean power that an optimal cycle maximises, by the word of
#: ``optimisation.objective``.
MEAN_POWERS: dict[str, tuple[str, str]] = {
    "mechanical": ("mean_power_W", "mean power"),
    "electrical": ("mean_electrical_power_W", "mean electrical power"),
}

DIMENSIONLESS = "1"

# Longest suffix first, so that `_m_s2` is not taken for seconds.
_UNIT_OF_SUFFIX: tuple[tuple[str, str], ...] = (
    ("_kg_m3", "kg/m3"),
    ("_deg_s", "deg/s"),
    ("_m_s2", "m/s2"),
    ("_N_m", "N m"),
    ("_m_s", "m/s"),
    ("_deg", "deg"),
    ("_rad", "rad"),
    ("_m2", "m2"),
    ("_kg", "kg"),
    ("_Pa", "Pa"),
    ("_m", "m"),
    ("_s", "s"),
    ("_N", "N"),
    ("_W", "W"),
    ("_J", "J"),
)


def unit_of(name: str) -> str:
    """Return the unit of a quantity from the suffix of its name.

    Parameters
    ----------
    name : str
        Name of a channel or of a summary key, as ``tether_force_kite_N``.

    Returns
    -------
    str
        The unit, as ``"N"`` or ``"m/s"``; ``"1"`` for a dimensionless quantity.

    """
    key = name.rpartition(".")[2]
    return next((unit for suffix, unit in _UNIT_OF_SUFFIX if key.endswith(suffix)), DIMENSIONLESS)


def suggest(name: str, known: Iterable[str]) -> str:
    """Return ``did you mean 'x'?`` for the nearest known name, or the list of known names where none is near."""
    names = [str(item) for item in known]
    import difflib  # noqa: PLC0415  (for mistakes only)

    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if near:
        return f"did you mean '{near[0]}'?"
    return f"known are {', '.join(names)}" if names else "there are none in this result"
