"""What `inspect` says of a file as a whole."""

import gzip
from pathlib import Path

import pytest
from mcap.writer import Writer

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.inspection import inspect


@pytest.mark.parametrize("damage", [slice(-200), slice(-8)])
def test_a_damaged_gzip_is_damaged_and_its_whole_rows_are_read(
    tmp_path: Path, damage: slice
) -> None:
    rows = "".join(f"{k / 100},{k % 7},{50 - k % 3}\n" for k in range(3000))
    text = "t [s],bc pressure [bar],axle 1 [km/h]\n" + rows
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(text.encode())[damage])
    seen = inspect(path, settings.load())
    assert (seen.summary.status, seen.summary.format, seen.code) == ("damaged", "csv", 3)
    assert 1000 < seen.summary.rows_read <= 3000
    (found,) = (f for f in seen.findings if f.severity == "error")
    assert found.code == "csv-gzip-damaged"
    assert found.values["line"] == seen.summary.rows_read + 1


def test_an_mcap_without_messages_is_one(tmp_path: Path) -> None:
    path = tmp_path / "log.bin"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    summary = inspect(path, settings.load()).summary
    assert (summary.format, summary.status) == ("mcap", "error")
    assert inspect(tmp_path / "none.mcap", settings.load()).summary.format is None


def test_columns_of_words_are_named_with_their_use(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k % 7},{'on' if k > 90 else 'off'},ok\n" for k in range(300))
    path = tmp_path / "log.csv"
    path.write_text("t [s],bc pressure [bar],WSP active,state\n" + rows)
    stated = inspect(path, settings.load()).summary.stated
    assert stated["words"] == "WSP active (used as wsp_active), state (not used)"
    assert "not numeric" not in stated
