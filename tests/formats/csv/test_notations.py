"""Numbers and times as people's logs write them: each kind in seeded variants."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from helpers import wild_logs
from helpers.pasted import pasted
from helpers.wild_logs import KINDS, ROWS, P, T

from adhesion_cli.analysis import settings
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.time_axis import clean
from adhesion_cli.core.units import in_name, unit
from adhesion_cli.formats.csv import stamps
from adhesion_cli.formats.csv.dialect import split
from adhesion_cli.formats.csv.reader import open_csv
from adhesion_cli.formats.source import ReadOptions

_SOUND = {"time-coarse-spread"}  # it costs no sample


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_log_gives_the_same_samples(tmp_path: Path, kind: str) -> None:
    for log in wild_logs.variants(kind):
        path = tmp_path / log.name
        path.write_bytes(log.text)
        source = open_csv(path, ReadOptions())
        fields = {f.unit or in_name(f.channel)[1]: f for f in source.fields}
        symbol, field = next(
            (u, f)
            for u, f in fields.items()
            if (known := unit(u)) and known.dimension == "pressure"
        )
        (column,) = source.columns([field])
        axis = clean("p", column, int(column.t.min()))
        findings = [*source.findings, *axis.findings]
        expected = _SOUND | ({"csv-rows-skipped"} if kind == "K1-blocks" else set())
        assert {f.code for f in findings if f.severity != "info"} <= expected, log.text[:300]
        known = unit(symbol)
        assert known is not None
        assert len(axis.data.t) == ROWS, log.text[:300]
        assert np.abs((axis.data.t - axis.data.t[0]) / 1e9 - T).max() <= log.apart_s
        assert np.abs(axis.data.value * known.factor / 1e5 - P).max() <= log.pressure_bar


HINTED = {  # logs that are refused, with a hint to paste; what it makes of them
    "steps of 1": ("time", 1.0, 20_000),
    "steps of 1000": ("time", 1000.0, 60_000),
    "beyond 2060": ("t [s]", 10.0, 3_000),
    "a column without a name for it": ("run", 20.0, 3_000),
}


@pytest.mark.parametrize("name", HINTED)
def test_a_hint_about_the_time_gives_a_usual_rate_when_it_is_pasted(
    tmp_path: Path, name: str
) -> None:
    header, step, rows = HINTED[name]
    begin = 1_795_266_307_000 if name == "beyond 2060" else 0
    path = tmp_path / "log.csv"
    lines = (f"{int(begin + k * step)},{k % 7}\n" for k in range(rows))
    path.write_text(f"{header},p [bar]\n" + "".join(lines))
    with pytest.raises(UserError) as error:
        open_csv(path, ReadOptions())
    stated = settings.load(assignments=pasted(error.value.hint), folder=False).read
    source = open_csv(path, stated)
    (column,) = source.columns(source.fields)
    assert 0.5 <= 1e9 / np.median(np.diff(column.t)) <= 20_000.0


def test_a_count_is_known_by_its_size_and_days_of_other_calendars_by_none(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"

    def write(times: np.ndarray) -> None:
        rows = "".join(f"{x},{k % 7}\n" for k, x in enumerate(times.tolist()))
        path.write_text(f"run,p [bar]\n{rows}")

    write(639_151_065_000_000_000 + 200_000 * np.arange(500))
    (column,) = (source := open_csv(path, ReadOptions())).columns(source.fields)
    assert "100 ns since the year 1" in source.time_reason
    assert column.t[0] == np.datetime64("2026-05-23T04:15", "ns").astype(np.int64)
    write(61_369.427083 + np.round(T[:500] / 86_400, 9))
    with pytest.raises(UserError, match="no column is a time") as error:
        open_csv(path, ReadOptions())
    assert not pasted(error.value.hint)


def test_seconds_and_microseconds_of_a_timeval_are_one_time(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    stamps = [divmod(1_795_515_300_000_000 + 20_000 * k, 10**6) for k in range(200)]
    rows = "".join(f"{s},{us},{k % 7}\n" for k, (s, us) in enumerate(stamps))
    path.write_text("tv_sec,tv_usec,p [bar]\n" + rows)
    (column,) = (source := open_csv(path, ReadOptions())).columns(source.fields)
    assert source.absolute
    assert (np.diff(column.t) == 20_000_000).all()


@pytest.mark.parametrize("cell", ["PT", "24-11", "now"])
def test_no_hint_states_a_column_that_cannot_be_read(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,p [bar]\n" + "".join(f"{cell},{k % 3}\n" for k in range(99)))
    with pytest.raises(UserError) as error:
        open_csv(path, ReadOptions())
    assert not pasted(error.value.hint)


def test_decimal_commas_of_one_column_prove_the_points_of_others_to_be_marks(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.csv"
    grouped = [f"{20 * k:,}".replace(",", ".") for k in range(99)]
    rows = "".join(f"{x};{x};{k},25\n" for k, x in enumerate(grouped))
    path.write_text("t [ms];p [mbar];v [km/h]\n" + rows)
    source = open_csv(path, ReadOptions())
    pressure, speed = source.columns(source.fields)
    assert (pressure.value == 20 * np.arange(99)).all()
    assert (speed.value == np.arange(99) + 0.25).all()


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("is_grouped", [False, True])
def test_the_hint_states_the_mark_that_makes_the_numbers_run_smoothly(
    tmp_path: Path, mark: str, is_grouped: bool
) -> None:
    path = tmp_path / "log.csv"
    values = 20 * np.arange(99)[::-1] if is_grouped else 100 + np.arange(99) * 1.003
    cells = [f"{x:,}" if is_grouped else f"{x:.3f}".removesuffix(".000") for x in values]
    rows = "".join(f"{k}\t{re.sub('[.,]', mark, x)}\n" for k, x in enumerate(cells))
    path.write_text("t [s]\tp [mbar]\n" + rows)
    with pytest.raises(UserError, match="grouped thousands") as error:
        open_csv(path, ReadOptions())
    stated = settings.load(assignments=pasted(error.value.hint), folder=False).read
    (column,) = (source := open_csv(path, stated)).columns(source.fields)
    assert np.allclose(column.value, values)


def test_a_column_that_may_be_grouped_or_not_is_left_out_and_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{k / 10:.1f};1.{100 + k};5,5\n".replace(".", ",", 1) for k in range(99))
    path.write_text("t [s];p [mbar];v [km/h]\n" + rows)
    source = open_csv(path, ReadOptions())
    pressure, speed = source.columns(source.fields)
    assert not pressure.valid.any()
    assert speed.valid.all()
    (finding,) = source.findings
    assert (finding.code, finding.channel) == ("csv-no-numbers", "p [mbar]")


@pytest.mark.parametrize("form", ["{:_}", "({})", "{}-"])
def test_digits_in_an_unknown_notation_cost_the_column(tmp_path: Path, form: str) -> None:
    """The other cells of the column are the low numbers, and would be a log of their own."""
    path = tmp_path / "log.csv"
    cells = [form.format(x) if (x := 20 * k) > 999 else str(x) for k in range(99)]
    rows = "".join(f"{k / 10},{cell},5.5\n" for k, cell in enumerate(cells))
    path.write_text(f"t [s],p [mbar],v [km/h]\n{rows}")
    source = open_csv(path, ReadOptions())
    pressure, speed = source.columns(source.fields)
    assert (pressure.valid.any(), speed.valid.all()) == (False, True)
    assert [f.code for f in source.findings] == ["csv-no-numbers"]


def test_marks_between_groups_of_a_clock_leave_its_decimals(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    times = [f"{20 * k:,}" for k in range(500)] + [f"{20 * k + 0.5:,.1f}" for k in range(500, 999)]
    path.write_text("t [ms];p [bar]\n" + "".join(f"{t};{k % 7}\n" for k, t in enumerate(times)))
    (column,) = (source := open_csv(path, ReadOptions())).columns(source.fields)
    assert column.t[499:501].tolist() == [9_980_000_000, 10_000_500_000]
    assert len(column.t) == 999


def test_a_clock_with_groups_and_three_decimals(tmp_path: Path) -> None:
    """Both marks in one cell: the first one separates groups."""
    path = tmp_path / "log.csv"
    times = [f"{1000.125 + 20 * k:,.3f}".translate(str.maketrans(".,", ",.")) for k in range(99)]
    path.write_text("t [ms];p [bar]\n" + "".join(f"{t};{k % 7},5\n" for k, t in enumerate(times)))
    (column,) = (source := open_csv(path, ReadOptions())).columns(source.fields)
    assert np.array_equal(column.t, 1_000_125_000 + 20_000_000 * np.arange(99))


def test_groups_of_digits_beside_decimals_of_another_column(tmp_path: Path) -> None:
    rows = "".join(f"{k / 50:.2f};{(10 * k, '1.234.567')[k == 50]};70.5\n" for k in range(99))
    _, (n, _) = numbers_of(tmp_path / "a.csv", f"t [s];n;v [km/h]\n{rows}")
    assert n.value[49:52].tolist() == [490.0, 1_234_567.0, 510.0]


def test_a_list_of_channels_above_the_table_is_no_other_table(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    above = "No;Name;Unit;Gain\n1;pressure;bar;1.0\n2;speed;km/h;1.0\n3;spare;V;1.0\n\n"
    path.write_text(above + "t [s];p [bar];v [km/h]\n0.0;1;2\n0.1;2;3\n0.2;3;4\n")
    source = open_csv(path, ReadOptions())
    assert [f.channel for f in source.fields] == ["p [bar]", "v [km/h]"]
    source.columns(source.fields)
    assert source.lines == {"above": 6, "used": 3}


def numbers_of(path: Path, text: str, options: ReadOptions | None = None) -> tuple:
    path.write_text(text, "utf-8")
    source = open_csv(path, options or ReadOptions())
    return source, source.columns(source.fields)


@pytest.mark.parametrize("begin", [0, 700])
def test_a_point_that_is_both_decimal_mark_and_group_mark(tmp_path: Path, begin: int) -> None:
    """Where the head shows it, the numbers are right; else the column is left out and named."""
    values = np.maximum(0, np.arange(900) - begin) * 10
    cells = [f"{x:,}".replace(",", ".") for x in values]
    rows = "".join(f"{k / 50:.3f};{c};70.5\n" for k, c in enumerate(cells))
    source, (p, v) = numbers_of(tmp_path / "a.csv", f"t [s];p [mbar];v [km/h]\n{rows}")
    assert (v.value == 70.5).all()
    codes = {f.code: f.channel for f in source.findings}
    if begin:
        assert codes == {"csv-no-numbers": "p [mbar]"}
        assert not p.valid.any()
    else:
        assert not codes
        assert np.array_equal(p.value, values)


@pytest.mark.parametrize(
    ("header", "first", "start"),
    [
        ("Time;ms", "101500", "1970-01-01T10:15:00"),
        ("Time;ms", "1795515300", "2026-11-24T10:15:00"),
        ("Date;Time", "20261124;101500", "2026-11-24T10:15:00"),
    ],
)
def test_parts_of_the_time_in_digits(tmp_path: Path, header: str, first: str, start: str) -> None:
    part = ".{:03d};" if "Date" in header else ";{};"
    rows = [
        f"{first[:-2]}{k // 50:02d}" + part.format(20 * (k % 50)) + f"{k % 7}" for k in range(500)
    ]
    source, (p, *_) = numbers_of(tmp_path / "a.csv", f"{header};p [bar]\n" + "\n".join(rows) + "\n")
    assert np.array_equal(p.t, np.datetime64(start, "ns").astype(int) + np.arange(500) * 20_000_000)
    assert source.absolute == ("1970" not in start)


@pytest.mark.parametrize(
    ("name", "number", "date"),
    [
        ("GPS time [s]", 1479550518, "2026-11-24"),
        ("GPS time [ms]", 1479550518000, "2026-11-24"),
        ("time [s]", 1479550518, "2016-11-19"),
        ("GPS time [s]", 1795515300, "2026-11-24"),
        ("UTC GPS time", 1479550518, "2016-11-19"),
    ],
)
def test_gps_time_is_no_unix_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, number: int, date: str
) -> None:
    monkeypatch.setattr("time.time", lambda: 1_479_600_000.0)  # the day of reading is no reason
    step = 100 if "ms" in name else 0.1
    text = f"{name},p [bar]\n" + "".join(f"{number + k * step:.1f},{k % 7}\n" for k in range(200))
    source, (p,) = numbers_of(tmp_path / "a.csv", text)
    assert str(p.t[0].astype("datetime64[ns]"))[:10] == date
    notes = [f for f in source.findings if f.code == "time-gps"]
    assert len(notes) == 1
    for note in notes:  # the other reading, as the hint states it
        stated = settings.load(assignments=pasted(note.hint), folder=False).read
        other, (p,) = numbers_of(tmp_path / "a.csv", text, stated)
        dates = {date, str(p.t[0].astype("datetime64[ns]"))[:10]}
        assert len(dates) == 2
        assert not [f for f in other.findings if f.code == "time-gps"]


@pytest.mark.parametrize(
    ("date", "clock", "day", "other"),
    [
        ("241126", "101500.{:02d}", "2026-11-24", "2024-11-26"),
        ("261124", "10:15:00.{:02d}", "2024-11-26", "2026-11-24"),
        ("113126", "101500.{:02d}", None, ""),
        ("112426", "101500.{:02d}", "2026-11-24", ""),
        ("10/11/2026", "10:15:00.{:02d}", "2026-11-10", "2026-10-11"),
        ("11/11/2026", "10:15:00.{:02d}", "2026-11-11", ""),
        ("24/11/2026", "10:15:00.{:02d}", "2026-11-24", ""),
        ("week 48", "10:15:00.{:02d}", None, ""),
    ],
)
def test_a_date_in_few_digits_is_read_and_another_order_is_named(
    tmp_path: Path, date: str, clock: str, day: str | None, other: str
) -> None:
    rows = (f"{date};{clock.format(k)};{k % 7}\n" for k in range(100))
    text = "Date;Time;p [bar]\n" + "".join(rows)
    source, (*_, p) = numbers_of(tmp_path / "a.csv", text)
    codes = {f.code: f for f in source.findings}
    assert ("date-not-read" in codes) is (day is None)
    assert ("date-order-guessed" in codes) is bool(other)
    assert source.absolute is (day is not None)
    if day:
        assert str(p.t[0].astype("datetime64[ns]")) == f"{day}T10:15:00.000000000"
    assert np.ptp(p.t) == 990_000_000
    if other:  # as the hint states it
        stated = settings.load(assignments=pasted(codes["date-order-guessed"].hint), folder=False)
        source, (*_, p) = numbers_of(tmp_path / "a.csv", text, stated.read)
        assert str(p.t[0].astype("datetime64[ns]"))[:10] == other
        assert not [f for f in source.findings if f.code == "date-order-guessed"]


def test_a_fine_time_counts_on_from_coarse_stamps(tmp_path: Path) -> None:
    elapsed = np.cumsum(np.random.default_rng(4).choice([0.02, 0.05, 0.31], 400)).round(2)
    stamps = np.datetime64("2026-11-24T10:15:00") + elapsed.astype("timedelta64[s]")
    rows = (f"{t};{e:.2f};{k % 7}\n" for k, (t, e) in enumerate(zip(stamps, elapsed, strict=True)))
    text = "Time;Elapsed [s];p [bar]\n" + "".join(rows)
    source, (*_, p) = numbers_of(tmp_path / "a.csv", text)
    begin = np.datetime64("2026-11-24T10:15:00", "ns").astype(np.int64)
    assert np.abs(p.t - begin - np.rint(elapsed * 1e9)).max() <= 50_000_000
    assert np.array_equal(np.diff(p.t), np.rint(np.diff(elapsed) * 1e9))
    assert source.absolute
    doubtful = text.replace("p [bar]\n", "p [bar]\n-;ms;bar\n")  # the header says seconds
    source, _ = numbers_of(tmp_path / "b.csv", doubtful)
    assert source.time_reason.startswith("column named 'Time'")
    blank = (
        f"{'24.11.2026' * (k % 3 > 0)};10:15:{k // 9:02d};{k / 9:.2f};{k % 7}\n" for k in range(99)
    )
    source, _ = numbers_of(tmp_path / "c.csv", "Date;Time;Elapsed [s];p [bar]\n" + "".join(blank))
    assert source.absolute


def test_a_fine_time_counts_on_from_a_date_in_the_order_that_is_stated(tmp_path: Path) -> None:
    rows = (f"10/11/2026;10:15:{k // 9:02d};{k / 9:.2f};{k % 7}\n" for k in range(99))
    text = "Date;Time;Elapsed [s];p [bar]\n" + "".join(rows)
    source, (*_, p) = numbers_of(tmp_path / "a.csv", text)
    [finding] = [f for f in source.findings if f.code == "date-order-guessed"]
    stated = settings.load(assignments=pasted(finding.hint), folder=False)
    source, (*_, other) = numbers_of(tmp_path / "a.csv", text, stated.read)
    assert np.array_equal(np.diff(other.t), np.diff(p.t))
    assert np.diff(p.t).min() > 0
    days = [str(c.t[0].astype("datetime64[ns]"))[:10] for c in (p, other)]
    assert days == ["2026-11-10", "2026-10-11"]
    assert not [f for f in source.findings if f.code == "date-order-guessed"]


@pytest.mark.parametrize(
    "cell",
    [
        "2026-11-21 13:05:07",
        "2026-11-21T13:05:07.123456789Z",
        "2026-11-21 13:05:07.1234567890",
        "2026-11-21 13:05:07+01:00",
        "2026-11-21 13:05:07,25",
        "2026-11-21 13:05:60",
        "2026-11-21 24:00:00",
        "2026-11-21 13:05",
        "2026-11-21 13:05+01:00",
        "2026-11-21T13:05Z",
        "2026-02-30 13:05:07",
        "2262-12-01 00:00:00",
        "-2026-11-21 13:05:07",
        "",
        None,
    ],
)
def test_stamps_of_iso_8601_say_the_same_beside_other_cells(cell: str | None) -> None:
    """All such stamps together are read by Arrow, others by their pattern."""
    pattern = stamps.STAMPS["colons ymd"]
    alone = stamps.parse(pa.array([cell, cell], pa.string()), pattern)
    beside = stamps.parse(pa.array([cell, "2026-11-21 13:05:07 Uhr"]), pattern)
    assert (alone[0][0], alone[1][0]) == (beside[0][0], beside[1][0])
    assert beside[1][1]


def test_a_stamp_holds_for_the_rows_below_it_that_have_none(tmp_path: Path) -> None:
    rows = (f"{f'2026-11-24 10:15:{k // 50:02d}' * (k % 50 == 0)},{k}\n" for k in range(1500))
    source, (column, *_) = numbers_of(tmp_path / "a.csv", "Time,p [bar]\n" + "".join(rows))
    assert column.value.tolist() == list(range(1500))
    assert (np.diff(column.t)[49::50] == 1_000_000_000).all()
    assert not [f for f in source.findings if f.severity != "info"]
    (axis,) = [clean("p", column, int(column.t[0]))]
    assert np.abs(np.diff(axis.data.t) - 20_000_000).max() < 1_000_000


def test_a_row_of_factors_is_no_data(tmp_path: Path) -> None:
    head = "Name;Time;p\nUnit;s;bar\nFactor;1;0.01\n"
    with pytest.raises(UserError, match="line 3 states factors") as error:
        numbers_of(tmp_path / "a.csv", head + "".join(f";{k};{k % 7}\n" for k in range(60)))
    stated = settings.load(assignments=pasted(error.value.hint), folder=False)
    assert stated.mappings[0].unit == "0.01 bar"
    rows = "".join(f";{k};{k % 7}\n" for k in range(60))
    with pytest.raises(UserError, match="line 1 states factors"):
        numbers_of(tmp_path / "c.csv", "Skalierung;1;0.01\nName;Time [s];p [bar]\n" + rows)
    _, (_, column) = numbers_of(tmp_path / "b.csv", head.replace("0.01", "1.0") + rows)
    assert column.value.tolist() == [k % 7 for k in range(60)]


@pytest.mark.parametrize(
    ("line", "cells"), [("Gain;10;1", "0.41"), ("Slope;2;1", "2.05"), ("LSB;0.1;1", "41")]
)
@pytest.mark.parametrize("is_above", [True, False])
def test_a_gain_that_the_numbers_may_lack_is_refused(
    tmp_path: Path, line: str, cells: str, is_above: bool
) -> None:
    names = "Time [s];p [bar];v [km/h]"
    head = "\n".join([line, names] if is_above else [names, line])
    rows = "".join(f"{k / 50:.2f};{cells};70.1\n" for k in range(60))
    with pytest.raises(UserError, match=f"states factors .'{line[:3]}"):
        numbers_of(tmp_path / "a.csv", f"{head}\n{rows}")


@pytest.mark.parametrize("cell", ["1.#IND", "-1.#QNAN", "1.#INF", "-1.#IND00"])
def test_what_windows_writes_for_no_number_costs_only_its_cells(tmp_path: Path, cell: str) -> None:
    rows = "".join(f"{k / 50:.2f};{cell if k % 7 else 4.11}\n" for k in range(60))
    _, (p,) = numbers_of(tmp_path / "a.csv", f"Time [s];p [bar]\n{rows}")
    assert p.valid.sum() == 9
    assert (p.value[p.valid] == 4.11).all()


@pytest.mark.parametrize(
    "line", ["Gain;1;1", "Resolution;0.01;0.02", "S/N;4712;4713", "Range;10;200"]
)
def test_rows_that_say_something_of_the_columns_are_no_loss(tmp_path: Path, line: str) -> None:
    rows = "".join(f"{k / 50:.2f};4.11;70.1\n" for k in range(60))
    text = f"Time [s];p [bar];v [km/h]\n{line}\n{rows}"
    source, (p, _) = numbers_of(tmp_path / "a.csv", text)
    assert (p.value == 4.11).all()
    assert not source.findings


@pytest.mark.parametrize(
    "results",
    [
        "\nAxle;p;v\n1;4.11;70.1\n2;4.12;70.2\n",
        "Span;4.11;70.1;\nMinimum;4.11;70.1;\nMaximum;4.11;70.1;\n",
    ],
)
def test_results_below_the_samples_are_no_loss(tmp_path: Path, results: str) -> None:
    rows = "".join(f"{k / 50:.2f};4.11;70.1;20\n" for k in range(60))
    text = f"Time [s];p [bar];v [km/h];T [°C]\n{rows}{results}"
    source, _ = numbers_of(tmp_path / "a.csv", text)
    assert [f.code for f in source.findings] == ["statistics-rows"]


@pytest.mark.parametrize("digits", ["04X", "04Xh"])
def test_words_of_hexadecimal_digits_are_no_numbers(tmp_path: Path, digits: str) -> None:
    words = (f"{k * 131:04X}{digits[3:]}" for k in range(99))
    rows = "".join(f"{k / 50:.2f};4.11;{word}\n" for k, word in enumerate(words))
    source, _ = numbers_of(tmp_path / "a.csv", f"Time [s];p [bar];Status\n{rows}")
    assert [f.channel for f in source.fields] == ["p [bar]"]
    assert not source.findings


@pytest.mark.parametrize(
    ("codec", "names"),
    [("big5", "時間,軔缸壓力(bar),速度(km/h)"), ("euc_kr", "시간,제동통 압력(bar),속도(km/h)")],
)
def test_codecs_of_taiwan_and_korea(tmp_path: Path, codec: str, names: str) -> None:
    rows = "".join(f"[2026-11-24 10:15:{k:02}],4.11,70.1\n" for k in range(60))
    (tmp_path / "a.csv").write_bytes(f"{names}\n{rows}".encode(codec))
    source = open_csv(tmp_path / "a.csv", ReadOptions())
    assert [f.channel for f in source.fields] == names.split(",")[1:]
    (p, _) = source.columns(source.fields)
    assert (np.diff(p.t) == 1_000_000_000).all()


def test_a_row_without_a_stamp_beside_rows_that_have_one_is_a_loss(tmp_path: Path) -> None:
    stamps = [f"2026-11-25 10:00:{k // 50:02}.{k % 50 * 20:03}" for k in range(400)]
    rows = (f"{'' if 20 <= k < 320 else t},{k % 7}\n" for k, t in enumerate(stamps))
    source, (column,) = numbers_of(tmp_path / "a.csv", "Time,p [bar]\n" + "".join(rows))
    assert len(column.t) == 100
    (loss,) = [f for f in source.findings if f.code == "csv-rows-skipped"]
    assert loss.count == 300


def test_the_number_of_a_thread_is_no_time(tmp_path: Path) -> None:
    rows = "".join(f"{k / 50},{4000 + 3 * k},{k % 7}\n" for k in range(60))
    _, (_, column) = numbers_of(tmp_path / "a.csv", "time [s],tid,p [bar]\n" + rows)
    assert column.t[-1] == 1_180_000_000


def test_columns_by_number_are_read_below_a_header_of_another_width(tmp_path: Path) -> None:
    text = "time [s],p [bar]\n" + "".join(f"{k},{k % 7},{k % 5}\n" for k in range(60))
    with pytest.raises(UserError, match="names 2 columns, the rows have 3") as error:
        numbers_of(tmp_path / "a.csv", text)
    stated = settings.load(assignments=pasted(error.value.hint), folder=False)
    _, columns = numbers_of(tmp_path / "a.csv", text, stated.read)
    assert [len(c.t) for c in columns] == [60, 60]


def test_a_date_that_is_written_once_is_the_start(tmp_path: Path) -> None:
    for log in wild_logs.variants("K10-sparse"):
        source, (column, *_) = numbers_of(tmp_path / log.name, log.text.decode())
        first = log.text.decode().splitlines()[1].split(",")
        fields = re.split("[./-]", first[0])
        day = "-".join(fields if len(fields[0]) == 4 else fields[::-1])
        assert str(column.t[0].astype("datetime64[ns]"))[:10] == day
        assert "date-not-read" not in {f.code for f in source.findings}


_ELAPSED = [f"{k / 50:.2f}" for k in range(200)]
_CLOCK = [f"09:12:{k // 50 + 3:02}.{k % 50 * 2:02}" for k in range(200)]
_STAMPS = [f"2026-11-26 {x}" for x in _CLOCK]


@pytest.mark.parametrize(
    ("lines", "times", "start"),
    [
        (["Zkouška brzdy;vůz č. 9123", "Datum;26.11.2026"], _CLOCK, "2026-11-26T09:12:03"),
        (["Date: 2026-11-26", "Rate;50"], _CLOCK, "2026-11-26T09:12:03"),
        (["Fecha;26/11/2026"], _CLOCK, "2026-11-26T09:12:03"),
        (["Data: 26.11.2026 09:12"], _CLOCK, "2026-11-26T09:12:03"),
        (["Dátum;2026. 11. 26."], _CLOCK, "2026-11-26T09:12:03"),
        (["Start: 2026-11-26T09:12:03+01:00"], _CLOCK, "2026-11-26T08:12:03"),
        (["Start time: 27.11.2026 14:20:41.500"], _ELAPSED, "2026-11-27T14:20:41.500"),
        (["Datum;27.11.2026", "Uhrzeit;14:20:41"], _ELAPSED, "2026-11-27T14:20:41"),
        (["Start time: 11/27/2026 2:20:41 PM"], _ELAPSED, "2026-11-27T14:20:41"),
        (["Início;27/11/2026 14:20"], _ELAPSED, "2026-11-27T14:20"),
        (["Messbeginn;27.11.2026 14:20 Uhr"], _ELAPSED, "2026-11-27T14:20"),
        (["Datum;27.11.2026", "Startzeit;14:20 Uhr"], _ELAPSED, "2026-11-27T14:20"),
        (["Start: 26.11.2026 08:12:03"], _STAMPS, "2026-11-26T09:12:03"),  # of another zone
        (["Datum;27.11.2026"], _ELAPSED, None),
        (["Kalibrace;26.11.2026", "Exported: 2026-11-28 07:00:00"], _CLOCK, None),
    ],
)
def test_a_date_or_start_above_the_table_dates_the_log(
    tmp_path: Path, lines: list[str], times: list[str], start: str | None
) -> None:
    rows = "".join(f"{t};{k % 7}\n" for k, t in enumerate(times))
    text = "\n".join(lines) + "\n\nTime;p [bar]\n" + rows
    source, (p,) = numbers_of(tmp_path / "a.csv", text)
    assert source.absolute is (start is not None)
    if start:
        assert p.t[0] == np.datetime64(start, "ns").astype(np.int64)
        assert ("taken as UTC" in source.time_reason) is ("+01:00" not in lines[0])
        assert ("above the table" in source.time_reason) is (times is not _STAMPS)
    assert np.ptp(p.t) == 3_980_000_000
    assert not [f for f in source.findings if f.code == "start-not-used"]


@pytest.mark.parametrize(
    ("line", "times", "problem"),
    [
        ("Start: 26.11.2026 11:40:00", _CLOCK, "the first row is at 09:12:03.00"),
        ("Start: 24.11.2026 09:12:03", _STAMPS, "the first row is at 2026-11-26 09:12:03.00"),
        ("Start: 26.11.2026 11:40:00", [f"7{t}" for t in _CLOCK], "the first row is at 709:12"),
        ("Date: 05/11/2026", _CLOCK, "it may be day/month or month/day"),
        ("Start: 05/11/2026 09:12:03", _ELAPSED, "it may be day/month or month/day"),
    ],
)
def test_a_start_that_is_contradicted_or_may_be_another_day_is_reported(
    tmp_path: Path, line: str, times: list[str], problem: str
) -> None:
    rows = "".join(f"{t};{k % 7}\n" for k, t in enumerate(times))
    text = f"{line}\n\nTime;p [bar]\n{rows}"
    source, (p,) = numbers_of(tmp_path / "a.csv", text)
    (note,) = [f for f in source.findings if f.code == "start-not-used"]
    assert note.names["problem"].startswith(problem)
    assert source.absolute is (times is _STAMPS)
    if times is _CLOCK and "/" in line:  # the user knows
        stated = settings.load(assignments=["channels.time.unit=dmy"], folder=False)
        source, (p,) = numbers_of(tmp_path / "a.csv", text, stated.read)
        assert p.t[0] == np.datetime64("2026-11-05T09:12:03", "ns").astype(np.int64)


@pytest.mark.parametrize(("begin", "date"), [("10:00:0", "2026-03-14"), ("23:59:5", None)])
def test_a_date_in_a_later_row_is_the_start_before_midnight(
    tmp_path: Path, begin: str, date: str | None
) -> None:
    times = [f"{begin}{k}" for k in range(10)] + [f"00:00:0{k}" for k in range(10) if not date]
    rows = (
        f"{'14.03.2026' if k == len(times) - 5 else ''},{t},{k % 7}\n" for k, t in enumerate(times)
    )
    text = "Date,Time,p [bar]\n" + "".join(rows)
    source, (column, *_) = numbers_of(tmp_path / "a.csv", text)
    assert source.absolute == bool(date)
    assert not date or str(column.t[0].astype("datetime64[ns]"))[:10] == date
    assert ("date-not-read" in {f.code for f in source.findings}) != bool(date)


def test_a_temperature_that_rises_is_no_second_time(tmp_path: Path) -> None:
    rows = (f"{k / 50},{40 + k**1.1:.3f},{k % 7}\n" for k in range(50))
    source, columns = numbers_of(tmp_path / "a.csv", "Time [s],T1 [°C],p [bar]\n" + "".join(rows))
    assert [f.channel for f in source.fields] == ["T1 [°C]", "p [bar]"]
    assert columns[0].t[-1] == 980_000_000


def test_unix_time_of_today_has_no_note_on_gps(tmp_path: Path) -> None:
    text = "time [s],p [bar]\n" + "".join(f"{1795515300 + k / 10},{k % 7}\n" for k in range(200))
    source, _ = numbers_of(tmp_path / "a.csv", text)
    assert source.findings == []


@pytest.mark.parametrize(
    ("head", "row", "encoding", "names"),
    [
        (
            "時間[s],BC圧力[kPa],車輪速度[km/h]",
            "{t:.2f},{k},70.5",
            "cp932",
            ["BC圧力[kPa]", "車輪速度[km/h]"],
        ),
        (
            "時間[s],ブレーキ[kPa],軸の回転[km/h]",
            "{t:.2f},{k},70.5",
            "cp932",
            ["ブレーキ[kPa]", "軸の回転[km/h]"],
        ),
        ("Time[s],速度[km/h]", "{t:.2f},{k}", "cp932", ["速度[km/h]"]),
        ("Czas[s],Prędkość koła[km/h]", "{t:.2f},{k}", "cp1250", ["Prędkość koła[km/h]"]),
        ("Czas[s],Zestaw kołowy 1[km/h]", "{t:.2f},{k}", "cp1250", ["Zestaw kołowy 1[km/h]"]),
        ("Czas[s],Prędkość koła[km/h]", "{t:.2f},{k}", "cp852", ["Prędkość koła[km/h]"]),
        ("Čas [s],Tlak ve válci [bar]", "{t:.2f},{k}", "cp1250", ["Tlak ve válci [bar]"]),
        ("Время [с],ДАВЛЕНИЕ ТЦ [бар]", "{t:.2f},{k}", "cp1251", ["ДАВЛЕНИЕ ТЦ [бар]"]),
        ('"time_s" "p_bar" "v_kmh"', '"{n}" {t:.2f} {k} 70.5', "utf-8", ["p_bar", "v_kmh"]),
        ("Time,p [bar]", "Tue Nov 24 10:15:{k:02d} GMT+01:00 2026,{k}", "utf-8", ["p [bar]"]),
        ("Time,p [bar]", "Tue Nov 24 10:15:{k:02d} CET 2026,{k}", "utf-8", ["p [bar]"]),
        ("Zeit;p [bar]", "24.11.2026 11:15:{k:02d} MESZ;{k}", "utf-8", ["p [bar]"]),
        ("Időpont;p [bar]", "2026. november 24. 9:15:{k:02d};{k}", "utf-8", ["p [bar]"]),
        ("Zeit;p [bar]", "(24.11.2026 09:15:{k:02d});{k}", "utf-8", ["p [bar]"]),
        ("Heure;p [bar]", "10h15mn{k:02d}.000s;{k}", "utf-8", ["p [bar]"]),
        ("Zeit\tp\ns\tbar\nMessrate=50 Hz\tMX840B_0 CH 1", "{t:.2f}\t{k}", "utf-8", ["p"]),
        (
            "サンプリング周期,20ms\nV [km/h],圧力[bar]",
            "{k},70.5",
            "cp932",
            ["V [km/h]", "圧力[bar]"],
        ),
        ("TraceName,p\nVUnit,bar\nBlockSize,60\nHResolution,0.02\nHUnit,s", ",{k}", "utf-8", ["p"]),
        ("Time;p\ns;bar\n;axle 1", "{t:.2f};{k}", "utf-8", ["p axle 1"]),
        ("Zeit 1 [s]\tp [bar]\nT0\tSG 4-Leiter", "{t:.2f}\t{k}", "utf-8", ["p [bar]"]),
    ],
)
def test_exports_of_other_countries_and_programs(
    tmp_path: Path, head: str, row: str, encoding: str, names: list[str]
) -> None:
    """Shift-JIS of Japan; R, whose header has no name for row numbers; Java's dates; catman."""
    rows = "\n".join(row.format(t=k / 50, k=k, n=k + 1) for k in range(60))
    path = tmp_path / "a.csv"
    path.write_bytes(f"{head}\n{rows}\n".encode(encoding))
    source = open_csv(path, ReadOptions())
    fields = [f for f in source.fields if f.channel != "column 1"]
    assert [f.channel for f in fields] == names
    column, *_ = source.columns(fields)
    assert column.value.tolist() == list(range(60))
    assert (
        not source.absolute or str(column.t[0].astype("datetime64[ns]"))[:16] == "2026-11-24T09:15"
    )


