"""Round trips through every dialect, and the account of every line."""

import contextlib
import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.csv.reader import open_csv
from adhesion_cli.formats.source import ReadOptions

S = 1_000_000_000
EPOCH = 1_795_266_307 * S

DELIMITERS = st.sampled_from([",", ";", "\t", "|", " "])
ENCODINGS = st.sampled_from(
    ["utf-8", "utf-8-sig", "utf-16-le", "utf-16-be", "utf-16", "gb18030", "cp1252"]
)
ENDS = st.sampled_from(["\n", "\r\n", "\r"])


def iso(t: int, sep: str, zone: str) -> str:
    base = datetime.datetime(1970, 1, 1) + datetime.timedelta(seconds=t // S)
    return f"{base:%Y-%m-%d}{sep}{base:%H:%M:%S}.{t % S:09d}{zone}"


def shifted(t: int, digits: int) -> str:
    return f"{t // 10**digits}.{t % 10**digits:0{digits}d}"


FORMS = {  # header, first time, text of a time in ns
    "s": ("t [s]", 0, lambda t: shifted(t, 9)),
    "ms": ("time_ms", 0, lambda t: shifted(t, 6)),
    "us": ("timestamp_us", 0, lambda t: shifted(t, 3)),
    "ns": ("t(ns)", 0, str),
    "epoch s": ("t", EPOCH, lambda t: shifted(t, 9)),
    "epoch ms": ("time", EPOCH, lambda t: shifted(t, 6)),
    "epoch us": ("time", EPOCH, lambda t: shifted(t, 3)),
    "epoch ns": ("time", EPOCH, str),
    "iso T": ("timestamp", EPOCH, lambda t: iso(t, "T", "")),
    "iso Z": ("timestamp", EPOCH, lambda t: iso(t, "T", "Z")),
    "iso zone": ("timestamp", EPOCH, lambda t: iso(t + 2 * 3600 * S, "T", "+02:00")),
}


@st.composite
def tables(draw):
    n = draw(st.integers(3, 30))
    steps = draw(st.lists(st.integers(1_000_000, 50_000_000), min_size=n, max_size=n))
    value = st.one_of(
        st.none(),
        st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: round(v, 6)),
        st.integers(-10_000, 10_000).map(float),
    )
    p = draw(st.lists(value, min_size=n, max_size=n))
    p[0] = 0.5  # so that a decimal comma shows
    return np.cumsum(steps), p, draw(st.lists(value, min_size=n, max_size=n))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    table=tables(),
    delimiter=DELIMITERS,
    encoding=ENCODINGS,
    end=ENDS,
    form=st.sampled_from([*FORMS]),
    null=st.sampled_from(["", "NaN", "null", "-", "#N/A"]),
    comma=st.booleans(),
    quoted=st.booleans(),
    preamble=st.booleans(),
    units=st.booleans(),
    open_end=st.booleans(),
)
def test_round_trip(
    tmp_path_factory, table, delimiter, encoding, end, form, null, comma, quoted, preamble, units,
    open_end,
):  # fmt: skip
    header, start, stamp = FORMS[form]
    steps, p, v = table
    t = start + steps
    comma = comma and delimiter != ","
    if delimiter == " ":
        null, quoted, units, header = null or "NaN", False, False, header.replace(" ", "")
    special = {"gb18030": "制动缸压力", "cp1252": "Drück"}.get(encoding, "Bremszyl.")

    def cell(text: str) -> str:
        text = text.replace(".", ",") if comma else text
        return f'"{text}"' if quoted else text

    def number(x: float | None) -> str:
        return null if x is None else cell(repr(x))

    lines = ["Vehicle: ET 423", ""] if preamble else []
    lines.append(delimiter.join((header, special, "v")))
    if units:
        lines.append(delimiter.join(("-", "bar", "km/h")))
    lines += [
        delimiter.join((cell(stamp(int(a))), number(b), number(c)))
        for a, b, c in zip(t, p, v, strict=True)
    ]
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    path.write_bytes((end.join(lines) + ("" if open_end else end)).encode(encoding))
    source = open_csv(path, ReadOptions())
    assert source.fields[0].channel == special
    columns = source.columns(source.fields)
    assert columns[0].t.tolist() == t.tolist()
    for column, expected in zip(columns, (p, v), strict=False):
        want = np.array([np.nan if x is None else x for x in expected])
        np.testing.assert_array_equal(column.value, want)
        np.testing.assert_array_equal(column.valid, ~np.isnan(want))
    assert source.absolute == (start > 0)
    assert not [f for f in source.findings if f.severity != "info"]


