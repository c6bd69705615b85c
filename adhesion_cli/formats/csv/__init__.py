"""Text logs: dialect, time column, rows."""