@pytest.mark.parametrize(
    "names",
    [
        ["Bremszylinderdruck [bar]", "Neigung [‰]"],
        ["Längsneigung [‰]", "Außentemperatur [°C]"],
        ["BC–pressure [bar]", "Wheel–speed–axle [km/h]"],
        ["Druck–Ä–b [bar]", "Rad–Öl – Überdruck [bar]"],
        ["Pression [bar]", "Vitesse de l’essieu ’e’e’ [km/h]"],
        ["élément1 [bar]", "vitesse à l’élément [km/h]"],
        ["“Druck” [bar]", "Weg … [m]"],
        ["Luftmenge Nm³h [-]", "Ø Rad [-]"],
    ],
)
def test_marks_of_european_logs_are_no_japanese_or_polish(tmp_path: Path, names: list[str]) -> None:
    rows = "".join(f"{k / 50:.2f};{k};70.5\n" for k in range(60))
    path = tmp_path / "a.csv"
    path.write_bytes(f"Zeit [s];{';'.join(names)}\n{rows}".encode("cp1252"))
    source = open_csv(path, ReadOptions())
    assert [f.channel for f in source.fields] == names


def test_rad_is_a_wheel_in_german_where_no_bracket_says_a_unit() -> None:
    assert in_name("v Rad") == ("v Rad", "")
    assert in_name("angle rad") == ("angle", "rad")


