"""The published numbers of van der Vlugt et al. (2019), as printed: inputs, results, and what is wrong in them.

Reference data only: nothing of the model depends on a number of this module. Numbers are kept as the strings that the
paper prints, because the last digit says how far each was rounded.
"""

from __future__ import annotations

import math
from decimal import Decimal

import msgspec

#: The two cases: names of the shipped problems, as the paper calls them.
CASES: dict[str, str] = {"strong-wind": "strong wind", "moderate-wind": "moderate wind"}


class Printed(msgspec.Struct, frozen=True):
    """A number as printed, and what turns it into SI (or the unit of a key)."""

    text: str
    scale: float = 1.0

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text) * self.scale

    @property
    def half_unit(self) -> float:
        """Half a unit of its last digit: how far rounding may have moved it."""
        exponent = Decimal(self.text).as_tuple().exponent
        return 0.5 * 10.0 ** int(exponent) * self.scale


#: Printed inputs (tab:parameters) by key path: strong wind, moderate wind. The time step is no input of the model.
_INPUTS: dict[str, tuple[str, str]] = {
    "environment.wind.reference_speed_m_s": ("9.9", "5.9"),
    "environment.wind.reference_height_m": ("6", "6"),
    "environment.wind.roughness_length_m": ("0.07", "0.07"),
    "operation.traction.azimuth_deg": ("10.5", "10.6"),
    "operation.traction.elevation_deg": ("27.0", "26.6"),
    "operation.traction.course_deg": ("100.9", "96.4"),
    "operation.tether_length_min_m": ("390", "234"),
    "operation.tether_length_max_m": ("720", "385"),
    "operation.traction.tether_force_N": ("3008", "3069"),
    "operation.retraction.tether_force_N": ("749", "750"),
    "kite.projected_area_m2": ("10.2", "19.8"),
    "kite.mass_kg": ("15.0", "19.6"),
    "kite.powered.lift_to_drag": ("4.0", "3.6"),
    "kite.depowered.lift_to_drag": ("3.1", "3.5"),
    "kite.powered.lift_coefficient": ("0.69", "0.59"),
    "kite.depowered.lift_coefficient": ("0.17", "0.15"),
    "tether.drag_coefficient": ("1.1", "1.1"),
    "tether.diameter_m": ("4", "4"),
    "tether.density_kg_m3": ("724", "724"),
}
#: Printed in another unit than the key's.
_SCALES = {"tether.diameter_m": 1e-3}

#: Sizes by name rather than measurements: a mast of 6 m and a tether sold as 4 mm. Half a unit of them, 8 % and 13 %,
#: would hide much of what the measured inputs say, and is accounted for apart.
NOMINAL_KEYS = frozenset({"environment.wind.reference_height_m", "tether.diameter_m"})

#: Printed results of the inputs, to check them by: strong wind, moderate wind.
PRINTED_CHECKS: dict[str, tuple[Printed, Printed]] = {
    "mean traction altitude z_mt (m)": (Printed("252"), Printed("139")),
    "wind speed at z_mt (m/s)": (Printed("18.2"), Printed("10.1")),
    "resultant coefficient, powered": (Printed("0.71"), Printed("0.61")),
    "resultant coefficient, depowered": (Printed("0.18"), Printed("0.20")),
}

#: Mean powers (kW) and durations (s) by phase: gravity excluded, gravity included, experiment (tab:results_highwind,
#: tab:results_lowwind).
_RESULTS: dict[str, dict[str, tuple[str, str, str]]] = {
    "strong-wind": {
        "retraction.mean_power_W": ("-2.46", "-4.03", "-3.64"),
        "retraction.duration_s": ("103", "60", "67"),
        "transition.mean_power_W": ("17.90", "23.67", "8.50"),
        "transition.duration_s": ("8", "7", "9"),
        "traction.mean_power_W": ("24.72", "22.57", "19.12"),
        "traction.duration_s": ("36", "38", "52"),
        "cycle.mean_power_W": ("5.37", "7.59", "6.48"),
        "cycle.duration_s": ("148", "106", "128"),
    },
    "moderate-wind": {
        "retraction.mean_power_W": ("-1.73", "-2.73", "-2.60"),
        "retraction.duration_s": ("66", "40", "43"),
        "transition.mean_power_W": ("5.08", "8.11", "3.44"),
        "transition.duration_s": ("14", "10", "12"),
        "traction.mean_power_W": ("9.20", "7.67", "6.23"),
        "traction.duration_s": ("42", "49", "66"),
        "cycle.mean_power_W": ("2.84", "3.55", "2.79"),
        "cycle.duration_s": ("123", "101", "122"),
    },
}

