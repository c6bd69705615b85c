"""TDMS logs: times by properties and by channels, groups, and files that end early."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import brakes
from nptdms import ChannelObject, RootObject, TdmsWriter

from adhesion_cli.channels.log import needed
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

N = 300
START = np.datetime64("2026-11-21T13:05:07.250000")
NS = int(START.astype("datetime64[ns]").astype(np.int64))
BAR, KMH, SECONDS = ({"unit_string": unit} for unit in ("bar", "km/h", "s"))
WAVE = {"wf_start_time": START, "wf_increment": 0.02, "wf_start_offset": 0.5}
P, V = np.linspace(0, 3, N), np.linspace(72, 60, N)


def written(path: Path, *channels: tuple[str, str, Any, dict[str, Any]]) -> Path:
    with TdmsWriter(path) as file:
        file.write_segment([RootObject({}), *(ChannelObject(*c) for c in channels)])
    return path


def columns(path: Path, **options: Any) -> tuple[dict[str, Any], dict[str, Any], Any]:
    source = open_source(path, ReadOptions(**options))
    found = source.columns(source.fields)
    names = [f"{f.channel} ({f.group})" if f.group else f.channel for f in source.fields]
    return dict(zip(names, found, strict=True)), {f.code: f for f in source.findings}, source


def test_time_by_start_and_increment(tmp_path: Path) -> None:
    found, findings, source = columns(written(
        tmp_path / "a.tdms",
        ("fast", "p", P, BAR | WAVE), ("fast", "v", V, KMH | WAVE),
        ("fast", "late", V, KMH | WAVE | {"wf_start_time": START + np.timedelta64(1, "s")}),
    ))  # fmt: skip
    assert source.absolute
    assert found["p"].t is found["v"].t
    assert np.array_equal(found["p"].t, NS + 500_000_000 + np.arange(N) * 20_000_000)
    assert np.array_equal(found["late"].t, found["p"].t + 10**9)
    assert [f.unit for f in source.fields] == ["bar", "km/h", "km/h"]
    assert not findings


@pytest.mark.parametrize(
    ("time", "properties", "start"),
    [
        (np.arange(N) / 50, SECONDS, 0),
        (np.arange(N) * 20, {"unit_string": "ms"}, 0),
        (START + np.arange(N) * np.timedelta64(20, "ms"), {}, NS),
    ],
)
def test_time_by_a_channel(
    tmp_path: Path, time: Any, properties: dict[str, Any], start: int
) -> None:
    path = written(
        tmp_path / "a.tdms", ("g", "Time", time, properties), ("g", "p", P, BAR), ("g", "v", V, KMH)
    )
    found, findings, source = columns(path)
    assert set(found) == {"p", "v"}
    assert source.absolute is bool(start)
    assert found["p"].t is found["v"].t
    assert np.array_equal(found["p"].t, start + np.arange(N) * 20_000_000)
    assert not findings


def test_a_group_without_time_is_left_out(tmp_path: Path) -> None:
    groups = ("g", "p", P, BAR | WAVE), ("other", "x", V, {}), ("other", "y", P, {})
    found, findings, _ = columns(written(tmp_path / "a.tdms", *groups))
    assert set(found) == {"p"}
    assert findings["group-not-read"].names["groups"] == "other"
    with pytest.raises(UserError, match="no column is a time"):
        columns(written(tmp_path / "b.tdms", *groups[1:]))


def test_times_that_cannot_be_compared(tmp_path: Path) -> None:
    """One group counts from 1970, the other from its own start."""
    path = written(
        tmp_path / "a.tdms",
        ("clock", "p", P, BAR | WAVE), ("none", "v", V, KMH | {"wf_increment": 0.02}),
    )  # fmt: skip
    found, findings, _ = columns(path)
    assert set(found) == {"p"}
    assert findings["group-not-read"].names["groups"] == "none"


def test_groups_are_the_axles_if_they_say_so(tmp_path: Path) -> None:
    channels = [
        (f"Axle {k}", name, values, unit | WAVE)
        for k in (1, 2)
        for name, values, unit in (("p_cyl", P, BAR), ("wheel speed", V, KMH))
    ]
    source = open_source(written(tmp_path / "a.tdms", *channels), ReadOptions())
    meant, _ = needed(source, ())
    assert [(m.meaning, m.axle) for m in meant] == [
        (meaning, axle) for axle in (1, 2) for meaning in ("pressure", "wheel_speed")
    ]


def test_texts_and_nan_times(tmp_path: Path) -> None:
    time = np.arange(N) / 50
    time[20:25] = np.nan
    found, findings, source = columns(written(
        tmp_path / "a.tdms",
        ("g", "Time", time, SECONDS), ("g", "p", P, BAR), ("g", "note", ["x"] * N, {}),
    ))  # fmt: skip
    assert len(found["p"].t) == N - 5
    assert findings["time-unreadable"].count == 5
    assert source.reasons["not numeric"] == "note"


def test_a_segment_that_was_not_closed(tmp_path: Path) -> None:
    """As a logger leaves it that lost its power."""
    path = brakes.tdms(tmp_path / "a.tdms", brakes.groups(), segments=4)
    raw = bytearray(path.read_bytes())
    at = raw.rindex(b"TDSm")
    raw[at + 12 : at + 20] = b"\xff" * 8
    path.write_bytes(raw)
    found, findings, _ = columns(path)
    assert {len(c.t) for c in found.values()} == {1801, 901, 361, 338}
    assert findings["log-damaged"].severity == "error"
    assert findings["log-damaged"].values["kept_rows"] == 3401


def test_garbage_behind_whole_segments_is_refused(tmp_path: Path) -> None:
    path = brakes.tdms(tmp_path / "a.tdms", brakes.groups(), segments=4)
    raw = path.read_bytes()
    at = raw.rindex(b"TDSm")
    path.write_bytes(raw[:at] + bytes(4) + raw[at + 4 :])
    with pytest.raises(UserError, match="damaged TDMS file: Segment does not start"):
        columns(path)


@pytest.mark.parametrize("left", [10, 40])  # of the last segment: of its lead, of its metadata
def test_a_last_segment_without_data_is_reported(tmp_path: Path, left: int) -> None:
    path = brakes.tdms(tmp_path / "a.tdms", brakes.groups(), segments=4)
    path.write_bytes(path.read_bytes()[: path.read_bytes().rindex(b"TDSm") + left])
    path.with_name("a.tdms_index").write_bytes(b"no index of this file")
    found, findings, _ = columns(path)
    assert {len(c.t) for c in found.values()} == {n * 3 // 4 for n in (1801, 901, 361, 338)}
    assert "no segment begins there" in findings["log-damaged"].message


@pytest.mark.parametrize("share", [0.7, 0.8, 0.95])
@pytest.mark.parametrize("by_channel", [False, True])
def test_a_cut_file_is_read_as_far_as_each_channel_is_there(
    tmp_path: Path, share: float, by_channel: bool
) -> None:
    """LabVIEW writes one channel after the other: those behind the cut have fewer samples."""
    rows = {"p": P, "v": V, "w": V}
    time = ("g", "Time", np.arange(N) / 50, SECONDS)
    own = {} if by_channel else WAVE
    channels = [("g", name, values, (BAR if name == "p" else KMH) | own)
                for name, values in rows.items()]  # fmt: skip
    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as file:
        for _ in range(2):
            objects = [ChannelObject(*c) for c in [time] * by_channel + channels]
            file.write_segment([RootObject({}), *objects])
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    found, findings, source = columns(path)
    assert "log-damaged" in findings
    n = {name: len(c.t) for name, c in found.items()}
    assert n["p"] > n["w"] >= N
    assert source.rows >= max(n.values())
    assert findings["log-damaged"].values["kept_rows"] == source.rows
