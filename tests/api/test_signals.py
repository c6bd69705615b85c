"""Logs in memory: arrays and tables are read as the same log in a file."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

import adhesion_cli as adhesion
from adhesion_cli.cli.app import app
from adhesion_cli.core.bundled import SAMPLE, folder

BRAKE = folder("sample_logs") / SAMPLE


@pytest.fixture(scope="module")
def table() -> pa.Table:
    return pyarrow.csv.read_csv(BRAKE)


@pytest.fixture(scope="module")
def of_file() -> adhesion.Analysis:
    return adhesion.analyze(BRAKE, algos="td")


def same(a: adhesion.Analysis, b: adhesion.Analysis) -> bool:
    """Whether two runs have the same brake applications and scores.

    The vehicle is found from the log: the last digits of its times show in those of the force.
    """
    x, y = (numbers(run.document["results"][0]["axles"]) for run in (a, b))
    return x.keys() == y.keys() and x == pytest.approx(y, rel=1e-6, abs=1e-9)


def numbers(tree: object, path: str = "") -> dict[str, float]:
    """The numbers of a document by their place."""
    if isinstance(tree, dict | list):
        entries = tree.items() if isinstance(tree, dict) else enumerate(tree)
        return {k: x for key, x in entries for k, x in numbers(x, f"{path}/{key}").items()}
    return {path: float(tree)} if isinstance(tree, int | float) else {}


def test_arrays_give_the_figures_of_the_file(table: pa.Table, of_file: adhesion.Analysis) -> None:
    time, pressure, speed, truth = (c.to_numpy() for c in table.columns)
    log = adhesion.Signals(
        time, {"p": pressure, "wheel speed [km/h]": speed, "adhesion_force_true": truth},
        units={"p": "bar", "adhesion_force_true": "N"}, name="bench",
    )  # fmt: skip
    run = adhesion.analyze(log, algos="td")
    assert same(run, of_file)
    assert (run.log.path, run.log.format, run.log.rows_read) == ("bench", "memory", len(time))
    assert run.document["results"][0]["log"]["rows_used"] > 1000
    fewer = adhesion.Signals(time, {"p": pressure, "wheel speed [km/h]": speed}, {"p": "bar"})
    assert run.log.sha256 != adhesion.inspect(fewer).log.sha256


def test_tables_give_the_figures_of_the_file(table: pa.Table, of_file: adhesion.Analysis) -> None:
    pandas = pytest.importorskip("pandas")
    assert same(adhesion.analyze(table, algos="td"), of_file)
    frame = table.to_pandas()
    assert same(adhesion.analyze(frame, algos="td"), of_file)
    elapsed = pandas.to_timedelta(frame.pop("time [s]"), "s")
    frame.index = pandas.DatetimeIndex(pandas.Timestamp("2026-11-03", tz="UTC") + elapsed)
    run = adhesion.analyze(frame, algos="td")
    assert same(run, of_file)
    assert run.document["results"][0]["log"]["start"] == "2026-11-03T00:00:00Z"
    told = pa.table({"t": table.column(0), "p": table.column(1), "v": table.column(2)}).cast(
        pa.schema([
            ("t", pa.float64()), pa.field("p", pa.float64(), metadata={"unit": "bar"}),
            pa.field("v", pa.float64()),
        ])
    )  # fmt: skip
    channels = {"pressure": "p", "speed": {"channel": "v", "unit": "km/h"}}
    log = adhesion.Signals.from_table(told, time="t")
    assert [c.unit for c in adhesion.inspect(log).channels] == ["bar", ""]
    applications = adhesion.analyze(log, algos="td", channels=channels).applications
    assert applications == of_file.applications


def test_a_unit_that_nobody_states_is_an_error(table: pa.Table) -> None:
    bare = table.rename_columns(["t", "bc_pressure", "wheel_speed [km/h]", "true [N]"])
    with pytest.raises(adhesion.UserError, match="its unit is not stated"):
        adhesion.analyze(bare)


@pytest.mark.parametrize(
    ("time", "values", "units", "text"),
    [
        ([0.0, 1.0], {"p": [1.0]}, {}, r"shape \(1,\)"),
        ([0.0, np.nan], {"p": [1.0, 2.0]}, {}, "no row of numbers"),
        ([[0.0]], {"p": [[1.0]]}, {}, "no row of numbers"),
        (["a"], {"p": [1.0]}, {}, "no row of numbers"),
        ([0.0], {"p": ["x"]}, {}, "no number"),
        ([0.0], {"p": [1.0]}, {"q": "bar"}, "'q'"),
    ],
)
def test_what_is_no_signal_is_refused(
    time: list[float], values: dict[str, list[float]], units: dict[str, str], text: str
) -> None:
    with pytest.raises(adhesion.UserError, match=text):
        adhesion.Signals(time, values, units)


def test_what_is_no_log_is_refused() -> None:
    with pytest.raises(adhesion.UserError, match="one log"):
        adhesion.analyze([BRAKE])
    for wrong in (5, {"a": 1}, None):
        with pytest.raises(adhesion.UserError, match="is no table"):
            adhesion.analyze(wrong)
    with pytest.raises(adhesion.UserError, match="no log given"):
        adhesion.compare([])


def test_a_simulation_is_the_log_that_the_command_writes(tmp_path: Path) -> None:
    log = adhesion.simulate("service-brake", seed=3)
    app(
        ["simulate", "service-brake", "--seed", "3", "-o", str(tmp_path / "cli.mcap"), "-q"],
        standalone_mode=False,
    )
    assert (
        adhesion.convert(log, tmp_path / "api.mcap").read_bytes()
        == (tmp_path / "cli.mcap").read_bytes()
    )
    assert log["bc_pressure"].shape == log.time("bc_pressure").shape
    assert log.units["bc_pressure"] == "bar"
    of_file = adhesion.analyze(tmp_path / "cli.mcap", algos="td")
    (one,), (other,) = adhesion.analyze(log, algos="td").applications, of_file.applications
    assert one.coefficient is not None
    assert other.coefficient is not None
    assert one.coefficient.mean == pytest.approx(other.coefficient.mean, rel=1e-6)
    with pytest.raises(adhesion.UserError, match="unknown scenario"):
        adhesion.simulate("service-brak")