def test_a_clock_of_twelve_hours_goes_on_behind_noon(tmp_path: Path) -> None:
    seconds = [46_790 + k / 10 for k in range(200)]  # from 12:59:50
    times = [
        f"{int(s // 3600 - 1) % 12 + 1:02d}:{int(s // 60) % 60:02d}:{s % 60:04.1f}" for s in seconds
    ]
    rows = "".join(f"{t},{k % 7}\n" for k, t in enumerate(times))
    _, (column,) = numbers_of(tmp_path / "a.csv", f"Time,p [bar]\n{rows}")
    axis = clean("p", column, int(column.t.min()))
    assert [f.code for f in axis.findings] == ["time-wrapped"]
    assert np.array_equal(axis.data.t, np.rint(np.array(seconds) * 10) * 100_000_000)


def test_the_hint_for_a_table_without_names_has_each_column_of_numbers_once(tmp_path: Path) -> None:
    text = "".join(f"{k / 50:.2f};{k % 7}.5\n" for k in range(50))
    with pytest.raises(UserError) as error:
        numbers_of(tmp_path / "a.csv", text)
    stated = settings.load(assignments=pasted(error.value.hint), folder=False)
    assert [m.meaning for m in stated.mappings] == ["pressure"]
    _, (p,) = numbers_of(tmp_path / "a.csv", text, stated.read)
    assert p.value[1] == 1.5


