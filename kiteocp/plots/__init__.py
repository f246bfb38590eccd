"""Pictures of results; the only room that imports matplotlib."""

from kiteocp.plots.pictures import draw

__all__ = ["draw"]
