"""Marks of tests whose subject Windows does not have."""

import sys

import pytest


def not_on_windows(reason: str) -> pytest.MarkDecorator:
    """Skips a test there; the reason ends a sentence that begins with "Windows"."""
    return pytest.mark.skipif(sys.platform == "win32", reason=f"Windows {reason}")