def test_lines_of_a_program_without_columns_of_numbers_get_no_columns_to_state(
    tmp_path: Path,
) -> None:
    rows = (f"2026-11-24 10:15:{k:02d}.000 INFO bcp={k}.5 bar\n" for k in range(50))
    with pytest.raises(UserError, match="no header row and no columns of numbers") as error:
        numbers_of(tmp_path / "a.log", "".join(rows))
    assert error.value.hint == "export the log as a table with a row of names"


def test_values_of_a_car_scanner_are_known_by_the_names_of_their_signals(tmp_path: Path) -> None:
    text = '"SECONDS";"PID";"VALUE";"UNITS"\n' + "".join(
        f'"{36900 + k / 50:.3f}";"{name}";"{k % 7}.5";"{unit}";\n'
        for k in range(50)
        for name, unit in (("BC pressure", "bar"), ("Wheel speed", "km/h"))
    )
    source, _ = numbers_of(tmp_path / "a.csv", text)
    assert [(f.channel, f.unit) for f in source.fields] == [
        ("BC pressure", "bar"),
        ("Wheel speed", "km/h"),
    ]


def test_a_row_that_numbers_the_columns_is_no_sample(tmp_path: Path) -> None:
    rows = "".join(f"{k / 50:.2f},{k % 7}.5,70\n" for k in range(50))
    text = f"Time,BC Pressure,Wheel Speed\nsec,bar,km/h\n1,2,3\n\n{rows}"
    source, (p, _) = numbers_of(tmp_path / "a.csv", text)
    assert (source.rows, p.t[0], p.value[0]) == (50, 0, 0.5)
    text = text.replace("1,2,3\n\n" + rows, "".join(f"{k},{k + 1},{k + 2}\n" for k in range(1, 50)))
    source, (p, _) = numbers_of(tmp_path / "a.csv", text)
    assert (source.rows, p.value[0]) == (49, 2.0)


