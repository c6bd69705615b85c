"""MDF logs: groups, conversions, invalidation bits, and files that break the library."""

import os
import signal
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from asammdf.blocks.conversion_utils import from_dict
from helpers import brakes
from helpers.systems import not_on_windows

from adhesion_cli.channels.log import needed, survey
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.formats import isolated
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

T = np.arange(200) / 50
V = np.linspace(70.0, 10.0, 200)
START_NS = round(brakes.START.timestamp() * 1e6) * 1000


def written(path: Path, *groups: tuple[str, list[Signal]], version: str = "4.10") -> Path:
    """A log of these groups, by name."""
    with MDF(version=version) as file:
        file.header.start_time = brakes.START
        for name, signals in groups:
            file.append(signals, acq_name=name, common_timebase=True)
        return Path(file.save(path, overwrite=True))


def with_time(
    path: Path, time: Any, unit: str, *, start: datetime | None = brakes.START, a: float = 0.0
) -> Path:
    """A log of one channel whose times are these numbers; `a` is the factor of their conversion."""
    with MDF(version="4.10") as file:
        file.header.start_time = start or datetime(1980, 1, 1, tzinfo=UTC)
        file.append([Signal(V, T, name="v", unit="km/h")], common_timebase=True)
        group = file.groups[0]
        group.channels[0].unit = unit
        stream, kind = group.channels[0], "u" if time.dtype.kind == "u" else "f"
        stream.data_type = 0 if kind == "u" else 4
        if a:
            stream.conversion = from_dict({"a": a, "b": 0.0})
        file.save(path, overwrite=True)
    # The library writes floats as the time: the numbers are put in their places.
    raw, width = path.read_bytes(), T.dtype.itemsize
    records = np.rec.fromarrays([T, V]).tobytes()
    assert raw.count(records) == 1
    assert time.dtype.itemsize == width
    path.write_bytes(raw.replace(records, np.rec.fromarrays([time, V]).tobytes()))
    return path


