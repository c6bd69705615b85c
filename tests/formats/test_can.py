"""CAN logs: signals as cantools decodes them, and what is wrong with frames, lines and files."""

import random
import struct
import zlib
from base64 import b64encode
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import can
import numpy as np
import pytest
from cantools.database import Database, Message, Signal
from cantools.database.conversion import BaseConversion

from adhesion_cli.analysis.settings import load
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

START = 1_795_266_307.25
NS = 1_795_266_307_250_000_000
HEAD = (
    "date Sat Nov 21 13:05:07.250 2026\nbase hex  timestamps absolute\nno internal events logged\n"
)


def signal(name: str, start: int, length: int, order: str = "little_endian", **more: Any) -> Signal:
    kept = {k: more.pop(k) for k in ("scale", "offset", "choices", "is_float") if k in more}
    return Signal(name, start, length, order, conversion=BaseConversion.factory(**kept), **more)


SPEED = signal("speed", 0, 16, scale=0.01, unit="km/h", choices={65535: "SNA", 0: "standstill"})
PRESSURE = signal("pressure", 23, 16, "big_endian", scale=0.001, offset=-1, unit="bar")
BRAKE = Message(0x123, "Brake", 5, [SPEED, PRESSURE])


def stated(folder: Path, *messages: Message) -> tuple[str, ...]:
    path = folder / "vehicle.dbc"
    path.write_text(Database(list(messages) or [BRAKE], version="").as_dbc_string(), "utf-8")
    return (str(path),)


def written(path: Path, frames: list[can.Message]) -> Path:
    with can.Logger(path) as log:
        for frame in frames:
            log(frame)
    return path


def frame(t: float, data: bytes, identifier: int = 0x123, **more: Any) -> can.Message:
    more = {"channel": 0, "is_extended_id": False} | more
    return can.Message(START + t, identifier, data=data, **more)


def columns(path: Path, dbc: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any], Any]:
    source = open_source(path, ReadOptions(dbc=dbc))
    found = source.columns(source.fields)
    names = [f"{f.channel} ({f.group})" if f.group else f.channel for f in source.fields]
    return dict(zip(names, found, strict=True)), {f.code: f for f in source.findings}, source


