"""Logs as CSV: every sample once, in its channel's order, with its own time."""

import csv
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.core.model import Channel, Column, Log
from adhesion_cli.results import wide_table


def channel(name: str, t: list[int], values: list[float], unit: str = "bar") -> Channel:
    v = np.array(values, float)
    data = Column(np.array(t, np.int64), v, np.isfinite(v))
    return Channel(name, "", None, None, unit, "", data)


def log(*channels: Channel, absolute: bool = False) -> Log:
    return Log("log.mcap", "mcap", "0" * 64, absolute, 1, channels, ())


def table(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


@settings(max_examples=60)
@given(st.lists(st.lists(st.integers(-5, 5), max_size=8), min_size=1, max_size=4))
def test_every_sample_once_and_in_order(
    tmp_path_factory: pytest.TempPathFactory, axes: list[list[int]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    channels = [channel(f"c{i}", t, [k + 0.1 for k in range(len(t))]) for i, t in enumerate(axes)]
    wide_table.write_csv(path, log(*channels))
    header, *rows = table(path)
    assert header == ["time [s]", *(f"c{i} [bar]" for i in range(len(axes)))]
    for i, t in enumerate(axes, 1):
        cells = [(round(float(row[0]) * 1e9), float(row[i])) for row in rows if row[i]]
        assert cells == [(at, k + 0.1) for k, at in enumerate(t)]
    # equal stamps share a row where every channel's time rises
    if all(sorted(set(t)) == t for t in axes):
        assert [round(float(r[0]) * 1e9) for r in rows] == sorted({at for t in axes for at in t})


def test_long_log_in_several_writes(tmp_path: Path) -> None:
    n = 150_000
    values = np.random.default_rng(0).normal(size=n)
    slow = channel("slow", list(range(0, n, 7)), list(range(0, n, 7)))
    wide_table.write_csv(
        tmp_path / "a.csv", log(channel("fast", list(range(n)), list(values)), slow)
    )
    _, *rows = table(tmp_path / "a.csv")
    assert [float(r[1]) for r in rows] == list(values)
    assert [float(r[2]) for r in rows if r[2]] == list(range(0, n, 7))


def test_clock_time_to_the_nanosecond(tmp_path: Path) -> None:
    start = 1_760_000_000_123_456_789
    wide_table.write_csv(tmp_path / "a.csv", log(channel("p", [start], [1.0]), absolute=True))
    header, row = table(tmp_path / "a.csv")
    assert header == ["time", "p [bar]"]
    whole, fraction = row[0].rstrip("Z").split(".")
    seconds = int(datetime.fromisoformat(whole + "+00:00").timestamp())
    assert seconds * 10**9 + int(fraction) == start


def test_units_follow_the_values(tmp_path: Path) -> None:
    raw = channel("BC (kPa)", [0], [350.0], "kPa")
    in_si = replace(channel("BC (kPa)", [0], [350e3], "kPa"), meaning="pressure")
    nameless = channel("count", [0], [7.0], "")
    wide_table.write_csv(tmp_path / "a.csv", log(raw, in_si, nameless))
    assert table(tmp_path / "a.csv") == [
        ["time [s]", "BC (kPa)", "BC [Pa]", "count"],
        ["0", "350", "350000", "7"],
    ]


def test_missing_and_masked_values_are_empty(tmp_path: Path) -> None:
    p = channel("p", [0, 1, 2], [1.0, np.nan, 3.0])
    p.data.valid[2] = False
    wide_table.write_csv(tmp_path / "a.csv", log(p))
    assert [row[1] for row in table(tmp_path / "a.csv")] == ["p [bar]", "1", "", ""]


def test_units_are_hostile_too(tmp_path: Path) -> None:
    wide_table.write_csv(tmp_path / "a.csv", log(channel("x", [0], [1.0], "\x1b[2J\u202e")))
    assert table(tmp_path / "a.csv")[0] == ["time [s]", "x [\\x1b[2J\\u202e]"]


@pytest.mark.parametrize(
    "name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", '"x"', "a,b", "a\nb"]
)
def test_hostile_names(tmp_path: Path, name: str) -> None:
    wide_table.write_csv(tmp_path / "a.csv", log(channel(name, [0], [1.0], "")))
    header, row = table(tmp_path / "a.csv")
    assert len(header) == len(row) == 2
    assert header[1][0] not in "=+-@\t\r"
    assert header[1].isprintable()


def test_log_without_channels(tmp_path: Path) -> None:
    wide_table.write_csv(tmp_path / "a.csv", log())
    assert table(tmp_path / "a.csv") == [["time [s]"]]
