"""No message ends a live run, whatever sends it; each that says nothing is counted."""

import math
import queue
import random
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rerun as rr
from helpers import mcap_logs
from helpers.grids import thinned
from helpers.live_runs import Kept, message
from mcap.records import Channel

from adhesion_cli.analysis.request import choose_estimators
from adhesion_cli.analysis.settings import Settings, load
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.live.bytes_arriving import Pieces
from adhesion_cli.live.can import Can
from adhesion_cli.live.feed import Feed
from adhesion_cli.live.growing_mcap import GrowingMcap
from adhesion_cli.live.messages import Messages, in_datagrams, lines
from adhesion_cli.live.recording import Batches, LiveView, Mcap
from adhesion_cli.live.run import Tally, follow
from adhesion_cli.live.shown import Counts, StatusLine
from adhesion_cli.live.table import LiveTable
from adhesion_cli.live.wheels import LiveWheels
from adhesion_cli.results.rrd.live import LiveRecording

HUGE = "9" * 400
NUMBERS = [
    HUGE, f"-{HUGE}", "1e400", "-1e400", "1e308", "-1e308", "1e200", "-1e200", "1e-320", "NaN",
    "Infinity", "-Infinity", "9223372036854775807", "-9223372036854775808", "9223372036854775808",
    "18446744073709551616", "1e18", "-1e18", "4e9", "-0.0", "0", "true", "null", '"x"', "[]", "{}",
    '"80.2"', '"\\ud800"',
]  # fmt: skip
TIMES = [
    *NUMBERS, '"0001-01-01"', '"0001-01-01T00:00:00+14:00"', '"9999-12-31T23:59:59.999999"',
    '"9999-12-31T23:59:59-14:00"', '"1677-09-21"', '"2262-04-12"', '"2262-04-11T23:47:16"',
    '"soon"', '"2026-13-45"', '""',
]  # fmt: skip
BYTES = [
    b"", b"{", b"[1]", b"null", b"\x00\xff", b"\xff\xfe{", b"[" * 100_000, b'{"a":' * 100_000,
    b'{"t": 1, "t": {}}', HUGE.encode(), b"NaN", b'{"": 1}', b'{"t": 1, "axle": {"axle": 1}}',
    b'{"t": 1, "axle": "\\ud800", "speed [km/h]": 1}', b'{"\\u0000": 1}', b" \t ", b'"' * 999,
]  # fmt: skip
HEAD, GOOD = 200, 60  # messages that show the fields; and good ones among the hostile


def hostile(random_: random.Random) -> bytes:
    """A message as a broken or malicious sender makes it."""
    if random_.random() < 0.2:
        return random_.choice(BYTES)
    names = "t axle bc axle.speed".split()
    said = {
        '"t"': random_.choice([*TIMES, "30.05"]),
        '"axle"': random_.choice(["1", "1", "1", *NUMBERS]),
        '"speed [km/h]"': random_.choice(["80", *NUMBERS]),
        '"bc pressure [bar]"': random_.choice(["1.0", *NUMBERS]),
        f'"{random_.choice(names)}"': random_.choice(NUMBERS),
    }
    kept = [f"{name}: {value}" for name, value in said.items() if random_.random() < 0.85]
    text = f"{{{', '.join(kept)}}}".encode()
    return text[: random_.randrange(len(text))] if random_.random() < 0.1 else text


def mixed(seed: int) -> list[bytes]:
    """Good messages, from the first ones on with hostile ones among them."""
    random_ = random.Random(seed)
    messages = [message(k / 100, 1, 80.0).encode() for k in range(HEAD)]
    for k in range(GOOD):
        messages += [hostile(random_) for _ in range(random_.randrange(4))]
        messages.append(message(10.0 + k / 10, 1, 80.0 - k / 10).encode())
    return messages


