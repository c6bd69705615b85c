"""One thin file per command: parse, one call, print; `__main__` is the only place that exits."""
