"""Logs that must be read right, and logs that must be refused in the right words."""

import gzip
import subprocess
import sys
from ast import literal_eval
from pathlib import Path

import numpy as np
import pytest
from helpers.pasted import pasted
from helpers.trains import START, three_trains

from adhesion_cli.analysis import settings
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.csv.block_parser import Parser
from adhesion_cli.formats.csv.header_words import is_units_row, time_name
from adhesion_cli.formats.csv.reader import CsvSource, open_csv
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.live.table import ArrivingCsv

S = 1_000_000_000
EPOCH = 1_795_266_307 * S  # 2026-11-21 13:05:07 UTC


def read(path: Path, data: bytes | str, **options) -> tuple[CsvSource, dict]:
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    source = open_csv(path, ReadOptions(**options))
    columns = source.columns(source.fields)
    return source, {
        (f.channel, f.group) if f.group else f.channel: c
        for f, c in zip(source.fields, columns, strict=True)
    }


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log.csv"


def codes(source: CsvSource) -> set[str]:
    return {f.code for f in source.findings if f.severity != "info"}


def skipped(source: CsvSource) -> list[tuple[int, str, int]]:
    """Line and text of the first row that is left out for each reason, and how many are."""
    found = [f for f in source.findings if f.code == "csv-rows-skipped"]
    assert len({f.names["reason"] for f in found}) == len(found)
    return [(int(f.values["line"]), literal_eval(f.names["example"]), f.count) for f in found]


PLAIN = "t [s],p,v\n0.00,1.5,20\n0.01,2.5,19\n0.02,3.5,18\n"
T = [0, 10_000_000, 20_000_000]
P, V = [1.5, 2.5, 3.5], [20, 19, 18]
GERMAN = PLAIN.replace(",", ";").replace(".", ",")

SAME = {
    "comma": PLAIN,
    "semicolon, decimal comma": GERMAN,
    "semicolon, decimal point": PLAIN.replace(",", ";"),
    "tab": PLAIN.replace(",", "\t"),
    "tab, decimal comma": PLAIN.replace(",", "\t").replace(".", ","),
    "pipe": PLAIN.replace(",", "|"),
    "blanks": "t[s]  p     v\n 0.00   1.5  20\n 0.01   2.5  19\n 0.02   3.5  18\n",
    "blanks and tabs": "t[s] p v\n0.00 \t1.5 20 \n0.01\t\t2.5   19\n0.02  3.5 18\n",
    "blank after comma": PLAIN.replace(",", ", "),
    "carriage returns": PLAIN.replace("\n", "\r"),
    "CRLF": PLAIN.replace("\n", "\r\n"),
    "no end of line": PLAIN[:-1],
    "byte order mark": "\ufeff" + PLAIN,
    "UTF-16 LE with mark": b"\xff\xfe" + PLAIN.encode("utf-16-le"),
    "UTF-16 BE with mark": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
    "UTF-16 LE": PLAIN.encode("utf-16-le"),
    "UTF-16 BE": PLAIN.encode("utf-16-be"),
    "gzip": gzip.compress(PLAIN.encode()),
    "sep line": "sep=;\n" + GERMAN,
    "quoted": '"t [s]","p","v"\n"0.00","1.5","20"\n"0.01","2.5","19"\n"0.02","3.5","18"\n',
    "blank before quotes": '"t [s]", "p", "v"\n"0.00", "1.5", "20"\n"0.01", "2.5", "19"\n'
    '"0.02", "3.5", "18"\n',
    "stray quotes": 'Pipe 5" wide\n'
    + PLAIN.replace("v\n", 'v,6" note\n')
    .replace("0\n", '0,1"\n')
    .replace("9\n", '9,2"\n')
    .replace("8\n", "8,c\n"),
    "quoted decimal comma": 't [s],p,v\n"0,00","1,5",20\n"0,01","2,5",19\n"0,02","3,5",18\n',
    "preamble": "Vehicle: X,Date: 2026-01-01\nOperator: Y\n\n" + PLAIN,
    "preamble of pairs": "Vehicle,ET 423,\nSample rate,100,\n,,\n" + PLAIN,
    "comment lines": "# made by X\n% rate, 100, Hz\n// more\n" + PLAIN,
    "comments between": PLAIN.replace("0.01,", "# stop, 1, 2\n# x\n0.01,"),
    "commented header": "# " + PLAIN,
    "trailing delimiters": PLAIN.replace("\n", ",\n"),
    "trailing delimiter in rows only": PLAIN.replace("\n", ",\n").replace("v,", "v"),
    "row of delimiters below the names": PLAIN.replace("v\n", "v\n,,\n"),
    "ranges below the names": PLAIN.replace("v\n", "v\nMin. range,0,0\nMax. range,10,99\n"),
    "tabs beside delimiters": GERMAN.replace(";", ";\t"),
    "versions": PLAIN.replace("v\n", "v,version\n")
    .replace("0\n", "0,1.2.3\n")
    .replace("9\n", "9,1.2.3\n")
    .replace("8\n", "8,1.2.3\n"),
    "blank lines": PLAIN.replace("\n", "\n\n"),
    "lines of blanks": PLAIN.replace("\n", "\n  \n"),
    "units row": PLAIN.replace("t [s],p,v\n", "t,p,v\ns,bar,km/h\n"),
    "units row in brackets": PLAIN.replace("t [s],p,v\n", "t,p,v\n[s],[bar],[km/h]\n"),
    "ms": "time_ms,p,v\n0,1.5,20\n10,2.5,19\n20,3.5,18\n",
    "us": "timestamp_us,p,v\n0,1.5,20\n10000,2.5,19\n20000,3.5,18\n",
    "ns": "t [ns],p,v\n0,1.5,20\n10000000,2.5,19\n20000000,3.5,18\n",
    "ms with fraction": "t (ms),p,v\n0.000,1.5,20\n10.000,2.5,19\n20.000,3.5,18\n",
    "Chinese header": "时间(s),p,v\n0,1.5,20\n0.01,2.5,19\n0.02,3.5,18\n".encode("gb18030"),
    "Latin-1 header": (
        "Zeit in s;p;v;T in °C für Öl\n0,00;1,5;20;1\n0,01;2,5;19;1\n0,02;3,5;18;1\n"
    ).encode("cp1252"),
    "exponents": "t [s],p,v\n0E0,1.5e0,2e1\n1E-2,25e-1,+1.9E+01\n2.0e-02,3.5,18.\n",
    "empty column": PLAIN.replace("v\n", "v,w\n")
    .replace("0\n", "0,\n")
    .replace("9\n", "9,\n")
    .replace("8\n", "8,\n"),
    "text column": PLAIN.replace("v\n", "v,state\n")
    .replace("0\n", "0,on\n")
    .replace("9\n", '9,"o,f"\n')
    .replace("8\n", "8,on\n"),
    "quoted quotes": PLAIN.replace("v\n", 'v,"no,te"\n')
    .replace("0\n", '0,"a""b"\n')
    .replace("9\n", '9,""""\n')
    .replace("8\n", "8,c\n"),
    "catman": (
        "HBM_CATMAN_DATAFILE\t5.0\nTitel:\tBremsprobe\nKanäle:\t3\n"
        + GERMAN.replace("t [s]", "Zeit  1 - Standardmessrate [s]").replace(";", "\t")
    ).encode("cp1252"),
    "LabVIEW": "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\n"
    "Channels\t2\t\nSamples\t3\t3\nDate\t2026/11/21\t2026/11/21\nX0\t0.0\t0.0\n"
    "***End_of_Header***\t\t\n" + PLAIN.replace("v\n", "v,Comment\n").replace(",", "\t"),
}


@pytest.mark.parametrize("name", SAME)
def test_reads_the_same_log_in_every_form(log, name):
    source, columns = read(log, SAME[name])
    names = list(columns)
    p, v = columns[names[0]], columns[names[1]]
    assert p.t.tolist() == T
    assert p.value.tolist() == P
    assert v.value.tolist() == V
    assert p.valid.all()
    assert v.valid.all()
    assert p.t is v.t
    assert not codes(source)
    assert source.rows == 3
    assert not source.absolute