def test_signals_are_as_cantools_decodes_them(tmp_path: Path) -> None:
    """Of any length, order of bytes and sign, and floats."""
    r = random.Random(7)
    messages = []
    for k in range(60):
        order = r.choice(("little_endian", "big_endian"))
        is_float = k % 5 == 0
        length = r.choice((32, 64)) if is_float else r.randint(1, 64)
        first = r.randrange(0, 64 - length + 1)
        start = first if order == "little_endian" else 8 * (first // 8) + 7 - first % 8
        conversion = {"scale": r.choice((1, 0.5, -0.125)), "offset": r.choice((0, -40))}
        signed = not is_float and bool(r.randrange(2))
        one = signal(
            f"s{k}", start, length, order, is_signed=signed, is_float=is_float, **conversion
        )
        messages.append(Message(0x200 + k, f"M{k}", 8, [one], strict=True))
    data = [r.randbytes(8) for _ in range(20)]
    frames = [frame(i / 100, x, m.frame_id) for i, x in enumerate(data) for m in messages]
    found, findings, _ = columns(written(tmp_path / "a.blf", frames), stated(tmp_path, *messages))
    for message in messages:
        name = message.signals[0].name
        expected = [float(message.decode(x, decode_choices=False)[name]) for x in data]
        value = found[name].value  # to the last bit: beyond 2⁵³ an integer is no float
        assert np.allclose(value, expected, rtol=1e-15, atol=0.0, equal_nan=True), name
    assert not findings


def test_a_float_of_another_length_has_no_value(tmp_path: Path) -> None:
    message = Message(0x123, "M", 4, [signal("odd", 0, 24), signal("whole", 24, 8)])
    dbc = stated(tmp_path, message)
    with Path(dbc[0]).open("a", encoding="utf-8") as file:
        file.write("SIG_VALTYPE_ 291 odd : 1;\n")
    frames = [frame(k / 10, bytes((1, 2, 3, k))) for k in range(10)]
    found, _, _ = columns(written(tmp_path / "a.blf", frames), dbc)
    assert np.isnan(found["odd"].value).all()
    assert found["whole"].value.tolist() == list(range(10))


def test_multiplexed_signals_are_read_where_they_are_selected(tmp_path: Path) -> None:
    mux = signal("mux", 0, 8, is_multiplexer=True)
    own = [signal(f"v{k}", 8, 16, multiplexer_ids=[k], multiplexer_signal="mux") for k in (1, 2)]
    message = Message(0x123, "M", 4, [mux, *own, signal("a", 24, 8)], strict=False)
    frames = [frame(k / 10, bytes((1 + k % 2, k, 0, 9))) for k in range(10)]
    found, _, _ = columns(written(tmp_path / "a.blf", frames), stated(tmp_path, message))
    assert found["v1"].value.tolist() == [0, 2, 4, 6, 8]
    assert found["v2"].value.tolist() == [1, 3, 5, 7, 9]
    assert np.array_equal(found["v2"].t - found["mux"].t[0], np.arange(1, 10, 2) * 10**8)
    assert found["mux"].t is found["a"].t


def test_values_that_are_none_and_frames_that_are_short(tmp_path: Path) -> None:
    raw = [7200, 65535, 0, 7100]
    frames = [frame(k / 10, struct.pack("<H", x) + b"\x10\x68\0") for k, x in enumerate(raw)]
    frames.append(frame(0.4, struct.pack("<H", 7000)))
    found, findings, source = columns(written(tmp_path / "a.blf", frames), stated(tmp_path))
    assert [f.unit for f in source.fields] == ["km/h", "bar"]
    assert np.allclose(found["speed"].value[found["speed"].valid], [72, 0, 71, 70])
    assert np.allclose(found["pressure"].value[:4], 3.2)
    assert found["pressure"].valid.tolist() == [True] * 4 + [False]
    assert (findings["value-is-text"].channel, findings["value-is-text"].count) == ("speed", 1)
    assert findings["value-is-text"].spans == ((0.1, 0.1),)
    assert (findings["value-missing"].channel, findings["value-missing"].count) == ("pressure", 1)


@pytest.mark.parametrize("suffix", ["blf", "asc"])
def test_error_frames_and_unknown_frames(tmp_path: Path, suffix: str) -> None:
    frames = [frame(k / 10, bytes(5)) for k in range(20)]
    frames[5:5] = [frame(0.45, b"", is_error_frame=True)] * 2
    frames += [frame(2.0, b"\1", 0x7FF), frame(2.0, b"", is_remote_frame=True)]
    found, findings, source = columns(written(tmp_path / f"a.{suffix}", frames), stated(tmp_path))
    assert source.absolute
    assert found["speed"].t[0] == NS
    assert len(found["speed"].t) == 20
    errors, unknown = findings["can-error-frames"], findings["can-unknown-frames"]
    assert (errors.count, errors.spans, errors.severity) == (2, ((0.45, 0.45),), "warning")
    assert (unknown.count, unknown.names["ids"], unknown.severity) == (1, "0x7FF", "info")


def test_two_buses(tmp_path: Path) -> None:
    frames = [frame(k / 10, bytes(5), channel=k % 2) for k in range(20)]
    found, _, _ = columns(written(tmp_path / "a.blf", frames), stated(tmp_path))
    assert {name: len(c.t) for name, c in found.items()} == {
        f"{name} (Brake, CAN {bus})": 10 for bus in (1, 2) for name in ("speed", "pressure")
    }


def test_lines_that_cannot_be_read_cost_only_themselves(tmp_path: Path) -> None:
    lines = [f" {k / 10:.6f} 1  123  Rx   d 5 20 1C 10 68 0{k % 10}" for k in range(20)]
    lines[3] = lines[3][:-6] + "xx yy"
    lines[7] = lines[7][:25]  # fewer bytes than it states
    lines[9] = " 0.900000 1  123  Rx   d 5 20 \0\0\0\0"
    lines[11:11] = ["// a comment", " 1.050000 1 Statistic: D 0 R 0", "", " 1.05 log trigger event"]
    path = tmp_path / "a.asc"
    path.write_text(HEAD + "\n".join(lines) + "\n 2.000000 1  123  Rx   d 5 20 1C 1", "utf-8")
    found, findings, source = columns(path, stated(tmp_path))
    t = (found["speed"].t - NS) // 10**8
    assert t.tolist() == [k for k in range(20) if k not in (3, 7, 9)]
    assert (findings["can-lines-skipped"].count, source.rows) == (4, 17)
    assert "log-damaged" not in findings  # a log without a trigger block has no end mark
    assert findings["can-lines-skipped"].values["line"] == 7


def test_times_of_a_second_block_that_begin_anew_follow_its_date(tmp_path: Path) -> None:
    begin = "Begin Triggerblock Tue Nov 24 10:{:02d}:00.000 am 2026\n"
    block = "".join(f" {k / 10:.6f} 1  123  Rx   d 5 20 1C 10 68 00\n" for k in range(20))
    head, path = "base hex  timestamps absolute\n", tmp_path / "a.asc"
    end = "End TriggerBlock\n"
    path.write_text(head + begin.format(15) + block + end + begin.format(16) + block + end)
    found, findings, _ = columns(path, stated(tmp_path))
    t = np.arange(20) * 10**8
    assert (found["speed"].t - found["speed"].t[0]).tolist() == [*t, *(t + 60 * 10**9)]
    assert not findings
    path.write_text(path.read_text(), "utf-16")  # as PowerShell copies a text
    assert (columns(path, stated(tmp_path))[0]["speed"].t == found["speed"].t).all()


@pytest.mark.parametrize("name", ["StatusBCU1", "ChipTemp", "Overload_1", "Statistics", "J1939_1"])
def test_messages_with_names_like_events(tmp_path: Path, name: str) -> None:
    lines = [f" {k / 10:.6f} 1  {name}  Rx   d 5 20 1C 10 68 00" for k in range(20)]
    lines[5:5] = [
        " 0.450000 1 Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
        " 0.460000 1 OverloadFrame",
        " 0.470000 1 J1939TP FEE3p 6 0 0 - Rx d 8 20 1C 10 68 00 00 00 00",
    ]
    path = tmp_path / "a.asc"
    path.write_text(HEAD + "\n".join(lines) + "\n", "utf-8")
    found, findings, _ = columns(path, stated(tmp_path, Message(0x123, name, 5, [SPEED])))
    assert len(found["speed"].t) == 20
    assert not findings


def test_what_is_refused(tmp_path: Path) -> None:
    dbc = stated(tmp_path)
    asc = tmp_path / "a.asc"
    line = " 0.000000 1  123  Rx   d 5 20 1C 10 68 00\n"
    asc.write_text(HEAD + line.replace("123", "321"), "utf-8")
    with pytest.raises(UserError, match="0x321"):
        columns(asc, dbc)
    asc.write_text(HEAD + line, "utf-8")
    with pytest.raises(UserError, match="DBC") as error:
        columns(asc, ())
    assert "--dbc" in error.value.hint
    with pytest.raises(UserError, match=r"no DBC file: .*Invalid syntax at line 1"):
        columns(asc, (str(asc),))
    with pytest.raises(UserError, match="No such file"):
        columns(asc, (str(tmp_path / "missing.dbc"),))
    other = tmp_path / "other"
    other.mkdir()
    changed = stated(other, Message(0x123, "Other", 5, [signal("x", 0, 8)]))
    with pytest.raises(UserError, match="0x123"):
        columns(asc, dbc + changed)
    trc = tmp_path / "a.trc"
    trc.write_text(";$FILEVERSION=1.2\n;$STARTTIME=46347.5\n 1) 0.0 1 Rx 0123 5 20 1C 10 68 00\n")
    with pytest.raises(UserError, match=r"1\.2"):
        columns(trc, dbc)


def test_error_lines_of_a_trc_log(tmp_path: Path) -> None:
    path = written(tmp_path / "a.trc", [frame(k / 10, bytes(5)) for k in range(20)])
    text = path.read_text().splitlines(keepends=True)
    text[-5:-5] = ["   99      1480.000 ER  1       -  Rx -  5    04 00 02 00 00\n"]
    text[-2] = text[-2][:30] + "\n"
    path.write_text("".join(text))
    found, findings, _ = columns(path, stated(tmp_path))
    assert len(found["speed"].t) == 19
    assert findings["can-error-frames"].spans == ((1.48, 1.48),)
    assert findings["can-lines-skipped"].count == 1


@pytest.mark.parametrize("name", ["1_0.trc", "1_1.trc", "1_3.trc", "2_1.trc"])
def test_bytes_that_read_like_a_state_are_data(tmp_path: Path, name: str) -> None:
    """`EC` is a state of TRC 2, and `Warng` one of TRC 1, at their place only."""
    head, row = ROWS[name]
    lines = [row.format(n=n, ms=100.0 * n, data=f"{n:02X} EC EC 68 00") for n in range(230, 240)]
    if name in ("1_1.trc", "1_3.trc"):
        state = row.replace("Rx", "Warng").replace("0123", "FFFFFFFF")
        lines.insert(4, state.format(n=1, ms=23_350.0, data="00 00 00 00 08 BUSHEAVY"))
    path = tmp_path / name
    path.write_text(head + "\n".join(lines) + "\n", "latin-1")
    found, findings, _ = columns(path, stated(tmp_path))
    assert len(found["speed"].t) == 10
    assert not findings


def test_a_last_line_that_is_cut_off_in_a_trc_log_is_skipped(tmp_path: Path) -> None:
    """Up to its line end, of one byte or two: a frame without it may lack a digit."""
    path = written(tmp_path / "a.trc", [frame(k / 10, bytes(5)) for k in range(20)])
    raw, dbc = path.read_bytes(), stated(tmp_path)
    body = raw.rstrip(b"\r\n")
    assert raw[len(body) :] == b"\r\n"
    begin, end_of_body = body.rfind(b"\n") + 1, len(body)
    for end in [*range(begin, end_of_body, 7), *range(end_of_body - 2, len(raw) + 1)]:
        path.write_bytes(raw[:end])
        found, findings, _ = columns(path, dbc)
        assert len(found["speed"].t) == (20 if end > len(body) else 19)
        ends = raw[:end].endswith((b"\r", b"\n"))  # nothing tells it from a shorter log
        assert ("can-lines-skipped" in findings) != ends


def blf(path: Path) -> list[int]:
    """A BLF log of several containers; where each begins."""
    with can.BLFWriter(path) as log:
        log.max_container_size = 2_000
        for k in range(400):
            log.on_message_received(frame(k / 10, bytes(5)))
    raw, at, found = path.read_bytes(), 144, []
    while at < len(raw):
        found.append(at)
        length = struct.unpack_from("<L", raw, at + 8)[0]
        at += length + length % 4
    return found


@pytest.mark.parametrize("damage", ["cut", "hole", "bomb"])
def test_a_damaged_blf_keeps_the_frames_before_the_damage(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "a.blf"
    places = blf(path)
    whole, _, _ = columns(path, stated(tmp_path))
    assert len(whole["speed"].t) == 400
    raw, at = bytearray(path.read_bytes()), places[5]
    if damage == "cut":
        del raw[at + 60 :]
    elif damage == "hole":
        raw[at + 50 : at + 60] = bytes(10)
    else:
        packed = zlib.compress(bytes(200 << 20))
        base = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
        raw[at:] = base + struct.pack("<H6xL4x", 2, 200 << 20) + packed
    path.write_bytes(raw)
    found, findings, _ = columns(path, stated(tmp_path))
    n = len(found["speed"].t)
    assert 150 < n < 300
    assert np.array_equal(found["speed"].t, whole["speed"].t[:n])
    assert findings["log-damaged"].values["kept_rows"] == n
    with pytest.raises(UserError, match="byte"):
        open_source(path, ReadOptions(strict=True, dbc=stated(tmp_path)))


def test_losses_that_the_logger_notes(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    blf(path)
    lost = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 40, 125, 2, 0, 0, 5 * 10**9) + bytes(8)
    packed = zlib.compress(lost)
    base = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
    with path.open("ab") as file:
        file.write(base + struct.pack("<H6xL4x", 2, len(lost)) + packed)
    _, findings, _ = columns(path, stated(tmp_path))
    assert findings["can-frames-lost"].spans == ((5.0, 5.0),)


def test_dbc_on_the_command_line_and_in_a_file(
    tmp_path: Path, run: Callable[..., CompletedProcess[str]]
) -> None:
    data = [struct.pack("<H", 7200 - k) + b"\x10\x68\0" for k in range(50)]
    written(tmp_path / "a.blf", [frame(k / 10, x) for k, x in enumerate(data)])
    stated(tmp_path)
    (tmp_path / "can.toml").write_text('[can]\ndbc = ["vehicle.dbc"]\n')
    assert run("convert", "a.blf", "b.csv", "--dbc", "vehicle.dbc").returncode == 0
    assert run("convert", "a.blf", "c.csv", "-c", "can.toml").returncode == 0
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()
    assert '"speed [km/h]","pressure [bar]"' in (tmp_path / "b.csv").read_text("utf-8")
    refused = run("convert", "a.blf", "d.csv")
    assert refused.returncode == 1
    assert "--dbc" in refused.stderr


@pytest.mark.parametrize("value", ["3", '"vehicle.dbc"', "[1]"])
def test_the_setting_is_a_list_of_texts(value: str) -> None:
    with pytest.raises(UserError, match=r"can\.dbc") as error:
        load(assignments=[f"can.dbc = {value}"], folder=False)
    assert "brake.dbc" in error.value.hint


# One frame of each text form, of bus 1: identifier 0x123, its name, data. Times are k / 10 s.
ASC_HEAD = HEAD.replace("no internal", "internal")
ROWS: dict[str, tuple[str, str]] = {  # head, and a line at t
    "negative.asc": (HEAD, "{t:.6f} 1  123  Rx   d 5 {data}"),
    "comma.asc": (HEAD, "{comma} 1  123  Rx   d 5 {data}"),
    "headless.asc": ("", "{t:.6f} 1  123  Rx   d 5 {data}"),
    "symbolic.asc": (HEAD, "{t:.6f} 1  Brake  Rx   d 5 {data}"),
    "mixed.asc": (ASC_HEAD, "{t:.6f} 1  Bremse  Rx   d 5 {data}  Length = 226 ID = 291"),
    "decimal.asc": (HEAD.replace("hex", "dec"), "{t:.6f} 1  291  Rx   d 5 {decimal}"),
    "latin.asc": (HEAD + "// Prüfzug München\n", "{t:.6f} 1  123  Tx   d 5 {data}"),
    "fd.asc": (HEAD, "{t:.6f} CANFD   1 Rx        123  Brake  1 0 5  5 {data}   130 120 303000"),
    "named_fd.asc": (HEAD, "{t:.6f} CANFD   1 Rx      Brake  0 0 5  5 {data}   130 120 303000"),
    "candump.log": ("", "({epoch:.6f}) can0 123#{packed}"),
    "fd.log": ("", "({epoch:.6f}) vcan1 123##1{packed}"),
    "screen.txt": ("", " ({epoch:.6f})  can0  123   [5]  {data}"),
    "direction.txt": ("", " ({epoch:.6f})  can0  RX - -  123   [5]  {data}   '..h..'"),
    "dated.txt": ("", " ({date})  can0  123   [5]  {data}"),
    "zero.txt": ("", " ({zero:010.6f})  can0  123   [5]  {data}"),
    "king.txt": (
        "Chn Identifier Flg   DLC  D0...1...2...3...4...5...6..D7       Time     Dir\n",
        " 0    00000123         5  {data}  {zero:14.6f} R",
    ),
    "hacker.trc": ("Time ID DLC Data Comment\n", "{short}    123      5     {data} "),
    "1_0.trc": (";$FILEVERSION=1.0\n", "{n:6d})  {ms:.1f}  0123  5  {data}"),
    "1_1.trc": (";$FILEVERSION=1.1\n;$STARTTIME=46347.5\n", "{n}) {ms:.1f}  Rx  0123  5  {data}"),
    "1_3.trc": (";$FILEVERSION=1.3\n", "{n:6d}) {ms:.3f} 1  Rx  0123 -  5    {data}"),
    "2_1.trc": (
        ";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n",
        "{n:6d} {ms:.3f} DT 1 0123 Rx - 5 {data}",
    ),
    "savvycan.csv": (
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5\n",
        "{us},00000123,false,Rx,0,5,{commas},",
    ),
    "python_can.csv": (
        "timestamp,arbitration_id,extended,remote,error,dlc,data\n",
        "{epoch:.6f},0x123,0,0,0,5,{base64}",
    ),
    "kvaser.csv": ("Time,Channel,ID,DLC,D0,D1,D2,D3,D4,Flags\n", "{t:.6f},1,291,5,{decimals},"),
    "pcan.csv": ("PCAN\nTime (ms);Type;ID (hex);Length;Data (hex)\n", "{ms:.1f};Rx;123;5;{data}"),
    "under.csv": ("Time_ms;can_id;dlc;data\n", "{ms:.0f};0x123;5;{data}"),
    "dated.csv": ("timestamp;ID;DLC;data\n", "{date};123;5;{data}"),
    "canedge.csv": ("TimestampEpoch;ID;IDE;DLC;DataBytes\n", "{epoch:.6f};123;0;5;{packed}"),
    "busmaster.log": (
        "***BUSMASTER Ver 3.2.2***\n***START DATE AND TIME 21:11:2026 13:05:07:250***\n***HEX***\n"
        "***SYSTEM MODE***\n***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***\n",
        "13:05:{bus} Rx 1 0x123 s 5 {data} ",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("Time [s],ID,DLC,D0,D1\n0.001,100,2,12,34\n0.01,100,2,99,100\n", "decimal or hexadecimal"),
        ("Time,ID,DLC,Data\n1000,123,2,05 06\n2000,123,2,15 16\n", "unit of the times"),
    ],
)
def test_a_table_of_frames_that_has_two_meanings_is_refused(
    text: str, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "frames.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=reason):
        columns(path, stated(tmp_path))


def test_base64_as_long_as_hexadecimal_bytes_is_no_hexadecimal(tmp_path: Path) -> None:
    path = tmp_path / "frames.csv"
    head = "timestamp,arbitration_id,extended,remote,error,dlc,data"
    rows = [
        f"{k / 10},0x123,0,0,0,5,{b64encode(bytes([k, 0, 16, 104, 0])).decode()}" for k in range(9)
    ]
    rows += ["1.0,0x124,0,0,0,4,ASNF/w=="]
    path.write_text("\n".join([head, *rows, ""]))
    found, findings, _ = columns(path, stated(tmp_path))
    assert np.allclose(found["speed"].value, np.arange(9) / 100)
    assert np.allclose(np.diff(found["speed"].t), 1e8)
    assert {*findings} == {"can-unknown-frames"}  # and none was left out


@pytest.mark.parametrize("name", ROWS)
def test_text_logs_of_every_form(tmp_path: Path, name: str) -> None:
    head, row = ROWS[name]
    first, lines, speeds = (-5 if name == "negative.asc" else 0), [], []
    for n, k in enumerate(range(first, 20)):
        t, speed = k / 10, 7200 - 11 * n
        data = struct.pack("<H", speed) + b"\x10\x68\0"
        seconds = datetime.fromtimestamp(START + t, UTC)
        cells = {
            "t": t, "comma": f"{t:.6f}".replace(".", ","), "short": f"{t:.3f}".replace(".", ","),
            "epoch": START + t, "zero": t, "ms": 1e3 * t, "n": n + 1,
            "date": f"{seconds:%Y-%m-%d %H:%M:%S.%f}", "bus": f"{seconds:%S:%f}"[:7],
            "data": data.hex(" ").upper(), "packed": data.hex().upper(),
            "decimal": " ".join(map(str, data)), "decimals": ",".join(map(str, data)),
            "us": round(1e6 * t), "commas": data.hex(",").upper(),
            "base64": b64encode(data).decode(),
        }  # fmt: skip
        lines.append(row.format(**cells))
        speeds.append(speed / 100)
    path = tmp_path / name
    path.write_text(head + "\n".join(lines) + "\n", "latin-1")
    found, findings, source = columns(path, stated(tmp_path))
    assert source.format == "can"
    assert np.allclose(found["speed"].value, speeds)
    origin = NS if source.absolute and name != "1_1.trc" else int(found["speed"].t[-first])
    assert np.array_equal(found["speed"].t - origin, np.arange(first, 20) * 100_000_000)
    assert source.absolute == (name.endswith((".asc", ".log")) or name in ("1_1.trc", *DATED)) - (
        name == "headless.asc"
    )
    assert not findings


def test_a_start_of_busmaster_with_numbers_of_one_digit(tmp_path: Path) -> None:
    lines = [f"7:04:0{k}:2500 Rx 1 0x123 s 5 20 1C 10 68 00" for k in range(8)]
    path = tmp_path / "a.log"
    head = ROWS["busmaster.log"][0].replace("21:11:2026 13:05:07:250", "6:6:2026 7:4:0:250")
    path.write_text(head + "\n".join(lines) + "\n", "utf-8")
    found, findings, source = columns(path, stated(tmp_path))
    assert source.absolute
    assert datetime.fromtimestamp(found["speed"].t[0] / 1e9, UTC) == datetime(
        2026, 6, 6, 7, 4, 0, 250_000, UTC
    )
    assert not findings


DATED = ("screen.txt", "direction.txt", "dated.txt", "dated.csv", "python_can.csv", "canedge.csv")


def test_a_table_of_frames_with_a_time_of_day(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    clocks = [f"23:59:{58 + k // 10}.{k % 10}00" for k in range(20)]
    clocks += [f"00:00:0{k // 10},{k % 10}00" for k in range(20)]
    rows = "".join(f"{clock};Rx;123;5;20 1C 10 68 00\n" for clock in clocks)
    path.write_text("Uhrzeit;Dir;ID;DLC;Daten\n" + rows)
    found, findings, source = columns(path, stated(tmp_path))
    assert np.allclose(np.diff(found["speed"].t), 1e8)
    assert not source.absolute
    assert not findings


def test_a_table_of_frames_needs_a_dbc_and_a_unit_of_its_times(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Zeit;ID;DLC;Daten\n" + "".join(f"{k},5;123;2;{k} 00\n" for k in range(10, 50)))
    with pytest.raises(UserError, match="holds frames"):
        columns(path, ())
    with pytest.raises(UserError, match="the unit of the times is not stated"):
        columns(path, stated(tmp_path))


def test_a_line_without_a_frame_in_candump_is_counted(tmp_path: Path) -> None:
    lines = [f"({START + k / 10:.6f}) can0 123#201C106800" for k in range(20)]
    lines[3] = lines[3][:-1]
    lines[5:5] = [f"({START + 0.45:.6f}) can0 20000080#0000000000000000", "noise"]
    path = tmp_path / "a.log"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    found, findings, _ = columns(path, stated(tmp_path))
    assert len(found["speed"].t) == 19
    assert findings["can-lines-skipped"].count == 2
    assert findings["can-error-frames"].count == 1


def test_candump_without_times(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("  can0  123   [5]  20 1C 10 68 00\n" * 60)
    with pytest.raises(UserError, match="without time stamps"):
        columns(path, stated(tmp_path))


RELATIVE = HEAD.replace("absolute", "relative")


@pytest.mark.parametrize(
    ("head", "row"),
    [
        (RELATIVE, "{delta:.6f} 1  123  Rx   d 5 20 1C 10 68 00\n"),
        ("", " ({delta:010.6f})  can0  123   [5]  20 1C 10 68 00\n"),
    ],
    ids=["ASC", "candump"],
)
def test_times_that_count_from_the_line_before_are_added(
    tmp_path: Path, head: str, row: str
) -> None:
    """An event between two frames has its share of the time."""
    path = tmp_path / "a.asc"
    deltas = [0.0, *(0.02 + k % 3 / 1e4 for k in range(1_200))]
    lines = [row.format(delta=delta) for delta in deltas]
    if head:
        lines[7] = f"0.005 Start of measurement\n{row.format(delta=deltas[7] - 0.005)}"
    path.write_text(head + "".join(lines))
    found, findings, source = columns(path, stated(tmp_path))
    t = found["speed"].t
    assert np.allclose((t - t[0]) / 1e9, np.cumsum(deltas), atol=1e-6)
    assert "time steps" in source.time_reason
    assert not findings


def test_steps_that_are_coarse_or_begin_anew_are_refused(tmp_path: Path) -> None:
    path, row = tmp_path / "a.asc", "{delta} 1  123  Rx   d 5 20 1C 10 68 00\n"
    coarse = "".join(row.format(delta=f"{0.02 + k % 3 / 1e4:.4f}") for k in range(60))
    fine = "".join(row.format(delta=f"{0.02 + k % 3 / 1e4:.6f}") for k in range(60))
    block = "Begin Triggerblock Sat Nov 21 13:{minute}:07.250 2026\n"
    blocks = [f"{block.format(minute=m)}{fine}End TriggerBlock\n" for m in ("05", "08")]
    for text in (coarse, "".join(blocks)):
        path.write_text(RELATIVE + text)
        with pytest.raises(UserError, match="relative to the frame before"):
            columns(path, stated(tmp_path))


def test_frames_of_two_buses_out_of_order_are_no_steps(tmp_path: Path) -> None:
    """And a head that says relative counts from the start where its times grow."""
    path, row = tmp_path / "a.asc", "{t:.6f} {bus}  123  Rx   d 5 20 1C 10 68 00\n"
    for head, apart in ((HEAD, 0.03), (RELATIVE, 0.03), (HEAD, 100.0)):
        times = [(k / 50 + apart * (k % 2), 1 + k % 2) for k in range(200)]
        path.write_text(head + "".join(row.format(t=t, bus=bus) for t, bus in times))
        source = open_source(path, ReadOptions(dbc=stated(tmp_path)))
        spans = [np.ptp(column.t) / 1e9 for column in source.columns(source.fields)]
        assert np.allclose(spans, 198 / 50)


MARKERS = [b"", b"x", b"ab", b"abc", b"text with LOBJ inside", b"\xfc" * 101]


@pytest.mark.parametrize("text", MARKERS)
@pytest.mark.parametrize("padding", [0, 1, 3, 4])
@pytest.mark.parametrize("is_outside", [False, True])
def test_a_marker_of_the_user_costs_no_frame(
    tmp_path: Path, text: bytes, padding: int, is_outside: bool
) -> None:
    """Of any length, padded as one likes, among the frames or between two containers."""
    path = tmp_path / "a.blf"
    places = blf(path)
    whole, _, _ = columns(path, stated(tmp_path))
    body = struct.pack("<LLL3xBLLL12x", 0, 0xFFFFFF, 0xFF3300, 0, 5, len(text), 0) + b"Mark " + text
    marker = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 32 + len(body), 96, 2, 0, 0, 10**9) + body
    marker += bytes(padding)
    raw, at = path.read_bytes(), places[3]
    if not is_outside:
        packed = zlib.compress(marker)
        base = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
        at, marker = places[0], base + struct.pack("<H6xL4x", 2, len(marker)) + packed
    path.write_bytes(raw[:at] + marker + raw[at:])
    found, findings, _ = columns(path, stated(tmp_path))
    assert np.array_equal(found["speed"].t, whole["speed"].t)
    assert not findings


@pytest.mark.parametrize("length", [3, 20, 33, 70])
def test_an_object_with_a_wrong_length_costs_itself(tmp_path: Path, length: int) -> None:
    frames = [frame(k / 10, bytes(5)) for k in range(400)]
    path = written(tmp_path / "a.blf", frames)
    raw = path.read_bytes()
    size = struct.unpack_from("<L", raw, 144 + 8)[0]
    content = bytearray(zlib.decompress(raw[144 + 32 : 144 + size]))
    struct.pack_into("<L", content, 48 * 200 + 8, length)
    packed = zlib.compress(bytes(content))
    base = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
    path.write_bytes(raw[:144] + base + struct.pack("<H6xL4x", 2, len(content)) + packed)
    found, findings, _ = columns(path, stated(tmp_path))
    assert 398 <= len(found["speed"].t) <= 400
    assert "log-damaged" in findings


def j1939(folder: Path, identifier: int) -> tuple[str, ...]:
    """A DBC with one message of that protocol."""
    message = Message(identifier, "Brake", 5, [SPEED, PRESSURE], is_extended_frame=True)
    text = Database([message], version="").as_dbc_string()
    text += 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    text += 'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
    text += f'BA_ "VFrameFormat" BO_ {identifier | 1 << 31} 3;\n'
    (folder / "j1939.dbc").write_text(text, "utf-8")
    return (str(folder / "j1939.dbc"),)


@pytest.mark.parametrize(
    ("identifier", "is_same"),
    [
        (0x18FEF10B, True),
        (0x0CFEF133, True),  # another priority
        (0x18FEF20B, False),  # another group
        (0x1CEF0B21, False),  # below 240 the second byte is an address
    ],
)
def test_j1939_frames_are_known_by_their_group(
    tmp_path: Path, identifier: int, is_same: bool
) -> None:
    dbc = j1939(tmp_path, 0x18FEF1FE)
    data = struct.pack("<H", 7200) + b"\x10\x68\0"
    frames = [frame(k / 10, data, identifier, is_extended_id=True) for k in range(9)]
    frames.append(frame(1.0, b"\xff\xfe\x10\x68\0", identifier, is_extended_id=True))
    written(tmp_path / "a.blf", frames)
    if not is_same:
        with pytest.raises(UserError, match="no frame of the log is in the DBC"):
            columns(tmp_path / "a.blf", dbc)
        return
    found, findings, _ = columns(tmp_path / "a.blf", dbc)
    assert found["speed"].value[:9].tolist() == [72.0] * 9
    assert findings["value-is-text"].count == 1  # not available


def test_j1939_address_below_240(tmp_path: Path) -> None:
    dbc = j1939(tmp_path, 0x18EF0BFE)
    frames = [frame(k / 10, bytes(5), 0x18EF2103, is_extended_id=True) for k in range(9)]
    found, _, _ = columns(written(tmp_path / "a.blf", frames), dbc)
    assert len(found["speed"].t) == 9


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_encodings_of_a_dbc(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "vehicle.dbc"
    text = Database([BRAKE], version="").as_dbc_string()
    path.write_text(text + 'CM_ "Bremszylinderdruck, geprüft bei 20 °C";\n', encoding)
    frames = [frame(k / 10, bytes(5)) for k in range(9)]
    found, findings, _ = columns(written(tmp_path / "a.blf", frames), (str(path),))
    assert len(found["speed"].t) == 9
    assert not findings


def test_the_reason_of_the_library_is_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "vehicle.dbc"
    path.write_text(Database([BRAKE], version="").as_dbc_string().replace("BO_ 291", "BO_ 4096"))
    log = written(tmp_path / "a.blf", [frame(0.0, bytes(5))])
    with pytest.raises(UserError, match="Standard frame id 0x1000 is more than 11 bits"):
        columns(log, (str(path),))


def test_a_dbc_that_is_not_used_is_reported(tmp_path: Path) -> None:
    path, dbc = tmp_path / "a.csv", stated(tmp_path)
    path.write_text("time [s],p [bar]\n" + "".join(f"{k / 10},{k % 3}\n" for k in range(50)))
    _, findings, _ = columns(path, dbc)
    assert findings["dbc-not-used"].names["dbc"] == "vehicle.dbc"
    path.write_text("".join(f"frame {k} at bus: 12 34\n" for k in range(50)))
    with pytest.raises(UserError, match="--dbc is not used"):
        columns(path, dbc)


def test_frames_in_an_mf4(tmp_path: Path) -> None:
    frames = [frame(k / 10, struct.pack("<H", 7200 - k) + bytes(3)) for k in range(50)]
    path = written(tmp_path / "a.mf4", frames)
    found, findings, source = columns(path, stated(tmp_path))
    assert source.format == "can"
    assert np.allclose(found["speed"].value, 72.0 - np.arange(50) / 100)
    assert np.array_equal(np.rint(np.diff(found["speed"].t) / 1e6), np.full(49, 100))
    assert not findings
    with pytest.raises(UserError, match="holds CAN frames") as error:
        columns(path, ())
    assert "--dbc" in error.value.hint
