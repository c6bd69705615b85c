"""The same brake in each format, written by the format's own library, gives the same numbers."""

import json
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest
from helpers import brakes

from adhesion_cli.channels.log import unchanged
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.results import wide_table

Run = Callable[..., CompletedProcess[str]]


FORMATS: dict[str, Callable[[Path], Path]] = {
    "log.parquet": lambda path: brakes.parquet(path, brakes.groups()),
    "plain.mf4": lambda path: brakes.mdf(path, brakes.groups()),
    "packed.mf4": lambda path: brakes.mdf(path, brakes.groups(), compression=2),
    "wave.tdms": lambda path: brakes.tdms(path, brakes.groups(), segments=5),
    "columns.tdms": lambda path: brakes.tdms(path, brakes.groups(), by_channel=True, segments=5),
    "can.blf": lambda path: brakes.can(path, brakes.groups()),
    "can.asc": lambda path: brakes.can(path, brakes.groups()),
    "can.trc": lambda path: brakes.can(path, brakes.groups()),
    "old.mdf": lambda path: brakes.mdf(path, brakes.groups(), "3.30"),
}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """The brake in each format; written once."""
    folder = tmp_path_factory.mktemp("logs")
    yield {name: write(folder / name) for name, write in FORMATS.items()}
    shutil.rmtree(folder)


class Read:
    """What a log holds: times after its start [s] and values by channel, and the findings."""

    def __init__(self, path: Path, start: int | None = None) -> None:
        dbc = path.with_suffix(".dbc")
        source = open_source(path, ReadOptions(dbc=(str(dbc),) if dbc.exists() else ()))
        columns = source.columns(source.fields)
        if start is None:
            start = min(int(c.t.min()) for c in columns if len(c.t))
        self.source, self.start = source, start
        self.findings: list[Finding] = source.findings
        self.units = {f.channel.split(" [")[0]: f.unit for f in source.fields}
        self.values = {
            f.channel.split(" [")[0]: (c.t[c.valid] - start, c.value[c.valid])
            for f, c in zip(source.fields, columns, strict=True)
        }

    def codes(self) -> set[str]:
        return {f.code for f in self.findings}


@pytest.fixture(scope="module")
def sample() -> dict[str, tuple[str, Any, Any]]:
    """Unit, times [ns] and values of each channel of the brake."""
    return {
        s.name: (s.unit, np.rint(g.t * 1e9).astype(np.int64), s.value)
        for g in brakes.groups()
        for s in g.signals
    }


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_samples(
    name: str, logs: dict[str, Path], sample: dict[str, Any]
) -> None:
    read = Read(logs[name])
    assert set(read.values) == set(sample)
    for channel, (unit, t, value) in sample.items():
        assert read.units[channel] == unit
        assert np.array_equal(read.values[channel][0], t), channel
        assert np.array_equal(read.values[channel][1], value), channel
    start = round(brakes.START.timestamp() * 1e3) * 10**6 * (name != "columns.tdms")
    assert read.source.absolute == bool(start)
    assert abs(read.start - start) < 256  # asammdf writes it by way of a float
    assert not [f for f in read.findings if f.severity != "info"]


@pytest.mark.slow
# The others give the same samples, see above.
@pytest.mark.parametrize("name", ["log.parquet", "packed.mf4", "columns.tdms", "can.blf"])
def test_analyze_gives_the_same_figures(name: str, logs: dict[str, Path], run: Run) -> None:
    def axles(log: Path) -> Any:
        dbc = ["--dbc", log.with_suffix(".dbc")] if name.startswith("can.") else []
        done = run("analyze", log, "--json", "--force", *dbc)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout, object_hook=without_clock)["results"][0]["axles"]

    def without_clock(keys: dict[str, Any]) -> dict[str, Any]:
        return {key: value for key, value in keys.items() if key != "time"}  # the sample has none

    assert axles(logs[name]) == axles(brakes.SAMPLE)