def followed(feed: Feed, settings: Settings, folder: Path) -> tuple[Kept, Tally]:
    """What every sink has of a sender, in the end; the file holds all."""
    kept, tally, vehicle = Kept(), Tally(lambda _: None), settings.vehicle
    algos = {e.name: (e, settings.params(e)) for e in choose_estimators(())}
    wheels = LiveWheels(feed.head(), settings.mappings, settings.vehicle, ())
    axles, errors = [p.axle for p in wheels.axles], list[str]()
    target = folder / "x.live.mcap"
    record = Mcap(target, "x", settings, algos, axles, tally.add)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rr, "GrpcSink", rr.FileSink)  # a viewer that keeps what it gets
        view = LiveRecording("x", vehicle, axles, list(algos), str(folder / "shown.rrd"))
    files = [
        Batches(record, 0.01),
        Batches(LiveView(view, list(algos), errors.append), 0.01),
    ]
    sinks = [kept, *files, Counts(), StatusLine("imm", vehicle)]
    follow(feed, wheels, settings, algos, sinks, tally)
    for file in files:
        file.close()
    assert not errors
    source = open_source(target, ReadOptions())
    speeds = [f for f in source.fields if f.channel == "/axle/1/input" and "speed" in f.path]
    unwritten = sum(f.count for f in tally.findings if f.code == "not-recorded")
    assert len(source.columns(speeds[:1])[0].t) == len(kept.of[1]) - unwritten
    return kept, tally


def check(kept: Kept, tally: Tally) -> None:
    """The good samples came, and the others are counted."""
    times = {s.t for s in kept.of[1] if s.estimates}
    assert len(times & {round((10.0 + k / 10) * 1e9) for k in range(GOOD)}) > 0.8 * GOOD
    assert all(math.isfinite(e.force) for s in kept.of[1] for e in s.estimates.values())
    codes = {f.code for f in tally.findings if f.count > 1}
    assert codes & {"messages-unreadable", "cell-not-a-number"}


@pytest.mark.parametrize(("way", "seed"), thinned(5, ["lines", "datagrams"], range(6)))
def test_json_messages(way: str, seed: int, tmp_path: Path) -> None:
    """Lines of standard input or a file, and datagrams of UDP or messages of a broker."""
    messages: list[Any] = mixed(seed)
    pieces: Any = iter([b"\n".join(messages)]) if way == "lines" else messages
    arriving = lines(pieces) if way == "lines" else in_datagrams(pieces)
    check(*followed(Messages("x", arriving, ReadOptions()), Settings(), tmp_path))


class Bus:
    """Gives frames, then ends."""

    def __init__(self, frames: Sequence[Any]) -> None:
        self._frames = iter(frames)
        self.feed: queue.SimpleQueue[Feed] = queue.SimpleQueue()

    def recv(self, timeout: float) -> Any:
        frame = next(self._frames, None)
        if frame is None:
            self.feed.get().close()
        return frame

    def shutdown(self) -> None:
        pass


