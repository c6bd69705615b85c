"""Excel workbooks: the same cells give the same log as their CSV."""

import csv
import re
from collections.abc import Sequence
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import openpyxl
import pytest
from helpers.pasted import pasted
from helpers.workbooks import Cell, Error, Formula, Serial, write
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.analysis.settings import load as settings_of
from adhesion_cli.channels.rules import names_brake, names_place
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats import xlsx
from adhesion_cli.formats.open import kind, open_source
from adhesion_cli.formats.source import ReadOptions, Source

_START = datetime(2026, 11, 21, 13, 5, 7)
_STEP = timedelta(milliseconds=20)
Rows = list[list[Cell]]


def opened(path: Path, **options: Any) -> Source:
    return open_source(path, ReadOptions(**options))


def refusal(path: Path, **options: Any) -> UserError:
    with pytest.raises(UserError) as error:
        read(opened(path, **options))
    assert error.value.text.startswith(str(path))
    assert "adhesion-" not in error.value.text
    return error.value


def log(n: int = 20, head: Sequence[str] = ("time [s]", "p [bar]", "v [km/h]")) -> Rows:
    rows: Rows = [[0.02 * k, 3.5 + k / 7, 80.0 - k / 3] for k in range(n)]
    return [list(head), *rows]


def read(source: Source) -> dict[str, list[tuple[int, float | None]]]:
    """Times and values of each channel, with its unit in the name."""
    columns = source.columns(source.fields)
    return {
        f"{f.channel} [{f.unit}]": [
            (t, x if valid else None)
            for t, x, valid in zip(c.t.tolist(), c.value.tolist(), c.valid.tolist(), strict=True)
        ]
        for f, c in zip(source.fields, columns, strict=True)
    }


# ------------------------------------------------------------------------------ the same as a CSV


def as_text(cell: Cell, mark: str) -> str:
    """A cell as a CSV has it."""
    match cell:
        case None:
            return ""
        case bool():
            return str(cell).lower()
        case float() | int():
            return repr(cell).replace(".", mark)
        case datetime():
            return cell.isoformat(" ", "microseconds")
        case time():
            return cell.isoformat("microseconds")
        case timedelta():
            hours, rest = divmod(cell, timedelta(hours=1))
            return f"{hours:02}{(datetime.min + rest).time().isoformat('microseconds')[2:]}"
        case Error():
            return cell.text
    return str(cell)


def write_csv(path: Path, rows: Rows, mark: str) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter=";", lineterminator="\n")
        writer.writerows([as_text(cell, mark) for cell in row] for row in rows)
    return path


def times(form: str, n: int) -> tuple[list[str], Rows]:
    """The heads and cells of the columns of a time."""
    stamps = [_START + k * _STEP for k in range(n)]
    if form == "date and time":
        return ["Zeitstempel"], [[stamp] for stamp in stamps]
    if form == "two columns":
        return ["Datum", "Uhrzeit"], [[stamp.date(), stamp.time()] for stamp in stamps]
    if form == "time of day":
        return ["Uhrzeit"], [[stamp.time()] for stamp in stamps]
    if form == "duration":
        return ["Dauer"], [[timedelta(hours=23, minutes=59, seconds=59.9) + k * _STEP]
                           for k in range(n)]  # fmt: skip
    if form == "text":
        return ["Zeitstempel"], [[stamp.isoformat(" ", "milliseconds")] for stamp in stamps]
    if form == "epoch":
        return ["time [ns]"], [[str(1_795_957_507_250_000_123 + k * 20_000_000)] for k in range(n)]
    return ["Zeit [s]"], [[k * 0.02] for k in range(n)]