@pytest.mark.parametrize("suffix", [".csv", ".mcap", ".parquet", ".xlsx"])
def test_convert_writes_what_it_read(
    suffix: str, logs: dict[str, Path], tmp_path: Path, sample: dict[str, Any]
) -> None:
    target = tmp_path / f"copy{suffix}"
    log = unchanged(open_source(logs["packed.mf4"], ReadOptions()), ())
    wide_table.writer(target)(target, log)
    read = Read(target)
    assert read.source.absolute
    for channel, (unit, t, value) in sample.items():
        assert read.units[channel] == (unit if suffix not in (".csv", ".xlsx") else "")
        assert np.array_equal(read.values[channel][0], t)
        assert np.array_equal(read.values[channel][1], value)


@pytest.mark.parametrize("name", ["plain.mf4", "log.parquet"])
def test_the_content_decides_whatever_the_name(
    name: str, logs: dict[str, Path], tmp_path: Path
) -> None:
    renamed = tmp_path / "log.csv"
    shutil.copy(logs[name], renamed)
    assert Read(renamed).source.format == logs[name].suffix[1:]


# ------------------------------------------------------------------------------------- damage


def damaged(raw: bytes, seed: int) -> bytes:
    """Cut off, bits changed, a number or a link overwritten, or a hole of zeros."""
    r = random.Random(seed)
    data, at = bytearray(raw), r.randrange(len(raw) - 8)
    kind = seed % 4
    if kind == 0:
        return bytes(data[: at + 1])
    if kind == 1:
        for _ in range(r.choice((1, 4))):
            data[r.randrange(len(data))] ^= 1 << r.randrange(8)
    elif kind == 2:
        at &= ~7
        data[at : at + 8] = r.choice(
            (b"\xff" * 8, bytes(8), r.randbytes(8), r.randrange(len(raw)).to_bytes(8, "little"))
        )
    else:
        end = min(len(data), at + r.choice((64, 4096, 65536)))
        data[at:end] = bytes(end - at)
    return bytes(data)


def judge(path: Path, raw: bytes, sample: dict[str, Any], start: int, cut: bool) -> str:
    """Reads a damaged log: one clear error, or what is left of it.

    Where the file is only cut off, or has checksums, all that is left is as it was, and what is
    lost is reported.
    """
    path.write_bytes(raw)
    told: UserError | None = None
    try:
        read = Read(path, start)
    except UserError as error:
        told = error
    if told:
        assert str(path) in told.text
        assert told.hint
        assert "\n" not in told.text
        return "refused"
    lost = False
    for channel, (_, t, value) in sample.items() if cut else ():
        got, values = read.values.get(channel, (t[:0], value[:0]))
        places = np.minimum(np.searchsorted(t, got), len(t) - 1)
        assert np.array_equal(t[places], got), channel
        assert np.array_equal(value[places], values), channel
        lost |= len(got) < len(t)
    # A TRC log has no end mark. Its line is whole with the first byte of "\r\n", a line end itself.
    if lost and not (path.suffix == ".trc" and raw.endswith((b"\r", b"\n"))):
        assert read.codes() & {"log-damaged", "can-lines-skipped"}
    return "lost" if lost else "kept"


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 200), marks=pytest.mark.slow)])
def test_damaged_files_are_read_in_part_or_refused(
    name: str, seeds: range, logs: dict[str, Path], tmp_path: Path, sample: dict[str, Any]
) -> None:
    raw = logs[name].read_bytes()
    path = tmp_path / logs[name].name
    if (dbc := logs[name].with_suffix(".dbc")).exists():
        shutil.copy(dbc, path.with_suffix(".dbc"))
    start, checked = Read(logs[name]).start, name == "log.parquet"
    fates = [judge(path, damaged(raw, k), sample, start, checked or k % 4 == 0) for k in seeds]
    assert set(fates) != {"kept"}


def test_a_log_of_famos_is_named_as_one(tmp_path: Path) -> None:
    log = tmp_path / "brake.dat"
    log.write_bytes(b"|CF,2,1,1;|CK,1,3,1,1;\r\n|NO,1,7,0,0,,0,;\r\n")
    with pytest.raises(UserError, match=r"brake\.dat: an imc FAMOS log") as told:
        open_source(log, ReadOptions())
    assert "export it" in told.value.hint
