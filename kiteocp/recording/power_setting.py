"""The setting of the kite, from 0 (depowered) to 1 (powered), by the depower or power signal of a recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from kiteocp.errors import InputError
from kiteocp.recording.blocks import PowerSetting
from kiteocp.recording.cleaning import FloatArray

#: A powered phase below this setting does not count: the kite is still being powered up, or down.
FULLY_POWERED = 0.95

#: The depowered level is the signal's extreme in the retraction, without this share of its samples.
BEYOND = 0.05


def levels(
    block: PowerSetting, signal: FloatArray, phase: np.ndarray[Any, np.dtype[np.str_]]
) -> tuple[float, float] | None:
    """Return what the signal shows where the kite is powered and depowered; None where it tells neither.

    What the map leaves open comes from the flight: the median over the traction, and what the signal reaches in the
    retraction (its quantile of 95 % on the far side), where the control unit takes a while to get.

    Parameters
    ----------
    block
        Of the column map.
    signal, phase
        Of each sample, shape (n,).
    """
    powered, depowered = block.powered, block.depowered
    traction, retraction = (_known(signal, phase == name) for name in ("traction", "retraction"))
    if powered is None:
        if not traction.size:
            return None
        powered = float(np.median(traction))
    if depowered is None:
        if not retraction.size:
            return None
        away = np.median(retraction) >= powered
        depowered = float(np.quantile(retraction, 1.0 - BEYOND if away else BEYOND))
    return None if powered == depowered else (powered, depowered)


def setting_of(signal: FloatArray, found: tuple[float, float]) -> FloatArray:
    """Return the setting of every sample, 0 to 1, by the levels `found`."""
    powered, depowered = found
    setting: FloatArray = np.clip((signal - depowered) / (powered - depowered), 0.0, 1.0)
    return setting


def check_levels(
    block: PowerSetting, setting: FloatArray, signal: FloatArray, phase: np.ndarray[Any, np.dtype[np.str_]], name: str
) -> None:
    """Refuse levels of a column map (called `name`) by which the kite is not powered in its tractions."""
    traction = (phase == "traction") & np.isfinite(setting)
    if block.powered is None or not traction.any() or np.mean(setting[traction] >= FULLY_POWERED) >= 0.5:
        return
    raise InputError(
        f"power_setting.powered is {block.powered:g}, but in most of the traction {block.column} is about "
        f"{np.median(signal[traction]):.4g}, so that the kite would not be powered there; correct "
        "power_setting.powered, or leave powered and depowered out to have them found from the flight",
        file=f"column map {name}",
        key="power_setting.powered",
    )


def _known(signal: FloatArray, among: np.ndarray[Any, np.dtype[np.bool_]]) -> FloatArray:
    values: FloatArray = signal[among & np.isfinite(signal)]
    return values