@pytest.mark.parametrize("seed", thinned(2, range(4)))
def test_frames_of_a_bus(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cantools")
    dbc = tmp_path / "train.dbc"
    dbc.write_text(
        'VERSION ""\nBS_:\nBU_: BCU\n'
        "BO_ 256 Brake: 8 BCU\n"
        ' SG_ bc_pressure_1 : 0|16@1+ (0.01,0) [0|10] "bar" BCU\n'
        ' SG_ wheel_speed_1 : 16|32@1- (1,0) [0|300] "km/h" BCU\n'
        "BO_ 257 Odd: 8 BCU\n"
        ' SG_ wheel_speed_2 : 0|24@1- (1,0) [0|300] "km/h" BCU\n'
        ' SG_ bc_pressure_2 : 24|16@1+ (0.01,0) [0|10] "bar" BCU\n'
        "SIG_VALTYPE_ 256 wheel_speed_1 : 1;\nSIG_VALTYPE_ 257 wheel_speed_2 : 1;\n"
    )

    def frame(t: float, data: Any, **values: Any) -> Any:
        usual = {"arbitration_id": 256, "is_extended_id": False}
        usual |= {"is_error_frame": False, "is_remote_frame": False}
        return SimpleNamespace(timestamp=t, data=data, **usual | values)

    random_ = random.Random(seed)

    def bad() -> Any:
        t = random_.choice([30.0, math.nan, math.inf, -1e300, 1e19, 3e8, -5.0, None, "soon"])
        raw = [struct.pack("<Hf", 100, x) for x in (math.nan, math.inf, -3e38, 3e38, 1e-45)]
        data = random_.choice([*raw, b"", b"\xff" * 8, b"\xff" * 64, None, object(), slice(3)])
        one = frame(t, data, arbitration_id=random_.choice([256, 256, 257, -1, None, 1 << 80]))
        if random_.random() < 0.1:  # a driver that has not all attributes
            delattr(one, random_.choice(["is_error_frame", "data", "timestamp"]))
        return one

    frames = [frame(k / 100, struct.pack("<Hf", 100, 80.0)) for k in range(HEAD)]
    for k in range(GOOD):
        frames += [bad() for _ in range(random_.randrange(4))]
        frames.append(frame(10.0 + k / 10, struct.pack("<Hf", 100, 80.0 - k / 10)))
    bus = Bus(frames)
    monkeypatch.setattr("adhesion_cli.live.can.bus", lambda _: bus)
    settings = load(assignments=[f"can.dbc = ['{dbc}']"])
    feed = Can("virtual:x", settings.read)
    bus.feed.put(feed)
    kept, tally = followed(feed, settings, tmp_path)
    check(kept, tally)
    assert 2 not in kept.of  # a float of 24 bits is none


@pytest.mark.parametrize("seed", thinned(3, range(3)))
def test_messages_of_an_mcap(seed: int, tmp_path: Path) -> None:
    random_ = random.Random(seed)

    def said(speed: str, pressure: str = "1.0") -> bytes:
        text = f'{{"axle 1 speed [km/h]": {speed}, "axle 1 bc pressure [bar]": {pressure}}}'
        return text.encode()

    def bad() -> Any:
        t = random_.choice([0, 1, 30 * 10**9, 10**18, 2**62, 2**63 - 1])
        numbers = said(random_.choice(NUMBERS), random_.choice(NUMBERS))
        return mcap_logs.message(1, t, random_.choice([numbers, *BYTES[:-1]]))

    messages = [mcap_logs.message(1, k * 10**7, said("80.0")) for k in range(HEAD)]
    for k in range(GOOD):
        messages += [bad() for _ in range(random_.randrange(4))]
        messages.append(mcap_logs.message(1, 10**10 + k * 10**8, said(f"{80 - k / 10}")))
    path = tmp_path / "log.mcap"
    log = mcap_logs.Log([], [Channel(1, "/a", "json", {}, 0)], messages, per_chunk=20)
    path.write_bytes(log.bytes())
    kept, tally = followed(GrowingMcap(path, ReadOptions()), Settings(), tmp_path)
    assert sum(bool(s.estimates) for s in kept.of[1]) >= HEAD + GOOD
    assert any(f.code == "mcap-bad-message" for f in tally.findings)


@pytest.mark.parametrize(("dates", "seed"), thinned(5, [False, True], range(6)))
def test_rows_of_a_table(dates: bool, seed: int, tmp_path: Path) -> None:
    random_ = random.Random(seed)
    times = [x.strip('"') for x in TIMES]

    def stamp(t: float) -> str:
        return f"2026-01-01 00:00:{t:06.3f}" if dates else f"{t:g}"

    def bad() -> str:
        cells = [random_.choice(times), *(random_.choice(NUMBERS) for _ in range(2))]
        if random_.random() < 0.3:
            cells[0] = stamp(30.0)
        if random_.random() < 0.1:
            cells = cells[: random_.randrange(3)] + cells * random_.randrange(2)
        return ",".join(cells)

    rows = ["t [s],axle 1 speed [km/h],axle 1 bc pressure [bar]"]
    rows = rows if not dates else [rows[0].replace("t [s]", "timestamp")]
    rows += [f"{stamp(k / 100)},80.0,1.0" for k in range(HEAD)]
    for k in range(GOOD):
        rows += [bad() for _ in range(random_.randrange(4))]
        rows.append(f"{stamp(10.0 + k / 10)},{80.0 - k / 10},1.0")

    def pieces() -> Iterator[bytes]:
        yield from (f"{row}\n".encode() for row in rows)

    feed = LiveTable(Pieces("x", pieces()), ReadOptions())
    kept, tally = followed(feed, Settings(), tmp_path)
    assert sum(bool(s.estimates) for s in kept.of[1]) > 0.9 * (HEAD + GOOD)
    assert all(math.isfinite(e.force) for s in kept.of[1] for e in s.estimates.values())
    assert tally.findings