RAW = "".join(f"{k // 50},{k % 50 * 2:02d};{k % 7},5;70,1\n" for k in range(50))  # s, bar, km/h
DATED = [f"2026-11-24 10:15:0{k / 50:.2f} {k % 7}.5 70.1\n" for k in range(50)]
PAIRS = "".join(f"{20 * k};{k % 7},5;{20 * k};70,1\n" for k in range(50))
TWINCAT = (
    "Name;Brake\nStart;24.11.2026 10:15:00\n\nName;BC pressure [bar];Name;wheel speed [km/h]\n"
    "SymbolName;MAIN.p;SymbolName;MAIN.v\nSampleTime[ms];20;SampleTime[ms];20\n"
    "ScaleFactor;1;ScaleFactor;1\nPort;851;Port;851\n"
)
IN_COMMAS = RAW.replace(",", ".").replace(";", ",")
FACTS = ["Record Length,50,", "Sample Interval,0.02,", *[",,"] * 48]
HEADS = {  # of programs, each above the same rows
    "TwinCAT": TWINCAT + PAIRS,
    "sqlcmd": "ts  bc_pressure_bar wheel_speed_kmh\n---- ---------- --------\n"
    f"{''.join(DATED)}\n(50 rows affected)\n",
    "logging of Python": "asctime,bc_pressure_bar,wheel_speed_kmh\n"
    + "".join(f"{row[:19]},{row[20:22]}0,{row[23:26]},70.1\n" for row in DATED),
    "LeCroy": "LECROY,15132,Waveform\nSegment,TrigTime,TimeSinceSegment1\n"
    f"#1,24-Nov-2026 10:15:00,0\nTime [s],BC pressure [bar],wheel speed [km/h]\n{IN_COMMAS}",
    "catman": f"Zeit 1 - Rate [s];C-Druck [bar];v_Rad [km/h]\n;SN: 123;SN: 124\n{RAW}",
    "an oscilloscope": "x-axis;1;2\nsecond;bar;km/h\n" + RAW,
    "a checksum": f"Time [s];p [bar];v [km/h]\n{RAW}End of file;;\nChecksum;0x3F2A;\n",
}


