from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helpers.pasted import pasted

from adhesion_cli.analysis.prepare import Window, prepare
from adhesion_cli.core import time_axis
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import AxleRecord, Channel, Column, Log, Meaning, Vehicle
from adhesion_cli.core.physics import clamping_force, rolling_deceleration, wheelset

BAR = 1e5


def channel(
    meaning: Meaning, t_s: np.ndarray, value: np.ndarray, axle: int | None = None
) -> Channel:
    t = np.round(np.asarray(t_s) * 1e9).astype(np.int64)
    data = Column(t, np.asarray(value, dtype=float), np.isfinite(value))
    axis = time_axis.clean(str(meaning), data, 0)
    return Channel(
        str(meaning), "", meaning, axle, "", "", axis.data, len(t), axis.starts, axis.gap_ns
    )


def log(*channels: Channel) -> Log:
    return Log("a.csv", "csv", "", False, 0, channels, ())


def records(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: Window = (None, None),
) -> tuple[list[AxleRecord], list[Finding]]:
    """The records of a log, and what was found on the way to them, but for the vehicle's brake.

    The speeds of these logs are straight lines, which no stated brake explains.
    """
    prepared = prepare(log, vehicle, axles, window)
    findings = [f for f in prepared.findings if f.code != "deceleration-unexplained"]
    return prepared.records, findings


def brake(rate: float = 100.0, seconds: float = 10.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], pressure [Pa] that rises and wheel speed [rad/s] that falls."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    return t, 4.0 * BAR * np.minimum(t / 2.0, 1.0), 50.0 - 2.0 * t


def test_same_stamps_give_the_log_row_by_row() -> None:
    t, p, y = brake()
    (record,), findings = records(
        log(channel("pressure", t, p), channel("wheel_speed", t, y)), Vehicle()
    )
    assert record.axle == 1
    np.testing.assert_array_equal(record.wheel_speed, y)
    np.testing.assert_allclose(record.clamping_force, clamping_force(p, Vehicle()))
    assert record.segments == (slice(0, len(t)),)
    assert not findings


def test_a_slower_pressure_is_held_for_estimators_and_interpolated_for_the_reference() -> None:
    t, p, y = brake()
    record = records(
        log(channel("pressure", t[::10], p[::10]), channel("wheel_speed", t, y)), Vehicle()
    )[0][0]
    assert record.pressure is not None
    np.testing.assert_array_equal(record.pressure, np.repeat(p[::10], 10))
    inner = slice(0, len(t) - 10)
    expected = clamping_force(p, Vehicle())[inner]
    np.testing.assert_allclose(record.clamping_force_smooth[inner], expected, atol=1e-6)


def test_changing_later_pressures_changes_no_earlier_clamping_force() -> None:
    t, p, y = brake()
    changed = p.copy()
    changed[500:] *= 0.5
    first, second = (
        records(log(channel("pressure", t, q), channel("wheel_speed", t, y)), Vehicle())[0][0]
        for q in (p, changed)
    )
    np.testing.assert_array_equal(first.clamping_force[:500], second.clamping_force[:500])


def test_a_gap_in_either_channel_parts_segments() -> None:
    t, p, y = brake()
    cut = (t < 4.0) | (t > 5.0)
    for keep_p, keep_y in ((cut, t >= 0), (t >= 0, cut)):
        speed = channel("wheel_speed", t[keep_y], y[keep_y])
        (record,), _ = records(log(channel("pressure", t[keep_p], p[keep_p]), speed), Vehicle())
        assert len(record.segments) == 2
        first, second = record.segments
        assert first.stop == second.start
        assert (record.t[second.start] - record.t[first.stop - 1]) / 1e9 > 0.9


def test_a_frozen_speed_is_found_and_left_out() -> None:
    t, p, y = brake()
    y = y + 0.003 * np.sin(1e3 * t)
    y[600:800] = y[600]
    (record,), findings = records(
        log(channel("pressure", t, p), channel("wheel_speed", t, y)), Vehicle()
    )
    (frozen,) = [f for f in findings if f.code == "speed-stuck"]
    assert (frozen.count, frozen.severity) == (199, "warning")
    assert frozen.spans == (pytest.approx((6.01, 7.99)),)
    assert len(record.segments) == 2


def test_a_constant_speed_without_brake_is_not_frozen() -> None:
    t, p, y = brake()
    y[:] = 50.0
    _, findings = records(
        log(channel("pressure", t, 0 * p), channel("wheel_speed", t, y)), Vehicle()
    )
    assert not findings