@st.composite
def sheets(draw: st.DrawFn) -> tuple[Rows, str]:
    """The rows of a sheet, and the decimal mark of its CSV."""
    n = draw(st.integers(8, 30))
    forms = ["s", "date and time", "two columns", "time of day", "duration", "text", "epoch"]
    heads, cells = times(draw(st.sampled_from(forms)), n)
    mark = draw(st.sampled_from(".,"))
    has_commas = mark == "," and draw(st.booleans())
    values = st.floats(-1e6, 1e6, allow_subnormal=False) | st.integers(0, 500)
    names = draw(st.permutations(["Druck", "v Rad", "F soll"]))
    blank = Error("#N/A") if draw(st.booleans()) else None
    for name in names:
        is_text = has_commas and draw(st.booleans())
        column: list[Cell] = [*draw(st.lists(values, min_size=n, max_size=n))]
        column[0] = 0.5  # proves the decimal mark of the CSV
        if is_text:
            column = [f"{x:.6f}".replace(".", ",") for x in column]
        for k in draw(st.sets(st.integers(1, n - 1), max_size=2)):
            column[k] = blank
        heads.append(name)
        for row, cell in zip(cells, column, strict=True):
            row.append(cell)
    units = ["bar", "km/h", "kN"]
    layout = draw(st.sampled_from(["brackets", "units row", "two rows"]))
    first = len(heads) - 3
    if layout == "brackets":
        rows = [
            [*heads[:first], *(f"{x} [{u}]" for x, u in zip(heads[first:], units, strict=True))]
        ]
    elif layout == "units row":
        rows = [heads, ["-"] * first + units]
    else:
        rows = [["Kopf"] * first + ["Achse 1"] * 3, heads]
    preamble: Rows = [["Fahrzeug", "4711"], ["Prüfer:", "Müller"], []][: draw(st.integers(0, 3))]
    return [*preamble, *rows, *cells], mark


@settings(max_examples=15, deadline=None)
@given(sheets())
def test_the_same_cells_give_the_same_log_as_their_csv(
    tmp_path_factory: pytest.TempPathFactory, drawn: tuple[Rows, str]
) -> None:
    rows, mark = drawn
    width = max(map(len, rows))
    padded = [row + [None] * (width - len(row)) if row else [] for row in rows]
    folder = tmp_path_factory.mktemp("same")
    text = opened(write_csv(folder / "a.csv", padded, mark), decimal=mark)
    sheet = opened(write(folder / "a.xlsx", {"Messung": padded}))
    assert read(sheet) == read(text)
    assert sheet.time_reason == text.time_reason
    assert sheet.metadata == text.metadata
    assert sheet.rows == text.rows
    assert [f for f in sheet.findings if f.code != "one-sheet-read"] == text.findings


# ---------------------------------------------------------------------------------- cells exactly


def test_numbers_keep_every_digit(tmp_path: Path) -> None:
    values = [0.1 + 0.2, 1 / 3, 1e-12, 1.7976931348623157e308, -5e-324, 123456789.12345679] * 2
    rows: Rows = [["time [s]", "x"], *([0.02 * k, x] for k, x in enumerate(values))]
    (column,) = read(opened(write(tmp_path / "a.xlsx", {"s": rows}))).values()
    assert [x for _, x in column] == values


@pytest.mark.parametrize("since_1904", [False, True])
@given(start=st.integers(0, 86_399_999_999), step=st.integers(100, 2_000_000))
@settings(max_examples=10, deadline=None)
def test_times_are_exact_to_the_microsecond(
    tmp_path_factory: pytest.TempPathFactory, since_1904: bool, start: int, step: int
) -> None:
    stamps = [_START + timedelta(microseconds=start + k * step) for k in range(20)]
    rows: Rows = [["Zeit", "x"], *([stamp, 1.5] for stamp in stamps)]
    path = tmp_path_factory.mktemp("times") / "a.xlsx"
    source = opened(write(path, {"s": rows}, since_1904=since_1904))
    (column,) = source.columns(source.fields)
    expected = [(stamp - datetime(1970, 1, 1)) // timedelta(microseconds=1) for stamp in stamps]
    assert (column.t // 1000).tolist() == expected
    assert not (column.t % 1000).any()


@pytest.mark.parametrize("since_1904", [False, True])
def test_durations_pass_a_day(tmp_path: Path, since_1904: bool) -> None:
    start = timedelta(days=1, hours=2, minutes=59, seconds=59.9)
    rows: Rows = [["Dauer", "x"], *([start + k * _STEP, 1.5] for k in range(20))]
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}, since_1904=since_1904))
    (column,) = source.columns(source.fields)
    assert not source.absolute
    assert column.t.tolist() == [97_199_900_000_000 + k * 20_000_000 for k in range(20)]


