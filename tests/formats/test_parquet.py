"""Parquet logs: which column is the time, what a damaged or hostile file costs."""

import datetime as dt
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from adhesion_cli.channels.log import needed
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats import as_text
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

N = 500
SECONDS = np.arange(N) / 100
START = 1_795_266_307_250_000_000  # [ns]


def log(path: Path, time: Any, unit: str = "", **more: Any) -> Any:
    """A log with this time column and two channels, opened."""
    fields = [
        pa.field("time", time.type, metadata={"unit": unit} if unit else None),
        pa.field("speed", pa.float32(), metadata={"unit": "km/h"}),
        pa.field("BC pressure [kPa]", pa.int16()),
    ]
    columns = [time, pa.array(72 - SECONDS, pa.float32()), pa.array(np.arange(N), pa.int16())]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), path, **more)
    return open_source(path, ReadOptions())


def ns(kind: str, zone: str | None = None) -> Any:
    ticks = pa.array(START + np.arange(N) * 10**7, pa.timestamp("ns", zone))
    return ticks.cast(pa.timestamp(kind, zone))


@pytest.mark.parametrize(
    ("time", "unit", "absolute"),
    [
        (ns("ns", "UTC"), "", True),
        (ns("ns", "Asia/Shanghai"), "", True),
        (ns("us"), "", True),
        (ns("ms", "UTC"), "", True),
        (ns("ns").cast(pa.int64()), "ns", True),
        (ns("ms").cast(pa.int64()), "", True),  # by its magnitude
        (pa.array(SECONDS), "s", False),
        (pa.array(SECONDS), "", False),
        (pa.array(np.arange(N) * 10), "ms", False),
        (pa.array(np.arange(N) * 10**7, pa.duration("ns")), "", False),
        (ns("ms").cast(pa.string()), "", True),
    ],
)
def test_the_time_column(tmp_path: Path, time: Any, unit: str, absolute: bool) -> None:
    source = log(tmp_path / "a.parquet", time, unit)
    speed, pressure = source.columns(source.fields)
    start = START if absolute else 0
    assert source.absolute is absolute
    assert speed.t is pressure.t
    assert np.array_equal(speed.t, start + np.arange(N) * 10**7)
    assert np.array_equal(speed.value, np.round(72 - SECONDS, 2))
    assert [f.unit for f in source.fields] == ["km/h", ""]


def test_a_time_of_single_precision_keeps_its_steps(tmp_path: Path) -> None:
    source = log(tmp_path / "a.parquet", pa.array(3000 + SECONDS, pa.float32()), "s")
    speed, _ = source.columns(source.fields)
    assert np.array_equal(np.diff(speed.t), np.full(N - 1, 10**7))


def test_a_date_beside_the_time_of_day(tmp_path: Path) -> None:
    day = dt.date(2026, 11, 24)
    of_day = pa.array([36_900_000_000 + 20_000 * k for k in range(50)], pa.time64("us"))
    table = pa.table({"date": [day] * 50, "time": of_day, "p [bar]": [k % 7 for k in range(50)]})
    pq.write_table(table, tmp_path / "a.parquet")
    source = open_source(tmp_path / "a.parquet", ReadOptions())
    (p,) = source.columns(source.fields)
    start = dt.datetime(2026, 11, 24, 10, 15, tzinfo=dt.UTC)
    assert source.absolute
    assert p.t[0] == start.timestamp() * 10**9


def test_a_line_end_in_a_name_is_no_row(tmp_path: Path) -> None:
    table = pa.table(
        {"time [s]": SECONDS, "BC pressure\n[bar]": SECONDS, "BC pressure [bar]": SECONDS}
    )
    pq.write_table(table, tmp_path / "a.parquet")
    source = open_source(tmp_path / "a.parquet", ReadOptions())
    source.columns(source.fields)
    names = [f.channel for f in source.fields]
    assert names == ["BC pressure [bar]", "BC pressure [bar] (2)"]
    assert (source.rows, source.findings) == (N, [])


