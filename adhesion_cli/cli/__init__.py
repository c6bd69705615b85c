"""One thin file per command: parse, one call, print; `app` is the only place that exits."""