def test_a_speed_in_steps_that_stands_after_the_release_is_not_frozen() -> None:
    t = np.arange(0.0, 30.0, 0.01)
    p = np.interp(t, [2.0, 4.0, 22.0, 24.0], [0.0, 3.0 * BAR, 3.0 * BAR, 0.0])
    K = clamping_force(p, Vehicle())
    y = 60.0 - np.cumsum(K) * 0.01 * 40.0 / np.sum(K * 0.01)
    speed = replace(channel("wheel_speed", t, np.round(y / 0.066) * 0.066), step=0.066)
    _, findings = records(log(channel("pressure", t, p), speed), Vehicle())
    assert "speed-stuck" not in {f.code for f in findings}


@pytest.mark.parametrize("drive", [0.3, 0.7, 1.5, 3.0])  # of the wheel [rad/s²]
def test_a_train_that_starts_and_stops_is_no_suspect(drive: float) -> None:
    t = np.arange(0.0, 100.0, 0.05)
    p = np.interp(t, [50.0, 52.0, 64.0, 66.0], [0.0, 3.0 * BAR, 3.0 * BAR, 0.0])
    K, w = clamping_force(p, Vehicle()), wheelset(Vehicle(), 1)
    gained = np.where((t > 2.0) & (t < 40.0), drive, 0.0) - rolling_deceleration(w) * K
    y = 20.0 + np.cumsum(gained) * 0.05
    _, findings = records(log(channel("pressure", t, p), channel("wheel_speed", t, y)), Vehicle())
    assert not findings


def test_quantised_speed_is_not_frozen() -> None:
    t, p, y = brake()
    y = np.round(y / 0.5) * 0.5
    speed = replace(channel("wheel_speed", t, y), step=0.5)
    assert not records(log(channel("pressure", t, p), speed), Vehicle())[1]


def test_axles_keep_apart_and_one_pressure_serves_all() -> None:
    t, p, y = brake()
    speeds = [channel("wheel_speed", t, y - n, n) for n in (1, 2, 3)]
    found, _ = records(log(channel("pressure", t, p), *speeds), Vehicle())
    assert [r.axle for r in found] == [1, 2, 3]
    assert [r.wheel_speed[0] for r in found] == [49.0, 48.0, 47.0]
    only, _ = records(log(channel("pressure", t, p), *speeds), Vehicle(), axles=[2])
    assert [r.axle for r in only] == [2]


def test_an_axle_without_pressure_is_reported() -> None:
    t, p, y = brake()
    found, findings = records(
        log(
            channel("pressure", t, p, 1),
            channel("wheel_speed", t, y, 1),
            channel("wheel_speed", t, y, 2),
        ),
        Vehicle(),
    )
    assert [r.axle for r in found] == [1]
    (told,) = findings
    assert (told.code, told.severity, told.values) == ("axle-incomplete", "warning", {"axle": 2})
    assert "channels.pressure.axle2.channel=pressure" in (told.hint or "")  # the one there is
    _, findings = records(
        log(*(channel("pressure", t, p, n) for n in (1, 2)), channel("wheel_speed", t, y, 1)),
        Vehicle(),
    )
    assert "channels.speed.axle2.channel=NAME" in (findings[0].hint or "")  # of one wheel
    with pytest.raises(UserError) as error:
        records(log(channel("pressure", t, p, 2), channel("wheel_speed", t, y, 3)), Vehicle())
    assert "channels.speed.axle2.channel=wheel_speed" in error.value.hint  # of no other axle


def test_the_pressure_of_the_other_axle_of_a_bogie_is_proposed() -> None:
    t, p, y = brake()
    speeds = [channel("wheel_speed", t, y, n) for n in (1, 2, 3, 4)]
    named = [replace(channel("pressure", t, p, n), name=f"p of {n}") for n in (1, 3)]
    _, findings = records(log(*named, *speeds), Vehicle())
    hints = {f.values["axle"]: f.hint or "" for f in findings}
    for axle, lacking in ((1, 2), (3, 4)):  # it stays the pressure of its own axle
        assert pasted(hints[lacking]) == [
            f"channels.pressure.axle{axle}.channel=p of {axle}",
            f"channels.pressure.axle{lacking}.channel=p of {axle}",
        ]


def test_the_window_counts_from_the_logs_start() -> None:
    t, p, y = brake()
    (record,), _ = records(
        log(channel("pressure", t + 100.0, p), channel("wheel_speed", t + 100.0, y)),
        Vehicle(), window=(2.0, 3.0),
    )  # fmt: skip
    assert (record.t[0], record.t[-1]) == (102 * 10**9, 103 * 10**9)


