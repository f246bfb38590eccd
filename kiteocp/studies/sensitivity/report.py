"""Sensitivities in words: the table, the shadow prices of limits, and warnings against wrong designs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from kiteocp.ocp.collocation import FloatArray
from kiteocp.problem.catalogue import limit_keys
from kiteocp.report.document import Document, Lines
from kiteocp.report.table import Column, Table
from kiteocp.report.words import listed
from kiteocp.result import Result

#: Amount in which a limit is priced: by unit, the amount and how it is written.
_AMOUNTS: dict[str, tuple[float, str]] = {
    "N": (1000.0, "1 kN"),
    "W": (1000.0, "1 kW"),
    "m": (1.0, "1 m"),
    "m/s": (1.0, "1 m/s"),
    "m/s2": (1.0, "1 m/s2"),
    "deg": (1.0, "1 deg"),
    "deg/s": (0.1, "0.1 deg/s"),
    "s": (1.0, "1 s"),
}

#: Amount of a limit without unit.
_RATIO_AMOUNT = (0.01, "0.01")

#: A share of the power, per 1 % of a key, below which a derivative is not worth a line.
_NOTHING = 1e-9

#: A change of a derivative, as a share of it, from which on keys that follow by default are named beside it.
_FOLLOWS = 1e-3

#: Keys whose derivative has a sign that everybody expects, with that sign and why the optimum may have the other.
_EXPECTED: dict[str, tuple[float, str]] = {
    "kite.mass_kg": (
        -1.0,
        "in this model weight helps the retraction; launching, gusts and steering, which it harms, are not modelled",
    ),
    "tether.density_kg_m3": (
        -1.0,
        "in this model weight helps the retraction; launching and sag in light wind, which it harms, are not modelled",
    ),
    "kite.projected_area_m2": (1.0, "more area cannot pull harder there and is harder to reel in"),
    "environment.air.density_sea_level_kg_m3": (1.0, "denser air cannot pull harder there and resists the retraction"),
    "kite.powered.lift_coefficient": (1.0, "more lift cannot be used there"),
    "kite.powered.lift_to_drag": (1.0, "more lift-to-drag cannot be used there"),
}

#: Where the largest tether force rules, and where it does not.
_FORCE_RULES = "limits.tether_force_max_N rules the traction, and"
_OTHER_RULES = "a limit rules (see the shadow prices), and"


def shadow_prices(
    keys: Sequence[str],
    prices: Mapping[str, FloatArray],
    alone: FloatArray,
    followers: Callable[[int], Sequence[str]],
) -> list[dict[str, Any]]:
    """Return what each active limit is worth, by phase.

    Parameters
    ----------
    keys
        Key paths.
    prices
        Derivative of the optimal mean power through each phase, W per unit of each key, shape (keys,); ``cycle`` is
        what does not act through a bound of one phase.
    alone
        The same through all of the cycle, with the keys held that follow by default, shape (keys,).
    followers
        From the place of a key to the keys that follow it by default.
    """
    rows = []
    for column, key in enumerate(keys):
        row = limit_keys()[key].limit if key in limit_keys() else None
        if row is None:
            continue
        total = sum(float(price[column]) for price in prices.values())
        by_phase = {phase: float(price[column]) for phase, price in prices.items()}
        largest = max(abs(price) for price in by_phase.values())
        kept = {phase: price for phase, price in by_phase.items() if abs(price) > 1e-6 * largest}
        if not kept:
            continue
        amount, written = _AMOUNTS.get(row.unit, _RATIO_AMOUNT)
        text = f"{written} {row.more} {_worth(amount * total)}"
        held = float(alone[column])
        if abs(held - total) > _FOLLOWS * max(abs(held), abs(total)):
            names = followers(column)
            follow, these = ("follows", "that") if len(names) == 1 else ("follow", "these")
            text += f", as {listed(names, 'and')} {follow} it by default; with {these} held, it {_worth(amount * held)}"
        rows.append(
            {
                "key": key,
                "derivative": total,
                "derivative_alone": held,
                "phases": kept,
                "text": text,
            }
        )
    return rows


def _worth(power: float) -> str:
    return f"{'is worth' if power >= 0.0 else 'costs'} {_watts(abs(power))}"


def _watts(power: float) -> str:
    return f"{power / 1e3:.3g} kW" if power >= 1e3 else f"{power:.3g} W"


def design_warnings(rows: Sequence[Mapping[str, Any]], force_rules: bool) -> list[str]:
    """Warn of derivatives whose sign invites a wrong design, and say why the optimum has it.

    Parameters
    ----------
    rows
        ``details["sensitivities"]``.
    force_rules
        Whether the largest tether force is held in the traction.
    """
    warnings = []
    for row in rows:
        expected, reason = _EXPECTED.get(row["key"], (0.0, ""))
        elasticity = row["elasticity"]
        if elasticity is not None and expected * row["derivative"] < 0.0 and abs(elasticity) > 1e-4:
            if expected > 0.0:
                reason = f"{_FORCE_RULES if force_rules else _OTHER_RULES} {reason}"
            unit = "unit" if row["unit"] == "1" else row["unit"]
            word = "raises" if row["derivative"] > 0.0 else "lowers"
            warnings.append(
                f"more {row['key']} {word} the optimum ({row['derivative']:+.3g} W per {unit}): {reason}; "
                "do not design by this sign"
            )
    return warnings


def sensitivities_document(result: Result) -> Document:
    """Return what a result of verb ``sensitivity`` says: keys by falling influence, shadow prices, warnings."""
    details = result.details
    title = f"{result.problem.name}: sensitivity of the optimal mean power ({result.status})"
    if message := details.get("message"):
        title += f" - {message}"
    if "sensitivities" not in details:
        return Document(title, [])
    power = f"optimal mean power {details['optimal_mean_power_W']:.1f} W ({details['objective']})"
    rows = sorted(details["sensitivities"], key=lambda row: -abs(row["elasticity"] or 0.0))
    felt = [row for row in rows if _felt(row)]
    heads = ("value", "unit", "W per unit", "% per %", "holds from", "to", "change (W)", "")
    table = Table([Column("key", left=True), *map(Column, heads)], [_cells(row) for row in felt])
    silent = [row["key"] for row in rows if not _felt(row)]
    notes = ["change: for the stated uncertainty (*), or for -1 % and +1 %"]
    if any(row.get("misleading") for row in rows):
        notes.append("!: re-solving gives a change that differs from the linear one by more than 10 %")
    notes += [
        f"+: {row['key']} moves {listed(row['followed_by'], 'and')} too, by default; alone "
        f"{row['derivative_alone']:.4g} W per unit"
        for row in felt
        if _mixed(row)
    ]
    prices = [f"  {price['text']} ({', '.join(price['phases'])})" for price in details["shadow_prices"]]
    return Document(
        title,
        [
            Lines([power], joined=True),
            table,
            Lines([f"without influence: {', '.join(silent)}"] if silent else []),
            Lines(notes),
            Lines(["limits (at the rate here):", *prices] if prices else []),
            Lines([f"warning: {text}" for text in result.warnings], joined=True),
        ],
    )


def _mixed(row: Mapping[str, Any]) -> bool:
    """Whether part of a derivative is that of keys that follow by default."""
    own = row.get("derivative_alone", row["derivative"])
    return bool(abs(own - row["derivative"]) > _FOLLOWS * max(abs(own), abs(row["derivative"])))


def _felt(row: Mapping[str, Any]) -> bool:
    slopes = (row["derivative"], row["derivative_below"], row["derivative_above"])
    return abs(row["elasticity"] or 0.0) > _NOTHING or any(slope is None or slope != 0.0 for slope in slopes)


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    mark = ("*" if row["uncertainty_stated"] else "") + ("!" if row.get("misleading") else "")
    mark += "+" if _mixed(row) else ""
    smooth = row["derivative_below"] is not None and row["derivative_above"] is not None
    smooth = smooth and math.isclose(row["derivative_below"], row["derivative_above"], rel_tol=1e-9, abs_tol=1e-12)
    derivative = f"{row['derivative']:.4g}"
    if not smooth:
        derivative = " | ".join(
            "none" if s is None else f"{s:.4g}" for s in (row["derivative_below"], row["derivative_above"])
        )
    changes = " / ".join("none" if c is None else f"{c:+.3g}" for c in (row["change_at_from_W"], row["change_at_to_W"]))
    elasticity = "" if row["elasticity"] is None else f"{row['elasticity']:+.3f}"
    ends = ["" if row[name] is None else f"{row[name]:.4g}" for name in ("valid_from", "valid_to")]
    unit = "" if row["unit"] == "1" else row["unit"]
    return (row["key"], f"{row['value']:g}", unit, derivative, elasticity, *ends, changes, mark)