def test_a_clock_that_passes_midnight_without_a_date_format(tmp_path: Path) -> None:
    """A stamp with date whose format shows only the time is a stamp with date."""
    days = 46_347 + np.arange(20) * 0.02 / 86_400
    rows: Rows = [["Uhrzeit", "x"], *([Serial(float(d), 3), 1.5] for d in days)]
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    assert source.absolute
    (column,) = source.columns(source.fields)
    assert str(column.t[0].astype("datetime64[ns]")) == "2026-11-21T00:00:00.000000000"


def test_a_whole_number_of_seconds_as_a_date_cell(tmp_path: Path) -> None:
    rows = log()
    for row in rows[1:]:
        row[0] = _START + timedelta(seconds=float(row[0]))  # type: ignore[arg-type]
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    source.columns(source.fields)
    assert [f.code for f in source.findings] == []


# ------------------------------------------------------------------------------ layouts of a sheet


def test_a_sheet_that_begins_below_and_right_of_its_corner(tmp_path: Path) -> None:
    rows: Rows = [[], [], *([None, None, *row] for row in log())]
    rows[10][3] = "defekt"
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    assert list(read(source)) == ["p [bar] []", "v [km/h] []"]
    (finding,) = source.findings
    assert "'defekt' in line 11" in finding.message
    assert finding.channel == "p [bar]"


def test_line_ends_tabs_and_quotes_in_heads(tmp_path: Path) -> None:
    rows = log(head=["Zeit\n[s]", 'p "C"\t[bar]', " v\r\n[km/h] "])
    assert list(read(opened(write(tmp_path / "a.xlsx", {"s": rows})))) == [
        'p "C" [bar] []',
        "v [km/h] []",
    ]


def test_merged_heads_name_the_columns_below(tmp_path: Path) -> None:
    rows: Rows = [["Zeit [s]", "Achse 1", None], [None, "p [bar]", "v [km/h]"], *log()[1:]]
    path = write(tmp_path / "a.xlsx", {"s": rows}, merged=["A1:A2", "B1:C1"])
    assert list(read(opened(path))) == ["Achse 1 p [bar] []", "Achse 1 v [km/h] []"]


def test_the_sheet_of_a_german_engineer(tmp_path: Path) -> None:
    merged = ["A5:A6", "B5:B6", "C5:D5", "E5:F5", "G5:G6"]
    rows: Rows = [
        ["Versuch:", "Bremsversuch 4711"],
        ["Prüfer", "Müller"],
        ["Beginn", _START],
        ["Tag", _START.date()],
        ["Datum", "Uhrzeit", "C-Druck", None, "v Rad", None, "v Zug"],
        [None, None, *["Achse 1", "Achse 2"] * 2, None],
        [None, None, "bar", "bar", "km/h", "km/h", "km/h"],
    ]
    for k in range(20):
        stamp = _START + k * _STEP
        values: Rows = [[0.1 * k, "0,5", 80.0 - k, 79.5 - k, None if k % 5 else 80.25 - k]]
        rows.append([stamp.date(), stamp.time(), *values[0]])
    sheets: dict[str, Rows] = {"Deckblatt": [["Bericht"]], "Messung": rows}
    source = opened(write(tmp_path / "a.xlsx", sheets, merged=merged))
    names = [f"{f.channel} [{f.unit}]" for f in source.fields]
    assert names == ["C-Druck Achse 1 [bar]", "C-Druck Achse 2 [bar]", "v Rad Achse 1 [km/h]",
                     "v Rad Achse 2 [km/h]", "v Zug [km/h]"]  # fmt: skip
    columns = source.columns(source.fields)
    assert columns[1].value.tolist() == [0.5] * 20
    assert int(columns[4].valid.sum()) == 4
    assert str(columns[0].t[1].astype("datetime64[ns]")) == "2026-11-21T13:05:07.020000000"


