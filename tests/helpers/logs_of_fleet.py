"""Small logs of a fleet, and work that ends its process."""

import os
import time
from pathlib import Path
from typing import Any

from adhesion_cli.core import bundled
from adhesion_cli.fleet import work

_LINES = (bundled.folder("sample_logs") / bundled.SAMPLE).read_bytes().splitlines(keepends=True)


def write(folder: Path, count: int) -> list[Path]:
    """Logs of one brake application, each of another length."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"stop-{i:03d}.csv" for i in range(count)]
    for i, path in enumerate(paths):
        path.write_bytes(b"".join(_LINES[: len(_LINES) - i]))
    return paths


def killed(item: work.Item, job: work.Job) -> Any:
    """As `work.analysed`; but a log named `dies` ends the process, and one named `once` once."""
    name = Path(item.log.place)
    mark = name.with_suffix(".tried")
    if name.name.startswith("dies") or (name.name.startswith("once") and not mark.exists()):
        mark.touch()
        os._exit(9)  # as a kill does, on every system
    return work.analysed(item, job)


def stuck(started: str) -> None:
    """Work that never ends; the file says that it has begun."""
    Path(started).touch()
    time.sleep(3600.0)