#: Largest time step of which the paper says that the scheme is within 3 % (section Convergence Study), its choice, and
#: the steps that it reports for the strong case with gravity.
PAPER_BAND, PAPER_BAND_TIME_STEP, PAPER_TIME_STEP, PAPER_STEPS = 0.03, 0.1, 0.01, 534


class Erratum(msgspec.Struct, frozen=True):
    """A published input that contradicts another.

    Attributes
    ----------
    case
        Name of the problem.
    what, paper, used, why
        In words: the quantity, what the paper says, what is used here, and why.
    overrides
        Keys and values of the reading that is not used, to show what it would change.
    """

    case: str
    what: str
    paper: str
    used: str
    why: str
    overrides: dict[str, float] = msgspec.field(default_factory=dict)


_LIFT = "kite.depowered.lift_coefficient"
ERRATA: tuple[Erratum, ...] = (
    Erratum(
        "moderate-wind",
        "depowered lift coefficient",
        "0.15",
        "0.192",
        "its own resultant coefficient of 0.20 and lift-to-drag ratio of 3.5 imply 0.192",
        {_LIFT: 0.15},
    ),
    Erratum(
        "moderate-wind",
        "projected area",
        "18.6 m2 in the text",
        "19.8 m2",
        "the table of inputs is followed",
        {"kite.projected_area_m2": 18.6},
    ),
    Erratum(
        "moderate-wind",
        "mass",
        "10.6 kg in the text",
        "19.6 kg",
        "the text gives the wing alone, the table includes the control unit",
        {"kite.mass_kg": 10.6},
    ),
    *(
        Erratum(
            case,
            "tether forces",
            "set values of 3000 N and 750 N in the text",
            used,
            "the measured means of the table are followed",
            {"operation.traction.tether_force_N": 3000.0, "operation.retraction.tether_force_N": 750.0},
        )
        for case, used in (("strong-wind", "3008 N and 749 N"), ("moderate-wind", "3069 N and 750 N"))
    ),
)


def printed_inputs(case: str) -> dict[str, Printed]:
    """Return the printed inputs of a case by key path, contradictions included."""
    column = list(CASES).index(case)
    return {key: Printed(texts[column], _SCALES.get(key, 1.0)) for key, texts in _INPUTS.items()}


def half_units(case: str, *, nominal: bool = False) -> dict[str, float]:
    """Return by key path how far rounding may have moved each input of a case.

    Half a unit of the last printed digit. The corrected lift coefficient (`ERRATA`) is a result of two printed numbers,
    the resultant coefficient and the lift-to-drag ratio: their half units are propagated.

    Parameters
    ----------
    case
        Name of the problem.
    nominal
        True counts the sizes by name (`NOMINAL_KEYS`) as well.
    """
    printed = printed_inputs(case)
    halves = {key: number.half_unit for key, number in printed.items() if nominal or key not in NOMINAL_KEYS}
    if case == "moderate-wind":
        resultant, ratio = corrected_lift_sources()
        # C_L = C_R G / sqrt(1 + G^2) for the lift-to-drag ratio G.
        root = math.sqrt(1 + ratio.value**2)
        halves[_LIFT] = ratio.value / root * resultant.half_unit + resultant.value / root**3 * ratio.half_unit
    return halves


def corrected_lift_sources() -> tuple[Printed, Printed]:
    """Return resultant coefficient and lift-to-drag ratio that the corrected lift coefficient follows from."""
    return PRINTED_CHECKS["resultant coefficient, depowered"][1], printed_inputs("moderate-wind")[
        "kite.depowered.lift_to_drag"
    ]


def published_simulation(case: str, *, gravity: bool) -> dict[str, Printed]:
    """Return the published simulation by quantity: mean powers in W and durations in s of phases and cycle."""
    return _column(case, 1 if gravity else 0)


def published_experiment(case: str) -> dict[str, Printed]:
    """Return the published experiment by quantity, as `published_simulation`."""
    return _column(case, 2)


def _column(case: str, column: int) -> dict[str, Printed]:
    return {
        quantity: Printed(texts[column], 1e3 if quantity.endswith("_W") else 1.0)
        for quantity, texts in _RESULTS[case].items()
    }
