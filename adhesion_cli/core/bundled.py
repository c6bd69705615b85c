"""Where the files that come with the package are, installed or in a checkout."""

from pathlib import Path

SAMPLE = "service-brake.csv"


def folder(name: str) -> Path:
    """A folder of files that came along: `sample_logs` or `schemas`."""
    package = Path(__file__).parents[1]
    installed = package / name
    return installed if installed.is_dir() else package.parent / name