def columns(path: Path, **options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """The columns by title, and the findings by code."""
    source = open_source(path, ReadOptions(**options))
    found = source.columns(source.fields)
    names = [f"{f.channel} ({f.group})" if f.group else f.channel for f in source.fields]
    return dict(zip(names, found, strict=True)), {f.code: f for f in source.findings}


def test_invalidation_bits_are_found_and_located(tmp_path: Path) -> None:
    bad = np.zeros(len(T), bool)
    bad[50:60] = True
    path = written(
        tmp_path / "a.mf4",
        ("", [Signal(T, T, name="p", unit="bar", invalidation_bits=bad),
              Signal(T, T, name="v", unit="km/h", invalidation_bits=~(T < 0))]),
    )  # fmt: skip
    found, _ = columns(path)
    assert np.array_equal(found["p"].valid, ~bad)
    assert not found["v"].valid.any()
    source = open_source(path, ReadOptions())
    source.columns(source.fields)
    one, every = (f for f in source.findings if f.code == "value-marked-invalid")
    assert (one.channel, one.count, one.severity) == ("p", 10, "warning")
    assert one.spans == ((1.0, 1.18),)
    assert (every.channel, every.severity) == ("v", "info")  # it was never measured


def test_values_that_stand_for_a_text_are_no_numbers(tmp_path: Path) -> None:
    raw = np.arange(len(T), dtype=np.uint16)
    raw[20:23] = 65535
    linear = {"a": 0.5, "b": -10.0}
    partly = {"val_0": 65535, "text_0": b"not available", "default_addr": linear}
    only = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"}
    path = written(
        tmp_path / "a.mf4",
        ("", [
            Signal(raw, T, name="speed", unit="km/h", conversion=linear),
            Signal(raw, T, name="speed2", unit="km/h", conversion=partly),
            Signal(raw % 2, T, name="state", conversion=only),
        ]),
    )  # fmt: skip
    found, findings = columns(path)
    assert set(found) == {"speed", "speed2"}
    assert np.array_equal(found["speed"].value, raw * 0.5 - 10.0)
    numbers = raw < 65535
    assert np.array_equal(found["speed2"].valid, numbers)
    assert np.array_equal(found["speed2"].value[numbers], (raw * 0.5 - 10.0)[numbers])
    assert (findings["value-is-text"].channel, findings["value-is-text"].count) == ("speed2", 3)
    assert findings["value-is-text"].spans == ((0.4, 0.44),)


def test_groups_of_one_name_are_the_axles_if_they_say_so(tmp_path: Path) -> None:
    def pair() -> list[Signal]:
        return [Signal(T, T, name="BC pressure", unit="bar"),
                Signal(70 - T, T, name="wheel speed", unit="km/h")]  # fmt: skip

    def axles(*names: str) -> list[tuple[str | None, int | None]]:
        path = written(tmp_path / "a.mf4", *((name, pair()) for name in names))
        meant, _ = needed(open_source(path, ReadOptions()), ())
        return [(m.meaning, m.axle) for m in meant]

    both = ["pressure", "wheel_speed"]
    assert axles("Axle 1", "Axle 2") == [(m, axle) for axle in (1, 2) for m in both]
    assert axles("CAN 1", "CAN 2") == [(m, None) for m in both]  # the second is reported


def test_groups_without_time_and_names_twice(tmp_path: Path) -> None:
    distance = Signal(T, T, name="track", unit="m", master_metadata=("s", 3))
    path = written(
        tmp_path / "a.mf4",
        ("slow", [Signal(T[::5], T[::5], name="p", unit="bar")]),
        ("fast", [Signal(T, T, name="p", unit="bar"), Signal(T, T, name="p", unit="bar")]),
        ("over distance", [distance]),
    )
    found, findings = columns(path)
    assert {name: len(c.t) for name, c in found.items()} == {
        "p (slow)": 40, "p (fast)": 200, "p (2) (fast)": 200
    }  # fmt: skip
    assert findings["group-not-read"].names["groups"] == "over distance"
    log = survey(open_source(path, ReadOptions()), (), Vehicle())
    assert {c.rate_hz for c in log.channels} == {10.0, 50.0}


def test_groups_without_a_start_beside_stamps_since_1970(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    with MDF(version="4.10") as file:
        for name, t in (("wheels", T), ("brake", T[::2] + START_NS / 1e9)):
            file.append([Signal(t, t, name=name)], acq_name=name, common_timebase=True)
        file.header.abs_time = 0
        file.save(path, overwrite=True)
    found, findings = columns(path)
    assert list(found) == ["brake"]
    assert findings["group-not-read"].names["groups"] == "wheels"
    assert "no start" in findings["group-not-read"].message
    assert open_source(path, ReadOptions()).rows == 100


def test_a_time_that_is_no_number_costs_its_row(tmp_path: Path) -> None:
    t = T.copy()
    t[100:103] = np.nan, np.inf, 1e300
    found, findings = columns(written(tmp_path / "a.mf4", ("", [Signal(T, t, name="p")])))
    assert len(found["p"].t) == len(T) - 3
    assert findings["time-unreadable"].count == 3


def test_a_hole_in_packed_data_is_refused(tmp_path: Path) -> None:
    path = brakes.mdf(tmp_path / "a.mf4", brakes.groups(), compression=1)
    raw = bytearray(path.read_bytes())
    at = raw.index(b"##DZ", raw.index(b"##DZ") + 4)
    raw[at + 100 : at + 200] = bytes(100)
    path.write_bytes(raw)
    with pytest.raises(UserError, match="damaged MDF file"):
        columns(path)


@not_on_windows("has no limit of memory")
def test_a_file_that_claims_too_many_rows_is_refused(tmp_path: Path) -> None:
    path = brakes.mdf(tmp_path / "a.mf4", brakes.groups())
    raw = bytearray(path.read_bytes())
    at = raw.index(b"##CG")
    links = int.from_bytes(raw[at + 16 : at + 24], "little")
    count = at + 24 + 8 * links + 8  # behind the record id
    assert int.from_bytes(raw[count : count + 8], "little") in (901, 1801, 361, 338)
    raw[count : count + 8] = (1 << 40).to_bytes(8, "little")
    path.write_bytes(raw)
    with pytest.raises(UserError, match=r"a\.mf4"):
        columns(path)


def test_a_library_that_crashes_is_one_error(tmp_path: Path) -> None:
    """The next log is read all the same."""
    path = brakes.mdf(tmp_path / "a.mf4", brakes.groups())
    source = open_source(path, ReadOptions())
    os.kill(isolated._children["mf4"].pid, signal.SIGTERM)
    with pytest.raises(UserError, match="crashes") as error:
        source.columns(source.fields)
    assert str(path) in error.value.text
    assert error.value.hint
    assert len(open_source(path, ReadOptions()).fields) == 17


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="asks Linux for the open files")
@pytest.mark.parametrize("is_damaged", [False, True])
def test_a_log_that_was_read_is_closed(tmp_path: Path, is_damaged: bool) -> None:
    """Windows replaces and removes no file that is open."""
    path = brakes.mdf(tmp_path / "a.mf4", brakes.groups(), compression=1)
    if is_damaged:
        raw = bytearray(path.read_bytes())
        packed = raw.index(b"##DZ", raw.index(b"##DZ") + 4)
        raw[packed + 100 : packed + 200] = bytes(100)
        path.write_bytes(raw)
    with suppress(UserError):
        columns(path)
    files = Path(f"/proc/{isolated._children['mf4'].pid}/fd").iterdir()
    assert path not in {file.readlink() for file in files}


def test_without_the_library_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = brakes.mdf(tmp_path / "a.mf4", brakes.groups())
    monkeypatch.setattr(isolated.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(UserError, match="asammdf") as error:
        open_source(path, ReadOptions())
    assert 'pip install "adhesion-cli[mf4]"' in error.value.hint


EPOCH_S = brakes.START.timestamp()


@pytest.mark.parametrize(
    ("time", "unit", "start", "first_ns"),
    [
        (T * 1e3, "ms", brakes.START, START_NS),
        (T * 1e6, "us", brakes.START, START_NS),
        (T * 1e9, "ns", brakes.START, START_NS),
        (T / 60.0, "min", brakes.START, START_NS),
        (T, "", brakes.START, START_NS),
        (T - 2.0, "s", brakes.START, START_NS - 2 * 10**9),
        (T + EPOCH_S, "s", brakes.START, START_NS),
        (T + EPOCH_S, "s", None, START_NS),  # without a start in the header
        ((T + EPOCH_S) * 1e3, "ms", brakes.START, START_NS),
        ((T + EPOCH_S) * 1e3, "", None, START_NS),  # no year has that many seconds
        ((T + EPOCH_S) * 1e6, "s", brakes.START, START_NS),
    ],
)
def test_the_unit_of_the_time_and_dates_count(
    tmp_path: Path, time: Any, unit: str, start: datetime | None, first_ns: int
) -> None:
    found, findings = columns(with_time(tmp_path / "a.mf4", time, unit, start=start))
    expected = first_ns + np.rint(T * 1e9).astype(np.int64)
    assert np.abs(found["v"].t - expected).max() < 1_000  # a date as a float is no better
    assert not findings


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6)])
def test_a_time_in_ms_that_says_s_is_refused_until_its_unit_is_stated(
    tmp_path: Path, unit: str, factor: float
) -> None:
    path = with_time(tmp_path / "a.mf4", T * factor, "s")
    with pytest.raises(UserError, match="says s, and has steps of more than 2 s") as error:
        columns(path)
    assert f"channels.time.unit={unit}`" in error.value.hint
    found, _ = columns(path, time_unit=unit)
    assert np.abs(found["v"].t - START_NS - np.rint(T * 1e9)).max() < 1_000
    found, _ = columns(path, time_unit="s")
    assert found["v"].t[-1] - START_NS == np.rint(T[-1] * factor * 1e9)


