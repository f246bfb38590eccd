"""What a pumping cycle is, and its forward simulation."""

from kiteocp.cycle.batch import BatchResult, simulate_batch
from kiteocp.cycle.simulation import simulate

__all__ = ["BatchResult", "simulate", "simulate_batch"]
