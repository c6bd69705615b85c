"""Small logs of a fleet, processes that outlive a run, and work that ends its process."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from adhesion_cli.core import bundled
from adhesion_cli.fleet import run, work, workers  # noqa: F401 (run: reads the class first)
from adhesion_cli.fleet.locations import LogLocation

_LINES = (bundled.folder("sample_logs") / bundled.SAMPLE).read_bytes().splitlines(keepends=True)


def write(folder: Path, count: int) -> list[Path]:
    """Logs of one brake application, each of another length."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"stop-{i:03d}.csv" for i in range(count)]
    for i, path in enumerate(paths):
        path.write_bytes(b"".join(_LINES[: len(_LINES) - i]))
    return paths


class _Kept(workers.Processes):
    """Processes that the end of a run leaves alive."""

    def close(self) -> None:
        """Leaves them to the next run."""


@contextmanager
def kept_processes() -> Iterator[None]:
    """The processes of a run serve the next one too, whose start and imports take seconds."""
    pool: list[_Kept] = []

    def kept(_: int) -> _Kept:
        """Two, however many are asked for."""
        pool.extend([] if pool else [_Kept(2)])
        return pool[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "Processes", kept)
        yield
    for one in pool:
        super(_Kept, one).close()


def killed(item: LogLocation, job: work.Job) -> Any:
    """As `work.analysed`; but a log named `dies` ends the process, and one named `once` once."""
    name = Path(item.place)
    mark = name.with_suffix(".tried")
    if name.name.startswith("dies") or (name.name.startswith("once") and not mark.exists()):
        mark.touch()
        os._exit(9)  # as a kill does, on every system
    return work.analysed(item, job)


def stuck(started: str) -> None:
    """Work that never ends; the file says that it has begun."""
    Path(started).touch()
    time.sleep(3600.0)