@pytest.mark.parametrize(("other_factor", "is_ms"), [(1.0, True), (1e3, False)])
def test_the_length_of_other_groups_shows_that_a_time_is_in_ms(
    tmp_path: Path, other_factor: float, is_ms: bool
) -> None:
    """A group of slow samples over the same time is one of seconds."""
    dense = np.arange(0.0, T[-1] * other_factor, 1.0 if other_factor > 1.0 else 0.02)
    with MDF(version="4.10") as file:
        file.start_time = brakes.START
        file.append([Signal(T, T * 1e3, name="v")], common_timebase=True)
        file.append([Signal(dense, dense, name="u")], common_timebase=True)
        path = Path(file.save(tmp_path / "a.mf4", overwrite=True))
    found, findings = columns(path)
    assert np.abs(found["v"].t - START_NS - np.rint(T * (1e9 if is_ms else 1e12))).max() < 1_000
    assert ("time-unit-guessed" in findings) == is_ms


@pytest.mark.parametrize("unit", ["Sek.", "sec", "[s]"])
def test_spellings_of_seconds(tmp_path: Path, unit: str) -> None:
    found, _ = columns(with_time(tmp_path / "a.mf4", T, unit))
    assert np.abs(found["v"].t - START_NS - np.rint(T * 1e9)).max() < 1_000


@pytest.mark.parametrize("factor", [1e-9, 1e-6])
def test_an_unsigned_time_that_began_below_zero(tmp_path: Path, factor: float) -> None:
    ticks = np.rint((T - 2.0) / factor).astype(np.int64).view(np.uint64)
    found, findings = columns(with_time(tmp_path / "a.mf4", ticks, "s", a=factor))
    assert np.array_equal(found["v"].t, START_NS + np.rint((T - 2.0) * 1e9).astype(np.int64))
    assert not findings


def test_a_time_that_is_no_time_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="their time is in 'm', which is no unit of time"):
        columns(with_time(tmp_path / "a.mf4", T, "m"))