STAMPS = {
    "ISO T": ("time", "2026-11-21T13:05:07", "2026-11-21T13:05:07.25"),
    "ISO blank": ("time", "2026-11-21 13:05:07.000", "2026-11-21 13:05:07.250"),
    "ISO Z": ("time", "2026-11-21T13:05:07Z", "2026-11-21T13:05:07.25Z"),
    "ISO offset": ("time", "2026-11-21T15:05:07+02:00", "2026-11-21T15:05:07.25+02:00"),
    "ISO short offset": ("time", "2026-11-21T08:05:07-0500", "2026-11-21T08:05:07.25-0500"),
    "ISO half-hour offset": ("time", "2026-11-21T18:35:07+05:30", "2026-11-21T18:35:07.25+05:30"),
    "ISO comma": ("time", "2026-11-21 13:05:07,000", "2026-11-21 13:05:07,250"),
    "slashes": ("时间", "2026/11/21 13:05:07.0", "2026/11/21 13:05:07.25"),
    "Chinese": ("日期时间", "2026年11月21日 13:05:07.0", "2026年11月21日 13:05:07.25"),
    "milliseconds after colon": ("time", "2026-11-21 13:05:07:000", "2026-11-21 13:05:07:250"),
    "German": ("Zeitstempel", "21.11.2026 13:05:07,000", "21.11.2026 13:05:07,250"),
    "German in Datum": ("Datum", "21.11.2026 13:05:07,000", "21.11.2026 13:05:07,250"),
    "US, day above 12": ("Time", "11/21/2026 1:05:07.000 PM", "11/21/2026 1:05:07.250 PM"),
    "British, day above 12": ("Time", "21/11/2026 13:05:07.000", "21/11/2026 13:05:07.250"),
    "date and time": ("Date;Time", "2026-11-21;13:05:07.000", "2026-11-21;13:05:07.250"),
    "Datum und Uhrzeit": ("Datum;Uhrzeit", "21.11.2026;13:05:07,000", "21.11.2026;13:05:07,250"),
    "epoch s": ("t", "1795266307.000", "1795266307.250"),
    "epoch s, six digits": ("timestamp", "1795266307.000000", "1795266307.250000"),
    "epoch ms": ("t", "1795266307000", "1795266307250"),
    "epoch us": ("t", "1795266307000000", "1795266307250000"),
    "epoch ns": ("t", "1795266307000000000", "1795266307250000000"),
    "epoch, long fraction": (
        "t",
        "1795266307.0000000000000000000",
        "1795266307.2500000000000000000",
    ),
    "epoch with exponent": ("t", "1.795266307e9", "1.79526630725e9"),
    "Excel": ("t", "46347.5452199074", "46347.5452228009"),
}


