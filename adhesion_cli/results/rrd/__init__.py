"""Results as a Rerun recording that opens in its own layout; the only package that knows Rerun.

The MCAP is the record; a recording is a view of it that opens only in a neighbouring version of the
viewer and can be made again. Everything is sent by columns.
"""

from .results import write_results
from .stops import StopsPage, write_stops

__all__ = ["StopsPage", "write_results", "write_stops"]
