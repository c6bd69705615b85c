"""Checks of what channels say about each other; they change nothing."""