@pytest.mark.parametrize("delimiter", ["\t", ";"])
@pytest.mark.parametrize("name", STAMPS)
def test_reads_every_form_of_absolute_time(log, name, delimiter):
    header, first, second = STAMPS[name]
    text = f"{header};p\n{first};1\n{second};2\n"
    source, columns = read(log, text.replace(";", delimiter))
    t = columns["p"].t
    tolerance = 50_000 if "Excel" in name else 0
    assert abs(t - [EPOCH, EPOCH + S // 4]).max() <= tolerance
    assert source.absolute
    assert not codes(source)


DATED = {  # first stamp of 2026-11-03 10:15:00 or so, the second one some seconds later
    "German, two digits": ("03.11.26 10:15:00", "03.11.26 10:15:02", "2026-11-03", "(dmy;"),
    "one date": ("03/11/2026 10:15:00", "03/11/2026 10:15:02", "2026-11-03", "one date"),
    "one date, American": ("11/3/26 10:15:00 AM", "11/3/26 10:15:02 AM", "2026-11-03", "month"),
    "month first by its dates": ("11/03/2026 23:59:59", "11/04/2026 00:00:01", "2026-11-03", "mdy"),
    "day first by its dates": ("03/11/26 23:59:59", "04/11/26 00:00:01", "2026-11-03", "dmy"),
    "day above 12 behind": ("11/12/2026 23:59:59", "11/13/2026 00:00:01", "2026-11-12", "(mdy;"),
    "year first": ("26/11/13 23:59:59", "26/11/14 00:00:01", "2026-11-13", "ymd"),
}


@pytest.mark.parametrize("apart", [1, 60_000])  # rows of a date: all in the head, and not
@pytest.mark.parametrize("name", DATED)
def test_dates_decide_what_is_the_day(log, name, apart):
    first, last, date, reason = DATED[name]
    source, columns = read(log, "Time;p\n" + f"{first};1\n" * apart + f"{last};2\n" * 9)
    t = columns["p"].t
    assert t[-1] - t[0] == 2 * S
    assert str(t[:1].astype("datetime64[ns]").astype("datetime64[D]")[0]) == date
    assert reason in source.time_reason


def test_stated_order_of_a_date(log):
    for unit, date in (("dmy", "2003-02-01"), ("mdy", "2003-01-02"), ("ymd", "2001-02-03")):
        text = "Time;p\n" + "".join(f"01/02/03 10:00:0{k};1\n" for k in range(9))
        _, columns = read(log, text, time_channel="Time", time_unit=unit)
        assert str(columns["p"].t[:1].astype("datetime64[ns]")[0])[:10] == date


RELATIVE = {
    "time of day": ("Time;p\n13:05:07,000;1\n13:05:07,250;2\n", {}, 47_107 * S),
    "minutes": ("Zeit [min];p\n0.5;1\n0.75;2\n", {}, 30 * S),
    "stated ms": ("x;p\n1000;1\n1250;2\n", {"time_channel": "x", "time_unit": "ms"}, S),
    "by number": ("1;7\n1.25;8\n1.5;9\n", {"time_channel": "column 1", "time_unit": "s"}, S),
}


@pytest.mark.parametrize("name", RELATIVE)
def test_reads_every_form_of_relative_time(log, name):
    text, options, start = RELATIVE[name]
    source, columns = read(log, text, **options)
    (column,) = columns.values()
    assert column.t[0] == start
    assert not source.absolute


def test_a_time_in_an_unknown_form_is_refused_and_no_measured_column_taken_for_it(log):
    log.write_text("time,p [bar]\n" + "".join(f"T{k}T,{k / 10}\n" for k in range(9)))
    with pytest.raises(UserError, match=r"'time' holds no times .* as 'T0T'") as error:
        open_csv(log, ReadOptions())
    assert "export it in seconds" in error.value.hint


def rows(step: float, n: int, form: str = "g") -> str:
    return "".join(f"{k * step:{form}},1\n" for k in range(n))


@pytest.mark.parametrize(
    ("step", "n", "unit"),
    [(0.01, 3000, "s"), (0.1, 600, "s"), (1, 120, "s"), (10, 10_000, "ms"), (5, 4000, "ms")],
)
def test_decides_the_unit_of_a_bare_time_where_only_one_is_plausible(log, step, n, unit):
    source, columns = read(log, "time,p\n" + rows(step, n, ".10g"))
    assert f"; {unit} (" in source.time_reason
    assert np.diff(columns["p"].t)[0] == step * {"s": S, "ms": 10**6}[unit]
    assert "time-unit-guessed" in {f.code for f in source.findings}


@pytest.mark.parametrize(("step", "n"), [(1, 20_000), (1000, 60_000), (10, 37)])
def test_asks_for_the_unit_where_several_are_plausible(log, step, n):
    log.write_text("time,p\n" + rows(step, n, ".0f"))
    with pytest.raises(UserError, match="unit of time column 'time'") as error:
        open_csv(log, ReadOptions())
    assert pasted(error.value.hint) == ["channels.time.channel=time", "channels.time.unit=ms"]


def test_epoch_nanoseconds_are_exact(log):
    stamps = [1_795_266_307_123_456_789 + k for k in (0, 1, 3)]
    _, columns = read(log, "t_ns,p\n" + "".join(f"{t},1\n" for t in stamps))
    assert columns["p"].t.tolist() == stamps


def test_bad_and_missing_cells_are_counted_apart_and_located(log):
    text = "t [s],p\n0,1\n1,abc\n2,\n3,NaN\n4,1e400\n5,1_000\n6,٣\n7,0x10\n8,-\n9,inf\n10, 5 \n"
    source, columns = read(log, text)
    p = columns["p"]
    assert p.value[p.valid].tolist() == [1, 5]
    assert np.isnan(p.value[~p.valid]).all()
    bad, missing, infinite = (
        next(f for f in source.findings if f.code == c)
        for c in ("csv-bad-cells", "csv-missing-cells", "not-a-number")
    )
    assert (bad.count, bad.channel, bad.severity) == (4, "p", "warning")
    assert (bad.values["line"], bad.names["example"]) == (3, "'abc'")
    assert bad.spans == ((1.0, 1.0), (5.0, 7.0))
    assert (infinite.count, infinite.severity) == (2, "warning")
    assert (infinite.values["line"], infinite.spans) == (6, ((4.0, 4.0), (9.0, 9.0)))
    assert (missing.count, missing.severity) == (3, "info")
    assert (missing.values["line"], missing.spans) == (4, ((2.0, 3.0), (8.0, 8.0)))


def test_cells_that_are_regularly_empty_are_one_stretch(log):
    missing = [*range(2, 42, 8), *range(42, 282, 4)]
    text = "t [s],p\n" + "".join(f"{k},{'' if k in missing else 1}\n" for k in range(300))
    source, _ = read(log, text)
    (lost,) = (f for f in source.findings if f.code == "csv-missing-cells")
    single = ((float(t), float(t)) for t in range(2, 42, 8))
    assert lost.spans == (*single, (42.0, 278.0))


def test_words_beyond_the_most_that_a_state_has_are_reported(log):
    words = ["off"] * 700 + [f"mode {k}" for k in range(16)] + ["off"] * 9
    rows = "".join(f"{k},{k % 7},{word}\n" for k, word in enumerate(words))
    source, _ = read(log, "t [s],p,state\n" + rows)
    (column,) = source.columns(source.texts)
    assert np.flatnonzero(~column.valid).tolist() == [715]
    (lost,) = source.findings
    assert (lost.code, lost.channel, lost.count) == ("csv-bad-cells", "state", 1)
    assert (lost.names["example"], lost.spans) == ("'mode 15'", ((715.0, 715.0),))


@pytest.mark.parametrize("cell", ["inf", "-Infinity", "+INF", "1e400", '"inf"'])
def test_infinity_is_a_value_lost(log, cell):
    rows = "".join(f"{k},{cell if k == 7 else k}\n" for k in range(20))
    source, columns = read(log, "t [s],p\n" + rows)
    assert columns["p"].valid.tolist() == [k != 7 for k in range(20)]
    (lost,) = source.findings
    assert (lost.code, lost.severity, lost.count) == ("not-a-number", "warning", 1)
    assert lost.spans == ((7.0, 7.0),)
    assert lost.values["line"] == 9


@pytest.mark.parametrize(
    ("lines", "codes"),
    [
        ("\nStatistik;\nMin;0,5\nMittelwert:;3,25\nMax.;6\n", {"statistics-rows": 3}),
        ("24.11.2026 10:15 - Aufzeichnung gestoppt\nEOF\n", {}),
        ("Logger;GL840\nRate 50;\nt [s];p\n20;3,5\n", {}),
        ("20.5\n", {"csv-rows-skipped": 1}),
    ],
)
def test_lines_of_a_program_among_the_rows_are_no_loss(log, lines, codes):
    rows = "".join(f"{k};{k % 7},5\n" for k in range(20))
    source, _ = read(log, "Logger;GL840\nRate 50;\nt [s];p\n" + rows + lines)
    assert {f.code: f.count for f in source.findings if f.code != "time-unit-guessed"} == codes


def test_lost_rows_whose_first_cell_is_a_word_are_no_statistics(log):
    rows = "".join(
        f"{'Max' if k > 9 else 'hold'};{'x' if k == 12 else k};{k % 7}\n" for k in range(20)
    )
    source, _ = read(log, "brake step;t [s];p\n" + rows)
    assert skipped(source) == [(14, "Max;x;5", 1)]


def test_remarks_beside_a_time_or_a_result_are_no_lost_rows(log):
    rows = "".join(f"{k};{k},5;20;on\n" for k in range(9))
    remarks = "3;Schnellbremsung ausgelöst\nBremsweg [m];312,5\nStatistik;p [bar];v;state\n"
    source, columns = read(log, "t [s];p [bar];v;state\n" + rows + remarks + "Stdabw.;1,2;3;\n")
    assert (source.lines["comment"], source.lines["statistics"], skipped(source)) == (3, 1, [])
    assert len(columns["v"].value) == 9
    source, _ = read(log, "t [s];state;p;v\n" + "1;apply;2,5;20\n2;apply;2,5;20\n3;apply\n")
    assert [x[1] for x in skipped(source)] == ["3;apply"]  # a row that is cut


def test_states_of_words_and_numbers_are_words(log):
    text = "t [s];p [bar];sanding\n" + "".join(
        f"{k};1,5;{'ein' if k > 4 else 0}\n" for k in range(9)
    )
    source, _ = read(log, text)
    assert [f.words for f in source.texts] == [("0", "ein")]
    assert not source.findings


def test_a_comma_in_the_clock_is_a_decimal_mark_in_all_columns(log):
    rows = "".join(f"10:15:0{k},000;{19 - k},392;{k}\n" for k in range(9))
    _, columns = read(log, "Zeit;v [m/s];n\n" + rows)
    assert columns["v [m/s]"].value[0] == 19.392


def test_a_tenth_of_a_second_is_no_form_of_a_clock(log):
    rows = "".join(f"{k / 10:.1f},1.5\n" for k in range(50))
    _, columns = read(log, "Time [s/10],p [bar]\n" + rows)
    assert columns["p [bar]"].t[-1] == 490_000_000


def test_rows_left_out_are_counted_by_class_and_located(log):
    text = "t [s];p\n0;1\n1;2;3\n2\nabc;4\n;5\n# note; x\n\n3;6\nMaximum;6\n"
    source, columns = read(log, text)
    assert columns["p"].value.tolist() == [1, 6]
    assert source.lines == {
        "above": 1, "used": 2, "too many cells": 1, "too few cells": 1, "time unreadable": 1,
        "statistics": 1, "time missing": 1, "comment": 1, "blank": 1,
    }  # fmt: skip
    assert skipped(source) == [(4, "2", 1), (3, "1;2;3", 1), (6, ";5", 1), (5, "abc;4", 1)]
    spans = [f.spans for f in source.findings if f.code == "csv-rows-skipped"]
    assert spans == [((0.0, 3.0),)] * 4


@pytest.mark.parametrize(
    ("lines", "first_s"),
    [
        ([";7", "10;1", "12;1", "15;1"], 0.0),  # none before it: the one behind it
        (["10;1", "12;1", "x", "15;1", "abc;2"], 2.0),
        (["10;1", "12;1", "abc;3", "y", "15;1"], 2.0),
        (["10;1", "12;1", "15;1", ";4"], 5.0),
        ([*(f"{10 + k};1" for k in range(200_000)), "x", "300000;1"], 199_999.0),  # blocks later
    ],
)
def test_rows_left_out_say_when(log, lines, first_s):
    source, _ = read(log, "t [s];p\n" + "\n".join(lines) + "\n")
    found = [f.spans for f in source.findings if f.code == "csv-rows-skipped"]
    assert min(found)[0][0] == first_s


@pytest.mark.parametrize("end", ["\n", "\r"])
def test_half_a_character_at_the_end_is_a_line(log, end):
    data = b"\xff\xfe" + PLAIN.replace("\n", end).encode("utf-16-le") + b"1"
    source, columns = read(log, data)
    assert columns["p"].value.tolist() == P
    assert source.lines == {"above": 1, "used": 3, "too few cells": 1}


def test_column_with_a_unit_and_no_numbers_is_told(log):
    rows = "".join(f"{k},{k}.5D+00,{k},x,N51\n" for k in range(9))
    source, columns = read(log, "t [s],p [bar],v [km/h],state,lat [deg]\n" + rows)
    assert list(columns) == ["v [km/h]"]
    (told,) = source.findings
    assert (told.code, told.channel, told.count) == ("csv-no-numbers", "p [bar]", 9)
    with pytest.raises(UserError, match=r"bar.*0.5D"):
        open_csv(log, ReadOptions(strict=True))


def test_of_many_rows_of_another_width_a_part_is_looked_at(log, monkeypatch):
    """Half of them stand alone in blocks; of a block the first 10 000 without a row are read."""
    seen: list[str] = []
    kind = Parser._kind
    monkeypatch.setattr(Parser, "_kind", lambda *line: seen.append(line[1]) or kind(*line))
    sound = "".join(f"0.{k:03};1\n" for k in range(700))
    rows = sound + "".join(f"1.{k:03};1\n1;2;3\n\n# a;b;c\nx\n" for k in range(200))
    text = "t [s];p\n" + rows + "x;y;z\nx\n" * 100_000
    source, columns = read(log, text)
    assert 900 <= len(seen) < 100_000
    assert source.lines == {
        "above": 1, "used": 900, "too many cells": 100_200, "too few cells": 100_200,
        "comment": 200, "blank": 200,
    }  # fmt: skip
    assert sum(source.lines.values()) == text.count("\n")
    assert len(columns["p"].value) == 900
    assert skipped(source) == [(706, "x", 100_200), (703, "1;2;3", 100_200)]


def test_second_reading_reports_nothing_twice(log):
    source, _ = read(log, "t [s];p;v\n0;1;1\n1;x;2\n2;3;y\n3;4;5;6\n")
    before = list(source.findings)
    source.columns(source.fields[:1])
    assert source.findings == before


@pytest.mark.parametrize("cell", ["1.2.{}", "1'0{}"])
def test_column_of_digits_that_cannot_be_read_is_reported(log, cell):
    rows = "".join(f"0.{k},{k}.5,{cell.format(k)}\n" for k in range(9))
    source, columns = read(log, "t [s],v,p\n" + rows)
    assert list(columns) == ["v"]
    (told,) = source.findings
    assert (told.code, told.channel, told.count) == ("csv-no-numbers", "p", 9)


def test_temperatures_are_no_times(log):
    text = "T,T1,Datum\n" + "".join(f"{20 - k % 2},{k},2026-11-21 13:05:0{k}\n" for k in range(9))
    source, columns = read(log, text)
    assert list(columns) == ["T", "T1"]
    assert source.absolute


def test_time_in_doubt_gives_way_to_one_that_is_not(log):
    text = "time,timestamp,p\n" + "".join(f"{k},2026-11-21T13:05:0{k}Z,1\n" for k in range(2))
    source, columns = read(log, text)
    assert columns["p"].t[0] == EPOCH - 7 * S
    assert "'timestamp'" in source.time_reason


@pytest.mark.parametrize(
    "other", ["timestamp_ms,{0}5", "GPS time [s],{1}.25", "Zeitstempel,{0}000", "t_raw [s],1{1}"]
)
def test_another_clock_of_the_same_rows_is_told_at_most(log, other):
    """Of another origin or unit, or held."""
    name, cell = other.split(",")
    rows = (f"{k / 100},{cell.format(k, k // 100)},{k}" for k in range(300))
    _, columns = read(log, "\n".join((f"time [s],{name},p [bar]", *rows, "")))
    assert columns["p [bar]"].t.tolist() == [k * S // 100 for k in range(300)]


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("Time [hh:mm:ss.fff]", None), ("Timestamp (UTC)", None), ("elapsed_seconds", "s"),
        ("timeMs", "ms"), ("Zeit in ms", "ms"), ("时间（毫秒）", "ms"), ("Time/s", "s"),
        ("t_us", "us"), ("TIME (µs)", "us"), ("时间戳", None), ("Zeit [min]", "min"),
    ],
)  # fmt: skip
def test_knows_time_by_its_name(header, unit):
    assert time_name(header)
    assert time_name(header)[1] == unit


@pytest.mark.parametrize("header", ["T1", "T [°C]", "Bremszeit", "response time", "times", "speed"])
def test_knows_what_is_no_time(header):
    assert time_name(header) is None


def test_units_stand_below_the_names(log):
    source, columns = read(log, PLAIN.replace("t [s],p,v\n", "t,p,v\ns,bar,km/h\n"))
    assert [f.unit for f in source.fields] == ["bar", "km/h"]
    assert columns[source.fields[0].channel].t.tolist() == T
    assert source.lines["above"] == 2


def test_a_remark_behind_the_first_row_costs_no_row(log):
    text = "t [s],p,Remark\n0,1,go\n" + "".join(f"{k},{k}\n" for k in range(1, 30))
    source, columns = read(log, text)
    assert columns["p"].value.tolist() == [1, *range(1, 30)]
    assert "csv-rows-skipped" not in {f.code for f in source.findings}


def test_names_that_are_numbers_are_a_header_beside_a_time(log):
    _, columns = read(log, "time [s],1,2\n0,1,2\n1,2,3\n2,3,4\n")
    assert list(columns) == ["1", "2"]


def numbered(width: int, first: int, n: int, delimiter: str = ",") -> str:
    return "".join(
        delimiter.join([f"{k / 100:.2f}", *(f"{k % 9 + c}.5" for c in range(1, width))]) + "\n"
        for k in range(first, first + n)
    )


def left_out(source: CsvSource) -> list[tuple[int, str, int]]:
    """What `skipped` gives, once it agrees with the account of lines."""
    found = [f for f in source.findings if f.code == "csv-rows-skipped"]
    assert {f.severity for f in found} == {"warning"}
    count = sum(f.count for f in found)
    assert count == sum(source.lines.values()) - sum(
        source.lines[kind] for kind in ("used", "header", "above")
    )
    return skipped(source)


@pytest.mark.parametrize("widths", [(3, 4), (4, 3)])
def test_rows_above_a_second_header_are_refused(log, widths):
    names = [",".join(["t [s]", "p [bar]", "v [km/h]", "w [km/h]"][:w]) + "\n" for w in widths]
    text = names[0] + numbered(widths[0], 0, 20) + names[1] + numbered(widths[1], 20, 90)
    with pytest.raises(UserError, match=r"line 2 .* another table") as error:
        read(log, text)
    assert "split" in error.value.hint


def test_a_change_of_delimiter_is_refused(log):
    text = "t [s],p,v\n" + numbered(3, 0, 20) + numbered(3, 20, 90, ";")
    with pytest.raises(UserError, match=r"line 2 .* another table"):
        read(log, text)


def test_a_preamble_of_words_and_numbers_is_no_rows(log):
    text = "Vehicle,12\n2026-11-21,13:05:07\nbogie,1\n1,2\ndiameter,0.92,0.91,0.9\n"
    source, _ = read(log, text + "t [s],p,v\n" + numbered(3, 0, 20))
    assert source.reasons["preamble"] == "5 lines (before the header)"
    assert not codes(source)


@pytest.mark.parametrize(
    "second",
    [
        "t [s],v,p",
        "t [s],p [kPa],v",
        "T [s],P,other",
        "p,v,t [s]",
        "Sek,Druck [bar],Weg [km/h]",
        "s,kPa,km/h",
    ],
)
def test_a_later_header_of_other_columns_is_refused(log, second):
    text = f"t [s],p,v\ns,bar,km/h\n{numbered(3, 0, 30)}{second}\n{numbered(3, 30, 50)}"
    with pytest.raises(UserError, match="line 33 is a header of other columns") as error:
        read(log, text)
    assert "split" in error.value.hint


@pytest.mark.parametrize(
    "second",
    ["t [s],p,v", "s,bar,km/h", "\ufefft [s],p,v", '"T [s]", P ,v', "[s],[bar],[km/h]"],
)
def test_the_same_header_again_is_no_loss(log, second):
    text = f"t [s],p,v\ns,bar,km/h\n{numbered(3, 0, 30)}{second}\n{numbered(3, 30, 50)}"
    source, _ = read(log, text, strict=True)
    assert (source.rows, codes(source)) == (80, set())
    assert sum(source.lines.values()) == text.count("\n")
    assert (source.lines["above"], source.lines["header"]) == (2, 1)


@pytest.mark.parametrize("second", ["t [s],p", "lost,lost,lost"])
def test_the_same_header_again_costs_its_own_row(log, second):
    text = f"t [s],p,v\ns,bar,km/h\n{numbered(3, 0, 30)}{second}\n{numbered(3, 30, 50)}"
    source, _ = read(log, text)
    assert source.rows == 80
    assert [count for *_, count in left_out(source)] == [1]


@pytest.mark.parametrize(
    ("names", "start"),
    [
        (("t [s]", "t [s]"), 2.0),
        (("t1 [s]", "t2 [s]"), 2.0),
        (("X_Value", "X_Value"), 2.0),
        (("time", "time 2"), 2.0),
        (("t_p [s]", "t_w [s]"), 0.5),
        (("Time A [s]", "Time speed [s]"), 0.5),
    ],
)
def test_channels_with_times_of_their_own(log, names, start):
    """The first one's are slower, so that its columns end before the others."""
    slow = [f"{k},{k + 0.5}" for k in range(10)] + [","] * 20
    fast = [f"{k / 10 + start:.1f},{k},{k % 3}" for k in range(30)]
    rows = "".join(f"{a},{b}\n" for a, b in zip(slow, fast, strict=True))
    source, columns = read(log, f"{names[0]},p,{names[1]},v,w\n{rows}")
    assert list(columns) == ["p", "v", "w"]
    assert (columns["p"].t == np.arange(10) * S).all()
    assert (columns["p"].value == np.arange(10) + 0.5).all()
    assert (columns["w"].t == np.arange(30) * S // 10 + int(start * S)).all()
    assert (columns["v"].value == np.arange(30)).all()
    assert (source.rows, codes(source)) == (30, set())
    (column,) = source.columns([source.fields[2]])
    assert (column.value == np.arange(30) % 3).all()
    with pytest.raises(UserError, match="times of their own, which arrive apart"):
        ArrivingCsv(source, source.fields)


def test_a_header_again_in_a_long_table_is_no_device(log):
    text = "".join(f"{k / 100},{a},5\n" for k in range(30) for a in (1, 2))
    source, _ = read(log, f"time [s],axle,p\n{text}time [s],axle,p\n{text}")
    assert [f.group for f in source.fields] == ["1", "2"]


def test_the_unit_behind_the_numbers_of_a_column_is_its_unit(log):
    text = "t [s],p,v,note\n" + "".join(f"{k / 100},{k}.5 bar,{k},go {k}\n" for k in range(20))
    source, columns = read(log, text)
    assert columns["p"].value.tolist() == [k + 0.5 for k in range(20)]
    assert [f.unit for f in source.fields] == ["bar", ""]
    assert not source.findings


def test_a_column_whose_cells_change_their_unit_is_left_out(log):
    rows = (f"{k / 100},{k * 10} {'mbar' if k < 15 else 'bar'}\n" for k in range(20))
    source, columns = read(log, "t [s],p\n" + "".join(rows))
    assert not columns["p"].valid.any()
    (finding,) = source.findings
    assert (finding.code, finding.names["example"]) == ("csv-no-numbers", "'150 bar'")


def test_words_that_begin_late_in_a_column_are_no_damage(log):
    source, _ = read(
        log, "t [s],p,event\n" + "".join(f"{k},1,\n" for k in range(900)) + "900,1,go\n"
    )
    assert not codes(source)
    assert "csv-bad-cells" in {f.code for f in source.findings}


@pytest.mark.parametrize("end", ["\x1a", "\x1a\x1a"])
def test_the_end_of_a_file_as_dos_marked_it_is_none_of_its_rows(log, end):
    source, columns = read(log, PLAIN + end)
    assert not source.findings
    assert columns["p"].value.tolist() == P


def test_strict_refuses_what_would_be_a_finding(log):
    log.write_text("t [s];p\n0;1\n1;x\n2;3\n")
    source = open_csv(log, ReadOptions(strict=True))
    with pytest.raises(UserError, match=r"p: .*no number"):
        source.columns(source.fields)


def test_units_row_gives_units_and_header_text_stays(log):
    text = "Zeit;BC pressure [kPa];v\n[s];[bar];[km/h]\n0;1;2\n1;2;3\n"
    log.write_text(text)
    fields = open_csv(log, ReadOptions()).fields
    assert [(f.channel, f.unit, f.unit_from) for f in fields] == [
        ("BC pressure [kPa]", "bar", "units row"),
        ("v", "km/h", "units row"),
    ]


_ROWS = [f"{i / 100:.2f}\t{1 + i / 7:.4f}\t{70 - i / 9:.4f}" for i in range(30)]
_UNNAMED = "".join(f"\t{row}\n" for row in _ROWS)


def test_a_remark_beside_a_row_is_no_label(log):
    _, columns = read(log, "Remark\tTime\tp\tv\nbegin\t-0.01\t5.25\t80\n" + _UNNAMED)
    assert columns["p"].value[:2].tolist() == [5.25, 1.0]


def test_units_row_may_hold_a_unit_we_do_not_know(log):
    text = "Zeit;Druck;v;Luft;Rate\nhh:mm:ss.fff;bar;km/h;Nl/min;Hz\n"
    log.write_text(text + "13:05:07,0;1;2;3;4\n13:05:07,5;1;2;3;4\n")
    fields = open_csv(log, ReadOptions()).fields
    assert [(f.channel, f.unit) for f in fields] == [
        ("Druck", "bar"), ("v", "km/h"), ("Luft", "Nl/min"), ("Rate", "Hz"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "row", [["t", "p", "v"], ["a", "x"], ["time", "bar", "pressure"], ["-", ""]]
)
def test_short_names_are_no_units_row(row):
    assert not is_units_row(row)


@pytest.mark.parametrize("unit", ["rads", "radps", "kph", "kmph", "mps"])
def test_a_unit_at_the_end_of_a_name_stays_there_and_makes_no_time(log, unit):
    name = f"wheel_speed_1_{unit}"
    source, columns = read(log, PLAIN.replace(",v\n", f",{name}\n"))
    assert list(columns) == ["p", name]
    assert source.fields[1].unit == ""
    source, _ = read(log, PLAIN.replace("t [s],p,v\n", f"t,p,v\ns,bar,{unit}\n"))
    assert source.fields[1].unit == unit


def test_header_rows_are_joined(log):
    _, columns = read(
        log, ",Axle 1,,Axle 2,\nt,p,v,p,v\ns,bar,km/h,bar,km/h\n0,1,2,3,4\n1,2,3,4,5\n"
    )
    assert {k: c.value[0] for k, c in columns.items()} == {
        "Axle 1 p": 1, "Axle 1 v": 2, "Axle 2 p": 3, "Axle 2 v": 4,
    }  # fmt: skip


def test_duplicate_names_are_made_distinct(log):
    source, columns = read(log, "t [s],x,x\n0,1,2\n1,2,3\n")
    assert list(columns) == ["x", "x (2)"]
    assert columns["x (2)"].value.tolist() == [2, 3]
    assert not source.findings


LONG = "time [s],axle,p\n0,1,10\n0,2,20\n0.1,1,11\n0.1,2,21\n0.2,1,12\n0.2,2,22\n"


@pytest.mark.parametrize(
    "line",
    ["Sample rate,100 Hz", "Sample rate [kHz],0.1", "Sampling rate,100", "Sampling rate,0.1,kHz",
     "Sample interval,0.01 s", "Sample interval [ms],10"],
)  # fmt: skip
def test_rows_without_a_time_are_counted(log, line):
    _, columns = read(log, f"{line}\np [bar],v [km/h]\n1.5,20.1\n2.5,19.2\n3.5,18.3\n")
    assert next(iter(columns.values())).t.tolist() == [0, S // 100, S // 50]


def test_long_layout_is_found_by_its_name(log):
    source, columns = read(log, LONG)
    assert columns["p", "1"].value.tolist() == [10, 11, 12]
    assert columns["p", "2"].value.tolist() == [20, 21, 22]
    assert columns["p", "2"].t.tolist() == [0, S // 10, S // 5]
    assert "long-layout" in {f.code for f in source.findings}


@pytest.mark.parametrize("names", ["Señal;Valor", "Segnale;Valore", "Sygnał;Wartość"])
def test_a_table_of_signals_is_known_in_other_languages(log, names):
    rows = "".join(f"{k / 10};p [bar];{k}.5\n{k / 10};v [km/h];{90 - k}.5\n" for k in range(9))
    _, columns = read(log, f"t [s];{names}\n{rows}")
    assert {name: len(column.value) for name, column in columns.items()} == {
        "p [bar]": 9, "v [km/h]": 9,
    }  # fmt: skip


@pytest.mark.parametrize(
    "names", ["Hora;Minuto;Segundo;Milisegundo", "Stunden;Minuten;Sekunden;Millisekunden"]
)
def test_parts_of_the_time_are_known_in_other_languages(log, names):
    rows = "".join(f"13;5;{k // 4};{k % 4 * 250};{k}.5\n" for k in range(12))
    _, columns = read(log, f"{names};p\n{rows}")
    assert np.diff(columns["p"].t).tolist() == [S // 4] * 11


def test_long_layout_one_device_after_the_other(log):
    head, *body = LONG.splitlines(keepends=True)
    _, columns = read(log, head + "".join(body[0::2] + body[1::2]))
    assert columns["p", "2"].value.tolist() == [20, 21, 22]


def test_long_layout_with_rounded_stamps(log):
    samples = ((k, axle) for k in range(200) for axle in (1, 2))
    rows = [f"{k // 5 / 100},{axle},{10 * axle + k / 1000}\n" for k, axle in samples]
    _, columns = read(log, "time [s],axle,p\n" + "".join(rows))
    assert [len(columns["p", axle].t) for axle in ("1", "2")] == [200, 200]


TWO_KEYS = "time [s],car,axle,p\n" + "".join(
    f"{k / 10 + late * (2 * car + axle):.4g},{car},{axle},{100 * car + 10 * axle + k}\n"
    for late in (0, 0.01)
    for k in range(20 * (late > 0), 20 + 20 * (late > 0))
    for car in (1, 2)
    for axle in (1, 2)
)  # half of it with one stamp for all, half with one for each row


def test_two_columns_tell_series_apart(log):
    source, columns = read(log, TWO_KEYS)
    assert [group for _, group in columns] == ["1, 1", "1, 2", "2, 1", "2, 2"]
    assert columns["p", "2, 1"].value.tolist() == [210 + k for k in range(40)]
    (told,) = (f for f in source.findings if f.code == "long-layout")
    assert (told.channel, told.count, told.values) == ("car", 4, {"series": 4})
    assert "'1, 1'" in told.names["titles"]


def test_the_rows_of_one_car_are_told_apart_by_axle(log):
    source, columns = read(log, TWO_KEYS, group_channel="car", group_equals="2")
    assert [group for _, group in columns] == ["1", "2"]
    assert columns["p", "2"].value.tolist() == [220 + k for k in range(40)]
    assert source.lines["other group"] == 80


def test_a_column_that_repeats_another_is_no_part_of_the_name(log):
    text = (
        LONG.replace("axle", "axle,sensor,unit").replace(",1,", ",1,a,u,").replace(",2,", ",2,b,u,")
    )
    _, columns = read(log, text)
    assert list(columns) == [("p", "1"), ("p", "2")]
    assert columns["p", "2"].value.tolist() == [20, 21, 22]


def test_table_of_signals(log):
    text = "time [s];Kanal;Wert;Einheit\n" + "".join(
        f"{k},5;v Achse 1;{k},25;km/h\n" + (f"{k},5;BCP 1;{k};bar\n" if k % 2 else "")
        for k in range(40)
    )
    source, columns = read(log, text)
    assert [(f.channel, f.group, f.unit, f.unit_from) for f in source.fields] == [
        ("v Achse 1", "", "km/h", "units column"), ("BCP 1", "", "bar", "units column"),
    ]  # fmt: skip
    assert columns["BCP 1"].value.tolist() == [*range(1, 40, 2)]
    assert columns["v Achse 1"].t.tolist() == [k * S + S // 2 for k in range(40)]


def test_signal_that_changes_its_unit_is_two_series(log):
    text = "time [s],signal,value,unit\n" + "".join(
        f"{k},p,{k},{'bar' if k < 20 else 'kPa'}\n{k},v,1,km/h\n" for k in range(40)
    )
    source, _ = read(log, text)
    assert sorted((f.channel, f.unit) for f in source.fields) == [
        ("p", "bar"), ("p", "kPa"), ("v", "km/h"),
    ]  # fmt: skip


def test_row_number_called_id_is_no_device(log):
    _, columns = read(log, "id,t [s],p\n" + "".join(f"{k},{k / 8},1\n" for k in range(20_000)))
    assert list(columns) == ["id", "p"]
    assert len(columns["p"].t) == 20_000


def test_group_of_very_many_values_is_refused(log):
    log.write_text("t [s],x,p\n" + "".join(f"{k},{k},1\n" for k in range(5000)))
    with pytest.raises(UserError, match="too many to be devices"):
        open_csv(log, ReadOptions(group_channel="x"))


def test_group_keeps_only_the_rows_asked_for(log):
    source, columns = read(
        log, LONG.replace("axle", "x"), group_channel="x", group_equals="2", time_channel="time [s]"
    )
    assert columns["p", "2"].value.tolist() == [20, 21, 22]
    assert source.lines["other group"] == 3
    assert source.rows == 6


@pytest.mark.parametrize(
    ("stated", "text", "hint"),
    [
        ({"delimiter": "§"}, "delimiter '§' is not one character between cells", '"tab"'),
        ({"delimiter": '"'}, "is not one character between cells", '"tab"'),
        ({"delimiter": ";;"}, "is not one character between cells", '"tab"'),
        ({"encoding": "base64"}, "unknown encoding 'base64'", "cp1252"),
        ({"encoding": "foo"}, "unknown encoding 'foo'", "cp1252"),
        (
            {"time_channel": "t [s]", "time_unit": "iso"},
            "column 't .s.' holds no times that can be read, as '0.00'",
            "one of ns, us, ms, s",
        ),
        ({"time_unit": "weeks"}, "unknown time unit 'weeks'", "known: ns"),
    ],
)
def test_what_is_stated_and_cannot_be_is_refused(log, stated, text, hint):
    log.write_text(PLAIN.replace(",", "§") if "§" in stated.values() else PLAIN)
    with pytest.raises(UserError, match=text) as error:
        open_csv(log, ReadOptions(**stated))
    assert hint in error.value.hint


def options_of(hint):
    """The reading options that a hint states."""
    return settings.load(assignments=pasted(hint), folder=False).read


def test_the_line_on_devices_reads_one_and_then_the_other(log):
    log.write_text(LONG)
    options = ReadOptions()
    for code, group in (("long-layout", "1"), ("one-device-read", "2")):
        (found,) = (f for f in open_csv(log, options).findings if f.code == code)
        options = options_of(found.hint)
        assert {f.group for f in open_csv(log, options).fields} == {group}


@pytest.mark.parametrize("devices", [2, 5000])
def test_the_line_in_a_refusal_of_devices_names_one(log, devices):
    log.write_text("t [s],x,p\n" + "".join(f"{k},{k % devices},1\n" for k in range(5000)))
    with pytest.raises(UserError, match=r"too many|no row") as error:
        open_csv(log, ReadOptions(group_channel="x", group_equals="9" if devices < 9 else None))
    options = options_of(error.value.hint)
    assert (options.group_channel, options.group_equals) == ("x", "0")


def test_unknown_group_value_names_the_known_ones(log):
    log.write_text(LONG)
    with pytest.raises(UserError, match="no row has '7'") as error:
        open_csv(log, ReadOptions(group_channel="axle", group_equals="7"))
    assert "1, 2" in error.value.hint


@pytest.mark.parametrize("name", ["x [s]", "Test time", "sec"])
def test_a_rising_column_that_says_time_is_one(log, name):
    source, columns = read(log, f"idx,{name},p\n1,0.0,5\n2,0.5,7\n3,1.0,6\n")
    assert columns["p"].t.tolist() == [0, S // 2, S]
    assert not codes(source)


@pytest.mark.parametrize("name", ["", "k", "a", "Scan", "Distance [m]", "angle [°]"])
def test_what_rises_but_counts_rows_or_is_measured_is_no_time(log, name):
    log.write_text(f"{name},p,v\n" + "".join(f"{k},1.5,{9 - k}\n" for k in range(9)))
    with pytest.raises(UserError, match="no column is a time") as error:
        open_csv(log, ReadOptions())
    assert "channels.time.channel=" in error.value.hint
    assert open_csv(log, ReadOptions(time_channel="column 1", time_unit="s")).fields


def test_no_count_of_rows_stands_in_for_stamps_that_cannot_be_read(log):
    log.write_text("x,Timestamp,p\n" + "".join(f"{k}.5,day {k},1.5\n" for k in range(9)))
    with pytest.raises(UserError, match="'Timestamp' holds no times that can be read, as 'day 0'"):
        open_csv(log, ReadOptions())


def test_stamps_of_which_some_have_a_zone(log):
    text = "".join(f"2026-11-21T13:05:0{k}{'Z' * (k % 3 > 0)},1\n" for k in range(9))
    source, columns = read(log, "time,p\n" + text)
    assert np.diff(columns["p"].t).tolist() == [S] * 8
    assert "UTC where no zone is stated" in source.time_reason


def test_log_order_is_kept(log):
    _, columns = read(log, "t [s],p\n5,1\n3,2\n3,3\n9,4\n")
    assert columns["p"].t.tolist() == [5 * S, 3 * S, 3 * S, 9 * S]


@pytest.mark.parametrize("rows", [2_000, 200_000])  # in the head, and behind it
def test_space_never_written_costs_only_its_rows(log, rows):
    lines = b"".join(b"%d,1.5\n" % k for k in range(rows))
    hole = lines[:-20].rindex(b"\n") - 3  # begins and ends inside a row: neither half is used
    text = lines[:hole] + b"\0" * 4096 + lines[hole + 13 :]
    source, columns = read(log, b"t [s],p\n" + text + b"\0" * 70_000)
    lost = lines[: hole + 14].count(b"\n") - lines[:hole].count(b"\n") + 1
    assert len(columns["p"].t) == rows - lost
    assert columns["p"].valid.all()
    assert source.lines["NUL bytes"] == 2
    assert skipped(source) == [(lines[:hole].count(10) + 2, "\0", 2)]


@pytest.mark.parametrize("rows", [2_000, 50_000])  # less than the head, and more
@pytest.mark.parametrize("damage", ["cut off", "checksum"])
def test_damaged_gzip_is_read_up_to_the_damage(log, rows, damage):
    text = "t [s],p\n" + "".join(f"{k},{k % 77}.5\n" for k in range(rows))
    packed = gzip.compress(text.encode())
    data = packed[:-1_000] if damage == "cut off" else packed[:-8] + b"\0" * 8
    source, columns = read(log, data)
    (found,) = (f for f in source.findings if f.severity != "info")
    assert (found.code, found.severity) == ("csv-gzip-damaged", "error")
    n = len(columns["p"].t)
    assert found.values["line"] == n + 1
    assert found.spans == ((n - 1.0, n - 1.0),)
    assert columns["p"].value.tolist() == [k % 77 + 0.5 for k in range(n)]  # no part of a number
    assert n == rows if damage == "checksum" else rows / 4 < n < rows
    assert not any(f.code == "csv-no-final-newline" for f in source.findings)
    with pytest.raises(UserError, match="Compressed data are damaged"):
        read(log, data, strict=True)


def test_gzip_without_a_whole_byte_is_refused(log):
    with pytest.raises(UserError, match="packed data are damaged"):
        read(log, gzip.compress(PLAIN.encode())[:8])


@pytest.mark.parametrize("rows", [9, 300_000])
def test_a_row_of_several_lines_is_left_out(log, rows):
    head = "".join(f"{k},{k},1\n" for k in range(rows))
    source, columns = read(log, f't [s],p,"note"\n{head}{rows},5,"a\nb"\n{rows + 1},6,"c"\n')
    assert columns["p"].value[-2:].tolist() == [rows - 1, 6]
    assert source.lines == {"above": 1, "used": rows + 1, "too few cells": 2}


def test_elapsed_times_pass_a_day(tmp_path: Path) -> None:
    log = tmp_path / "a.csv"
    stamps = [f"{h:02}:{m:02}:{s:02}.500" for h, m, s in ((23, 59, 59), (24, 0, 0), (100, 0, 1))]
    log.write_text("Dauer,p [bar]\n" + "".join(f"{t},1.5\n" for t in stamps))
    source = open_csv(log, ReadOptions())
    (column,) = source.columns(source.fields)
    assert not source.absolute
    assert (column.t // 500_000_000).tolist() == [172_799, 172_801, 720_003]


def test_a_date_has_no_hour_24(tmp_path: Path) -> None:
    log = tmp_path / "a.csv"
    hours = ("23:00:00", "24:00:00", "23:00:02")
    log.write_text("time,p [bar]\n" + "".join(f"2026-11-21 {h},1.5\n" for h in hours))
    source = open_csv(log, ReadOptions())
    source.columns(source.fields)
    (finding,) = source.findings
    assert finding.code == "csv-rows-skipped"


def test_a_time_above_a_column_without_a_name_is_a_part_of_the_header(tmp_path: Path) -> None:
    """As a spreadsheet writes heads that are merged."""
    log = tmp_path / "a.csv"
    heads = "Prüfer;Müller;\nZeit [s];Achse 1;\n;p [bar];v [km/h]\n"
    log.write_text(heads + "".join(f"{k / 50};1.5;{80 - k}\n" for k in range(9)))
    source = open_csv(log, ReadOptions())
    assert [f.channel for f in source.fields] == ["Achse 1 p [bar]", "Achse 1 v [km/h]"]


REFUSED = {
    "empty": (b"", "is empty", "header and data"),
    "only blanks": (b"\n \n\n", "is empty", "header and data"),
    "header only": (b"t [s],p 1 [bar],v 1 [km/h]\n", "1 line and no data rows", "data rows"),
    "header and units only": (b"t;p;v\ns;bar;km/h\n", "no data rows", "data rows"),
    "one row": (b"t [s],p\n0,1\n", "1 data row", "several rows"),
    "binary": (bytes(range(1, 256)) * 40, "binary", "one of the formats"),
    "NUL bytes": (b"t,p\n0,1\n" + b"1,\0\0\0\0\0\n" * 9, "NUL bytes in line 3", "text log"),
    "HTML": (b"<!DOCTYPE html><html><body><table>", "HTML", "download"),
    "HTML behind a remark": (b"<!-- saved --><html><body>\n<table>\n", "HTML", "download"),
    "JSON": (b'[{"t": 0, "p": 1}, {"t": 1, "p": 2}]', "JSON", "export"),
    "no header": (
        b"0,1,2\n1,2,3\n2,3,4\n",
        "no header",
        "--set channels.time.channel=1 --set channels.time.unit=s",
    ),
    "header of other width": (
        b"t [s],p\n0,1,2\n1,2,3\n2,3,4\n",
        "names 2 columns, the rows have 3",
        "csv.header=false",
    ),
    "decimal comma as delimiter": (
        b"t [s],p,v\n" + b"".join(b"0,%02d,1,50,80,05\n" % k for k in range(9)),
        "names 3 columns, the rows have 6",
        "semicolons",
    ),
    "only NUL bytes": (bytes(2_000_000), "holds nothing but NUL bytes", "again"),
    "no line end": (b"1" * 50_000_000, "no line end", "one row per line"),
    "20000 columns": (
        b"\n".join([b",".join([b"%d" % k for k in range(20_000)])] * 3),
        "20000 columns",
        "channels",
    ),
    "cell of 10 MB in the first row": (
        b't [s],p\n0,"' + b"x" * 10_000_000 + b'"\n1,2\n',
        "line 2 is longer than 512 KiB",
        "one row per line",
    ),
    "comma, thousands or decimal": (
        b"t;p\n1;1,234\n2;2,345\n3;3,456\n",
        "decimal comma or grouped",
        "decimal",
    ),
    "point, thousands or decimal": (
        b"t [s];p\n1;1.234\n2;987\n3;1.002\n",
        "grouped thousands or a decimal",
        "decimal",
    ),
    "no time": (b"p,v\n5,1\n3,2\n4,1\n", "no column is a time", "a column of times"),
    "day or month": (
        b"Time;p\n01/02/2026 13:00:00;1\n05/03/2026 13:00:01;2\n",
        "day/month or month/day",
        """--set channels.time.channel=Time --set channels.time.unit=dmy` (or "mdy")""",
    ),
    "day, month or short year": (
        b"Time;p\n01/02/03 13:00:00;1\n05/03/04 13:00:01;2\n",
        "day/month or month/day or year/month/day",
        '(or "mdy" or "ymd")',
    ),
    "date only": (
        b"Date;p\n2026-01-01;1\n2026-01-01;2\n",
        "no column is a time",
        "a column of times",
    ),
    "seconds beyond 2060": (
        b"t [s];p\n1795266307000;1\n1795266307010;2\n",
        "beyond the year 2060",
        "unit",
    ),
    "numbered times of other channels": (
        b"t1 [s];t2 [s];p;v\n0;5;1;1\n1;6;2;2\n",
        "both times, and differ",
        '--set "channels.time.channel=column 1"',
    ),
    "times of two clocks": (
        b"PC time [s];p;GPS time [s];v\n"
        + b"".join(b"%d;1;%.1f;1\n" % (k, k / 2 + 7_000) for k in range(9)),
        "'GPS time .s.' and 'PC time .s.' are both times, and differ",
        "one time axis",
    ),
    "a unit of time stated twice": (
        b"time_ms;p\ns;bar\n0;1\n0.01;2\n0.02;3\n",
        "unit of time column 'time_ms' is stated twice: 's' .units row. and 'ms' .header.",
        "channels.time.channel=time_ms",
    ),
    "hours and minutes": (
        b"Time;p\n12:05;1\n12:06;2\n",
        "'Time' holds no times that can be read, as '12:05'",
        "13:05:07",
    ),
    "clock stands still": (
        b"t [s],p\n5.0,1\n5.0,2\n5.0,3\n",
        "clock stands still: all 3 rows have '5.0' in column 't .s.'",
        "channels.time.channel=p",
    ),
    "time runs backwards": (
        b"t [s],p\n" + b"".join(b"%d,%d\n" % (99 - k, k) for k in range(9)),
        "'t .s.' runs backwards .from 99 to 91.",
        "oldest first",
    ),
    "stamps run backwards": (
        b"time,p\n" + b"".join(b"2026-01-01 00:00:%02d,%d\n" % (30 - k, k) for k in range(9)),
        "'time' runs backwards",
        "oldest first",
    ),
    "no delimiter": (b"speed\n1.5\n2.5\n3.5\n", "no delimiter", "time column"),
}


def test_a_point_that_is_a_decimal_mark_elsewhere_groups_no_digits(log):
    _, columns = read(log, b"t [s],p,v\n0.00,0.01,19.001\n0.01,0.02,19\n0.02,0.02,18.998\n")
    assert columns["v"].value.tolist() == [19.001, 19.0, 18.998]


@pytest.mark.parametrize("name", REFUSED)
def test_refuses_in_the_right_words(log, name):
    data, text, hint = REFUSED[name]
    with pytest.raises(UserError, match=text) as error:
        read(log, data)
    assert str(log) in error.value.text
    assert hint in error.value.hint
    assert "\n" not in error.value.text + error.value.hint


def test_refuses_a_missing_file_and_a_folder(tmp_path):
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(UserError, match="cannot be read"):
            open_csv(path, ReadOptions())


def test_giant_cell_is_one_wrong_row(log):
    body = b"".join(b"%d,1.5\n" % k for k in range(300_000))
    source, columns = read(log, b"t [s],p\n" + body + b"x" * 10_000_000 + b"\n300000,1\n")
    assert len(columns["p"].t) == 300_001
    assert source.lines["too few cells"] == 1


def test_interleaved_devices_without_a_name_are_reported(log):
    text = "".join(f"{k // 2}.{k % 2},{k % 2},{[5, 90][k % 2] + k * 0.01:.2f}\n" for k in range(40))
    source, _ = read(log, text, time_channel="column 1", time_unit="s")
    (found,) = (f for f in source.findings if f.code == "devices-interleaved")
    assert (found.severity, found.channel, found.count) == ("warning", "column 2", 2)
    assert options_of(found.hint) == ReadOptions(group_channel="column 2", group_equals="0")


def test_log_of_three_interleaved_trains(tmp_path):
    path = tmp_path / "trains.csv"
    path.write_text(three_trains())
    with pytest.raises(UserError, match="no header"):
        open_csv(path, ReadOptions())
    whole = open_csv(path, ReadOptions(time_channel="column 1", time_unit="s"))
    assert [f.channel for f in whole.findings if f.code == "devices-interleaved"] == ["column 2"]
    source = open_csv(
        path,
        ReadOptions(
            time_channel="column 1", time_unit="s", group_channel="column 2", group_equals="5"
        ),
    )
    by_name = {f.channel: f for f in source.fields}
    (speed,) = source.columns([by_name["column 12"]])
    assert speed.t[0] == START * S
    assert speed.value[:3].tolist() == [95.1, 97.4, 98.7]
    assert (np.diff(speed.t) > 0).all()
    assert source.absolute
    assert source.lines == {"used": len(speed.t), "other group": 2 * len(speed.t)}


LEFT_OUT = {
    "61": "too few cells",
    "62,1,2,3": "too many cells",
    "x,1,压": "time stamp not readable",
    ",=1+2,压": "no time stamp",
    "\0\0,1": "NUL bytes, from space that was never written",
    "63,压,1": "",
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16-le", "utf-16-be", "gb18030"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("block", [64, 1 << 20])
def test_the_first_row_and_cell_left_out_can_be_found_again(log, monkeypatch, encoding, end, block):
    monkeypatch.setattr("adhesion_cli.formats.csv.lines._BLOCK", block)
    good = [f"{k},{k}.5,压{k}" for k in range(60)]
    lines = ["t [s],p,注", *good, "# 压", *LEFT_OUT, "", *good]
    raw = "\n".join(lines).replace("\n", end).encode(encoding)
    source, _ = read(log, raw, encoding=encoding)
    left = [f for f in source.findings if f.code in ("csv-rows-skipped", "csv-bad-cells")]
    places = {f.names.get("reason", ""): f.values["line"] for f in left if f.channel in ("", "p")}
    assert places == {reason: 63 + k for k, reason in enumerate(LEFT_OUT.values())}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for its peak")
def test_reading_holds_the_columns_and_not_the_text(log):
    row = b",1.5," + b"x" * 1000 + b"\n"
    with log.open("wb") as file:
        file.write(b"t [s],p,note\n")
        file.writelines(b"%d%b" % (k, row) for k in range(150_000))
    code = (
        "import re, sys\n"
        "from pathlib import Path\n"
        "from adhesion_cli.formats.csv.reader import open_csv\n"
        "from adhesion_cli.formats.source import ReadOptions\n"
        "source = open_csv(Path(sys.argv[1]), ReadOptions())\n"
        "status = Path('/proc/self/status')\n"
        "peak = lambda: int(re.search(r'VmHWM:\\s*(\\d+) kB', status.read_text())[1])\n"
        "before = peak()\n"
        "(column,) = source.columns(source.fields)\n"
        "assert len(column.t) == 150_000\n"
        "print(peak() - before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, log], capture_output=True, text=True, check=True
    )
    assert 0 < int(done.stdout) * 1024 < log.stat().st_size * 0.6
