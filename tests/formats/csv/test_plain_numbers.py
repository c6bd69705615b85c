"""Rows of plain decimals: the compiled parser gives what pyarrow gives, bit for bit, or nothing."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.csv import block_parser, plain_numbers
from adhesion_cli.formats.csv.reader import open_csv
from adhesion_cli.formats.source import ReadOptions

numbers = st.one_of(
    st.decimals(-(10**9), 10**9, places=4).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**20), 10**20).map(str),
)
spellings = st.sampled_from(
    ["", "-", ".", "1.", ".5", "-.5", "+1.5", "-0", "00.10", "1e3", "nan", "NaN", "inf", "-Inf",
     " 2.5 ", "fault", "9007199254740993", "0.1234567890123456789", "1_000", "0x10", "1.2.3", "µ"]
)  # fmt: skip
lines = st.sampled_from(
    ["", "#", "# a remark", "1.0,2.0", "1,2,3,4,5", "time [s],a,b", "x,1,2", "\0"]
)
STAMPS = {
    "s": [f"{k / 100:.2f}" for k in range(40)],
    "long s": [f"{31e6 + k / 8:.4f}" for k in range(40)],
    "since 1970": [f"{1_772_000_000 + k / 8:.6f}" for k in range(40)],
    "since 1970, ns": [f"{1_772_000_000 + k // 8}.{k % 8}23456789" for k in range(40)],
    "ISO": [f"2024-02-{28 + k // 20}T23:{k % 20:02d}:59.{k:03d}" for k in range(40)],
    "ISO, Z": [f"2000-12-31 {k % 24:02d}:00:{k:02d}Z" for k in range(40)],
}
TIME = {name: "time" if name.startswith("ISO") else "time [s]" for name in STAMPS}
ODD_TIMES = [
    "",
    "1e3",
    "2024-02-30T00:00:00",
    "2024-01-01T24:00:00",
    "2023-02-29 00:00:00Z",
    "7",
    "x",
]


def read(path: Path, least: float, of: pytest.MonkeyPatch) -> object:
    """Everything that one reading gives; the error where it is refused."""
    of.setattr(block_parser, "_LONG", least)
    try:
        source = open_csv(path, ReadOptions(rejects=True))
        found = source.columns(source.fields)
    except UserError as error:
        return error.text
    arrays = [(c.t.tobytes(), c.value.tobytes(), c.valid.tobytes()) for c in found]
    return arrays, source.lines, source.findings, list(source.rejects)


@pytest.mark.parametrize("stamps", STAMPS)
@given(data=st.data())
def test_both_parsers_give_the_same(stamps: str, data: st.DataObject) -> None:
    rows = [[t, "1.5", "-20.25"] for t in STAMPS[stamps]]
    for row in data.draw(st.lists(st.integers(5, 39), max_size=6)):
        rows[row][data.draw(st.integers(1, 2))] = data.draw(st.one_of(numbers, spellings))
    if data.draw(st.integers(0, 3)) == 0:
        rows[data.draw(st.integers(5, 39))][0] = data.draw(st.sampled_from(ODD_TIMES))
    texts = [",".join(row) for row in rows]
    for at in data.draw(st.lists(st.integers(5, 39), max_size=1)):
        texts.insert(at, data.draw(lines))
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as of:
        path = Path(folder) / "log.csv"
        header = f"{TIME[stamps]},a [bar],b [km/h]"
        path.write_text("\n".join([header, *texts, ""]), encoding="utf-8")
        assert read(path, 0, of) == read(path, np.inf, of)


@pytest.mark.parametrize("stamps", STAMPS)
def test_plain_rows_are_parsed_by_it(
    stamps: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parsed, parse = [], plain_numbers.parse
    monkeypatch.setattr(plain_numbers, "parse", lambda *of: parsed.append(parse(*of)) or parsed[-1])
    path = tmp_path / "log.csv"
    rows = [f"{t},{k}.5,-0.25" for k, t in enumerate(STAMPS[stamps])]
    path.write_text("\n".join([f"{TIME[stamps]},a [bar],b [km/h]", *rows, ""]))
    assert not isinstance(read(path, 0, monkeypatch), str)
    assert [p is not None for p in parsed] == [True]


@pytest.mark.parametrize("cut", ["", "2", "2024-", "2024-01-01T00:00:00."])
def test_a_stamp_that_ends_with_the_data_is_not_read_past(cut: str) -> None:
    data = np.frombuffer(f"1,{cut}\n".encode(), np.uint8)
    layout = plain_numbers.Layout(",", ".", 2, 1, plain_numbers.STAMPS, True, [0])
    assert plain_numbers.parse(data, layout, 1) is None
