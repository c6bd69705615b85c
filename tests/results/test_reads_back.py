"""What is written is a log that our own reader takes: values, units, times, and which clock."""

from pathlib import Path

import numpy as np
import pytest
from helpers.made_results import EPOCH, result

from adhesion_cli.channels.meaning import understood
from adhesion_cli.core.model import Channel, Column, Log
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.results import mcap, wide_table

WRITERS = {"csv": wide_table.write_csv, "mcap": mcap.write_log}


def channel(name: str, unit: str, t: list[int], values: list[float], start: int) -> Channel:
    data = Column(np.array(t) + start, np.array(values), np.isfinite(values))
    return Channel(name, "", None, None, unit, "", data)


@pytest.mark.parametrize("start", [0, EPOCH], ids=["seconds", "clock"])
@pytest.mark.parametrize("suffix", ["csv", "mcap"])
def test_log(tmp_path: Path, suffix: str, start: int) -> None:
    channels = (
        channel("BC pressure", "bar", [0, 10**7, 2 * 10**7], [0.5, np.nan, -3e-9], start),
        channel("axle 1 speed", "km/h", [0, 1, 10**7, 3 * 10**7], [80.0, 80.0, 79.1, 1 / 3], start),
    )
    path = tmp_path / f"a.{suffix}"
    WRITERS[suffix](path, Log("", "", "", start > 0, 4, channels, ()))
    source = open_source(path, ReadOptions())
    fields = [f for f in source.fields if f.path in ("", "value")]
    assert source.absolute == (start > 0)
    for written, field, column in zip(channels, fields, source.columns(fields), strict=True):
        known, expected = column.valid, written.data.valid
        assert field.channel.startswith(written.name)
        np.testing.assert_array_equal(column.t[known], written.data.t[expected])
        np.testing.assert_array_equal(column.value[known], written.data.value[expected])
    meant, findings = understood(source.fields, [])
    assert {(m.meaning, m.unit) for m in meant if m.meaning} == {
        ("pressure", "bar"),
        ("wheel_speed", "km/h"),
    }
    assert not findings


def test_result(tmp_path: Path) -> None:
    """A result file is itself a log: pressure, speeds and truth of every axle."""
    mcap.write_results(tmp_path / "a.adhesion.mcap", [result(2, 100)], "{}")
    source = open_source(tmp_path / "a.adhesion.mcap", ReadOptions())
    meant, _ = understood(source.fields, [])
    found = {(m.meaning, m.axle, m.field.channel, m.field.path) for m in meant if m.meaning}
    for N in (1, 2):
        assert {
            ("pressure", N, f"/axle/{N}/input", "brake_cylinder_pressure"),
            ("wheel_speed", N, f"/axle/{N}/input", "wheel_speed"),
            ("truth", N, f"/axle/{N}/truth", "force"),
            ("true_slip", N, f"/axle/{N}/truth", "slip"),
        } <= found
    (speed,) = [m.field for m in meant if m.meaning == "wheel_speed" and m.axle == 2]
    (column,) = source.columns([speed])
    record = result(2, 100).axles[1].record
    np.testing.assert_array_equal(column.t, record.t)
    np.testing.assert_array_equal(column.value, record.wheel_speed)
