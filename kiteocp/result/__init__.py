"""What comes out of a calculation: named channels with units, summaries, saving, loading and the printed table."""

from kiteocp.result.channels import TIME_SERIES_CHANNELS, unit_of
from kiteocp.result.container import Result
from kiteocp.result.contract import STATUSES
from kiteocp.result.loading import load_result

__all__ = ["STATUSES", "TIME_SERIES_CHANNELS", "Result", "load_result", "unit_of"]
