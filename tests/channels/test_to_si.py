import json
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import Run

from adhesion_cli.channels.to_si import codes_of_no_value, with_held
from adhesion_cli.core.model import Bools, Column, Floats, Times
from adhesion_cli.core.time_axis import clean

MS = 1_000_000
T = np.arange(0, 30_000, 20) * MS
P = np.round(4.0 * np.clip(np.minimum((T - 3e9) / 1.5e9, (27e9 - T) / 1.5e9), 0.0, 1.0), 2)


def on_change(value: Floats) -> Column:
    rows = np.flatnonzero(np.diff(value, prepend=np.nan) != 0.0)
    return Column(T[rows], value[rows], np.ones(len(rows), np.bool_))


def held(column: Column, t: Times) -> tuple[Column, Bools]:
    return with_held(column, int(t[-1]), np.zeros(len(column.t), np.bool_))


def test_recorder_that_writes_changes_holds_its_values_until_the_end_of_the_log() -> None:
    column = on_change(P)
    filled, added = held(column, T)
    assert added.sum() == len(T) - len(column.t) > 1_200
    np.testing.assert_array_equal(filled.t, T)
    np.testing.assert_array_equal(filled.value, P)
    in_table = Column(T, np.where(np.isin(T, column.t), P, np.nan), np.isin(T, column.t))
    np.testing.assert_array_equal(held(in_table, T)[0].value, P)


@pytest.mark.parametrize("heartbeat", [0, 100])
@pytest.mark.parametrize("deadband", [0.0, 0.02])
def test_held_values_of_a_polled_brake_leave_no_gap(heartbeat: int, deadband: float) -> None:
    """Steps of 0.4 bar on the way up, of 0.01 bar at its end; some values come once more."""
    t = np.arange(0, 60_000, 100) * MS
    rise, fall = (4.0 * (1.0 - np.exp(-np.maximum(t / 1e9 - x, 0.0) / 0.8)) for x in (10.0, 40.0))
    value, written, last = np.round(rise - fall, 2), np.zeros(len(t), np.bool_), np.inf
    for k, x in enumerate(value.tolist()):
        if abs(x - last) > deadband or (heartbeat and k % heartbeat == 0):
            written[k], last = True, x
    filled, _ = held(Column(t, value, written), t)
    assert np.diff(filled.t).max() <= 300 * MS
    assert np.abs(filled.value - value[np.searchsorted(t, filled.t)]).max() <= deadband + 1e-9


def test_old_value_that_comes_once_more_right_before_a_change_leaves_no_gap() -> None:
    t = np.arange(0, 60_000, 100) * MS
    braked = np.clip(t / 1e9 - 20.0, 0.0, 10.0) + np.clip(t / 1e9 - 40.0, 0.0, 10.0)
    value = np.round(2.0 * (70.0 - 1.7 * braked)) / 2.0  # steps of 0.5
    changes = np.diff(value, prepend=np.nan) != 0.0
    written = changes | np.append(changes[1:], False)
    filled, added = held(Column(t[written], value[written], written[written]), t)
    assert added.any()
    assert np.diff(filled.t).max() <= 300 * MS
    assert (filled.value == value[np.searchsorted(t, filled.t)]).all()
    assert not held(Column(t[::3], value[::3], written[::3] | True), t)[1].any()  # an even recorder


def test_value_far_from_the_one_before_a_pause_was_not_held() -> None:
    column = on_change(P)
    lost = (column.t > 25.7e9) & (column.t < 26.6e9)  # most of the release
    kept = Column(column.t[~lost], column.value[~lost], column.valid[~lost])
    (gap,) = [f for f in clean("p", held(kept, T)[0], 0).findings if f.code == "gap"]
    assert gap.spans == (pytest.approx((25.7, 26.6), abs=0.03),)


@pytest.mark.parametrize("noise", [0.0, 0.004, 0.03, 1.0])
@pytest.mark.parametrize("digits", [2, 3, 12])
@pytest.mark.parametrize("lost", [(5.0, 8.0), (3.1, 3.6), (28.0, 29.0), (10.0, 24.0)])
def test_lost_samples_of_an_even_recorder_are_a_gap(
    noise: float, digits: int, lost: tuple[float, float]
) -> None:
    falls = 70.0 - 0.2 * T / 1e9 - 0.01 * (T / 1e9) ** 1.5
    for signal in (P, falls):
        value = np.round(signal + np.random.default_rng(0).normal(0.0, noise, len(T)), digits)
        kept = (lost[0] * 1e9 > T) | (lost[1] * 1e9 < T)
        _, added = held(Column(T[kept], value[kept], kept[kept]), T)
        assert not added.any()


