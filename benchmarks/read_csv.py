"""How fast CSV logs are read, as a ratio to bare pyarrow.csv asked for the same columns.

Writes one log per form into a temporary folder; reads it with `pyarrow.csv.read_csv` and with
ours, opening included, turn by turn; the quickest of the turns counts. Both use every processor.
Processor time is given beside, since it does not suffer from what else the machine does.

    python benchmarks/read_csv.py [--megabytes 300]
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from table import Row, show

from adhesion_cli.formats.csv.reader import open_csv
from adhesion_cli.formats.source import ReadOptions

TURNS = 3
NAMES = ["bc_pressure_1 [bar]", "bc_pressure_2 [bar]", "axle_1 [km/h]", "axle_2 [km/h]", "a", "b"]
WANTED = NAMES[:4]
ROWS = 50_000  # distinct ones, repeated under a rising time


def write(path: Path, size: int, delimiter: str, decimal: str, stamps: bool, bad: bool) -> None:
    values = np.random.default_rng(1).normal(100.0, 30.0, (ROWS, len(NAMES)))
    tails = [delimiter + delimiter.join(f"{v:.3f}" for v in row) + "\n" for row in values]
    if bad:
        for k in range(0, ROWS, 1000):
            tails[k] = f"{delimiter}fault{tails[k][tails[k].index(delimiter, 1) :]}"
    at = 0
    with path.open("w") as file:
        file.write(delimiter.join(["time" if stamps else "time [s]", *NAMES]) + "\n")
        while file.tell() < size:
            if stamps:
                start = np.datetime64("2026-01-01", "ms")
                times = np.datetime_as_string(start + 10 * np.arange(at, at + ROWS))
            else:
                times = [f"{k / 100:.2f}" for k in range(at, at + ROWS)]
            text = "".join(t + tail for t, tail in zip(times, tails, strict=True))
            file.write(text.replace(".", decimal))
            at += ROWS


def bare(path: Path, delimiter: str, decimal: str, stamps: bool, bad: bool) -> Any:
    time_type = pa.timestamp("ns") if stamps else pa.float64()
    types = dict.fromkeys(WANTED, pa.string() if bad else pa.float64())
    types["time" if stamps else "time [s]"] = time_type
    return pyarrow.csv.read_csv(
        path,
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
        convert_options=pyarrow.csv.ConvertOptions(
            column_types=types, include_columns=list(types), decimal_point=decimal
        ),
    )


def ours(path: Path) -> Any:
    source = open_csv(path, ReadOptions())
    return source.columns([f for f in source.fields if f.channel in WANTED])


def quickest(calls: list[Callable[[], Any]]) -> list[tuple[float, float]]:
    """Wall and processor seconds of each call in its best turn."""
    best = [(np.inf, np.inf)] * len(calls)
    for _ in range(TURNS):
        for k, call in enumerate(calls):
            wall, before = time.perf_counter(), os.times()
            call()
            after = os.times()
            spent = after.user + after.system - before.user - before.system
            best[k] = min(best[k][0], time.perf_counter() - wall), min(best[k][1], spent)
    return best


def rows(megabytes: int = 300) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        for name, least, *form in (
            ("clean", 0.8, ",", ".", False, False),
            ("; and decimal comma", None, ";", ",", False, False),
            ("ISO stamps", None, ",", ".", True, False),
            ("1 bad cell in 1000", None, ",", ".", False, True),
        ):
            write(path, megabytes * 1_000_000, *form)
            size = path.stat().st_size / 1e6
            a, b = quickest([lambda form=form: bare(path, *form), lambda: ours(path)])
            against = "pyarrow.csv, the same columns"
            yield Row(f"read CSV, {name}", size / b[0], size / a[0], "MB/s", against, least)
            against = "the same, by processor time"
            yield Row(f"read CSV, {name}", size / b[1], size / a[1], "MB/s", against)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--megabytes", type=int, default=300)
    show(rows(parser.parse_args().megabytes))
