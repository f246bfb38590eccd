"""What a pumping cycle is, and its forward simulation."""

from kiteocp.cycle.simulation import simulate

__all__ = ["simulate"]
