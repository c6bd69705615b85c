"""One brake as people's loggers and exports write it: kinds of text logs, each in seeded variants.

Every variant holds the same samples: the first time is 0, or the start that its form states.
"""

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

RATE = 50  # Hz
ROWS = 901


@dataclass(frozen=True)
class WildLog:
    """A log, and how exactly its numbers can be known.

    Attributes:
        name: of the file.
        text: its bytes.
        apart_s: the most that a time may be wrong by [s].
        pressure_bar: and a pressure [bar].
    """

    name: str
    text: bytes
    apart_s: float = 1e-4
    pressure_bar: float = 0.006


def brake() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], pressures [bar] and speeds [km/h] of one brake application; shape (n,)."""
    t = np.arange(ROWS) / RATE
    rng = np.random.default_rng(0)
    rise, fall = (t - 3.0) / 1.5, (27.0 - t) / 1.5
    p = 4.0 * np.clip(np.minimum(rise, fall), 0.0, 1.0)
    slowing = np.cumsum(0.5 * p / 4.0 / RATE)
    v = 3.6 * (19.4 - slowing) + rng.normal(0.0, 0.01, ROWS)
    return t, np.round(p, 2), np.round(v, 2)


T, P, V = brake()
NAMES = ["BC pressure [bar]", "wheel speed [km/h]"]


def table(
    heads: list[list[str]], columns: list[list[str]], delimiter: str = ",", end: str = "\n"
) -> bytes:
    """Rows of cells below heads, as UTF-8."""
    rows = [*heads, *zip(*columns, strict=True)]
    return "".join(delimiter.join(row) + end for row in rows).encode()


def timed(name: str, times: list[str], delimiter: str = ",") -> bytes:
    """A table with these texts as times."""
    values = [[f"{x:.2f}" for x in series] for series in (P, V)]
    return table([[name, *NAMES]], [times, *values], delimiter)


def _start(rng: random.Random) -> datetime:
    """A start some seconds before the end of a minute, on a day whose order no date leaves open."""
    minute, second = rng.randrange(1, 58), rng.randrange(45, 58)
    day = rng.randrange(13, 28)
    return datetime(
        2026, rng.randrange(1, 13), day, rng.randrange(2, 11), minute, second, tzinfo=UTC
    )


def _stamps(rng: random.Random) -> list[datetime]:
    begin = _start(rng)
    return [begin + timedelta(milliseconds=20 * k) for k in range(ROWS)]


def _clock(seconds: float, hours: str = "02d") -> str:
    ms = round(seconds * 1000)
    return f"{ms // 3_600_000:{hours}}:{ms // 60_000 % 60:02}:{ms // 1000 % 60:02}.{ms % 1000:03}"


def _ms(stamp: datetime) -> str:
    return f"{stamp.microsecond // 1000:03}"


# ------------------------------------------------------------------------------- repeated headers


def segments(rng: random.Random) -> Iterator[WildLog]:
    """LVM files with a header for each segment; X goes on, or begins anew in the last two."""
    for k in range(5):
        length, separator = rng.randrange(60, 300), ["\t", ",", "\t", "\t", ";"][k]
        name = ["Tab", "Comma", "Tab", "Tab", "Semicolon"][k]
        in_names, comment = k % 2 == 1, k != 2
        rows = ["LabVIEW Measurement", "Writer_Version|2", "Reader_Version|2", f"Separator|{name}"]
        rows += ["Decimal_Separator|.", "Multi_Headings|Yes", "X_Columns|One"]
        rows += ["Time_Pref|Relative", "Date|2026/11/24", "Time|10:15:00.000000"]
        rows += ["***End_of_Header***", ""]
        names = ["BC pressure", "wheel speed"]
        for begin in range(0, ROWS, length):
            rows += [
                "",
                "Channels|2||",
                f"Samples|{length}|{length}|",
                "Date|2026/11/24|2026/11/24|",
            ]
            clock = _clock(36_900 + begin / RATE)
            rows += [f"Time|{clock}|{clock}|"]
            rows += [] if in_names else ["Y_Unit_Label|bar|km/h|"]
            rows += ["X_Dimension|Time|Time|", "X0|0.0000000E+0|0.0000000E+0|"]
            rows += ["Delta_X|0.020000|0.020000|", "***End_of_Header***|||"]
            rows += ["|".join(["X_Value", *(NAMES if in_names else names), *["Comment"] * comment])]
            part = slice(begin, begin + length)
            since = begin / RATE if k > 2 else 0.0
            rows += [
                f"{t - since:.6f}|{p:.6f}|{v:.6f}"
                for t, p, v in zip(T[part], P[part], V[part], strict=True)
            ]
        yield WildLog("log.lvm", "\n".join(rows).replace("|", separator).encode() + b"\n")


def blocks(rng: random.Random) -> Iterator[WildLog]:
    """Tables whose names, or names and lines above them, come again and again."""
    for k in range(5):
        length, delimiter = rng.randrange(100, 700), rng.choice(",;\t")
        head = [["time [s]", *NAMES]]
        above = [
            [],
            [["Block 1"]],
            [["Logger", "A7"], []],
            [[], ["# part"]],
            [["Record", "2", "ok"]],
        ][k]
        rows = []
        for begin in range(0, ROWS, length):
            part = slice(begin, begin + length)
            rows += [*above, *head]
            rows += [
                [f"{t:.3f}", f"{p:.2f}", f"{v:.2f}"]
                for t, p, v in zip(T[part], P[part], V[part], strict=True)
            ]
        yield WildLog("log.csv", table(rows, [[], [], []], delimiter))


def restarts(rng: random.Random) -> Iterator[WildLog]:
    """Tables whose times begin anew below each header; lines above it state when."""
    for k in range(4):
        length, start = rng.randrange(100, 700), _start(rng)
        rows: list[list[str]] = []
        for begin in range(0, ROWS, length):
            part, at = slice(begin, begin + length), start + timedelta(seconds=begin / RATE)
            clock = f"{at:%H:%M:%S}.{_ms(at)}"
            rows += [
                [[f"Start: {at:%d.%m.%Y} {clock}"], ["Rate", "50"]],
                [["Date", f"{at:%Y-%m-%d}"], ["Time", clock], []],
                [
                    ["Exported", f"{start:%Y-%m-%d} 23:{begin // 60:02d}:00"],
                    ["Trigger", f"#{begin}", f"{at:%Y/%m/%d} {clock}"],
                ],
                [[f"# started {at:%Y-%m-%d} {clock}"], ["# started", f"{at:%Y-%m-%d} {clock}"]],
            ][k]
            rows += [["time [s]", *NAMES]]
            rows += [
                [f"{t - begin / RATE:.3f}", f"{p:.2f}", f"{v:.2f}"]
                for t, p, v in zip(T[part], P[part], V[part], strict=True)
            ]
        yield WildLog("log.csv", table(rows, [[], [], []], rng.choice(";\t")))


# ------------------------------------------------------------------------------------- numbers


def _grouped(number: float, mark: str, decimal: str, decimals: int) -> str:
    text = f"{abs(number):,.{decimals}f}".replace(",", "_").replace(".", decimal)
    return text.replace("_", mark)


def groups(rng: random.Random) -> Iterator[WildLog]:
    """Pressures in mbar or Pa, with marks between groups of digits."""
    marks = [(".", ",", 1), ("'", ".", 0), ("\u202f", ",", 1), (",", ".", 0), (".", ",", 0)]
    marks += [("\u00a0", ",", 2), ("\u2019", ".", 1), (",", ".", 2)]
    for mark, decimal, decimals in marks:
        factor, unit = rng.choice([(1_000.0, "mbar"), (100_000.0, "Pa")])
        cells = [_grouped(x * factor, mark, decimal, decimals) for x in P]
        if decimal == "." and mark == ",":
            cells = [f'"{c}"' for c in cells]
        time, speed = ([f"{x:.3f}".replace(".", decimal) for x in y] for y in (T, V))
        heads = [["Zeit [s]", f"Bremszylinderdruck [{unit}]", "Radgeschwindigkeit [km/h]"]]
        delimiter = rng.choice(";\t" if decimal == "," else ",;\t")
        yield WildLog("log.csv", table(heads, [time, cells, speed], delimiter))


def minus(rng: random.Random) -> Iterator[WildLog]:
    """Times before the trigger with the minus of typesetting."""
    for decimal in (".", ",", ".", ",", "."):
        before, sign = rng.randrange(1, 9), rng.choice("\u2212\u2011\u2012\uff0d")
        times = [f"{x - before:.3f}".replace("-", sign).replace(".", decimal) for x in T]
        values = [[f"{x:.2f}".replace(".", decimal) for x in y] for y in (P, V)]
        yield WildLog("log.csv", table([["time [s]", *NAMES]], [times, *values], ";"))


def marks(rng: random.Random) -> Iterator[WildLog]:
    """One column, or the time, with another decimal mark than the others."""
    for odd in (2, 1, 0, 2, 1):
        points = [[f"{x:.{n}f}" for x in y] for y, n in ((T, 3), (P, 2), (V, 2))]
        columns = [
            [c.replace(".", ",") for c in x] if k != odd else x for k, x in enumerate(points)
        ]
        yield WildLog("log.csv", table([["time [s]", *NAMES]], columns, rng.choice(";\t")))


def unit_cells(rng: random.Random) -> Iterator[WildLog]:
    """Numbers with their unit behind them."""
    for gap in (" ", "", " ", " ", ""):
        behind = f"{gap}s" if gap or rng.random() < 0.5 else ""
        time = [f"{x:.3f}{behind}" for x in T]
        values = [[f"{x:.2f}{gap}{u}" for x in y] for y, u in ((P, "bar"), (V, "km/h"))]
        yield WildLog("log.csv", table([["Time", "BC pressure", "wheel speed"]], [time, *values]))


# -------------------------------------------------------------------------------------- times


def clock_digits(rng: random.Random) -> Iterator[WildLog]:
    """Times as digits, HHMMSS.sss, across a minute."""
    for k in range(5):
        name = rng.choice(["time", "Time", "UTC time", "time [s]"][: 3 if k == 2 else 4])
        form = ["%H%M%S.", "%H%M%S.", "%H%M%S", "%H%M%S.", "%-H%M%S."][k]
        times = [x.strftime(form) + _ms(x) for x in _stamps(rng)]
        yield WildLog("log.csv", timed(name, times))


def bare_milliseconds(rng: random.Random) -> Iterator[WildLog]:
    """Milliseconds without leading zeros."""
    stamps = _stamps(rng)
    for k in range(5):
        fraction = [str(x.microsecond // 1000) for x in stamps]
        whole = [
            [f"{int(x)}" for x in T],
            [x.strftime("%H:%M:%S") for x in stamps],
            [x.strftime("%Y-%m-%d %H:%M:%S") for x in stamps],
            [f"{int(x + 1e-9) + 17}" for x in T],
            [x.strftime("%d.%m.%Y %H:%M:%S") for x in stamps],
        ][k]
        if k in (0, 3):
            fraction = [str(20 * (n % 50)) for n in range(ROWS)]
            whole = [str(n // 50 + 17 * (k == 3)) for n in range(ROWS)]
        times = [f"{a}.{b}" for a, b in zip(whole, fraction, strict=True)]
        yield WildLog("log.csv", timed("Time (sec)" if k in (0, 3) else "Time", times))


def _written(rng: random.Random, *forms: Callable[[datetime], str]) -> Iterator[WildLog]:
    for form in forms:
        name = rng.choice(["Time", "Timestamp", "Zeit", "Datum/Uhrzeit", "Fecha y hora"])
        yield WildLog("log.csv", timed(name, [form(x) for x in _stamps(rng)], ";"))


def day_halves(rng: random.Random) -> Iterator[WildLog]:
    """Clocks of twelve hours."""
    yield from _written(
        rng,
        lambda x: x.strftime("%d/%m/%Y %I:%M:%S.") + _ms(x) + " a. m.",
        lambda x: x.strftime("%m/%d/%Y %I:%M:%S.") + _ms(x) + "\u202fAM",
        lambda x: x.strftime("%m/%d/%Y %I:%M:%S AM.") + _ms(x),
        lambda x: x.strftime("%d/%m/%Y %I:%M:%S.") + _ms(x) + "\u00a0a.\u00a0m.",
        lambda x: x.strftime("%Y/%m/%d ") + "上午 " + x.strftime("%I:%M:%S.") + _ms(x),
    )


def named_months(rng: random.Random) -> Iterator[WildLog]:
    """Dates with the name of the month."""
    yield from _written(
        rng,
        lambda x: x.strftime("%d-%b-%Y %H:%M:%S.") + _ms(x),
        lambda x: x.strftime("%a %b %d %H:%M:%S.") + _ms(x) + x.strftime(" %Y"),
        lambda x: x.strftime("%b %d, %Y %I:%M:%S.") + _ms(x) + " AM",
        lambda x: x.strftime("%d %B %Y %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("%d.%b.%y %H:%M:%S.") + _ms(x),
    )


def local(rng: random.Random) -> Iterator[WildLog]:
    """Dates as programs in several languages write them."""
    yield from _written(
        rng,
        lambda x: x.strftime("%d de noviembre de %Y %H:%M:%S.") + _ms(x),
        lambda x: x.strftime("%d juil. %Y à %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("%d lip %Y %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("Di %d.%m.%Y %H:%M:%S,") + _ms(x) + " Uhr",
        lambda x: x.strftime("%Y-%m-%dT%H:%M:%S.") + _ms(x) + "+02:00[Europe/Berlin]",
        lambda x: f"{x.hour}:{x.minute}:{x.second}:{x.microsecond // 1000}",
        lambda x: x.strftime("%d. %m. %Y %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("%Y. %m. %d. %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("%d ноя %Y %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("%Y-%m-%d 오전 %I:%M:%S.") + _ms(x),
        lambda x: x.strftime("%d-%b-%y %I.%M.%S.") + _ms(x) + "000 AM",
        lambda x: x.strftime("%d%b%Y:%H:%M:%S.") + _ms(x),
        lambda x: x.strftime("%d Kasım %Y %H:%M:%S,") + _ms(x),
        lambda x: x.strftime("%Y-%m-%d kl. %H.%M.%S,") + _ms(x),
        lambda x: x.strftime("'%Y-%m-%d %H:%M:%S.") + _ms(x) + "'",
    )


def iso(rng: random.Random) -> Iterator[WildLog]:
    """Dates of ISO 8601 that are not the usual one."""
    yield from _written(
        rng,
        lambda x: x.strftime("%Y-%jT%H:%M:%S.") + _ms(x) + "Z",
        lambda x: x.strftime("%Y%m%dT%H%M%S.") + _ms(x) + "Z",
        lambda x: x.strftime("%Y%m%d%H%M%S") + _ms(x),
        lambda x: x.strftime("%Y%jT%H%M%S.") + _ms(x),
        lambda x: x.strftime("%Y%m%d %H%M%S") + _ms(x),
    )


def dotted(rng: random.Random) -> Iterator[WildLog]:
    """Clocks with other marks than colons."""
    yield from _written(
        rng,
        lambda x: x.strftime("%d.%m.%Y %H.%M.%S,") + _ms(x),
        lambda x: x.strftime("%H.%M.%S.") + _ms(x),
        lambda x: x.strftime("%Y-%m-%d %H.%M.%S,") + _ms(x),
        lambda x: x.strftime("%Y-%m-%d_%H-%M-%S.") + _ms(x),
        lambda x: x.strftime("%Hh%Mm%S.") + _ms(x) + "s",
    )


def elapsed(rng: random.Random) -> Iterator[WildLog]:
    """Clocks above a day, below zero, and periods."""
    hours, before = rng.randrange(25, 400), rng.randrange(1, 9)
    forms: list[Callable[[float], str]] = [
        lambda x: _clock(hours * 3600 + 3590 + x),
        lambda x: ("-" if round(x, 3) < before else "") + _clock(abs(x - before)),
        lambda x: f"{int(x // 86_400)} days {_clock(x % 86_400)}000",
        lambda x: f"1.{_clock(x + 7200)}0000",
        lambda x: f"PT{x:.3f}S",
        lambda x: f"00d 00h 00m {x:06.3f}s",
        lambda x: f"{hours % 60}m{x:.3f}s",
        lambda x: (
            f"-1 days +{_clock(86_400 + x - before)}"
            if round(x, 3) < before
            else f"0 days {_clock(x - before)}"
        ),
    ]
    for form in forms:
        yield WildLog("log.csv", timed("Time", [form(x) for x in T], ";"))


def minutes(rng: random.Random) -> Iterator[WildLog]:
    """MM:SS.s, as Excel shows times; also across an hour."""
    for digits in (1, 3, 2, 3, 1):
        begin = rng.randrange(100, 3500) if digits != 2 else 3_590
        ms = [round(1000 * (begin + x)) // 10 ** (3 - digits) for x in T]
        unit = 10**digits
        times = [f"{x // unit // 60 % 60:02}:{x // unit % 60:02}.{x % unit:0{digits}}" for x in ms]
        yield WildLog("log.csv", timed("Time", times), 0.11 if digits == 1 else 1e-4)


def counts(rng: random.Random) -> Iterator[WildLog]:
    """Numbers that count from another day, or in days."""
    unix = np.array([round(x.timestamp() * 1000) for x in _stamps(rng)])
    day = 86_400_000
    for name, times, apart in (
        ("Time", [f"{(x + 2_082_844_800_000) / 1000:.3f}" for x in unix.tolist()], 1e-3),
        ("timestamp", [str((x + 11_644_473_600_000) * 10_000) for x in unix.tolist()], 1e-4),
        ("datenum", [f"{x / day + 719_529:.10f}" for x in unix.tolist()], 1e-3),
        ("Time [days]", [f"{x / 86_400:.10f}" for x in T], 1e-3),
        ("t", [str((x + 62_135_596_800_000) * 10_000) for x in unix.tolist()], 1e-4),
        ("Time [s]", [f"{(x + 2_082_844_800_000) / 1000:.3f}" for x in unix.tolist()], 1e-3),
        ("t", [f"{x / day + 2_440_587.5:.10f}" for x in unix.tolist()], 1e-3),
        ("t [10 ms]", [str(2 * k) for k in range(ROWS)], 1e-4),
        ("Zeit (1/1000 s)", [str(20 * k) for k in range(ROWS)], 1e-4),
    ):
        yield WildLog("log.csv", timed(name, times), apart)


def parts(rng: random.Random) -> Iterator[WildLog]:
    """Times in several columns."""
    stamps, values = _stamps(rng), [[f"{x:.2f}" for x in y] for y in (P, V)]
    seconds = [str(int(x.timestamp())) for x in stamps]
    ns = [str(x.microsecond * 1000) for x in stamps]
    ms = [str(x.microsecond // 1000) for x in stamps]
    split = [
        [str(getattr(x, k)) for x in stamps] for k in "year month day hour minute second".split()
    ]
    dates, clocks = ([x.strftime(form) for x in stamps] for form in ("%Y-%m-%d", "%H:%M:%S"))
    for names, columns in (
        (["secs", "nsecs"], [seconds, ns]),
        (["/axle/header/stamp/sec", "/axle/header/stamp/nanosec"], [seconds, ns]),
        (["Year", "Month", "Day", "Hour", "Minute", "Second", "Millisecond"], [*split, ms]),
        (["Hour", "Minute", "Second", "ms"], [*split[3:], ms]),
        (["Date", "Time", "Millitm"], [dates, clocks, ms]),
        (["Date", "Time", "ms"], [dates, [f"{x}.000" for x in clocks], ms]),
        (["sec", "usec"], [seconds, [str(x.microsecond) for x in stamps]]),
    ):
        yield WildLog("log.csv", table([[*names, *NAMES]], [*columns, *values]))
    head = ["Year", *NAMES, "Month", "Day", "Hour", "Minute", "Second", "ms"]
    yield WildLog("log.csv", table([head], [split[0], *values, *split[1:], ms]))


# -------------------------------------------------------------------------------------- heads


def _lvm(columns: str, separator: str, delta: str = "0.020000") -> bytes:
    """An LVM file with one header; X for all channels, for each, or for none."""
    name = {"\t": "Tab", ",": "Comma", ";": "Semicolon"}[separator]
    rows = ["LabVIEW Measurement", "Writer_Version|2", "Reader_Version|2", f"Separator|{name}"]
    rows += ["Decimal_Separator|.", "Multi_Headings|No", f"X_Columns|{columns}"]
    rows += ["Time_Pref|Relative", "Date|2026/11/24", "Time|10:15:00.000000"]
    rows += ["***End_of_Header***|", "|", "Channels|2||"]
    gap = "||" if columns == "Multi" else "|"
    for label, value in (
        ("Samples", str(ROWS)),
        ("Date", "2026/11/24"),
        ("Time", "10:15:00.000000"),
        ("X_Dimension", "Time"),
        ("X0", "0.0000000E+0"),
        ("Delta_X", delta),
    ):
        rows += [f"{label}|{value}{gap}{value}|"]
    rows += [f"Y_Unit_Label|bar{gap}km/h|", "***End_of_Header***|||"]
    names = [
        "X_Value",
        "BC pressure",
        *["X_Value"] * (columns == "Multi"),
        "wheel speed",
        "Comment",
    ]
    rows += ["|".join(names)]
    for t, p, v in zip(T, P, V, strict=True):
        x = "" if columns == "No" else f"{t:.6f}"
        rows += [f"{x}|{p:.6f}|{x}|{v:.6f}" if columns == "Multi" else f"{x}|{p:.6f}|{v:.6f}"]
    return "\n".join(rows).replace("|", separator).encode() + b"\n"


def lvm(rng: random.Random) -> Iterator[WildLog]:
    """LVM files with one header."""
    for columns in ("One", "Multi", "No", "One", "Multi", "No"):
        yield WildLog("log.lvm", _lvm(columns, rng.choice("\t,;")))


def heads(rng: random.Random) -> Iterator[WildLog]:
    """Units rows in several places, names with line ends, and labels above the table."""
    cells = [[f"{x:.{n}f}" for x in y] for y, n in ((T, 3), (P, 2), (V, 2))]
    names, units = ["Time", "BC pressure", "wheel speed"], ["s", "bar", "km/h"]
    lines = [[f'"{a}\n[{b}]"' for a, b in zip(names, units, strict=True)]]
    objects = ["-", "brake", "axle"]
    delimiter = rng.choice(",;\t")
    for rows in (
        [names, units],
        [units, names],
        [names, units, objects],
        [[f"Logger {rng.randrange(99)}"], [], names, [f"[{u}]" for u in units]],
        lines,
    ):
        yield WildLog("log.csv", table(rows, cells, delimiter))
    wide = [f"{a:>12}  {b:>14}  {c:>14}" for a, b, c in [names, units, *zip(*cells, strict=True)]]
    yield WildLog("log.txt", ("\n".join(wide) + "\n").encode())
    labelled = [["Name", *names], ["Unit", *units]]
    yield WildLog("log.csv", table(labelled, [["Data"] * ROWS, *cells], delimiter))
    scope = [["Model", "DL850"], ["TraceName", *names[1:]], ["VUnit", *units[1:]]]
    scope += [["HResolution", "2.0E-02"], ["HUnit", "s"], ["Date", "2026/11/24"]]
    scope += [["Time", "10:15:00.000000"], [""]]
    yield WildLog("log.csv", table(scope, [[""] * ROWS, *cells[1:], [""] * ROWS]))
    vbo = [
        "File created",
        "[header]",
        "time",
        "BC pressure bar",
        "velocity kmh",
        "",
        "[channel units]",
        *rng.choice([["bar", "km/h"], ["km/h"]]),
        "",
        "[column names]",
        "time BC_pressure v",
        "[data]",
    ]
    rows = [f"{a} {b} {c}" for a, b, c in zip(*cells, strict=True)]
    yield WildLog("log.vbo", ("\n".join([*vbo, *rows]) + "\n").encode())


def typed_heads(rng: random.Random) -> Iterator[WildLog]:
    """Rows of types beside names and units; a drawn table; the name of an index; signs apart."""
    stamps = [f"{s:%Y-%m-%d %H:%M:%S}.{_ms(s)}" for s in _stamps(rng)]
    values = [[f"{x:.2f}" for x in series] for series in (P, V)]
    numbers = [str(k) for k in range(ROWS)]
    campbell = [
        ["TOA5", "A7", "CR1000", "123"],
        ["TIMESTAMP", "RECORD", "BC_pressure", "wheel_speed"],
    ]
    campbell += [["TS", "RN", "bar", "km/h"], ["", "", "Smp", "Avg"]]
    yield WildLog("log.dat", table(campbell, [stamps, numbers, *values]))
    etas = [["sampleCount", str(ROWS)], ["time", "BC_pressure", "wheel_speed"]]
    etas += [["f8", "f8", "f8"], ["s", "bar", "km/h"]]
    yield WildLog("log.ascii", table(etas, [[f"{t:.3f}" for t in T], *values], "\t"))
    line = "+".join("-" * n for n in (25, 17, 17)) + "\n"
    names = " ts | bc_pressure_bar | wheel_speed_kmh \n"
    rows = zip(stamps, *values, strict=True)
    drawn = names + line + "".join(f" {t} | {p} | {v} \n" for t, p, v in rows)
    yield WildLog("log.txt", (drawn + f"({ROWS} rows)\n\n").encode())
    boxed = line + "".join(f"|{x} |\n" for x in drawn.replace(line, "").splitlines()) + line
    yield WildLog("log.txt", (boxed + f"{ROWS} rows in set (0.01 sec)\n").encode())
    index = [["", "BC pressure", "wheel speed"], ["", "bar", "km/h"], ["time", "", ""]]
    yield WildLog("log.csv", table(index, [stamps, *values]))
    above = [["Time [s]", *NAMES], ["Max", "4.00", "70.1"], ["Min:", "0.00", "31.2"]]
    yield WildLog("log.csv", table(above, [[f"{t:.3f}" for t in T], *values], ";"))
    graphtec = [
        ["Number", "Date&Time", "BC pressure", "wheel speed"],
        ["NO.", "Time", "bar", "km/h"],
    ]
    apart = [[f"{'-' if x < 0 else '+'}{abs(x):9.2f}" for x in series] for series in (P, V)]
    yield WildLog("log.csv", table(graphtec, [numbers, stamps, *apart]))


def lists(rng: random.Random) -> Iterator[WildLog]:
    """Numbered lists of channels above the table."""
    cells = [[f"{x:.{n}f}" for x in y] for y, n in ((T, 3), (P, 2), (V, 2))]
    for k in range(5):
        first, delimiter = rng.choice([0, 1]), rng.choice(",;\t")
        entries = [["pressure", "bar"], ["speed", "km/h"], ["spare", "V"]]
        numbers = [[f"{rng.uniform(0.0, 9.0):.2f}" for _ in range(1 + k % 3)] for _ in entries]
        rows = [
            [str(first + n), *entry, *gains]
            for n, (entry, gains) in enumerate(zip(entries, numbers, strict=True))
        ]
        above = [["Report", "brake test"], ["No", "Name", "Unit", "Gain"], *rows, []]
        yield WildLog("log.csv", table([*above, ["Time [s]", *NAMES]], cells, delimiter))
    factors = [["Calibrated", "2026-03-12"], ["No", "Gain", "Offset"], ["1", "2.5", "-1.0"]]
    yield WildLog("log.csv", table([*factors, ["2", "1.0", "0.0"], ["t [s]", *NAMES]], cells))


def remarks(rng: random.Random) -> Iterator[WildLog]:
    """Lines of words among the rows and behind them, and units rows that come again."""
    cells = [[f"{x:.{n}f}" for x in y] for y, n in ((T, 3), (P, 2), (V, 2))]
    rows = [list(row) for row in zip(*cells, strict=True)]
    names, units = ["Zeit [s]", "BC pressure", "wheel speed"], ["", "[bar]", "[km/h]"]
    for remark in ("Ende der Messung", "*** Log started 24.11.2026 10:15:00 ***"):
        cut = rng.randrange(400, 800)
        text = table([names, units, *rows[:cut], [remark], names, units], [[], [], []], ";")
        yield WildLog("log.csv", text + table([*rows[cut:], [remark]], [[], [], []], ";"))


def texts(rng: random.Random) -> Iterator[WildLog]:
    """Cells that Excel is told to take as texts, and rows without a cell behind the last one."""
    cells = [[f"{x:.{n}f}" for x in y] for y, n in ((T, 3), (P, 2), (V, 2))]
    heads, delimiter = [["Time [s]", *NAMES]], rng.choice(";\t")
    for mark, end, count in (("'", "", 3), ('="', '"', 3), ("'", "", 1), ("", "", 0)):
        marked = [[f"{mark}{x}{end}" for x in y] for y in cells[:count]] + cells[count:]
        empty = (2 * delimiter + "\n").encode() * rng.randrange(1, 5)
        end_mark = f"Ende{2 * delimiter}\n".encode()
        yield WildLog("log.csv", table(heads, marked, delimiter) + empty + end_mark)


def day_clocks(rng: random.Random) -> Iterator[WildLog]:
    """Clocks that count days, from the start or from New Year, or write marks of angles."""
    forms: tuple[Callable[[datetime], str], ...] = (
        lambda s: f"{s:%j:%H:%M:%S}.{_ms(s)}",
        lambda s: f"{s:%Y:%j:%H:%M:%S}.{_ms(s)}",
        lambda s: f"{rng.choice('2')} {s:%H:%M:%S}.{_ms(s)}",
        lambda s: f"{s:%H}h{s:%M}'{s:%S}\",{_ms(s)}",
        lambda s: f"{s:%Y年%m月%d日 %H时%M分%S}.{_ms(s)}秒",
        lambda s: f"{s:%Y-%m-%d} godz. {s:%H:%M:%S}.{_ms(s)}",
    )
    yield from _written(rng, *forms)
    days = [(s - datetime(1899, 12, 30, tzinfo=UTC)).total_seconds() / 86_400 for s in _stamps(rng)]
    yield WildLog("log.csv", timed("Date", [f"{x:.11f}" for x in days]), apart_s=1e-3)


def sparse_dates(rng: random.Random) -> Iterator[WildLog]:
    """A date that is written once, or when it changes, beside a time of day."""
    values = [[f"{x:.2f}" for x in series] for series in (P, V)]
    for form in ("%d.%m.%Y", "%Y-%m-%d", "%Y/%m/%d"):
        for begin in (
            _start(rng),
            datetime(2026, 11, 24, 23, 59, rng.randrange(45, 55), tzinfo=UTC),
        ):
            stamps = [begin + timedelta(milliseconds=20 * k) for k in range(ROWS)]
            dates = [s.strftime(form) for s in stamps]
            changes = [d if k == 0 or d != dates[k - 1] else "" for k, d in enumerate(dates)]
            clocks = [f"{s:%H:%M:%S}.{_ms(s)}" for s in stamps]
            name = rng.choice(["Date", "Datum", "Data"])
            yield WildLog("log.csv", table([[name, "Time", *NAMES]], [changes, clocks, *values]))


def bare_minutes(rng: random.Random) -> Iterator[WildLog]:
    """Digits MMSS, which begin anew with the hour, and HHMMSS, which do with the day."""
    for hours, name in ((1, "Time"), (1, "time"), (24, "UTC"), (24, "time")):
        begin = 3_600.0 * hours - rng.randrange(5, 15) - 45.0 * (name == "time")
        clock = np.rint((begin + T) * 1000).astype(int) % (3_600_000 * hours)
        digits = [
            f"{ms // 3_600_000:02}{ms // 60_000 % 60:02}{ms // 1000 % 60:02}.{ms % 1000:03}"
            for ms in clock.tolist()
        ]
        yield WildLog("log.csv", timed(name, [x[2 * (hours == 1) :] for x in digits]))


def waveforms(rng: random.Random) -> Iterator[WildLog]:
    """Tables of LabVIEW's waveforms, and of units with a factor."""
    stamps, cells = _stamps(rng), [[f"{x:.2f}" for x in series] for series in (P, V)]
    times = [f"{s:%d.%m.%Y %H:%M:%S}.{_ms(s)}" for s in stamps]
    heads = [["waveform", "[0]", "[1]"], ["t0", times[0], times[0]], ["delta t", "0.02", "0.02"]]
    yield WildLog("log.txt", table([*heads, [], ["time[0]", *NAMES]], [times, *cells], "\t"))
    for above in (["Sample rate: 50 Hz"], ["Interval", "20 ms"], ["Abtastfrequenz [Hz]", "50"]):
        yield WildLog("log.csv", table([above, NAMES], cells, ";"))
    hundredths = [[f"{100 * x:.0f}" for x in series] for series in (P, V)]
    heads = [["Time", "BC pressure", "wheel speed"], ["s", "0.01bar", "0.01km/h"]]
    yield WildLog("log.csv", table(heads, [[f"{x:.2f}" for x in T], *hundredths]))
    heads = [["Time [s]", "BC pressure [in 0.01 bar]", "wheel speed [in 0.01 km/h]"]]
    yield WildLog("log.csv", table(heads, [[f"{x:.2f}" for x in T], *hundredths]))