def test_a_duration_that_is_not_the_time_is_no_channel(tmp_path: Path) -> None:
    delay = pa.array(np.arange(N) * 10**7, pa.duration("ns"))
    columns = {"time [s]": SECONDS, "delay": delay, "delay of\nthe bus": delay, "p [bar]": SECONDS}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    source = open_source(tmp_path / "a.parquet", ReadOptions())
    assert [f.channel for f in source.fields] == ["p [bar]"]


def test_the_text_of_a_time_needs_no_database_of_time_zones() -> None:
    """Some versions of Windows have none, and a text in local time needs one."""
    text = as_text.printable(ns("ns", "Asia/Shanghai")).to_pylist()
    assert text[:2] == [x + "Z" for x in ns("ns")[:2].cast(pa.string()).to_pylist()]


def test_a_null_and_nan_are_no_samples(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    value = pa.array([1.0, None, np.nan, 4.0])
    pq.write_table(pa.table({"time [s]": pa.array([0.0, 0.1, 0.2, 0.3]), "p [bar]": value}), path)
    source = open_source(path, ReadOptions())
    [column] = source.columns(source.fields)
    assert column.valid.tolist() == [True, False, False, True]
    [finding] = [f for f in source.findings if f.code == "csv-missing-cells"]
    assert (finding.count, finding.spans, finding.severity) == (2, ((0.1, 0.2),), "info")


def test_rows_without_a_time_are_reported(tmp_path: Path) -> None:
    time = pa.array([None if 10 <= k < 15 else t for k, t in enumerate(SECONDS)])
    source = log(tmp_path / "a.parquet", time, "s")
    columns = source.columns(source.fields)
    assert [len(c.t) for c in columns] == [N - 5] * 2
    [finding] = source.findings
    assert (finding.code, finding.count, finding.severity) == ("csv-rows-skipped", 5, "warning")


def test_a_damaged_page_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    log(path, pa.array(SECONDS), "s", row_group_size=100, write_page_checksum=True,
        compression="none", use_dictionary=False)  # fmt: skip
    place = pq.ParquetFile(path).metadata.row_group(2).column(1)
    raw = bytearray(path.read_bytes())
    raw[place.data_page_offset + place.total_compressed_size - 10] ^= 1
    path.write_bytes(raw)
    with pytest.raises(UserError, match=r"damaged Parquet file: .*CRC") as error:
        open_source(path, ReadOptions())
    assert "copy" in error.value.hint


def test_a_bomb_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """A column of one value costs no bytes of the file, whatever its length."""
    path = tmp_path / "a.parquet"
    rows = 1 << 25
    indices = pa.array(np.zeros(rows, np.int8))
    column = pa.DictionaryArray.from_arrays(indices, pa.array([1.0]))
    pq.write_table(pa.table({"time [s]": column, "p [bar]": column}), path)
    assert path.stat().st_size < 400_000
    with pytest.raises(UserError, match="more than a file of this size holds"):
        open_source(path, ReadOptions())


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"p [bar]": [1.0, 2.0]}, "no column is a time"),
        ({"time [s]": [0.0, 0.1]}, "no numbers"),
        ({"time [s]": [0.0, 0.1], "note": ["a", "b"]}, "no numbers"),
    ],
)
def test_what_is_no_log(tmp_path: Path, columns: dict[str, list[Any]], says: str) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table(columns), path)
    with pytest.raises(UserError, match=says) as error:
        open_source(path, ReadOptions())
    assert error.value.hint