@pytest.mark.parametrize("name", HEADS)
def test_heads_and_ends_that_programs_write(tmp_path: Path, name: str) -> None:
    source, (p, v) = numbers_of(tmp_path / "a.csv", HEADS[name])
    assert np.array_equal(p.t - p.t[0], np.arange(50) * 20_000_000)
    assert np.allclose(p.value, np.arange(50) % 7 + 0.5)
    assert (v.value == 70.1).all()
    units = [unit(f.unit or in_name(f.channel)[1]) for f in source.fields]
    assert [x and x.name for x in units] == ["bar", "km/h"]
    assert not [f for f in source.findings if f.code != "csv-missing-cells"]


def test_a_remark_between_two_rows_of_a_header_parts_nothing(tmp_path: Path) -> None:
    head = "Time;Axle 1;;Axle 2;\n# exported, by A; B\n[s];p [bar];v [km/h];p [bar];v [km/h]\n"
    rows = "".join(f"{k / 50:.2f};1.5;70.5;2.5;71.5\n" for k in range(50))
    source, _ = numbers_of(tmp_path / "a.csv", head + rows)
    assert [f.channel[:6] for f in source.fields] == ["Axle 1", "Axle 1", "Axle 2", "Axle 2"]


def test_rows_of_errors_are_reported(tmp_path: Path) -> None:
    text = f"t [s];p [bar];v [km/h]\n{RAW}Error;Error;Error\n"
    source, _ = numbers_of(tmp_path / "a.csv", text)
    assert [f.code for f in source.findings] == ["csv-rows-skipped"]


