"""Optimal pumping cycles: a generic multi-phase transcription, and the cycle problem written in it."""

from kiteocp.ocp.outcome import solve

__all__ = ["solve"]