@pytest.mark.parametrize("code", [-9999.0, 9999.0, -999.25, -32768.0, 65535.0, 6553.5, 1e30, 1e20])
def test_code_of_no_value_is_left_out_and_counted(tmp_path: Path, run: Run, code: float) -> None:
    value = P.copy()
    value[5::100], value[7::500] = code, -99999.0
    rows = (
        f"{t / 1e9},{p},70.{t // MS % 7}\n" for t, p in zip(T.tolist(), value.tolist(), strict=True)
    )
    (tmp_path / "a.csv").write_text(
        "time [s],BC pressure [bar],wheel speed [km/h]\n" + "".join(rows)
    )
    (log,) = json.loads(run("inspect", "--json", "a.csv").stdout)["logs"]
    notes = [f for f in log["findings"] if f["code"] == "value-is-code"]
    assert {f["values"]["number"]: (f["severity"], f["count"]) for f in notes} == {
        code: ("info", 15), -99999.0: ("info", 3),
    }  # fmt: skip
    assert [c["valid"] for c in log["channels"]] == [1482, 1500]
    assert "pressure-negative" not in {f["code"] for f in log["findings"]}


def test_a_short_code_is_one_below_zero_only() -> None:
    assert codes_of_no_value(np.append(P, [-99.0, -99.0])) == [-99.0]
    assert codes_of_no_value(np.append(P, [99.0, 99.0])) == []


@pytest.mark.parametrize("value", [[0.0, 999.0], [99.9, 60.0], [9999.0], [0.0, 33.3, 99.9]])
def test_values_that_may_be_measured_are_no_code(value: list[float]) -> None:
    assert codes_of_no_value(np.repeat(value, 20)) == []


@pytest.mark.parametrize("name", ["brake demand [%]", "Emergency brake"])
def test_demand_and_states_have_no_codes(tmp_path: Path, run: Run, name: str) -> None:
    demand = np.where(T < 20e9, np.arange(len(T)) % 40, 99.9)
    rows = (f"{t / 1e9},{p},{d}\n" for t, p, d in zip(T, P, demand, strict=True))
    (tmp_path / "a.csv").write_text(f"time [s],BC pressure [bar],{name}\n" + "".join(rows))
    (log,) = json.loads(run("inspect", "--json", "a.csv").stdout)["logs"]
    assert [c["valid"] for c in log["channels"]] == [1500, 1500]
    assert "value-is-code" not in {f["code"] for f in log["findings"]}


def test_speed_of_each_wheel_revolution_is_not_held() -> None:
    t, v, written = 0.0, 20.0, list[tuple[float, float]]()
    while v > 0.6:
        duration = 2.9 / v
        t, v = t + duration, v - (0.9 if v > 4.0 else 0.03) * duration
        written.append((t, round(3.6 * v, 1)))
    times, value = np.array(written).T
    column = Column(np.rint(times * 1e9).astype(np.int64), value, np.ones(len(value), np.bool_))
    assert not held(column, column.t)[1].any()


def test_slow_samples_of_a_recorder_with_two_rates_are_not_held() -> None:
    t = np.r_[np.arange(60.0), np.arange(60.0, 80.0, 0.05)]
    value = np.round(90.0 - 0.072 * t - 3.2 * np.maximum(t - 60.0, 0.0) ** 1.01, 2)
    column = Column(np.rint(t * 1e9).astype(np.int64), value, np.ones(len(t), np.bool_))
    assert not held(column, column.t)[1].any()


def test_value_holds_no_longer_than_until_a_code_and_counts_are_those_of_the_log(
    tmp_path: Path, run: Run
) -> None:
    """The recorder says -9999 all the time of a brake application."""
    column = on_change(P)
    cell_of = dict(zip(column.t.tolist(), map(str, column.value.tolist()), strict=True))
    again = {t + 30_000 * MS: "-9999" if 3e9 < t < 27e9 else cell for t, cell in cell_of.items()}
    cells, times = cell_of | again, np.arange(0, 60_000, 20) * MS
    rows = (f"{t / 1e9},{cells.get(t, '')},70.{t // MS % 7}\n" for t in times.tolist())
    (tmp_path / "a.csv").write_text(
        "time [s],BC pressure [bar],wheel speed [km/h]\n" + "".join(rows)
    )
    (log,) = json.loads(run("inspect", "--json", "a.csv").stdout)["logs"]
    findings = {f["code"]: f for f in log["findings"]}
    codes = sum(cell == "-9999" for cell in cells.values())
    assert findings["value-is-code"]["count"] == codes > 100
    ((begin, end),) = findings["gap"]["spans"]
    assert (begin, end) == (pytest.approx(33.0, abs=0.1), pytest.approx(57.0, abs=0.1))
    assert [c["valid"] for c in log["channels"]] == [len(cells) - codes, 3000]
