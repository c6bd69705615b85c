"""Why a train slows otherwise than stated: the cause is found, or it is said that nothing tells."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import DEFAULT, VEHICLES, clean, found
from helpers.grids import thinned
from helpers.reference_runs import share_inside

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.analysis.prepare import align_log, prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.model import AxleRecord, Channel, Column, Floats, Parameter
from adhesion_cli.core.physics import G, clamping_force, force_line, rolling_deceleration, wheelset
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.records.axle_channels import AxleChannels
from adhesion_cli.train import deceleration_cause, solve
from adhesion_cli.train.explanation import AS_STATED, Explanation
from adhesion_cli.train.grid import build_grids

VEHICLE = settings.load(None, ["vehicle.lever_ratio=2.4"]).vehicle


class Fault(NamedTuple):
    """What the log has otherwise than the train."""

    late: float = 0.0  # the pressure's clock [s]
    scale: float = 1.0  # of the force line
    offset: float = 0.0  # of it [bar]


def pressure(t: Floats, applications: int) -> Floats:
    """Build-ups of 1 to 3 s to other pressures, released but for the last one; [Pa]."""
    p = np.zeros(len(t))
    for i in range(applications):
        begin, ramp, level = 4.0 + 25.0 * i, 1.0 + i % 3, (3.0 + i % 2) * 1e5
        last = i == applications - 1
        end = np.inf if last and applications == 1 else begin + 14.0
        up = np.clip((t - begin) / ramp, 0.0, 1.0)
        p += level * np.minimum(up, np.clip((end - t) / 1.5, 0.0, 1.0) if np.isfinite(end) else 1.0)
    return p


def axle(
    rate: float, applications: int, fault: Fault, *, noise: float = 3e-3, step: float = 0.0,
    gradient: float = 10.0, seed: int = 1, fill: float = 0.0, begin: float = 0.0,
    creep: float = 1.0 / (22.0 * G),
) -> AxleChannels:  # fmt: skip
    """A rolling wheel and a pressure, as a log has them."""
    t = np.arange(0.0, 20.0 if applications == 1 else 25.0 * applications, 1.0 / rate)
    fine = np.arange(-10.0, t[-1] + 10.0, min(1.0 / rate, 0.01))
    w = wheelset(VEHICLE, 1)
    true = pressure(fine - begin, applications)
    if fill:  # a hole that fills the cylinder with this time constant, after the valve
        steps = np.round(true / 3e5) * 3e5
        for i in range(1, len(fine)):
            true[i] = true[i - 1] + (steps[i] - true[i - 1]) * min((fine[1] - fine[0]) / fill, 1.0)
    K = fault.scale * clamping_force(true - 1e5 * fault.offset, VEHICLE)
    slows = rolling_deceleration(w) * K + w.rolling * G * gradient / 1000.0 / w.radius
    speed = np.concatenate([[0.0], np.cumsum((slows[1:] + slows[:-1]) / 2.0 * np.diff(fine))])
    train = 40.0 + speed[-1] - speed
    y = np.interp(t, fine, train * (1.0 - creep * slows * w.radius))
    y += noise * np.random.default_rng(seed).standard_normal(len(t))
    y = np.round(y / step) * step if step else y
    p = np.interp(t - fault.late, fine, true)
    ns = np.round(t * 1e9).astype(np.int64)

    def channel(meaning: str, x: Floats, step: float = 0.0) -> Channel:
        data = Column(ns, x, np.ones(len(x), dtype=np.bool_))
        return Channel(
            meaning, "", meaning, 1, "SI", "", data, len(x), gap_ns=round(5e9 / rate), step=step,  # type: ignore[arg-type]
            rate_hz=rate,
        )  # fmt: skip

    force = clamping_force(p, VEHICLE)
    record = AxleRecord(1, ns, force, force, y, (slice(0, len(t)),), step, p)
    return AxleChannels(
        record, channel("wheel_speed", y, step), channel("pressure", p), None, p, VEHICLE
    )


def told(one: AxleChannels) -> Explanation:
    e = deceleration_cause.explain_deceleration([one], build_grids([one]), VEHICLE)
    return e._replace(pieces=(), design=None)


@pytest.mark.parametrize(
    ("name", "late", "rate"),
    [
        ("service-brake", -0.15, 20.0),
        ("service-brake", 0.6, 100.0),
        ("four-axles", 0.2, 20.0),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("service-brake", -0.15, 100.0),
                ("service-brake", 0.2, 20.0),
                ("service-brake", 0.2, 100.0),
                ("service-brake", 0.6, 20.0),
                ("four-axles", 0.2, 100.0),
                ("four-axles", 0.6, 20.0),
                ("four-axles", 0.6, 100.0),
            )
        ),
    ],
)
def test_sigma_holds_a_late_pressure(name: str, late: float, rate: float, tmp_path: Path) -> None:
    log = simulated.late(simulated.recordings(name, rate=rate, noise=1e-4), "pressure", late)
    path = simulated.write(tmp_path / "log.csv", log)
    stated = settings.load(None, ["analysis.vehicle=stated"])
    result = analyze.analyze(path, stated, ["td"])
    (told,) = [f for f in result.findings if f.code == "pressure-delay"]
    assert told.severity == ("warning" if abs(late) > 0.25 else "info")
    for a in result.axles:
        # A rail takes its time, too.
        assert a.record.pressure_late.value == pytest.approx(late, abs=0.035)
        t, K = a.record.t * 1e-9, a.record.clamping_force_smooth
        moves = np.abs(np.interp(t + 0.5, t, K) - np.interp(t - 0.5, t, K)) > 500.0
        assert a.record.truth is not None
        assert share_inside(a.reference, a.record.truth, moves) >= 0.9


@pytest.mark.parametrize(("scale", "rate"), thinned(3, [0.3, 0.5], [5.0, 25.0]))
def test_a_scaled_pressure_before_slides_is_no_delay(
    scale: float, rate: float, tmp_path: Path
) -> None:
    log = simulated.recordings("low-adhesion", rate=rate)
    codes = {f.code for f in found(simulated.scaled(log, "pressure", 0, scale), tmp_path)}
    assert codes & {"vehicle-suspect", "deceleration-unit-suspect"}
    assert "pressure-delay" not in codes


@pytest.mark.parametrize(("late_s", "by_wheels"), [(0.05, False), (0.5, True)])
def test_wheels_say_more_of_the_brake_than_a_train_speed_that_may_be_late(
    late_s: float, by_wheels: bool, tmp_path: Path
) -> None:
    path = simulated.write(tmp_path / "log.csv", simulated.recordings("low-adhesion"))
    aligned = align_log(read(open_source(path, ReadOptions()), (), VEHICLE), VEHICLE)
    late = Parameter(0.0, late_s)
    axles = [a._replace(record=replace(a.record, train_speed_late=late)) for a in aligned.axles]
    design = deceleration_cause.explain_deceleration(axles, aligned.grids, VEHICLE).design
    assert design is not None
    assert design.creeps == by_wheels


def test_what_one_edge_cannot_tell_apart_is_said(tmp_path: Path) -> None:
    stated = settings.load(None, ["vehicle.spring_force=133"])  # as a pressure of 1 bar less
    log = clean("low-adhesion", 1, "as it is")
    told = {f.code for f in found(log, tmp_path, stated)}
    assert told >= {"delay-or-vehicle", "pressure-delay"}


RATES = [2.0, 5.0, 20.0, 100.0, 1000.0]


@pytest.mark.parametrize(
    ("rate", "applications", "noise", "gradient"),
    thinned(7, RATES, [1, 2, 4], [0.0, 1e-2], [-20.0, 15.0]),
)
def test_as_stated(rate: float, applications: int, noise: float, gradient: float) -> None:
    assert told(axle(rate, applications, Fault(), noise=noise, gradient=gradient)) == AS_STATED


@pytest.mark.parametrize("fill", [0.2, 0.5])
@pytest.mark.parametrize("begin", [0.0, 0.4, 0.8])
def test_what_happens_between_two_samples_is_no_other_line(fill: float, begin: float) -> None:
    assert told(axle(1.0, 2, Fault(), fill=fill, begin=begin)).line is None


@pytest.mark.parametrize(
    ("rate", "applications", "late"),
    thinned(3, RATES, [1, 3], [-2.0, -0.7, -0.3, -0.2, 0.12, 0.2, 0.26, 0.4, 1.0, 2.0]),
)
def test_a_late_pressure(rate: float, applications: int, late: float) -> None:
    e = told(axle(rate, applications, Fault(late)))
    if abs(late) < max(0.2 if applications == 1 else 0.12, 2.0 / rate):  # as creep and sampling
        assert e.line is None or e.delay_or_line
        return
    assert e.pressure_delay.value == pytest.approx(
        late, abs=max(0.02, 4.0 * e.pressure_delay.tolerance)
    )
    assert e.line is None or e.delay_or_line


def test_the_delay_of_a_pressure_is_as_uncertain_as_the_lag_of_the_pads() -> None:
    """Pads that lag by 0.04 s hide as much of a delay."""
    e = told(axle(50.0, 3, Fault(0.4 - 0.04)))
    assert abs(e.pressure_delay.value - 0.4) < 1.96 * e.pressure_delay.tolerance < 0.15


def test_a_delay_beside_much_more_force_may_be_another_brake() -> None:
    """An ED brake that acts earlier, and that no channel shows, does the same."""
    e = told(axle(50.0, 3, Fault(0.4, scale=1.6)))
    assert e.line is not None
    assert (e.pressure_delay.value, e.delay_or_line) == (0.0, False)
    assert e.pressure_delay.tolerance > 0.2
    sure = told(axle(50.0, 3, Fault(0.4, scale=0.6)))
    assert sure.pressure_delay.value == pytest.approx(0.4, abs=0.1)


@pytest.mark.parametrize(
    ("rate", "applications", "scale"), thinned(7, RATES, [1, 3], [0.3, 0.5, 0.6, 1.6, 2.0, 3.0])
)
def test_another_factor(rate: float, applications: int, scale: float) -> None:
    e = told(axle(rate, applications, Fault(scale=scale)))
    assert e.line is not None
    assert e.line.scale == pytest.approx(scale, rel=0.05)
    assert not e.pressure_delay.value


@pytest.mark.parametrize(
    ("rate", "applications", "offset"), thinned(7, RATES, [1, 3], [-0.35, 0.4, 0.8])
)
def test_an_offset_is_no_delay(rate: float, applications: int, offset: float) -> None:
    e = told(axle(rate, applications, Fault(offset=offset)))
    if e == AS_STATED:  # one edge and few samples
        assert rate < 10.0 or abs(offset) < 0.5
        return
    assert e.line is not None
    assert not e.pressure_delay.value or e.delay_or_line
    if (
        not e.delay_or_line
    ):  # scale and offset may share it: the force at the highest pressure is known
        top = float(clamping_force(np.array([3e5 if applications == 1 else 4e5]), VEHICLE)[0])
        true = top - 1e5 * offset * force_line(VEHICLE).per_pascal
        assert e.line.scale * (top - e.line.offset) == pytest.approx(true, rel=0.05)


@pytest.mark.parametrize("scale", [1e4, 1e6])
@pytest.mark.parametrize("applications", [1, 2])
@pytest.mark.parametrize("rate", [2.0, 20.0])
def test_a_brake_that_a_log_hardly_shows_fails_nothing(
    rate: float, applications: int, scale: float
) -> None:
    assert told(axle(rate, applications, Fault(scale=scale))) == AS_STATED


def test_sigma_where_hardly_anything_tells_is_no_rounding() -> None:
    J = np.array([[3.0, 4.0, 0.0], [1.0, 2.0, 5.0]])
    A = J @ J.T
    assert solve.invert_normal(A) == pytest.approx(np.linalg.inv(A))
    scaled = np.diag([1e-10, 1e3]) @ A @ np.diag([1e-10, 1e3])
    assert solve.invert_normal(scaled)[0, 0] == pytest.approx(1e20 * np.linalg.inv(A)[0, 0])
    same = np.array([J[0], 7.0 * J[0] + 1e-12 * J[1]])
    assert solve.invert_normal(same @ same.T)[0, 0] == np.inf
    assert solve.invert_normal(np.zeros((2, 2)))[0, 0] == np.inf


def seeded(seed: int) -> None:
    """Whatever is wrong: what is told without doubt is so, and what matters is told.

    A train that gains speed downhill before its only brake may be driven: that shows nothing.
    """
    random = np.random.default_rng(seed)
    rate = float(np.exp(random.uniform(np.log(5.0), np.log(1000.0))))
    kind = int(random.integers(0, 4))
    fault = Fault(
        float(random.uniform(-2.0, 2.0)) if kind in (0, 3) else 0.0,
        float(np.exp(random.uniform(np.log(0.3), np.log(3.0)))) if kind in (1, 3) else 1.0,
        float(random.uniform(-0.35, 1.0)) if kind == 2 else 0.0,
    )
    applications, noise = int(random.integers(1, 5)), float(random.choice([0.0, 3e-3, 2e-2]))
    step, gradient = float(random.choice([0.0, 0.0, 0.05])), float(random.uniform(-25.0, 25.0))
    e = told(axle(rate, applications, fault, seed=seed, noise=noise, step=step, gradient=gradient))
    if e.pressure_delay.value and not e.delay_or_line:
        assert fault.late
        close = max(0.03, 0.5 / rate, 5.0 * e.pressure_delay.tolerance)
        assert e.pressure_delay.value == pytest.approx(fault.late, abs=close)
    if e.line and not e.delay_or_line:
        assert fault.scale != 1.0 or fault.offset
    may_be_driven = applications == 1 and gradient < -5.0
    matters = abs(fault.late) > max(0.2, 2.0 / rate) or not 0.6 < fault.scale < 1.7
    if matters and not may_be_driven:
        assert e != AS_STATED


@pytest.mark.parametrize("seed", range(14))
def test_no_wrong_cause(seed: int) -> None:
    seeded(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(14, 1000))
def test_no_wrong_cause_ever(seed: int) -> None:
    seeded(seed)


@pytest.mark.parametrize(("regains", "severity"), [(0.0, "warning"), (1.0, "info")])
def test_wheels_that_gain_speed_beside_their_brake_have_slid(
    regains: float, severity: str, tmp_path: Path
) -> None:
    t = np.arange(0.0, 22.0, 0.05)
    bar = 3.5 * np.clip(t - 2.0, 0.0, 1.0) * np.clip(15.0 - t, 0.0, 1.0)
    rolling = rolling_deceleration(wheelset(VEHICLE, 1)) * 0.42
    slowing = 1.6 * rolling * clamping_force(1e5 * bar, VEHICLE)
    slowing = np.where((t > 14.5) & (t < 16.0) & (regains > 0.0), -regains, slowing)
    v = 25.0 - np.cumsum(slowing) * 0.05 + 0.003 * np.sin(37.0 * t)
    lines = ["time [s],p1 [bar],v1 [m/s],p2 [bar],v2 [m/s]"]
    lines += [f"{a:.2f},{b:.4f},{c:.4f},{b:.4f},{c:.4f}" for a, b, c in zip(t, bar, v, strict=True)]
    log = tmp_path / "a.csv"
    log.write_text("\n".join(lines) + "\n")
    one = read(open_source(log, DEFAULT.read), (), VEHICLE)
    told = [f for f in prepare(one, VEHICLE).findings if f.code == "vehicle-suspect"]
    assert {f.severity for f in told} == {severity}


@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0])
@pytest.mark.parametrize(("creep", "late"), [(0.009, 0.0), (0.009, 0.4), (0.002, 0.4)])
def test_creep_is_no_late_pressure(rate: float, creep: float, late: float) -> None:
    """A clock is as late at every speed, and creep is not."""
    e = told(axle(rate, 3, Fault(late), creep=creep))
    assert e.line is None
    assert e.pressure_delay.value == pytest.approx(
        late, abs=max(0.03, 4.0 * e.pressure_delay.tolerance)
    )


@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0])
@pytest.mark.parametrize("creep", [0.004, 0.007])
def test_creep_at_one_speed_is_told_as_such(rate: float, creep: float) -> None:
    e = told(axle(rate, 1, Fault(), creep=creep))
    assert e.line is None
    assert not e.pressure_delay.value


@pytest.mark.parametrize("vehicle", ["heavy", "shoes"])
def test_a_heavy_train_that_creeps_on_a_wet_rail_has_no_late_pressure(
    vehicle: str, tmp_path: Path
) -> None:
    stated = settings.load(None, VEHICLES[vehicle])  # 0.8 % and 0.5 % at 1 m/s²
    log = simulated.recordings("four-axles", rate=100.0, noise=1e-2, vehicle=stated.vehicle)
    assert not found(log, tmp_path, stated)
