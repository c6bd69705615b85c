"""Which reader opens a file, and formats that are known and not read."""

import bz2
import lzma
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.pasted import pasted
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from adhesion_cli.analysis.settings import load
from adhesion_cli.channels.log import needed, read
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.units import in_name, unit
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.records.choose import choose

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


T, P, V = np.arange(200) / 50, np.linspace(0.0, 3.0, 200), np.linspace(72.0, 60.0, 200)


def tdms(path: Path) -> None:
    """The time channel and the increment differ."""
    waves = [("BC pressure", P, "bar"), ("wheel speed", V, "km/h")]
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("g", "Time", T, {"unit_string": "s"}), *(
            ChannelObject("g", name, value, {"unit_string": unit, "wf_increment": 0.05})
            for name, value, unit in waves
        )])  # fmt: skip


def table(*names: str) -> Callable[[Path], None]:
    """A log with these names of time, pressure and speed."""

    def write(path: Path) -> None:
        if path.suffix == ".parquet":
            pq.write_table(pa.table(dict(zip(names, (T, P, V), strict=True))), path)
        elif path.suffix == ".mat":
            savemat(path, dict(zip(names, (T, P, V), strict=True)))
        else:
            rows = zip(T, P, V, strict=True)
            text = "".join(f"{t:.2f};{p:.3f};{v:.3f}\n" for t, p, v in rows)
            path.write_text(";".join(names) + "\n" + text, "utf-8")

    return write


@pytest.mark.parametrize(
    ("name", "write", "says"),
    [
        ("a.tdms", tdms, "wf_increment = 0.05 s"),
        ("a.parquet", table("x", "BC pressure [bar]", "v [km/h]"), "no column is a time"),
        ("b.parquet", table("time_s", "BC pressure", "v [km/h]"), "its unit is not stated"),
        ("a.mat", table("time_s", "bc_pressure", "v_kmh"), "its unit is not stated"),
        ("c.csv", table("time [s]", "BC pressure (0-10 bar)", "v [km/h]"), "unit '0-10 bar'"),
        ("d.csv", table("time [s]", "BC pressure 10bar", "v [km/h]"), "unit '10bar'"),
    ],
)
def test_the_remedy_of_each_hint_works(
    tmp_path: Path, name: str, write: Callable[[Path], None], says: str
) -> None:
    path = tmp_path / name
    write(path)

    def meanings(assignments: list[str]) -> list[str]:
        settings = load(assignments=assignments, folder=False)
        meant, _ = needed(open_source(path, settings.read), settings.mappings)
        return [str(m.meaning) for m in meant]

    with pytest.raises(UserError, match=says) as error:
        meanings([])
    assert meanings(pasted(error.value.hint)) == ["pressure", "wheel_speed"]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("[bar x10]", "0.1 bar"),
        ("[bar] x10", "0.1 bar"),
        ("[bar*0.01]", "0.01 bar"),
        ("[bar·10⁻²]", "0.01 bar"),
        ("[mbar/10]", "0.1 mbar"),
        ("[hPa x 10]", "10 hPa"),
        ("[Pa*1000]", "1000 Pa"),
        ("[dPa]", "0.1 Pa"),
    ],
)
def test_a_factor_behind_a_unit_is_asked_for_by_the_likely_one(
    tmp_path: Path, unit: str, factor: str
) -> None:
    path = tmp_path / "a.csv"
    table("time [s]", f"BC pressure {unit}", "v [km/h]")(path)
    with pytest.raises(UserError, match="unknown unit") as error:
        needed(open_source(path, ReadOptions()), ())
    settings = load(assignments=pasted(error.value.hint), folder=False)
    meant, _ = needed(open_source(path, settings.read), settings.mappings)
    assert meant[0].unit == factor
    assert ("(or " in error.value.hint) == (unit != "[dPa]")


def test_a_unit_that_nobody_knows_is_not_said_to_be_the_usual_one(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table("time [s]", "BC pressure [foo]", "v [km/h]")(path)
    with pytest.raises(UserError, match="unknown unit") as error:
        needed(open_source(path, ReadOptions()), ())
    assert error.value.hint.startswith(
        "if 1 'foo' is 1 bar, state it, as `--set channels.pressure.unit=bar`"
    )


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("MPa(g)", 1e6), ("kPa (rel)", 1e3),
        ("kPa-g", 1e3), ("bar (ü)", 1e5), ("kp/cm²", 98066.5), ("Upm", np.pi / 30),
        ("bar rel.", 1e5), ("kN/m²", 1e3), ("mmHg", 133.322),
        ("km.h-1", 1 / 3.6), ("kilometers per hour", 1 / 3.6), ("m/min", 1 / 60),
    ],
)  # fmt: skip
def test_units_of_other_trades(text: str, factor: float) -> None:
    known = unit(in_name(f"x [{text}]")[1])
    assert known is not None
    assert known.factor == pytest.approx(factor, rel=1e-5)


@pytest.mark.parametrize(
    ("names", "missing", "hint"),
    [
        (("time [s]", "C-Wert", "v [km/h]"), "pressure", "channels.pressure.channel=C-Wert"),
        (("time [s]", "C-Wert [kPa]", "v [km/h]"), "pressure", "channels.pressure.unit=kPa"),
        (("time [s]", "BC pressure [bar]", "xyz"), "wheel speed", "channels.speed.axle1"),
        (("time [s]", "main reservoir [bar]", "v [km/h]"), "pressure", ""),
    ],
)
def test_a_missing_channel_is_asked_for_by_one_of_the_log(
    tmp_path: Path, names: tuple[str, str, str], missing: str, hint: str
) -> None:
    path = tmp_path / "a.csv"
    table(*names)(path)

    def chosen(assignments: list[str]) -> set[str]:
        settings = load(assignments=assignments, folder=False)
        log = read(open_source(path, settings.read), settings.mappings, Vehicle())
        return {str(meaning) for meaning, _ in choose(log, (), Vehicle()).channels}

    with pytest.raises(UserError, match=f"no channel is a .*{missing}") as error:
        chosen([])
    assert hint in error.value.hint
    assert "NAME" not in error.value.hint
    if hint:
        assert {"pressure", "wheel_speed"} <= chosen(pasted(error.value.hint))