def influx(rng: random.Random) -> Iterator[WildLog]:
    """Tables of InfluxDB and of historians: a row for each value, with its name."""
    stamps = [f"{s:%Y-%m-%dT%H:%M:%S}.{_ms(s)}Z" for s in _stamps(rng)]
    blocks = [
        [f",,{k},{stamps[0]},{t},{x:.2f},{name},brake" for t, x in zip(stamps, y, strict=True)]
        for k, (name, y) in enumerate((("BC_pressure_bar", P), ("wheel_speed_kmh", V)))
    ]
    above = ["#group,false,false,true,false,false,true,true"]
    above += ["#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,double,string,string"]
    above += ["#default,_result,,,,,,", ",result,table,_start,_time,_value,_field,_measurement"]
    for rows in (
        [*above, *blocks[0], *blocks[1]],
        [*above, *blocks[0], "", *above, *blocks[1]],
        [above[-1], *(row for pair in zip(*blocks, strict=True) for row in pair)],
    ):
        yield WildLog("log.csv", ("\r\n".join(rows) + "\r\n").encode())
    tags = [
        [name, f"{s:%d.%m.%Y %H:%M:%S},{_ms(s)}", f"{x:.2f}".replace(".", ","), "192"]
        for s, *values in zip(_stamps(rng), P, V, strict=True)
        for name, x in zip(("A7.BC_pressure_bar", "A7.wheel_speed_kmh"), values, strict=True)
    ]
    heads = [["TagName", "Timestamp", "Value", "Quality"]]
    yield WildLog("log.csv", table(heads, [list(x) for x in zip(*tags, strict=True)], ";"))


KINDS: dict[str, Callable[[random.Random], Iterator[WildLog]]] = {
    "K1-lvm": segments,
    "K1-blocks": blocks,
    "K1-restarts": restarts,
    "K8-groups": groups,
    "K8-minus": minus,
    "K9-digits": clock_digits,
    "K8-texts": texts,
    "K9-minutes": bare_minutes,
    "K9-ms": bare_milliseconds,
    "K10-half": day_halves,
    "K10-days": day_clocks,
    "K10-sparse": sparse_dates,
    "K10-month": named_months,
    "K10-local": local,
    "K10-iso": iso,
    "K10-dots": dotted,
    "K10-elapsed": elapsed,
    "K10-minutes": minutes,
    "K11": counts,
    "K12": parts,
    "K13-lvm": lvm,
    "K13-heads": heads,
    "K13-types": typed_heads,
    "K13-waveforms": waveforms,
    "K14-lists": lists,
    "K14-remarks": remarks,
    "K16-mark": marks,
    "K16-unit": unit_cells,
    "K17-influx": influx,
}


def variants(kind: str, seed: int = 1) -> list[WildLog]:
    """The logs of a kind."""
    return list(KINDS[kind](random.Random(f"{kind} {seed}")))
