"""TDMS logs: times by properties and by channels, groups, and files that end early."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import brakes
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from nptdms import tdms as library

from adhesion_cli.channels.log import needed
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats import tdms
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
        (np.datetime_as_string(START + np.arange(N) * np.timedelta64(20, "ms")).tolist(), {}, NS),
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


def pieces(path: Path, *segments: tuple[dict[str, Any], dict[str, Any]]) -> Path:
    """A log of one channel in segments: properties of the root, and of the channel, in each."""
    with TdmsWriter(path) as file:
        for root, own in segments:
            file.write_segment([RootObject(root), ChannelObject("g", "p", P, own)])
    return path


def later(seconds: float) -> dict[str, Any]:
    return WAVE | {"wf_start_time": START + np.timedelta64(round(seconds * 1e6), "us")}


@pytest.mark.parametrize("place", ["file", "group"])
@pytest.mark.parametrize("own", [{}, {"wf_increment": 0.04}])
def test_increment_and_start_of_the_group_or_the_file(
    tmp_path: Path, place: str, own: dict[str, Any]
) -> None:
    path, root = tmp_path / "a.tdms", RootObject(WAVE if place == "file" else {})
    with TdmsWriter(path) as file:
        group = GroupObject("g", WAVE if place == "group" else {})
        file.write_segment([root, group, ChannelObject("g", "p", P, BAR | own)])
    found, findings, _ = columns(path)
    step = round(own.get("wf_increment", 0.02) * 1e9)
    assert np.array_equal(found["p"].t, NS + 500_000_000 + np.arange(N) * step)
    assert not findings


@pytest.mark.parametrize("place", ["file", "channel"])
@pytest.mark.parametrize("pause", [0.0, 1.0, 90.0, -3.0])
def test_segments_with_starts_of_their_own(tmp_path: Path, place: str, pause: float) -> None:
    """A pause between recordings is in the times; where there is none, the clock runs on."""
    starts = [later(k * (N * 0.02 + pause) + 0.004 * (k % 2)) for k in range(3)]
    segments = [(x, BAR) if place == "file" else ({}, BAR | x) for x in starts]
    found, _, _ = columns(pieces(tmp_path / "a.tdms", *segments))
    t = (found["p"].t - NS - 500_000_000) / 1e9
    for k in range(3):
        jitter = 0.004 * (k % 2) if pause else 0.0  # less than half a sample is none of its own
        expected = k * (N * 0.02 + pause) + jitter + np.arange(N) * 0.02
        assert np.abs(t[k * N : (k + 1) * N] - expected).max() < 1e-6


@pytest.mark.parametrize(
    ("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("s", 1.0), ("", 1.0), ("min", 1 / 60)]
)
def test_the_unit_of_the_x_axis(tmp_path: Path, unit: str, factor: float) -> None:
    wave = {"wf_increment": 0.02 * factor, "wf_start_offset": 0.5 * factor, "wf_xunit_string": unit}
    found, _, _ = columns(written(tmp_path / "a.tdms", ("g", "p", P, BAR | WAVE | wave)))
    assert np.abs(found["p"].t - (NS + 500_000_000 + np.arange(N) * 20_000_000)).max() < 10


@pytest.mark.parametrize("unit", ["m", "Hz", "km", "rev"])
def test_an_x_axis_that_is_no_time_is_named(tmp_path: Path, unit: str) -> None:
    channels = ("g", "p", P, BAR | WAVE | {"wf_xunit_string": unit}), ("g", "v", V, KMH | WAVE)
    found, findings, _ = columns(written(tmp_path / "a.tdms", *channels))
    assert set(found) == {"v"}
    assert repr(unit) in findings["channel-not-read"].message
    assert (findings["channel-not-read"].channel, findings["channel-not-read"].severity) == (
        "p", "info"
    )  # fmt: skip


@pytest.mark.parametrize("name", ["Frequency", "Frequenz", "Order", "Weg"])
def test_the_name_of_an_x_axis_that_is_no_time_is_told(tmp_path: Path, name: str) -> None:
    spectrum = {"wf_increment": 0.5, "wf_start_offset": 0.0, "wf_xname": name}
    channels = ("g", "p", P, BAR | spectrum), ("g", "v", V, KMH | WAVE | {"wf_xname": "Zeit"})
    found, findings, _ = columns(written(tmp_path / "a.tdms", *channels))
    assert set(found) == {"v"}
    assert f"wf_xname = {name!r}" in findings["channel-not-read"].message


def test_channels_name_their_time_channel(tmp_path: Path) -> None:
    slow, fast = np.arange(N) / 10, np.arange(N) / 50
    path = written(
        tmp_path / "a.tdms",
        ("g", "time p", slow, SECONDS), ("g", "time v", fast * 1e3, {"unit_string": "ms"}),
        ("g", "p", P, BAR | {"xchannel": "time p"}), ("g", "v", V, KMH | {"xchannel": "time v"}),
    )  # fmt: skip
    found, findings, _ = columns(path)
    assert set(found) == {"p", "v"}
    assert np.allclose(found["p"].t, slow * 1e9)
    assert np.allclose(found["v"].t, fast * 1e9)
    assert not findings


def test_a_time_channel_holds_where_the_increment_is_a_default(tmp_path: Path) -> None:
    time, default = ("g", "Time", np.arange(N) / 50, SECONDS), {"wf_increment": 1.0}
    path = written(tmp_path / "a.tdms", time, ("g", "p", P, BAR | default))
    found, _, _ = columns(path)
    assert set(found) == {"p"}
    assert np.array_equal(found["p"].t, np.arange(N) * 20_000_000)
    path = written(tmp_path / "b.tdms", time, ("g", "p", P, BAR | {"wf_increment": 0.05}))
    with pytest.raises(UserError, match=r"'p' states wf_increment = 0.05 s, but .*'Time'") as error:
        columns(path)
    assert "channels.time.channel=Time" in error.value.hint
    found, _, _ = columns(path, time_channel="Time")
    assert np.array_equal(found["p"].t, np.arange(N) * 20_000_000)


def test_a_time_channel_beside_increments_shows_pauses_and_the_start(tmp_path: Path) -> None:
    t, wave = np.arange(N) / 50, {"wf_increment": 0.02}
    drifting = t * (1 + 1e-4) + 0.004 * np.sin(t)
    path = written(tmp_path / "a.tdms", ("g", "Time", drifting, SECONDS), ("g", "p", P, BAR | wave))
    assert np.array_equal(columns(path)[0]["p"].t, np.arange(N) * 20_000_000)
    paused = np.where(t < 3.0, t, t + 60.0)
    path = written(tmp_path / "b.tdms", ("g", "Time", paused, SECONDS), ("g", "p", P, BAR | wave))
    with pytest.raises(UserError, match="'Time' has a pause of 60 s") as error:
        columns(path)
    assert "channels.time.channel=Time" in error.value.hint
    stamps = START + np.arange(N) * np.timedelta64(20, "ms")
    path = written(tmp_path / "c.tdms", ("g", "Time", stamps, {}), ("g", "p", P, BAR | wave))
    found, _, source = columns(path)
    assert source.absolute
    assert np.array_equal(found["p"].t, NS + np.arange(N) * 20_000_000)


@pytest.mark.parametrize("increment", [0.02, 1.0])
@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("valve on time", np.arange(N) % 7 * 10.0, "ms"),
        ("sanding duration", np.minimum(np.arange(N) * 0.01, 2.0), "s"),
    ],
)
def test_a_duration_is_no_rival_of_the_increments(
    tmp_path: Path, name: str, value: Any, unit: str, increment: float
) -> None:
    wave = WAVE | {"wf_increment": increment}
    duration = ("g", name, value, {"unit_string": unit} | wave)
    found, findings, _ = columns(written(tmp_path / "a.tdms", ("g", "p", P, BAR | wave), duration))
    assert set(found) == {"p", name}
    assert np.allclose(np.diff(found["p"].t), increment * 1e9)
    assert not findings


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time since brake", np.arange(N) / 25),
        ("Laufzeit", np.full(N, 3.0)),
        ("trigger", np.array([START])),
    ],
)
def test_a_stated_increment_stands_against_what_is_no_rising_time(
    tmp_path: Path, name: str, value: Any
) -> None:
    path = written(tmp_path / "a.tdms", ("g", "p", P, BAR | WAVE), ("g", name, value, SECONDS))
    assert np.allclose(np.diff(columns(path)[0]["p"].t), 20_000_000)


def test_a_default_increment_gives_way_to_rising_seconds(tmp_path: Path) -> None:
    default, rising = {"wf_increment": 1.0}, ("g", "t_1", np.arange(N) / 50, SECONDS)
    path = written(tmp_path / "a.tdms", ("g", "p", P, BAR | default), rising)
    assert np.allclose(np.diff(columns(path)[0]["p"].t), 20_000_000)


LINEAR = {
    "NI_Number_Of_Scales": 1, "NI_Scaling_Status": "unscaled", "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 0.5, "NI_Scale[0]_Linear_Y_Intercept": 1.0,
}  # fmt: skip
RAW = np.arange(N, dtype=np.int16)


@pytest.mark.parametrize(
    ("scaling", "reason"),
    [
        (LINEAR | {"NI_Scale[0]_Scale_Type": "PieceWisePolynomial"}, "PieceWisePolynomial"),
        (LINEAR | {"NI_Scale[0]_Scale_Type": "Callback"}, "Callback"),
        ({"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear"}, "Linear lacks"),
        (LINEAR | {"NI_Scale[0]_Linear_Input_Source": 0}, "Linear lacks"),  # of itself
        ({"NI_Scaling_Status": "unscaled"}, "of its raw numbers is not known"),
        ({"Gain": 0.01}, "property 'Gain' may scale"),
        ({"scale_factor": 0.01}, "property 'scale_factor' may scale"),
    ],
)
def test_raw_numbers_of_an_unknown_scaling_are_no_pressure(
    tmp_path: Path, scaling: dict[str, Any], reason: str
) -> None:
    channels = ("g", "p", RAW, BAR | WAVE | scaling), ("g", "v", V, KMH | WAVE)
    found, findings, _ = columns(written(tmp_path / "a.tdms", *channels))
    assert set(found) == {"v"}
    assert reason in findings["channel-not-read"].message
    assert findings["channel-not-read"].severity == "warning"


@pytest.mark.parametrize(
    ("scaling", "factor"), [({}, 1.0), (LINEAR, 0.5), ({"NI_Scaling_Status": "scaled"}, 1.0)]
)
def test_a_known_scaling_is_applied(tmp_path: Path, scaling: dict[str, Any], factor: float) -> None:
    path = written(tmp_path / "a.tdms", ("g", "p", RAW, BAR | WAVE | scaling))
    found, findings, _ = columns(path)
    assert np.allclose(found["p"].value, RAW * factor + (1.0 if factor < 1.0 else 0.0))
    assert not findings


@pytest.mark.parametrize("changed", [{"unit_string": "mbar"}, {"NI_Scaling_Status": "unscaled"}])
def test_a_scaling_that_changes_is_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    path = pieces(tmp_path / "a.tdms", ({}, BAR | WAVE), ({}, BAR | WAVE | changed))
    with pytest.raises(UserError, match="its scaling or unit changes"):
        columns(path)


def test_an_increment_that_changes_is_refused(tmp_path: Path) -> None:
    path = pieces(tmp_path / "a.tdms", ({}, BAR | WAVE), ({}, BAR | WAVE | {"wf_increment": 0.04}))
    with pytest.raises(UserError, match="wf_increment changes inside the file"):
        columns(path)


def test_a_channel_without_time_beside_others_is_left_out(tmp_path: Path) -> None:
    channels = ("g", "p", P, BAR | WAVE), ("g", "x", V, {}), ("g", "y", P[::-1], {})
    found, findings, _ = columns(written(tmp_path / "a.tdms", *channels))
    assert set(found) == {"p"}
    assert findings["channel-not-read"].severity == "info"


def test_a_process_opens_any_number_of_files(tmp_path: Path) -> None:
    reader = library.TdmsReader
    tdms.Reader(written(tmp_path / "a.tdms", ("g", "p", P, BAR | WAVE)), ReadOptions())
    assert library.TdmsReader is reader


def test_digits_of_a_clock_are_a_time_of_day(tmp_path: Path) -> None:
    seconds = 50 + np.arange(N) / 10
    digits = seconds // 60 * 100 + seconds % 60
    path = written(tmp_path / "a.tdms", ("g", "time", digits, SECONDS), ("g", "v", V, KMH))
    found, findings, source = columns(path)
    np.testing.assert_allclose(found["v"].t / 1e9, seconds, atol=1e-6)
    assert set(findings) == {"time-digits"}
    assert "HHMMSS" in source.time_reason


@pytest.mark.parametrize(
    "stated",
    [{"wf_increment": "0,02"}, {"SampleRate": 50.0}, {"Sampling rate [kHz]": "0.05"}],
)
def test_the_increment_as_a_text_or_a_rate(tmp_path: Path, stated: dict[str, Any]) -> None:
    found, _, _ = columns(written(tmp_path / "a.tdms", ("g", "v", V, KMH | stated)))
    assert np.array_equal(found["v"].t, np.arange(N) * 20_000_000)