def test_factors_of_twincat_are_refused(tmp_path: Path) -> None:
    text = TWINCAT.replace("ScaleFactor;1", "ScaleFactor;0,1") + PAIRS
    with pytest.raises(UserError, match="line 7 states factors"):
        numbers_of(tmp_path / "a.csv", text)


@pytest.mark.parametrize("interval", ["5 min", "0 s"])
def test_an_interval_that_no_brake_log_has_is_no_time(tmp_path: Path, interval: str) -> None:
    rows = "".join(f"{k % 7}.5;70\n" for k in range(50))
    text = f"Interval: {interval}\nDevice: X\np [bar];v [km/h]\n{rows}"
    with pytest.raises(UserError, match="no column is a time"):
        numbers_of(tmp_path / "a.csv", text)


UNNAMED = {
    "facts beside the table": "".join(
        f"{fact},{row}" for fact, row in zip(FACTS, IN_COMMAS.splitlines(True), strict=True)
    ),
    "stamps": "".join(f"{row[:22]};{row[-9:-6]};70.1\n" for row in DATED),
    "numbers of rows": "Sample;p [bar];v [km/h]\n"
    + "".join(f"{k};{k % 7}.5;70\n" for k in range(50)),
}


@pytest.mark.parametrize("name", UNNAMED)
def test_a_hint_about_columns_works_when_it_is_pasted(tmp_path: Path, name: str) -> None:
    with pytest.raises(UserError) as error:
        numbers_of(tmp_path / "a.csv", UNNAMED[name])
    stated = settings.load(assignments=pasted(error.value.hint), folder=False)
    source, columns = numbers_of(tmp_path / "a.csv", UNNAMED[name], stated.read)
    assert {m.channel for m in stated.mappings} <= {str(f.column) for f in source.fields}
    p = columns[-2]
    assert np.array_equal(p.t - p.t[0], np.arange(50) * 20_000_000)
    assert np.allclose(p.value, np.arange(50) % 7 + 0.5)


def test_decimals_below_two_whole_numbers_stay_decimals(tmp_path: Path) -> None:
    """The rows 0 and 300 may be the ends of a range."""
    speeds = ["0", "300", *(f"{88.56 - k / 8:.3f}" for k in range(50))]
    rows = "".join(f"{k / 50:.3f},{v}\n" for k, v in enumerate(speeds))
    _, (v,) = numbers_of(tmp_path / "a.csv", f"t [s],v [km/h]\n{rows}")
    assert np.allclose(v.value, [float(x) for x in speeds])


