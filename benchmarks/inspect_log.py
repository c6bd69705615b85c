"""Whole `inspect` of long logs against the library of their format.

    python benchmarks/inspect_log.py [--messages 1600000]

The log has four axles at 100 Hz, with pressure and wheel speed of each. The train stops every
minute, as a metro does, or every 5 minutes, as between two towns. It is MCAP (protobuf) or, an hour
with the train speed, CSV.

Ours is a process from its start to its end, with all checks. mcap's reader with its decoder only
reads, as does `pyarrow.csv`. Times are of the processor, all threads together: other programs do
not count. Ours and the rival take turns; the quickest turn of each counts.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow.csv
from mcap.writer import Writer
from read_mcap import CASES, CHANNELS, ENCODING, START, by_mcap
from table import Row, show
from write_results import METRO, RATE, TOWNS, write_log

TURNS = 3


def write(path: Path, of: Path, messages: int) -> None:
    """Pressures and wheel speeds of a CSV as protobuf messages, one channel each."""
    name, encoding, schema, message = CASES["protobuf"]
    table = pyarrow.csv.read_csv(of).slice(0, messages // CHANNELS)
    columns = [c for c in table.column_names if c[-7:] != "[km/h]" or "wheel" in c][1:]
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        kind = writer.register_schema(name, encoding, schema)
        topics = [f"/{c.replace(' [', '_').replace('/', '').rstrip(']')}" for c in columns]
        ids = [writer.register_channel(t, ENCODING[encoding], kind) for t in topics]
        for i, row in enumerate(zip(*(table[c].to_pylist() for c in columns), strict=True)):
            t = START + round(i * 1e9 / RATE)
            for channel, value in zip(ids, row, strict=True):
                writer.add_message(channel, t, message(t, value), t)
        writer.finish()


def inspected(path: Path) -> float:
    """Processor seconds of `adhesion inspect`."""
    # As installed: with the bytecode that pip writes.
    env = {name: x for name, x in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, "-m", "adhesion_cli", "inspect", str(path), "--json"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, env=env, check=False, capture_output=True)
    assert done.returncode in (0, 3), done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def processor(work: Callable[[], object]) -> float:
    """Processor seconds of work in this process."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def quickest(ours: Callable[[], float], rival: Callable[[], float]) -> tuple[float, float]:
    """Of both, turn by turn; the first turn of ours only fills the caches."""
    ours()
    turns = [(ours(), rival()) for _ in range(TURNS)]
    return min(t[0] for t in turns), min(t[1] for t in turns)


def rows(messages: int = 1_600_000, sample: int = 150_000) -> Iterator[Row]:
    """Two rows per log: MCAP and CSV.

    Args:
        messages: in each MCAP.
        sample: how many of them mcap's own reader decodes.
    """
    with tempfile.TemporaryDirectory() as folder:
        log, mcap = Path(folder) / "log.csv", Path(folder) / "log.mcap"
        for period in (TOWNS[1], METRO[1]):
            stops = f"stop each {period:g} s"
            write_log(log, round(3600.0 / period), period)
            write(mcap, log, messages)
            each = lambda: processor(lambda: by_mcap(mcap, "protobuf", sample))  # noqa: E731
            own, theirs = quickest(lambda: inspected(mcap), each)
            against = "mcap's reader with its decoder"
            ours, rival = messages / own / 1e3, sample / theirs / 1e3
            yield Row(f"inspect MCAP, {stops}", ours, rival, "k msg/s", against, 15)
            megabytes = log.stat().st_size / 1e6
            read = lambda: processor(lambda: pyarrow.csv.read_csv(log))  # noqa: E731
            own, theirs = quickest(lambda: inspected(log), read)
            ours, rival = megabytes / own, megabytes / theirs
            yield Row(f"inspect CSV, {stops}", ours, rival, "MB/s", "pyarrow.csv, only reading")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--messages", type=int, default=1_600_000)
    show(rows(parser.parse_args().messages))