ODD_LINES = st.sampled_from(
    ["", "", "   ", "# a comment", "# a, b, c", "% 5", "1", "1,2", "1,2,3,4", ",,", "x,1,2", ",1,2",
     '7,"a\nb",2', '8,"a,""b",2', '9,1,"\n\n"', "Max,5,6", "\x00", "1e400,1,1", '3,5" pipe,2']
)  # fmt: skip


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    body=st.lists(
        st.one_of(st.integers(0, 99).map(lambda k: f"{k},1.5,2"), ODD_LINES), max_size=40
    ),
    end=ENDS,
    last=st.booleans(),
)
def test_every_line_is_accounted_for(tmp_path_factory, body, end, last):
    lines = ["Vehicle: X", "t [s],p,v", *(f"{k},{k}.5,{k}" for k in range(30)), *body, "99,1,1"]
    text = "\n".join(lines).replace("\n", end)
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    path.write_bytes((text + (end if last else "")).encode())
    source = open_csv(path, ReadOptions())
    columns = source.columns(source.fields)
    assert source.lines["above"] == 2
    assert sum(source.lines.values()) == text.count(end) + 1
    assert source.lines["used"] == source.rows == len(columns[0].t)
    skipped = sum(f.count for f in source.findings if f.code == "csv-rows-skipped")
    kinds = ("too few cells", "too many cells", "time missing", "time unreadable", "NUL bytes")
    assert skipped == sum(source.lines[k] for k in kinds)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(data=st.binary(max_size=400))
def test_any_bytes_are_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    for content in (data, b"t [s],p\n0,1\n1,2\n2,3\n" + data + b"\n3,4\n"):
        path.write_bytes(content)
        with contextlib.suppress(UserError):  # any other error fails
            source = open_csv(path, ReadOptions())
            columns = source.columns(source.fields)
            assert all(len(c.t) == len(c.value) == source.lines["used"] for c in columns)


@pytest.mark.parametrize("quotes", ["", '"'])
def test_blocks_join_without_a_seam(tmp_path, monkeypatch, quotes):
    """Small blocks give what one block gives, quoted delimiters included."""
    q = quotes
    path = tmp_path / "log.csv"
    path.write_text(
        "t [s],p,note\n"
        + "".join(f"{k},{q}{k / 8}{q},{q}{'a,' * (k % 3) if q else 'b'}{q}\n" for k in range(3000))
    )
    results = []
    for size in (64 << 20, 997, 64):
        monkeypatch.setattr("adhesion_cli.formats.csv.lines._BLOCK", size)
        source = open_csv(path, ReadOptions())
        (column,) = source.columns(source.fields)
        results.append((column.t.tolist(), column.value.tolist(), source.lines))
    assert results[0][1] == [k / 8 for k in range(3000)]
    assert results[1:] == results[:1] * 2


def test_a_ragged_row_that_is_no_utf_8_is_counted_in_silence(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    rows = [b"%d,1\n" % k for k in range(900)]
    rows[800] = b"800,1,\xff\n"
    path.write_bytes(b"t [s],p\n" + b"".join(rows))
    monkeypatch.setattr("adhesion_cli.formats.csv.lines.HEAD_BYTES", 1000)
    ignored = []
    monkeypatch.setattr("sys.unraisablehook", ignored.append)
    source = open_csv(path, ReadOptions())
    source.columns(source.fields)
    assert source.lines == {"above": 1, "used": 899, "too many cells": 1}
    assert not ignored
