"""Parallel efficiency of `adhesion fleet`, and the memory of its processes.

    python benchmarks/fleet.py

Two hundred logs of one axle and 26 s are analysed with all estimators, by one process and by two.
Efficiency is the time by one over twice the time by two, by the clock: other programs on the
machine spoil it. The code is compiled before.
"""

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from table import Row, show

LOGS = 200
SAMPLE = Path(__file__).parents[1] / "sample_logs" / "service-brake.csv"


def write_logs(folder: Path) -> None:
    """Logs that differ in their last rows: of equal ones only the first is analysed."""
    lines = SAMPLE.read_text().splitlines()
    for i in range(LOGS):
        (folder / f"{i}.csv").write_text("\n".join(lines[: len(lines) - i]) + "\n")


def seconds(logs: Path, out: Path, workers: int) -> float:
    begin = time.perf_counter()
    command = [sys.executable, "-m", "adhesion_cli", "fleet", str(logs), "-o", str(out), "-q"]
    subprocess.run([*command, "--workers", str(workers)], check=True, capture_output=True)
    return time.perf_counter() - begin


def rows() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs, one_log = folder / "logs", folder / "one"
        for x in (logs, one_log):
            x.mkdir()
        write_logs(logs)
        (logs / "0.csv").rename(one_log / "0.csv")
        seconds(one_log, folder / "first", 1)  # compiles
        one, two = (seconds(logs, folder / str(n), n) for n in (1, 2))
        kilobytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        yield Row("fleet, efficiency of 2 processes", one, 2.0 * two, "s", "twice 2", least=0.9)
        yield Row("fleet, memory of a process", kilobytes / 1e3, 400.0, "MB", "the limit", most=1)


if __name__ == "__main__":
    show(rows())