def test_notes_beside_and_below_the_table(tmp_path: Path) -> None:
    rows = log(60)
    for k, note in enumerate(("Faktor", 3.6, "Versatz", 0.25, "Bemerkung", "Sensor getauscht")):
        row = rows[3 + k // 2]
        row += [None] * (6 + k - len(row)) + [note]
    rows[5] += [None] * 10 + ["x"]
    rows += [[], [None, "Mittelwert"]]
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    columns = dict(
        zip((f.channel for f in source.fields), source.columns(source.fields), strict=True)
    )
    assert [f.channel for f in source.fields][:2] == ["p [bar]", "v [km/h]"]
    assert columns["p [bar]"].value.tolist() == [row[1] for row in rows[1:61]]
    assert columns["p [bar]"].valid.all()


def test_blank_rows_cost_nothing(tmp_path: Path) -> None:
    rows = log()
    rows[8:8] = [[], []]
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    source.columns(source.fields)
    assert (source.rows, source.findings) == (20, [])


def test_formulas_give_their_values(tmp_path: Path) -> None:
    rows = log()
    for row in rows[1:]:
        row[1] = Formula("B1*2", 2.5)
    values = read(opened(write(tmp_path / "a.xlsx", {"s": rows})))["p [bar] []"]
    assert {x for _, x in values} == {2.5}


def test_an_error_is_a_cell_without_a_number(tmp_path: Path) -> None:
    rows = log()
    rows[4][1], rows[7][1], rows[9][0] = Error("#DIV/0!"), Error("#N/A"), Error("#NAME?")
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    values = read(source)["p [bar] []"]
    assert [k for k, (_, x) in enumerate(values) if x is None] == [3, 6]
    messages = {f.code: f.message for f in source.findings}
    assert "'#DIV/0!' in line 5" in messages["csv-bad-cells"]
    assert "line 8" in messages["csv-missing-cells"]
    assert "line 10" in messages["csv-rows-skipped"]


def test_decimal_commas_that_are_texts(tmp_path: Path) -> None:
    rows = log()
    for k, row in enumerate(rows[1:]):
        row[1] = f"{k},25"
    source = opened(write(tmp_path / "a.xlsx", {"s": rows}))
    assert [x for _, x in read(source)["p [bar] []"]] == [k + 0.25 for k in range(20)]


def test_commas_that_may_group_digits_leave_the_column_out(tmp_path: Path) -> None:
    rows = log()
    for k, row in enumerate(rows[1:]):
        row[1] = f"{k + 1},250"
    path = write(tmp_path / "a.xlsx", {"Daten": rows})
    source = opened(path)
    assert {x for _, x in read(source)["p [bar] []"]} == {None}
    (finding,) = source.findings
    assert (finding.code, finding.channel) == ("csv-no-numbers", "p [bar]")
    values = read(opened(path, decimal=","))["p [bar] []"]
    assert [x for _, x in values] == [k + 1.25 for k in range(20)]


def test_a_workbook_of_openpyxl(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.title = "Deckblatt"
    book.active.append(["Prüfer", "Müller"])
    sheet = book.create_sheet("Messung 1")
    sheet.append(["Zeitstempel", "C-Druck [bar]"])
    for k in range(20):
        sheet.append([_START + k * _STEP, 0.25 * k])
    book.save(tmp_path / "a.xlsx")
    source = opened(tmp_path / "a.xlsx")
    ((name, values),) = read(source).items()
    assert (name, len(values)) == ("C-Druck [bar] []", 20)
    assert source.absolute
    (finding,) = source.findings
    assert finding.message.startswith("The program reads 'Messung 1', the first with a speed")
    assert finding.message.endswith("The workbook also has 'Deckblatt'.")


# --------------------------------------------------------------------------------- other workbooks


def test_a_sheet_of_libreoffice(tmp_path: Path) -> None:
    def cell(value: Cell) -> str:
        kind, attribute, text = "string", "", value
        if isinstance(value, timedelta):
            hours, rest = divmod(value, timedelta(hours=1))
            minutes, seconds = divmod(rest, timedelta(minutes=1))
            text = f"PT{hours:02}H{minutes:02}M{seconds.total_seconds():07.4f}S"
            kind, attribute = "time", f'office:time-value="{text}"'
        elif isinstance(value, float):
            kind, attribute = "float", f'office:value="{value!r}"'
        return (
            f'<table:table-cell office:value-type="{kind}" {attribute}>'
            f"<text:p>{text}</text:p></table:table-cell>"
        )

    rows: Rows = [["Dauer", "x"], *([timedelta(days=1) + k * _STEP, k / 3] for k in range(20))]
    names = "".join(
        f' xmlns:{x}="urn:oasis:names:tc:opendocument:xmlns:{x}:1.0"'
        for x in ("office", "table", "text")
    )
    lines = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    with ZipFile(tmp_path / "a.ods", "w", ZIP_DEFLATED) as parts:
        parts.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        parts.writestr("META-INF/manifest.xml", "<manifest/>")
        parts.writestr(
            "content.xml",
            f"<office:document-content{names}><office:body><office:spreadsheet>"
            f'<table:table table:name="Messung">{lines}</table:table>'
            "</office:spreadsheet></office:body></office:document-content>",
        )
    (column,) = read(opened(tmp_path / "a.ods")).values()
    assert column == [(86_400_000_000_000 + k * 20_000_000, k / 3) for k in range(20)]


def test_an_old_workbook() -> None:
    path = Path(__file__).parents[1] / "data" / "old.xls"
    source = opened(path)
    assert kind(path) == source.format == "xlsx"
    assert source.absolute
    values = read(source)["p [bar] []"]
    assert [t - values[0][0] for t, _ in values] == [k * 20_000_000 for k in range(20)]
    assert [x for _, x in values] == pytest.approx([0.1 * k for k in range(20)], rel=1e-15)


def test_text_with_the_suffix_of_a_workbook(tmp_path: Path) -> None:
    path = tmp_path / "a.xls"
    path.write_text("time [s]\tp [bar]\n" + "".join(f"{k / 50}\t1.5\n" for k in range(9)))
    source = opened(path)
    assert (source.format, len(read(source)["p [bar] []"])) == ("csv", 9)


# ---------------------------------------------------------------------------------- the right sheet


def test_the_first_visible_sheet_with_columns_of_numbers_is_read(tmp_path: Path) -> None:
    cover: Rows = [["Fahrzeug", "4711"], ["Masse [t]", 40.5], ["Prüfer", "Müller"]]
    sheets = {"Deckblatt": cover, "alt": log(30), "leer": [], "Messung": log(20), "zweite": log()}
    path = write(tmp_path / "a.xlsx", sheets, hidden=["alt"])
    source = opened(path)
    source.columns(source.fields)
    assert source.rows == 20
    assert source.reasons["sheet"] == "'Messung' (the first with a speed or a brake pressure)"
    (finding,) = source.findings
    assert finding.code == "one-sheet-read"
    stated = opened(path, sheet="alt")
    stated.columns(stated.fields)
    assert (stated.rows, stated.findings) == (30, [])


@pytest.mark.parametrize("summary", [{}, {"Summary": ["Time [s]", "p mean [bar]", "v mean"]}])
def test_sheets_of_one_log_are_read_together(summary: dict[str, list[str]], tmp_path: Path) -> None:
    """Beside each other, of axles or of other channels; below each other, where time goes on."""
    sheets = {f"Achse {k}": log(20 + k) for k in (1, 2)}
    sheets |= {name: log(20, head) for name, head in summary.items()}
    path = write(tmp_path / "a.xlsx", sheets)
    places = opened(path, names_brake=names_brake, names_place=names_place)
    samples = read(places)
    counts = {name: sum(x is not None for _, x in series) for name, series in samples.items()}
    channels = {f"Achse {k} {name} []": 20 + k for k in (1, 2) for name in ("p [bar]", "v [km/h]")}
    assert channels.items() <= counts.items()
    assert places.reasons["sheet"] == "'Achse 2', 'Achse 1' (one log)"
    kinds = {
        "Drücke": log(head=["t [s]", "p1 [bar]", "p2 [bar]"]),
        "v": log(head=["t [s]", "v1", "v2"]),
    }
    assert len(read(opened(write(tmp_path / "b.xlsx", kinds), names_brake=names_brake))) == 4
    rows = log(40)
    parts = {"Daten 1": rows[:21], "Daten 2": [rows[0], *rows[21:]]}
    assert read(opened(write(tmp_path / "c.xlsx", parts))) == read(
        opened(write(tmp_path / "d.xlsx", {"Daten": rows}))
    )


def test_sheets_of_several_runs_are_several_logs(tmp_path: Path) -> None:
    head = ["Time [s]", "p filtered [bar]", "v filtered [km/h]"]
    for name, severity in (("Run", "info"), ("Axle", "warning")):
        later = [[t + 20.0 if isinstance(t, float) else t, *x] for t, *x in log(30, head)]
        path = write(tmp_path / f"{name}.xlsx", {f"{name} 1": log(20), f"{name} 2": later})
        source = opened(path, names_brake=names_brake, names_place=names_place)
        assert len(read(source)["p [bar] []"]) == 20
        assert [(f.code, f.severity) for f in source.findings] == [("one-sheet-read", severity)]


def test_a_table_of_results_before_the_samples_is_no_log(tmp_path: Path) -> None:
    results: Rows = [["Achse", "p max [bar]", "v0 [km/h]"], [1, 4.1, 70.0], [2, 4.2, 70.1]]
    source = opened(write(tmp_path / "a.xlsx", {"Auswertung": results, "Messung": log(20)}))
    assert source.reasons["sheet"].startswith("'Messung'")


def test_a_workbook_whose_only_log_is_hidden(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xlsx", {"Text": [["a"]], "Daten": log()}, hidden=["Daten"])
    error = refusal(path)
    assert "no visible sheet has two columns of numbers" in error.text
    assert "xlsx.sheet" in str(error.hint)
    assert "'Text', 'Daten' (hidden)" in str(error.hint)


def test_an_unknown_sheet_names_the_nearest(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xlsx", {"Messung 1": log(), "Messung 2": log()})
    error = refusal(path, sheet="messung 2")
    assert "unknown sheet 'messung 2'" in error.text
    assert "did you mean 'Messung 2'" in str(error.hint)


def test_an_empty_sheet(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xlsx", {"leer": [], "Daten": log()})
    assert "sheet 'leer' is empty" in refusal(path, sheet="leer").text


LIST: Rows = [["Parameter", "Wert", "Toleranz"], *(["m", 40.0 + k, 1.5] for k in range(9))]


def test_a_sheet_with_a_speed_or_a_brake_pressure_is_read_before_others(tmp_path: Path) -> None:
    """As a list of channels, which Dewesoft writes before the samples, or other measurements."""
    warm = log(head=["Zeit [s]", "T1 [°C]", "T2 [°C]"])
    by_name = log(30, head=["Zeit [s]", "BC pressure", "wheel speed"])
    path = write(tmp_path / "a.xlsx", {"Liste": LIST, "warm": warm, "Messung": by_name, "b": log()})
    source = opened(path, names_brake=names_brake)
    assert len(read(source)["BC pressure []"]) == 30
    [finding] = source.findings
    assert finding.message.startswith(
        "The program reads 'Messung', the first with a speed or a brake"
    )
    [setting] = pasted(finding.hint)
    stated = settings_of(assignments=[setting], folder=False).read.sheet
    assert "sheet 'Liste': no column is a time" in refusal(path, sheet=stated).text


def test_a_sheet_that_is_no_log_gives_way_to_the_next_and_the_note_says_why(tmp_path: Path) -> None:
    other = log(head=["Zeit [s]", "T1 [°C]", "T2 [°C]"])
    source = opened(write(tmp_path / "a.xlsx", {"Parameter": LIST, "Messung": other}))
    assert source.reasons["sheet"] == "'Messung' (the first that is a log)"
    [finding] = source.findings
    assert (finding.code, finding.names["others"]) == ("one-sheet-read", "'Parameter'")
    assert "sheet 'Parameter': no column is a time" in finding.message
    path = write(tmp_path / "b.xlsx", {"Parameter": LIST, "Liste": LIST})
    error = refusal(path)
    assert error.text.startswith(f"{path}: sheet 'Parameter': no column is a time")
    assert "`--set xlsx.sheet=Liste`" in str(error.hint)


def test_a_brake_without_a_time_does_not_give_way_to_other_measurements(tmp_path: Path) -> None:
    timeless = log(head=["run", "BC pressure", "wheel speed"])
    warm = log(head=["Zeit [s]", "T1 [°C]", "T2 [°C]"])
    path = write(tmp_path / "a.xlsx", {"Messung": timeless, "warm": warm})
    error = refusal(path, names_brake=names_brake)
    assert error.text.startswith(f"{path}: sheet 'Messung': no column is a time")


def test_a_log_in_doubt_does_not_give_way_to_another(tmp_path: Path) -> None:
    of_ticks = log(head=["Zeit [Takte]", "p [bar]", "v [km/h]"])
    error = refusal(write(tmp_path / "a.xlsx", {"Messung": of_ticks, "Probe": log()}))
    assert "sheet 'Messung'" in error.text
    assert "no column is a time" in error.text


def test_a_hidden_sheet_is_not_read_for_one_that_is_no_log(tmp_path: Path) -> None:
    sheets = {"Parameter": LIST, "alt": log(30), "Messung": log()}
    source = opened(write(tmp_path / "a.xlsx", sheets, hidden=["alt"]))
    assert len(read(source)["p [bar] []"]) == 20


@pytest.mark.parametrize("other", [log(30), [["Speed [km/h]"], [80], [60]]])
def test_a_brake_in_a_sheet_that_cannot_be_read_keeps_no_log_back(
    tmp_path: Path, other: Rows
) -> None:
    """It is hidden, or has one column."""
    warm = log(head=["Zeit [s]", "T1 [°C]", "T2 [°C]"])
    sheets = {"Parameter": LIST, "warm": warm, "andere": other}
    path = write(tmp_path / "a.xlsx", sheets, hidden=["andere"] * (len(other) > 3))
    assert len(read(opened(path))["T1 [°C] []"]) == 20


@pytest.mark.parametrize("order", [1, -1])
def test_the_sheet_with_the_stated_channels_is_read_before_one_with_a_speed(
    tmp_path: Path, order: int
) -> None:
    stated = log(head=["t", "K1", "K2"])
    runs = log(30, head=["Run", "Speed [km/h]", "Distance [m]"])
    sheets = {"Log": stated, "Summary": runs}
    path = write(tmp_path / "a.xlsx", dict([*sheets.items()][::order]))
    settings = ["channels.wheel_speed.channel=K2", "channels.wheel_speed.unit=km/h"]
    source = open_source(path, settings_of(assignments=settings, folder=False).read)
    assert len(read(source)["K2 []"]) == 20
    assert source.reasons["sheet"] == "'Log' (the one with most of the stated channels)"
    for name in ("Lower K2", "column 4"):
        wide = [[*row, 70.0 - k] for k, row in enumerate(log(head=["t", "K1", "K3"]))]
        wide[0][-1] = "K2"
        path = write(tmp_path / "a.xlsx", {"Log": wide, "Summary": runs})
        settings = [f"channels.wheel_speed.channel={name}", "channels.wheel_speed.unit=km/h"]
        source = open_source(path, settings_of(assignments=settings, folder=False).read)
        assert "'Log'" in str(source.reasons["sheet"])
    by_time = settings_of(assignments=["channels.time.channel=T"], folder=False).read
    assert "'Log'" in str(open_source(path, by_time).reasons["sheet"])


def test_of_two_sheets_with_the_stated_time_the_one_with_a_brake_is_read(tmp_path: Path) -> None:
    warm = log(30, head=["t [s]", "T1 [°C]", "T2 [°C]"])
    path = write(tmp_path / "a.xlsx", {"warm": warm, "Log": log(head=["t [s]", "p [bar]", "v"])})
    assert len(read(opened(path, time_channel="t [s]"))["p [bar] []"]) == 20


def test_an_encrypted_workbook(tmp_path: Path) -> None:
    path = tmp_path / "a.xlsx"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(1024)
                     + "EncryptedPackage".encode("utf-16-le") + bytes(1024))  # fmt: skip
    error = refusal(path)
    assert "encrypted" in error.text
    assert "without a password" in str(error.hint)


def test_a_workbook_that_was_cut_off(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xlsx", {"s": log(500)})
    path.write_bytes(path.read_bytes()[:2000])
    assert "damaged Excel file" in refusal(path).text


def test_a_changed_byte_is_noticed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xlsx", {"s": log(500)})
    data = bytearray(path.read_bytes())
    data[data.index(b"xl/worksheets/s1.xml") + 3000] ^= 4
    path.write_bytes(data)
    error = refusal(path)
    assert "damaged Excel file" in error.text
    assert error.hint


def test_an_archive_that_is_no_workbook(tmp_path: Path) -> None:
    path = tmp_path / "logs.zip"
    with ZipFile(path, "w") as parts:
        parts.writestr("log.csv", "time,p\n0,1\n")
    error = refusal(path)
    assert "a ZIP archive, not a workbook" in error.text
    assert "unpack" in str(error.hint)


def test_a_workbook_that_unpacks_to_too_much(tmp_path: Path, monkeypatch: Any) -> None:
    path = write(tmp_path / "a.xlsx", {"s": log(500)})
    monkeypatch.setattr(xlsx, "_MOST_BYTES", 1 << 12)
    with pytest.raises(UserError, match="unpacks to"):
        xlsx.write_text(path, tmp_path / "a.txt", ReadOptions())


def test_a_part_that_unpacks_to_more_than_it_states(tmp_path: Path) -> None:
    """A ZIP bomb whose heads state a small size."""
    path = write(tmp_path / "a.xlsx", {"s": log()})
    with ZipFile(path, "a", ZIP_DEFLATED) as parts:
        parts.writestr("xl/sharedStrings.xml", bytes(1 << 24))
    data = path.read_bytes()
    size = (1 << 24).to_bytes(4, "little")
    assert data.count(size) == 2
    path.write_bytes(data.replace(size, (1 << 10).to_bytes(4, "little")))
    assert "xl/sharedStrings.xml" in refusal(path).text


def test_the_text_of_a_sheet_goes_with_its_source(tmp_path: Path) -> None:
    source: Any = opened(write(tmp_path / "a.xlsx", {"s": log()}))
    folder = source.table.path.parent
    assert re.search("adhesion-", folder.name)
    assert folder.exists()
    del source
    assert not folder.exists()
