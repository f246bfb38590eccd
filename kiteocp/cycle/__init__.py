"""What a pumping cycle is, and its forward simulation, one by one (here) or in batches (`kiteocp.cycle.fast.batch`)."""

from kiteocp.cycle.simulation import simulate

__all__ = ["simulate"]
