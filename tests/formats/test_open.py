"""Which reader opens a file, and formats that are known and not read."""

import bz2
import lzma
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

INFLUX = "brake,car=1,axle=2 bc_pressure=1.25,speed=70i 1795515300000000000\n"


@pytest.mark.parametrize(
    ("head", "says", "remedy"),
    [
        (b"|CF,2,1,1;", "imc FAMOS", "MDF 4"),
        (b'<?xml version="1.0"?>\n<usi:tdm xmlns:usi="x">', "DIAdem TDM", "TDMS"),
        (b"#ROSBAG V2.0\n", "ROS 1 bag", "MCAP"),
        (b"SQLite format 3\0", "ROS 2 bag", "MCAP"),
        (b"\x89HDF\r\n\x1a\n", "HDF5", "Parquet"),
        (INFLUX.encode(), "InfluxDB", "column for each field"),
        (b"brake value=0.25 1795515300000000000\n", "InfluxDB", "column for each field"),
        (b"#datatype,string,long,dateTime:RFC3339\n", "InfluxDB", "column for each field"),
    ],
)
def test_known_formats_that_are_not_read_are_named(
    tmp_path: Path, head: bytes, says: str, remedy: str
) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(head + head * 40)
    with pytest.raises(UserError, match=says) as error:
        open_source(path, ReadOptions())
    assert remedy in error.value.hint


@pytest.mark.parametrize("pack", [lzma.compress, bz2.compress])
def test_packed_text_logs(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    rows = "".join(f"{k / 50},{k % 7}\n" for k in range(500))
    packed = pack(f"time [s],p [bar]\n{rows}".encode())
    path = tmp_path / "a.csv.packed"
    path.write_bytes(packed)
    source = open_source(path, ReadOptions())
    [column] = source.columns(source.fields)
    assert np.array_equal(column.value, np.arange(500) % 7)
    assert not source.findings
    source = open_source(path, ReadOptions(max_unpacked=1000))
    with pytest.raises(UserError, match="inflates to more than"):
        source.columns(source.fields)