def test_rows_of_several_devices(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    t, device = np.repeat(np.arange(200) / 50, 2), np.tile(["A", "B"], 200)
    speed = np.where(device == "A", 70 - t, 20 + t)
    table = {"time [s]": t, "device": device, "speed [km/h]": speed, "p [bar]": speed / 10}
    pq.write_table(pa.table(table), path, row_group_size=150)
    source = open_source(path, ReadOptions())  # as in a text log, each device has its series
    assert [(f.channel, f.group) for f in source.fields] == [
        (name, group) for group in "AB" for name in ("speed [km/h]", "p [bar]")
    ]
    assert source.format == "parquet"
    assert np.allclose(source.columns(source.fields)[2].value, speed[1::2])
    source = open_source(path, ReadOptions(group_channel="device", group_equals="B"))
    column, _ = source.columns(source.fields)
    assert np.array_equal(column.value, speed[1::2])
    assert [f.code for f in source.findings] == ["one-device-read"]
    with pytest.raises(UserError) as error:
        open_source(path, ReadOptions(group_channel="device", group_equals="C"))
    assert error.value.text == f"{path}: no row has 'C' in column 'device'"
    source = open_source(path, ReadOptions(group_channel="device"))
    assert {f.group for f in source.fields} == {"A", "B"}


def test_a_name_that_is_no_text_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    log(path, pa.array(SECONDS), "s")
    path.write_bytes(path.read_bytes().replace(b"speed", b"sp\xff\xfed"))
    with pytest.raises(UserError, match="the name of a column is not UTF-8"):
        open_source(path, ReadOptions())


P, V = np.linspace(0, 3, N), np.linspace(72, 60, N)


def columns(path: Path, table: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """The columns of a written table by title, and the source."""
    pq.write_table(pa.table(table), path, row_group_size=150)
    source = open_source(path, ReadOptions())
    found = source.columns(source.fields)
    return {f.channel + f.path: c for f, c in zip(source.fields, found, strict=True)}, source


def test_structures_and_lists(tmp_path: Path) -> None:
    inner = [{"bogie": {"p_bar": p, "axles_kmh": [v, v - 1.0]}} for p, v in zip(P, V, strict=True)]
    inner[7]["bogie"]["axles_kmh"] = [V[7]]  # one is missing
    inner[8]["bogie"] = None
    table = {"time_s": SECONDS, "car": inner, "tags": [[("a", "b")]] * N, "long": [[1.0] * 100] * N}
    found, source = columns(tmp_path / "a.parquet", table)
    assert list(found) == ["car.bogie.p_bar", "car.bogie.axles_kmh[0]", "car.bogie.axles_kmh[1]"]
    assert np.allclose(found["car.bogie.axles_kmh[1]"].value[:7], V[:7] - 1.0)
    assert np.flatnonzero(~found["car.bogie.axles_kmh[1]"].valid).tolist() == [7, 8]
    assert np.flatnonzero(~found["car.bogie.p_bar"].valid).tolist() == [8]
    [finding] = [f for f in source.findings if f.code == "nested-columns"]
    assert finding.names["columns"] == "tags, long"
    meant, _ = needed(source, ())
    assert [(m.meaning, m.axle, m.unit) for m in meant] == [
        ("pressure", None, "bar"), ("wheel_speed", 1, "kmh"), ("wheel_speed", 2, "kmh")
    ]  # fmt: skip


def test_a_list_of_axles_each_with_its_channels(tmp_path: Path) -> None:
    axles = [[{"bcp_bar": k / N, "v_kmh": 60.0 - j} for j in range(2)] for k in range(N)]
    found, _ = columns(tmp_path / "a.parquet", {"time_s": SECONDS, "axles": axles})
    names = [f"axles[{j}].{x}" for j in range(2) for x in ("bcp_bar", "v_kmh")]
    assert list(found) == names
    assert found["axles[1].v_kmh"].value.tolist() == [59.0] * N


@pytest.mark.parametrize(("length", "names"), [(3, ["v[0]", "v[1]", "v[2]"]), (100, [])])
def test_lists_that_become_longer(tmp_path: Path, length: int, names: list[str]) -> None:
    lists = [[1.0, 2.0]] * 2000 + [[1.0] * length] * 2000
    table = {"time_s": np.arange(4000) / 100, "v": lists, "w": np.arange(4000)}
    found, source = columns(tmp_path / "a.parquet", table)
    assert list(found) == [*names, "w"]
    assert not names or np.count_nonzero(found["v[2]"].valid) == 2000
    assert [f.code for f in source.findings if f.code != "csv-missing-cells"] == (
        [] if names else ["nested-columns"]
    )


@pytest.mark.parametrize("times", [{}, {"time": np.arange(4000) // 2 / 100}])
def test_damage_behind_the_head_names_the_file(tmp_path: Path, times: dict[str, Any]) -> None:
    path = tmp_path / "a.parquet"
    table = pa.table(times | {"v": np.arange(4000) % 7 / 10})
    pq.write_table(table, path, row_group_size=2000, use_dictionary=False)
    place = pq.ParquetFile(path).metadata.row_group(1).column(len(times))
    raw = bytearray(path.read_bytes())
    raw[place.data_page_offset : place.data_page_offset + 20] = b"\xff" * 20
    path.write_bytes(raw)
    with pytest.raises(UserError, match=r"a\.parquet: damaged Parquet file"):
        open_source(path, ReadOptions())


@pytest.mark.parametrize("key", ["units", "Unit", "physical_unit", "unit_string", "uom"])
def test_a_unit_by_any_key_of_the_metadata(tmp_path: Path, key: str) -> None:
    fields = [pa.field("t", pa.float64(), metadata={key: "s"})]
    fields.append(pa.field("bcp", pa.list_(pa.float64()), metadata={"note": "x", key: "kPa"}))
    table = pa.table([SECONDS, [[1.0, 2.0]] * N], schema=pa.schema(fields))
    pq.write_table(table, tmp_path / "a.parquet")
    source = open_source(tmp_path / "a.parquet", ReadOptions())
    assert [(f.channel, f.unit) for f in source.fields] == [("bcp[0]", "kPa"), ("bcp[1]", "kPa")]


def test_nested_columns_alone_are_the_reason(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="Nested columns are not read: axles"):
        columns(tmp_path / "a.parquet", {"time_s": SECONDS, "axles": [[[1.0]]] * N})


@pytest.mark.parametrize("unit", ["bar", "", "10 kPa"])
def test_names_that_are_pairs_of_texts(tmp_path: Path, unit: str) -> None:
    names = ("t", "s"), ("BC pressure", unit), ("axle 1", "speed")
    table = dict(zip(map(str, names), (SECONDS, P, V), strict=True))
    found, source = columns(tmp_path / "a.parquet", table)
    assert list(found) == ["BC pressure", "axle 1 speed"]
    assert [f.unit for f in source.fields] == [unit, ""]


@pytest.mark.parametrize(("key", "is_read"), [("scale_factor", False), ("comment", True)])
def test_raw_numbers_with_a_scale_are_no_pressure(tmp_path: Path, key: str, is_read: bool) -> None:
    path = tmp_path / "a.parquet"
    fields = [pa.field("t [s]", pa.float64()), pa.field("v", pa.float64(), metadata={key: "2"})]
    fields.append(pa.field("p", pa.int16(), metadata={"unit": "bar", key: "0.01"}))
    pq.write_table(pa.table([SECONDS, V, np.arange(N)], schema=pa.schema(fields)), path)
    source = open_source(path, ReadOptions())
    assert [f.channel for f in source.fields] == (["v", "p"] if is_read else ["v"])
    reasons = [f.message for f in source.findings if f.code == "channel-not-read"]
    assert reasons == [] if is_read else f"property {key!r} may scale" in reasons[0]


@pytest.mark.parametrize("in_blocks", [False, True])
def test_tables_of_influxdb(tmp_path: Path, in_blocks: bool) -> None:
    order = "F" if in_blocks else "C"
    names = np.repeat(["p_bar", "v_kmh"], N) if in_blocks else np.tile(["p_bar", "v_kmh"], N)
    times = np.rint(np.stack([SECONDS, SECONDS], 1).ravel(order) * 1e9).astype("datetime64[ns]")
    table = {
        "_time": pa.array(times, pa.timestamp("ns", "UTC")),
        "_value": np.stack([P, V], 1).ravel(order),
        "_field": names,
        "_measurement": ["brake"] * (2 * N),
    }
    found, _ = columns(tmp_path / "a.parquet", table)
    assert list(found) == ["p_bar", "v_kmh"]
    assert np.array_equal(found["v_kmh"].value, V)
    assert np.allclose(found["v_kmh"].t, SECONDS * 1e9)


@pytest.mark.parametrize("key", ["signal", "name", "channel"])
@pytest.mark.parametrize("with_unit", [False, True])
def test_long_tables(tmp_path: Path, key: str, with_unit: bool) -> None:
    names = ("BC pressure", "wheel speed") if with_unit else ("p [bar]", "v [km/h]")
    table = {
        "time_s": np.repeat(SECONDS, 2),
        key: pa.array(list(names) * N).dictionary_encode(),
        "value": np.column_stack([P, V]).ravel(),
    }
    if with_unit:
        table["unit"] = ["bar", "km/h"] * N
    found, source = columns(tmp_path / "a.parquet", table)
    assert list(found) == list(names)
    assert np.allclose(found[names[1]].value, V)
    if with_unit:
        assert [f.unit for f in source.fields] == ["bar", "km/h"]


@pytest.mark.parametrize("names", [("t_p", "t_v"), ("time 1", "time 2"), ("Time [s]", "Zeit [ms]")])
def test_pairs_of_time_and_channel(tmp_path: Path, names: tuple[str, str]) -> None:
    slow = np.full(N, np.nan)
    slow[: N // 5] = SECONDS[::5]
    scale = 1e3 if "ms" in names[1] else 1.0
    p = pa.array(np.where(np.isnan(slow), 0.0, P), mask=np.isnan(slow))
    table = {names[0]: pa.array(slow, mask=np.isnan(slow)), "p [bar]": p}
    table |= {names[1]: scale * (SECONDS + 0.5), "v [km/h]": V, "w [km/h]": V}
    found, source = columns(tmp_path / "a.parquet", table)
    assert np.allclose(found["p [bar]"].t, SECONDS[::5] * 1e9)
    assert np.allclose(found["v [km/h]"].t, (SECONDS + 0.5) * 1e9)
    assert found["v [km/h]"].t is found["w [km/h]"].t
    assert not [f for f in source.findings if f.severity != "info"]


def test_digits_of_a_clock_are_a_time_of_day(tmp_path: Path) -> None:
    seconds = 3_590 + SECONDS * 5
    digits = seconds // 60 % 60 * 100 + seconds % 60 + seconds // 3600 * 10_000
    source = log(tmp_path / "a.parquet", pa.array(digits))
    speed, _ = source.columns(source.fields)
    np.testing.assert_allclose(speed.t / 1e9, seconds, atol=1e-6)
    assert [f.code for f in source.findings] == ["time-digits"]
    assert "HHMMSS" in source.time_reason


def test_numbers_as_texts_are_read_as_in_a_text_log(tmp_path: Path) -> None:
    texts = {"bc [bar]": [f"{0.25 * k:.2f}".replace(".", ",") for k in range(N)]}
    found, source = columns(tmp_path / "a.parquet", {"t [s]": SECONDS, **texts})
    assert source.format == "parquet"
    np.testing.assert_array_equal(found["bc [bar]"].value, 0.25 * np.arange(N))


def test_the_reason_for_a_log_without_numbers_is_no_note_on_its_time(tmp_path: Path) -> None:
    pq.write_table(pa.table({"time": SECONDS, "remark": ["a"] * N}), tmp_path / "a.parquet")
    with pytest.raises(UserError) as error:
        open_source(tmp_path / "a.parquet", ReadOptions())
    assert error.value.text.endswith("the log holds no numbers over time")
