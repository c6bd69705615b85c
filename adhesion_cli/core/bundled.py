"""Where the files of the package are, installed or in a checkout."""

from pathlib import Path

SAMPLE = "service-brake.csv"


def folder(name: str) -> Path:
    """A folder of such files: `sample_logs` or `schemas`."""
    package = Path(__file__).parents[1]
    installed = package / name
    return installed if installed.is_dir() else package.parent / name
