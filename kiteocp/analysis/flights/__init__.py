"""Measured flights: reading them, and flying them again in the model."""

from __future__ import annotations

from kiteocp.analysis.flights.data import FLIGHT_PHASES, FlightData

__all__ = ["FLIGHT_PHASES", "FlightData"]