def test_underscores_between_the_digits_of_a_stamp(tmp_path: Path) -> None:
    rows = "".join(f"20261124_1015{k // 50:02d}_{k % 50 * 20:03d},{k % 7}\n" for k in range(100))
    source, (p,) = numbers_of(tmp_path / "a.csv", f"Time,p [bar]\n{rows}")
    assert source.absolute
    assert np.array_equal(p.t - p.t[0], np.arange(100) * 20_000_000)


LONG = "Time;Name;Value;Quality\n" + "".join(
    f"{k / 50:.2f};{name};{k % 7}.5;{'Bad' if name[0] == 'p' and 10 <= k < 15 else 'Good'}\n"
    for k in range(50)
    for name in ("p [bar]", "v [km/h]")
)
WIDE = "Time;p [bar];p quality;v [km/h];Quality\n" + "".join(
    f"{k / 50:.2f};{k % 7}.5;{'Bad (comm. failure)' if 10 <= k < 15 else 'Good'};70.5;Bad\n"
    for k in range(50)
)


@pytest.mark.parametrize("text", [LONG, WIDE], ids=["long", "wide"])
def test_values_that_a_historian_calls_bad_are_left_out(tmp_path: Path, text: str) -> None:
    source, (p, v) = numbers_of(tmp_path / "a.csv", text)
    assert np.array_equal(np.flatnonzero(~p.valid), np.arange(10, 15))
    assert v.valid.all()
    (finding,) = (f for f in source.findings if f.severity != "info")
    assert (finding.code, finding.count) == ("value-of-bad-quality", 5)
    assert (finding.spans[0][0], finding.spans[-1][1]) == (0.2, 0.28)


def test_seconds_that_are_far_apart_may_be_milliseconds(tmp_path: Path) -> None:
    """Unless the user states seconds, or their steps are usual for a slow log."""
    path, rows = tmp_path / "a.csv", "".join(f"{20 * k},{k % 7}.5,70\n" for k in range(300))
    head = "Time [s],p [bar],v [km/h]\n"
    with pytest.raises(UserError, match="has steps of 20 s") as error:
        numbers_of(path, head + rows)
    for assignments, step in ((pasted(error.value.hint), 0.02), (["channels.time.unit=s"], 20.0)):
        stated = settings.load(assignments=assignments, folder=False)
        _, (p, _) = numbers_of(path, head + rows, stated.read)
        assert p.t[1] - p.t[0] == step * 1e9
    _, (p, _) = numbers_of(path, head + "".join(f"{5 * k},1.5,70\n" for k in range(300)))
    assert p.t[1] == 5_000_000_000


def test_units_in_the_column_behind_hold_for_all_rows(tmp_path: Path) -> None:
    rows = [f"{k / 50:.2f};{k % 7}00;mbar;{k % 5};m/s\n" for k in range(2_000)]
    head = "Zeit [s];C-Druck;Einheit;v_Rad;Einheit\n"
    source, (p, _) = numbers_of(tmp_path / "a.csv", head + "".join(rows))
    assert [f.unit for f in source.fields] == ["mbar", "m/s"]
    assert p.value[6] == 600.0
    rows[1_500] = rows[1_500].replace("00;mbar", ";bar")  # as of a meter that chooses its range
    with pytest.raises(UserError, match="the unit beside 'C-Druck' changes"):
        numbers_of(tmp_path / "a.csv", head + "".join(rows))
    blocks = [
        f"{k / 50:.2f};{name};{k % 7};{symbol}\n"
        for name, symbol in (("p", "bar"), ("v", "km/h"))
        for k in range(700)
    ]
    source, _ = numbers_of(tmp_path / "a.csv", "Time;Name;Value;Unit\n" + "".join(blocks))
    assert [(f.channel, f.unit) for f in source.fields] == [("p", "bar"), ("v", "km/h")]


def test_no_value_as_databases_and_compilers_write_it(tmp_path: Path) -> None:
    for text in ("\\N", "(null)", "<NULL>", "-1.#IND", "1.#QNAN", "-nan(ind)"):
        rows = "".join(f"{k / 50:.2f};{text if k == 9 else k % 7};70\n" for k in range(100))
        source, (p, _) = numbers_of(tmp_path / "a.csv", f"t [s];p [bar];v [km/h]\n{rows}")
        assert np.flatnonzero(~p.valid).tolist() == [9], text
        assert [f.severity for f in source.findings] == ["info"], text


def test_decimal_commas_with_units_and_lines_below_the_rows(tmp_path: Path) -> None:
    rows = [f"{k / 50:.3f} s;{k % 7 / 10:.2f} bar;70,1 km/h\n" for k in range(100)]
    below = "Max;4,1 bar;70,1 km/h\nAnzahl;100;100\n;Unterschrift;\n"
    text = "Zeit;C-Druck;v Rad\n" + "".join(rows).replace(".", ",") + below
    source, (p, v) = numbers_of(tmp_path / "a.csv", text)
    assert (p.value[6], v.value[0], len(p.t)) == (0.6, 70.1, 100)
    assert [(f.code, f.count) for f in source.findings] == [("statistics-rows", 2)]
    assert [in_name(f"C-Druck [{x}]")[1] for x in ("bar ü", "kPa(G)")] == ["bar ü", "kPa(G)"]


def test_a_column_of_engineering_units(tmp_path: Path) -> None:
    rows = [
        f"{tag},2026-11-24 10:15:{k / 10:06.3f},{k % 7},192,{symbol}\n"
        for tag, symbol in (("BCP_1", "bar"), ("V_1", "km/h"))
        for k in range(100)
    ]
    text = "TagName,DateTime,Value,QualityDetail,EU\n" + "".join(rows)
    source, _ = numbers_of(tmp_path / "a.csv", text)
    assert [(f.channel, f.unit) for f in source.fields] == [("BCP_1", "bar"), ("V_1", "km/h")]


@pytest.mark.parametrize("line", ["Parameter {0};{0}", "# Parameter {0}"])
def test_a_long_preamble_is_no_table(tmp_path: Path, line: str) -> None:
    preamble = "".join(f"{line.format(k)}\n" for k in range(900))
    rows = "".join(f"{k / 50:.2f};{k % 7};70.5\n" for k in range(900))
    source, (p, _) = numbers_of(tmp_path / "a.csv", f"{preamble}t [s];p [bar];v [km/h]\n{rows}")
    assert ([f.channel for f in source.fields], len(p.t)) == (["p [bar]", "v [km/h]"], 900)


@pytest.mark.parametrize("mark", ["\x0b", "\x1c", "\x85", "\u2028"])
def test_marks_that_are_no_line_ends_stay_in_their_cell(mark: str) -> None:
    assert split(f"a{mark}b;2;3", ";") == [f"a{mark}b", "2", "3"]
