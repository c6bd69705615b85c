"""Stops of the whole train: found in a log, measured, and compared as a test series."""
