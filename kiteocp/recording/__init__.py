"""Measured flights: reading them, and flying them again in the model."""

from __future__ import annotations

from kiteocp.recording.columns import ColumnMap, load_columns, shipped_columns
from kiteocp.recording.data import FLIGHT_PHASES, FlightData
from kiteocp.recording.reading import load_flight

__all__ = ["FLIGHT_PHASES", "ColumnMap", "FlightData", "load_columns", "load_flight", "shipped_columns"]
