"""Pictures of results; the only room that imports matplotlib."""

from kiteocp.plots.cycle import plot_cycle, plot_optimum, plot_result

__all__ = ["plot_cycle", "plot_optimum", "plot_result"]
