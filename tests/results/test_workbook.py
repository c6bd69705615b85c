"""Excel workbooks: cells of the type that the column has, read by another library."""

import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import openpyxl
import pyarrow as pa
import pytest

from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Channel, Column, Log
from adhesion_cli.results import tables, wide_table, workbook

_START = 1_795_957_507_250_000_123  # 2026-11-29 13:05:07.250000123 UTC


def written(path: Path, table: Any, name: str = "t") -> Any:
    tables.write(path, ".xlsx", {name: table})
    return openpyxl.load_workbook(path)[name]


def test_each_cell_has_the_type_of_its_column(tmp_path: Path) -> None:
    schema = pa.schema(
        [
            pa.field("force", pa.float64(), metadata={"unit": "N"}),
            pa.field("slip", pa.float64(), metadata={"unit": "-"}),
            pa.field("axle", pa.int64()),
            pa.field("valid", pa.bool_()),
            pa.field("start", pa.timestamp("us", "UTC")),
        ]
    )
    time = datetime(2026, 11, 29, 13, 5, 7, 250_000)
    rows = [[0.1 + 0.2, 1e-300, 3, True, time], [float("nan"), float("inf"), 4, None, None]]
    sheet = written(tmp_path / "a.xlsx", pa.table(list(zip(*rows, strict=True)), schema=schema))
    heads, first_row, second_row = sheet.iter_rows(values_only=True)
    assert heads == ("force [N]", "slip", "axle", "valid", "start [UTC]")
    assert first_row == tuple(rows[0])
    assert second_row == (None, None, 4, None, None)
    assert sheet["E2"].is_date
    assert sheet.freeze_panes == "A2"


@pytest.mark.parametrize(
    "text", ["=1+1", "+1", "@SUM(A1)", "{=1}", "http://a.b/c", "1e5", " x ", "a\nb\x00\u202e"]
)
def test_a_text_stays_a_text(tmp_path: Path, text: str) -> None:
    sheet = written(tmp_path / "a.xlsx", pa.table({text: [text]}))
    for cell in (sheet["A1"], sheet["A2"]):
        assert cell.data_type == "s"
        assert cell.hyperlink is None
        assert cell.value == text.replace("\n", "\\n").replace("\0", "\\x00").replace(
            "\u202e", "\\u202e"
        )


def test_a_long_text_is_cut_to_what_a_cell_holds(tmp_path: Path) -> None:
    sheet = written(tmp_path / "a.xlsx", pa.table({"t": ["x" * 40_000]}))
    assert len(sheet["A2"].value) == 32_767


def test_columns_are_as_wide_as_their_text_within_limits(tmp_path: Path) -> None:
    table = pa.table({"a": ["x"], "b": ["y" * 20], "c": ["z" * 500]})
    widths = {k: d.width for k, d in written(tmp_path / "a.xlsx", table).column_dimensions.items()}
    assert widths == {"A": pytest.approx(10, abs=1), "B": pytest.approx(22, abs=1),
                      "C": pytest.approx(40, abs=1)}  # fmt: skip


def test_the_same_tables_give_the_same_bytes(tmp_path: Path) -> None:
    table = pa.table({"a": [1.5], "b": ["x"]})
    for name in ("a.xlsx", "b.xlsx"):
        tables.write(tmp_path / name, ".xlsx", {"t": table, "u": table})
    assert (tmp_path / "a.xlsx").read_bytes() == (tmp_path / "b.xlsx").read_bytes()
    with ZipFile(tmp_path / "a.xlsx") as parts:
        assert {part.date_time[0] for part in parts.infolist()} == {1980}
        assert (
            re.findall(rb"20[0-9]{2}-[^<]+", parts.read("docProps/core.xml"))
            == [b"2000-01-01T00:00:00Z"] * 2
        )


def log(*values: float, absolute: bool) -> Log:
    t = _START * absolute + np.arange(len(values)) * 20_000_000
    column = Column(t, np.array(values), np.isfinite(values))
    channels = (Channel("=p", "", None, None, "bar", "", column),)
    return Log("log.mcap", "mcap", "0" * 64, absolute, 1, channels, ())


def test_a_log_has_times_as_dates(tmp_path: Path) -> None:
    wide_table.write_workbook(tmp_path / "a.xlsx", log(1.5, np.nan, absolute=True))
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx").active
    heads, *rows = sheet.iter_rows(values_only=True)
    start = datetime(2026, 11, 29, 13, 5, 7, 250_000)
    assert heads == ("time [UTC]", "=p [bar]")
    assert rows == [(start, 1.5), (start + timedelta(milliseconds=20), None)]


def test_a_log_without_a_date_has_seconds(tmp_path: Path) -> None:
    wide_table.write_workbook(tmp_path / "a.xlsx", log(1.5, 2.5, absolute=False))
    rows = openpyxl.load_workbook(tmp_path / "a.xlsx").active.iter_rows(values_only=True)
    assert list(rows) == [("time [s]", "=p [bar]"), (0, 1.5), (0.02, 2.5)]


def test_a_log_of_more_rows_than_a_sheet_is_refused(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(workbook, "MAX_ROWS", 3)
    wide_table.write_workbook(tmp_path / "a.xlsx", log(1.0, 2.0, absolute=False))
    with pytest.raises(UserError, match=r"sheet holds 2 rows.*has 3") as refusal:
        wide_table.write_workbook(tmp_path / "b.xlsx", log(1.0, 2.0, 3.0, absolute=False))
    assert "CSV, Parquet or MCAP" in str(refusal.value.hint)
    assert not (tmp_path / "b.xlsx").exists()