def test_refusals_name_the_place_and_the_remedy() -> None:
    t, p, y = brake()
    pressure, speed = channel("pressure", t, p), channel("wheel_speed", t, y)
    with pytest.raises(UserError, match="wheel speed") as error:
        records(log(pressure), Vehicle())
    assert "`adhesion inspect` lists the channels" in error.value.hint
    with pytest.raises(UserError, match="brake-cylinder pressure"):
        records(log(speed), Vehicle())
    with pytest.raises(UserError, match="share no time"):
        records(log(channel("pressure", t + 1e4, p), speed), Vehicle())
    apart = channel("pressure", t, p, 1), channel("wheel_speed", t, y, 2)
    with pytest.raises(UserError, match=r"Axle 1 has no wheel speed.*Axle 2 has no pressure"):
        records(log(*apart), Vehicle())
    with pytest.raises(UserError, match="1 usable"):
        records(log(pressure, channel("wheel_speed", t[:1], y[:1])), Vehicle())
    with pytest.raises(UserError, match="no axle 7"):
        records(log(pressure, speed), Vehicle(), axles=[7])


def test_two_passes_through_one_time_keep_their_own_pressure() -> None:
    t, p, y = brake(50.0, 4.0)
    twice = np.concatenate([t, t])
    pressure = channel("pressure", twice, np.concatenate([0.0 * p, p]))
    speed = channel("wheel_speed", twice, np.concatenate([y, y]))
    (record,), _ = records(log(pressure, speed), Vehicle())
    assert record.pressure is not None
    first, second = record.segments
    assert not record.pressure[first].any()
    np.testing.assert_array_equal(record.pressure[second], p)


def test_the_pressures_resolution_reaches_the_clamping_force() -> None:
    t, p, y = brake()
    coarse = replace(channel("pressure", t, np.round(p / 1e4) * 1e4), step=1e4)
    (record,), _ = records(log(coarse, channel("wheel_speed", t, y)), Vehicle())
    force = clamping_force(np.array([3e5, 3.1e5]), Vehicle())
    assert record.clamping_force_step == pytest.approx(force[1] - force[0])


def test_running_backwards_brakes_all_the_same() -> None:
    t, p, y = brake()
    forward, backward = (
        records(log(channel("pressure", t, p), channel("wheel_speed", t, x)), Vehicle())
        for x in (y, -y)
    )
    np.testing.assert_array_equal(forward[0][0].wheel_speed, backward[0][0].wheel_speed)
    assert [f.code for f in backward[1]] == ["reverse-running"]


@pytest.mark.parametrize("wheel", [1.0, -1.0])
def test_a_train_speed_of_the_other_sign_is_taken_without_it(wheel: float) -> None:
    t, p, y = brake()
    pressure = channel("pressure", t, p)

    def made(of_wheel: float, of_train: float) -> tuple[AxleRecord, list[Finding]]:
        speeds = channel("wheel_speed", t, of_wheel * y), channel("train_speed", t, of_train * y)
        (record,), findings = records(log(pressure, *speeds), Vehicle())
        return record, findings

    forward, (record, findings) = made(1.0, 1.0)[0], made(wheel, -1.0)
    assert forward.train_speed is not None
    assert record.train_speed is not None
    np.testing.assert_array_equal(record.train_speed, forward.train_speed)
    code, named = (
        ("train-speed-sign", "train_speed") if wheel > 0.0 else ("reverse-running", "wheel_speed")
    )
    (told,) = (f for f in findings if f.code in {"train-speed-sign", "reverse-running"})
    assert (told.code, told.severity, told.channel) == (code, "info", named)
    assert told.spans == ((0.0, pytest.approx(9.99)),)


@pytest.mark.parametrize(("unit", "total"), [("count", True), ("rad", True), ("rad/s", False)])
def test_a_speed_made_of_a_logged_total_is_marked_for_the_reference(unit: str, total: bool) -> None:
    t, p, y = brake()
    wheel = replace(channel("wheel_speed", t, y), unit=unit)
    (record,), _ = records(log(channel("pressure", t, p), wheel), Vehicle())
    assert record.of_totals == total
    assert record.extract(slice(0, 100)).of_totals == total


def test_spikes_and_broken_wires_are_left_out() -> None:
    t, p, y = brake()
    y, p = y + 0.003 * np.sin(1e3 * t), p.copy()
    y[300], y[500] = 9999.0, 0.0
    p[700:720] = -1.25 * BAR
    (record,), findings = records(
        log(channel("pressure", t, p), channel("wheel_speed", t, y)), Vehicle()
    )
    told = {f.code: (f.count, f.spans) for f in findings}
    assert told["speed-outlier"] == (2, ((3.0, 3.0), (5.0, 5.0)))
    assert told["pressure-negative"] == (20, (pytest.approx((7.0, 7.19)),))
    assert record.wheel_speed.max() < 51.0
    assert record.pressure is not None
    assert record.pressure.min() >= 0.0
