"""The closed loop against the laws of its own plant, and the controllers against each other."""

import functools
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers import rails
from helpers.commands import in_process
from helpers.grids import thinned
from helpers.recordings import batches, column, static
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.cli.app import app
from adhesion_cli.core import estimator, physics
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import LOCKED, WORKING
from adhesion_cli.formats.open import open_source
from adhesion_cli.rail import creep_law, sliding, slope
from adhesion_cli.results import mcap, rrd
from adhesion_cli.wsp import (
    closed_loop,
    controllers,
    reference_speed,
    scenario,
    wsp_controller,  # fmt: skip
)
from adhesion_cli.wsp.controller import APPLY, DUMP, HOLD, Observed, registry
from adhesion_cli.wsp.controllers import patent, rule
from adhesion_cli.wsp.plant import RailConditions
from adhesion_cli.wsp.scenario import Scenario
from adhesion_cli.wsp.stop import Stop, Verdict


@cache
def case(name: str) -> Scenario:
    return scenario.load(name)


@cache
def short() -> Scenario:
    """One axle from 9 m/s on a slippery rail."""
    long = case("slippery-stop")
    return replace(long, train=scenario.ScenarioTrain(speed=9.0), name="short")


@cache
def stopped(name: str, controller: str) -> Stop:
    return closed_loop.run(short() if name == "short" else case(name), controller)


@cache
def judged(name: str, controller: str) -> Verdict:
    dry = closed_loop.dry_distance(case(name))
    return closed_loop.verdict(stopped(name, controller), case(name), dry)


# --- the laws -----------------------------------------------------------------------------------

STILL = Observed(10.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, 0.0, APPLY)


@pytest.mark.parametrize(
    ("slip", "rate", "k", "valve"),
    [
        (0.5, 0.0, math.nan, DUMP),  # right of the slip band, slope or not
        (0.0, 0.0, math.nan, APPLY),
        (None, 0.0, 0.0, HOLD),  # both in their bands
        (None, 0.0, -1.0, DUMP),  # the curve falls
        (None, 0.0, 5.0, APPLY),  # it still rises
        (None, 0.0, math.nan, HOLD),  # not observable
        (None, 10.0, 0.0, DUMP),  # on its way out
        (0.5, -10.0, -1.0, APPLY),  # caught: the slide's slope is past
    ],
)
def test_patent_law_is_the_and_test(slip: float | None, rate: float, k: float, valve: int) -> None:
    p = patent.Params()
    middle = 0.5 * (p.slip_low + p.slip_high)
    o = STILL._replace(slip=middle if slip is None else slip, slip_rate=rate, slope=k)
    assert patent.step(p, patent.init(p, o), 0.01, o).valve == valve


def test_slip_within_its_noise_is_that_of_a_wheel_that_rolls() -> None:
    p = patent.Params()
    o = STILL._replace(slip=0.05, slip_rate=1.0)
    assert patent.step(p, patent.init(p, o), 0.01, o).valve == DUMP
    o = o._replace(slip_noise=1.01 * 0.05 / p.guard)
    assert patent.step(p, patent.init(p, o), 0.01, o).valve == APPLY


def test_a_slope_that_stays_hidden_is_looked_for() -> None:
    p = patent.Params(patience=0.2, probe=0.1)
    o = STILL._replace(slip=0.5 * (p.slip_low + p.slip_high))
    s, valves = patent.init(p, o), []
    for _ in range(300):
        s = patent.step(p, s, 0.01, o)
        valves.append(s.valve)
    assert set(valves) == {APPLY, HOLD}
    assert valves.count(APPLY) == pytest.approx(100, abs=12)
    assert np.count_nonzero(np.diff(valves)) == pytest.approx(20, abs=2)
    assert valves[:19] == [HOLD] * 19
    shown = patent.step(p, s, 0.01, o._replace(slope=0.0))
    assert shown == (0.0, o.slip, HOLD)  # it waits anew
    one = patent.Params(patience=0.2, probe=0.0)  # never less than a tick
    s, valves = patent.init(one, o), []
    for _ in range(300):
        s = patent.step(one, s, 0.01, o)
        valves.append(s.valve)
    assert valves.count(APPLY) == pytest.approx(15, abs=2)


def test_watchdog_ends_a_vent_that_does_not_help() -> None:
    p = rule.Params(watchdog=5.0, reset=1.0)
    o = STILL._replace(slip=0.9, rim_speed=1.0)
    s, valves = rule.init(p, o), []
    for _ in range(1200):
        s = rule.step(p, s, 0.01, o)
        valves.append(s.valve)
    assert valves[: int(p.watchdog / 0.01)] == [DUMP] * int(p.watchdog / 0.01)
    after = valves[int(p.watchdog / 0.01) + 2 :]
    assert after[: int(p.reset / 0.01) - 2] == [APPLY] * (int(p.reset / 0.01) - 2)


def test_slip_rate_is_the_derivative_of_slip() -> None:
    """`wsp_controller.observed` without noise against the simulated wheel, while it slides off."""
    quiet = replace(short().antiskid, delay=0.0, wheel_noise=0.0, pressure_noise=0.0, train_noise=0)
    s = replace(short(), antiskid=replace(quiet, period=1e-3))
    stop = closed_loop.run(s, "none")
    w = physics.wheelset(s.vehicle, 1)
    k = slope.init(slope.Params(), 0.0, 0.0)
    t, v = stop.t * 1e-9, stop.train_speed
    sliding = np.flatnonzero((stop.slip[:, 0] > 0.2) & (stop.slip[:, 0] < 0.9) & (v > 2.0))
    assert len(sliding) > 100
    true = np.gradient(stop.slip[:, 0], t)
    for i in sliding[5:-5:20]:
        y, K = stop.measured_wheel_speed[i, 0], stop.measured_clamping_force[i, 0]
        F = stop.force[i, 0]
        train = reference_speed.TrainEstimate(v[i], 0.0, reference_speed.NO_PILOT)
        o = wsp_controller.observed(w, train, y, K, F, F / w.mass, k, 0.0, APPLY)
        assert o.slip_rate == pytest.approx(true[i], rel=0.02, abs=1e-3)


LAZY = '''
from typing import NamedTuple

from adhesion_cli.wsp.controller import HOLD, Observed
from adhesion_cli.core.methods import About


class Params(NamedTuple):
    """None."""


class State(NamedTuple):
    """Slip and command."""

    judged: float
    valve: int


def init(p, o):
    """Holds."""
    return State(o.slip, HOLD)


def step(p, s, h, o):
    """Holds."""
    return State(o.slip, HOLD)


ABOUT = About("Lazy", "nobody")
'''


@pytest.fixture
def fourth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The place of one more controller."""
    monkeypatch.setattr(controllers, "__path__", [*controllers.__path__, str(tmp_path)])
    yield tmp_path / "lazy.py"
    sys.modules.pop("adhesion_cli.wsp.controllers.lazy", None)


def test_a_fourth_controller_is_one_file(fourth: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fourth.write_text(LAZY, encoding="utf-8")
    laws = registry()
    assert list(laws) == ["lazy", "none", "patent", "rule"]
    monkeypatch.setattr(wsp_controller, "controllers", lambda: laws)
    switches = Switches()
    samples = [(k * 10**7, 9.0, [9.0 / 0.42], [1e3 * k]) for k in range(5)]
    chosen = wsp_controller.choose("lazy", "leso", {}, short().vehicle)
    assert list(wsp_controller.online(chosen, samples, [switches])) == [[HOLD]] * 5
    assert switches.seen == [(True, False)] * 5 + [(False, False)]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("def step", "def stop"), "not a controller, lacks step"),
        (("    valve: int", "    valves: int"), "State must end with judged, valve"),
        (('About("Lazy", "nobody")', "None"), "ABOUT must be"),
    ],
)
def test_a_broken_controller_is_named(fourth: Path, change: tuple[str, str], says: str) -> None:
    fourth.write_text(LAZY.replace(*change), encoding="utf-8")
    with pytest.raises(UserError, match=says) as caught:
        registry()
    assert "lazy.py" in caught.value.text
    assert "adhesion_cli.wsp.controller" in caught.value.hint


# --- the loop -----------------------------------------------------------------------------------


class Switches:
    """A rig that remembers how its valves were switched."""

    def __init__(self) -> None:
        self.seen: list[tuple[bool, bool]] = []

    def set(self, hold: bool, vent: bool) -> None:
        self.seen.append((hold, vent))


def fed_back(controller: str, algo: str, train_speed: str) -> np.ndarray:
    """Valves of a stop, which are those of the same unit fed with the stop's measured values."""
    s = replace(case("slippery-stop"), train=replace(case("slippery-stop").train, speed=9.0))
    s = replace(s, antiskid=replace(s.antiskid, train_speed=train_speed))
    stop, switches = closed_loop.run(s, controller, algo=algo), [Switches() for _ in range(4)]
    speed = [None] * len(stop.t) if train_speed == "axles" else stop.measured_train_speed.tolist()
    samples = zip(
        stop.t.tolist(), speed, stop.measured_wheel_speed.tolist(),
        stop.measured_clamping_force.tolist(), strict=True,
    )  # fmt: skip
    chosen = wsp_controller.choose(controller, algo, {}, s.vehicle, closed_loop.speed_noise(s))
    valves = np.array(list(wsp_controller.online(chosen, samples, switches)))
    np.testing.assert_array_equal(valves, stop.valve)
    for seen, valve in zip(switches, valves.T.tolist(), strict=True):
        assert seen.seen == [*((x != APPLY, x == DUMP) for x in valve), (False, False)]
    return valves


@pytest.mark.parametrize(
    ("controller", "train_speed"), [("patent", "measured"), ("rule", "measured"), ("rule", "axles")]
)
def test_sample_by_sample_is_the_compiled_loop(controller: str, train_speed: str) -> None:
    valves = fed_back(controller, closed_loop.ESTIMATOR, train_speed)
    assert np.unique(valves).tolist() == [APPLY, HOLD, DUMP]
    assert (np.ptp(valves, axis=1) > 0).any()  # not every axle alike


@pytest.mark.slow
@pytest.mark.parametrize("train_speed", ["measured", "axles"])
@pytest.mark.parametrize("algo", estimator.registry())
@pytest.mark.parametrize("controller", registry())
def test_so_is_every_unit(controller: str, algo: str, train_speed: str) -> None:
    valves = fed_back(controller, algo, train_speed)
    assert (np.unique(valves).tolist() == [APPLY]) == (controller == "none")


def test_a_sample_that_lacks_an_axle_is_refused() -> None:
    chosen = wsp_controller.choose("rule", closed_loop.ESTIMATOR, {}, Vehicle())
    whole = (0, 9.0, [20.0, 20.0], [1e3, 1e3])
    for samples, text in (
        (
            [whole, (10**7, 9.0, [20.0], [1e3])],
            "1 wheel speeds, 1 clamping forces, 1 wheel radii for 2 axles",
        ),
        (
            [whole, (10**7, 9.0, [20.0] * 2, [1e3])],
            "2 wheel speeds, 1 clamping forces, 1 wheel radii for 2 axles",
        ),
        (
            [(0, 9.0, [20.0] * 2, [1e3])],
            "2 wheel speeds, 1 clamping forces, 1 wheel radii for 2 axles",
        ),
        ([(0, 9.0, [], [])], "0 wheel speeds, 0 clamping forces, 1 wheel radii for 0 axles"),
    ):
        with pytest.raises(UserError, match=text):
            list(wsp_controller.online(chosen, samples))


@pytest.mark.parametrize("end", ["fails", "order", "drive", "closed"])
def test_valves_rest_however_the_samples_end(end: str) -> None:
    slide = [(10**7 * i, 20.0, [47.0 - 0.5 * i] * 2, [15e3] * 2) for i in range(40)]

    class Broken(Switches):
        def set(self, hold: bool, vent: bool) -> None:
            super().set(hold, vent)
            if vent:
                raise OSError("no answer")

    def samples() -> Iterator[Any]:
        yield from slide
        if end == "order":
            yield slide[0]
        raise OSError("the bus is off")

    drives = [Switches(), Broken() if end == "drive" else Switches()]
    valves = wsp_controller.online(
        wsp_controller.choose("patent", closed_loop.ESTIMATOR, {}, Vehicle()), samples(), drives
    )
    if end == "closed":
        while next(valves) != [DUMP, DUMP]:
            pass
        valves.close()
    else:
        with pytest.raises((OSError, UserError)):
            list(valves)
    for drive in drives:
        assert drive.seen[-2:] == [(True, True), (False, False)]


def test_samples_out_of_order_and_missing_drives_are_refused() -> None:
    chosen = wsp_controller.choose("patent", closed_loop.ESTIMATOR, {}, Vehicle())
    one = (0, 9.0, [20.0], [1e3])
    with pytest.raises(UserError, match="not after"):
        list(wsp_controller.online(chosen, [one, one]))
    with pytest.raises(UserError, match="for 2 axles"):
        list(wsp_controller.online(chosen, [one], [Switches()] * 2))


@pytest.mark.parametrize("controller", ["patent", "rule"])
def test_a_sample_that_is_no_number_is_forgotten(controller: str) -> None:
    """The valves rest for it, and the unit answers to what comes after."""
    chosen = wsp_controller.choose(controller, closed_loop.ESTIMATOR, {}, Vehicle())
    slides = [(10**7 * i, 20.0, [47.0 - 0.5 * i], [15e3]) for i in range(40)]
    for bad in ((math.nan, [45.5], [15e3]), (20.0, [math.nan], [15e3]), (20.0, [45.5], [math.inf])):
        samples = [*slides[:3], (slides[3][0], *bad), *slides[4:]]
        valves = list(wsp_controller.online(chosen, samples))
        assert valves[3] == [APPLY]
        assert valves[4:] == list(wsp_controller.online(chosen, slides[4:]))
        assert [DUMP] in valves[4:]


def test_peak_is_the_most_the_rail_gives() -> None:
    stop, s = stopped("slippery-stop", "patent"), case("slippery-stop")
    assert (stop.force <= stop.peak * (1.0 + 1e-9)).all()
    patch = s.contact.patch(s.vehicle.axle_mass.value * physics.G)
    low = creep_law.condition("low")
    k = len(stop.t) // 2
    v = stop.train_speed[k]
    forces = [
        creep_law.creep_force(x, v, low._replace(f0=low.f0 * 1.25), patch)[0]
        for x in np.geomspace(1e-3, v, 20_000)
    ]
    assert stop.peak[k, 3] == pytest.approx(max(forces), rel=1e-6)


def test_a_curve_with_two_humps_has_its_highest_as_the_peak() -> None:
    """As fits to short slides draw them: a small hump at 0.04 % of slip, the largest at 8 %."""
    rail = np.array([1.0, 0.03, 0.06, 0.2, 0.3])
    track = RailConditions(False, np.array([0.0, np.inf]), np.tile(rail, (1, 2, 1)), 0.0, 1.0)
    stop = closed_loop.run(short(), "patent", track=track)
    moving = stop.train_speed > 1.0
    assert (stop.force <= stop.peak * (1.0 + 1e-9))[moving].all()
    assert np.median(stop.peak_slip[moving]) == pytest.approx(0.08, abs=0.03)


def test_on_dry_rail_a_controller_costs_nothing() -> None:
    s = replace(case("slippery-stop"), rail=rails.RAILS["dry"])
    s = replace(s, train=replace(s.train, cleaning=()))
    dry = closed_loop.dry_distance(s)
    for law in registry():
        v = closed_loop.verdict(closed_loop.run(s, law), s, dry)
        assert v.extension == pytest.approx(0.0, abs=1e-3)
        assert (v.utilisation, v.mean_slip_error) == (None, None)
        assert v.locked_s == v.limited_s == 0.0


@pytest.mark.parametrize("speed", [2.0, pytest.param(3.0, marks=pytest.mark.slow), 6.0])
def test_nor_at_walking_pace_where_noise_is_slip(speed: float) -> None:
    s = replace(case("slippery-stop"), rail=rails.RAILS["dry"])
    s = replace(s, train=replace(s.train, speed=speed))
    stop = closed_loop.run(s, "patent")
    v = closed_loop.verdict(stop, s, closed_loop.dry_distance(s))
    assert v.extension == pytest.approx(0.0, abs=0.01)
    assert np.count_nonzero(np.diff(stop.valve, axis=0)) < 100  # of four axles


@pytest.mark.parametrize(
    ("wrong", "train_speed"),
    thinned(
        3,
        [(0.97,), (0.98,), (0.99,), (1.01,), (1.02,), (1.03,), (1.05, 1.0, 1.0, 1.0)],
        ["measured", "axles"],
    ),
)
def test_nor_with_wheels_of_another_radius(wrong: tuple[float, ...], train_speed: str) -> None:
    s = replace(case("slippery-stop"), rail=rails.RAILS["dry"])
    s = replace(s, train=replace(s.train, speed=12.0))
    s = replace(s, antiskid=replace(s.antiskid, radius=wrong, train_speed=train_speed))
    v = closed_loop.verdict(closed_loop.run(s, "patent"), s, closed_loop.dry_distance(s))
    assert v.extension == pytest.approx(0.0, abs=0.01)


def test_every_axle_has_the_radius_that_is_stated_for_it() -> None:
    radii = (0.40, 0.41, 0.42)
    one = Vehicle().wheel_radius[0]
    vehicle = replace(Vehicle(), wheel_radius=tuple(one._replace(value=R) for R in radii))
    chosen = wsp_controller.choose("patent", closed_loop.ESTIMATOR, {}, vehicle)
    assert tuple(x.radius for x in wsp_controller.initial_wheels(chosen.constants, 3)) == radii
    y = [20.0 / R for R in radii]
    _, axles = wsp_controller.start(
        chosen.constants, wsp_controller.initial_wheels(chosen.constants, 3), 20.0, y, [1e4] * 3
    )
    assert [x.controller.valve for x in axles] == [APPLY] * 3
    with pytest.raises(UserError, match="3 wheel radii for 2 axles"):
        list(wsp_controller.online(chosen, [(0, 20.0, y[:2], [0.0] * 2)]))


def test_a_radius_is_found_only_where_the_wheel_rolls_unbraked() -> None:
    c = wsp_controller.choose("patent", closed_loop.ESTIMATOR, {}, Vehicle()).constants
    (new,) = wsp_controller.initial_wheels(c, 1)
    train = reference_speed.TrainEstimate(20.0, 0.0, reference_speed.NO_PILOT)
    free = train.v / (1.03 * new.radius)  # of a wheel 3 % larger

    def after(
        wheel: wsp_controller.Wheel, seconds: float, y: float, K: float
    ) -> wsp_controller.Wheel:
        for _ in range(round(seconds / 0.01)):
            wheel = wsp_controller.calibrated(wheel, 0.01, train, y, K)
        return wheel

    assert after(new, 1.0, free, 0.0).radius == pytest.approx(1.03 * new.radius, rel=1e-4)
    braked = after(new, 1.0, free, 1e3)
    assert (braked.radius, braked.free_time) == (new.radius, 0.0)
    vented = after(braked, 9.0, free, 0.0)
    assert vented.radius == new.radius
    assert after(after(vented, 1.0, 0.5 * free, 0.0), 9.0, free, 0.0).radius == new.radius
    assert after(vented, 2.0, free, 0.0).radius == pytest.approx(1.03 * new.radius, rel=1e-4)


def test_air_is_what_the_cylinders_took_in() -> None:
    stop, s = stopped("slippery-stop", "none"), case("slippery-stop")
    normal = 101_325.0 * 293.15 / 273.15
    filled = 4 * stop.pressure[-1, 0] * s.antiskid.volume / normal * 1e3
    assert stop.air == pytest.approx(filled, rel=1e-3)
    assert stopped("slippery-stop", "patent").air > stop.air


SLIPPERY_RAILS = ["low", "very-low", "early-peak", "late-peak", "sudden", "film"]


def shorter(mine: list[Verdict], its: list[Verdict]) -> list[bool]:
    return [a.stopping_distance_m < b.stopping_distance_m for a, b in zip(mine, its, strict=True)]


def uses_the_rail(verdicts: list[Verdict]) -> None:
    for v in verdicts:
        assert v.locked_s == 0.0
        assert v.utilisation is not None
        assert v.utilisation >= 0.95


def test_patent_law_uses_the_rail_and_locks_no_wheel() -> None:
    one = replace(case("slippery-stop"), train=scenario.ScenarioTrain(speed=30.0))
    found = rails.verdicts(one, SLIPPERY_RAILS, ["patent", "rule"], [7])
    uses_the_rail([found[r, "patent"][0] for r in SLIPPERY_RAILS])
    assert all(found[r, "rule"][0].locked_s == 0.0 for r in SLIPPERY_RAILS)
    shorter_stops = [shorter(found[r, "patent"], found[r, "rule"])[0] for r in SLIPPERY_RAILS]
    assert sum(shorter_stops) > len(SLIPPERY_RAILS) / 2
    assert judged("slippery-stop", "none").locked_s > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("name", SLIPPERY_RAILS)
def test_so_it_does_on_every_slippery_rail(name: str) -> None:
    found = rails.verdicts(case("slippery-stop"), [name], ["patent", "rule"], range(3))
    uses_the_rail(found[name, "patent"])
    assert all(shorter(found[name, "patent"], found[name, "rule"]))


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("name", SLIPPERY_RAILS)
def test_no_wheel_locks_without_a_radar(name: str, friction: float) -> None:
    s = case("slippery-stop").with_train_speed("axles")
    s = replace(s, antiskid=replace(s.antiskid, friction=friction))
    found = rails.verdicts(s, [name], ["patent", "rule"], range(3))
    for law in ("patent", "rule"):
        assert all(v.locked_s == 0.0 for v in found[name, law])
        assert all((v.utilisation or 0.0) > 0.85 for v in found[name, law])


def test_noise_of_the_speeds_guards_the_slope() -> None:
    def seen(parameters: dict[str, dict[str, float]]) -> float:
        return float(
            np.isfinite(closed_loop.run(short(), "patent", settings=parameters).slope).mean()
        )

    assert 0.1 < seen({}) < 0.9
    assert seen({"slope": {"guard": 30.0}}) < 0.5 * seen({})


def test_no_wheel_locks_on_leaf_film() -> None:
    uses_the_rail([judged("leaf-film", "patent")])


@pytest.mark.parametrize(("name", "worth"), [("low", 0.03), ("early-peak", 0.1)])
def test_slope_decides_where_the_peak_is(name: str, worth: float) -> None:
    """Slip alone does not know it: the law's slip band is wide."""
    one = replace(case("slippery-stop"), train=scenario.ScenarioTrain(speed=15.0))

    def utilisation(parameters: dict[str, dict[str, float]]) -> float:
        found = rails.verdicts(one, [name], ["patent"], [3], settings=parameters)
        return found[name, "patent"][0].utilisation or 0.0

    told = utilisation({})
    assert told > 0.95
    assert told > worth + utilisation({"patent": {"slope_low": -10.0, "slope_high": 50.0}})
    assert told > worth + utilisation({"slope": {"surest": 1.0}})  # none is ever so sure


def test_a_unit_without_a_radar_goes_by_its_axles() -> None:
    s = case("low-adhesion")  # two of its axles roll
    s = replace(s, antiskid=replace(s.antiskid, train_speed="axles"))
    stop = closed_loop.run(s, "patent")
    fastest = (stop.measured_wheel_speed * s.vehicle.radius(1).value).max(axis=1)
    assert (stop.measured_train_speed >= fastest - 1e-9).all()
    assert np.abs(stop.measured_train_speed - stop.train_speed).max() < 0.1
    verdict = closed_loop.verdict(stop, s, closed_loop.dry_distance(s))
    assert verdict.utilisation == pytest.approx(
        judged("low-adhesion", "patent").utilisation, abs=0.01
    )


def test_axles_that_all_slide_keep_the_train() -> None:
    s = replace(case("slippery-stop"), train=replace(case("slippery-stop").train, speed=12.0))
    s = s.with_train_speed("axles")
    for law in ("patent", "rule"):
        for known in ({}, {"friction": 0.9}, {"friction": 1.1}):
            stop = closed_loop.run(replace(s, antiskid=replace(s.antiskid, **known)), law)
            v, rims = stop.train_speed, stop.measured_wheel_speed * s.vehicle.radius(1).value
            assert (stop.sliding() > 0).all(axis=1).any()  # no axle showed the speed
            assert stop.train_speed_doubt.max() > 0.1
            creep = 0.04 * v + 0.2  # of wheels that are still left to themselves
            error = np.abs(stop.measured_train_speed - v)
            assert (error <= stop.train_speed_doubt + creep).all()
            assert (stop.measured_train_speed >= rims.max(axis=1) - 0.2).all()
            assert not (stop.sliding() == LOCKED).any()


def test_a_pilot_runs_up_while_the_others_brake() -> None:
    s = case("slippery-stop").with_train_speed("axles")
    stop = closed_loop.run(replace(s, train=replace(s.train, speed=12.0)), "patent")
    found = np.flatnonzero((np.diff(stop.train_speed_doubt) < 0) & (stop.train_speed[1:] > 2.0))
    assert len(found) > 0
    for k in found:
        slip = stop.slip[k + 1]
        assert slip.min() < 0.02  # a wheel shows the train's speed
        error = stop.measured_train_speed[k + 1] - stop.train_speed[k + 1]
        assert abs(error) < 0.02 * stop.train_speed[k + 1] + 0.1
    assert ((stop.rim_speed < 0.1) & (stop.train_speed > 1.0)[:, None]).sum() == 0


def test_speed_goes_on_by_the_forces_where_no_axle_rolls() -> None:
    known = reference_speed.TrainEstimate(20.0, 0.0, reference_speed.NO_PILOT)
    for _ in range(100):
        known = reference_speed.estimate_next(known, False, 15.0, 0.6, 0.01)
    assert known.v == pytest.approx(19.4)
    assert known.doubt == pytest.approx(0.06)
    assert (
        reference_speed.estimate_next(known, False, 19.9, 0.6, 0.01).v == 19.9
    )  # never below a rim
    rolling = reference_speed.estimate_next(known, True, 19.39, 0.6, 0.01)
    assert (rolling.v, rolling.doubt) == (19.39, 0.0)


def test_a_wheel_is_a_witness_until_its_valves_move_and_again_when_it_has_run_up() -> None:
    w = physics.wheelset(short().vehicle, 1)
    x = reference_speed.Witness(0.0, 0.0)

    def after(
        x: reference_speed.Witness, rim: float, K: float, F: float, valve: int, ticks: int = 1
    ):
        for _ in range(ticks):
            x = reference_speed.watched(w, x, 20.0, 0.6, rim, K, F, valve, 0.01)
        return x

    held = 3e3 / w.phi  # a brake that the rail's 3 kN just hold
    assert after(x, 19.9, held, 3e3, APPLY, 100).recent_force == 0.0
    assert after(x, 19.0, held, 3e3, APPLY).recent_force == 3e3  # it lags
    slides = after(x, 19.9, held, 3e3, HOLD)
    assert slides.recent_force == 3e3
    assert (
        after(slides, 19.0, held, 3e3, HOLD, 100).recent_force == 3e3
    )  # even, but all the rail gives
    assert after(slides, 19.0, 0.3 * held, 2e3, HOLD, 20).recent_force > 0.0  # less, but it runs up
    assert after(slides, 19.9, 0.5 * held, 1.5e3, HOLD, 5).recent_force == 0.0


def test_same_seed_same_stop() -> None:
    again = closed_loop.run(short(), "patent")
    assert (again.pressure == stopped("short", "patent").pressure).all()
    other = closed_loop.run(short(), "patent", seed=99)
    assert len(other.t) != len(again.t) or (other.pressure != again.pressure).any()


def test_a_step_longer_than_the_units_period_is_refused() -> None:
    for dt in (0.015, 0.02):
        with pytest.raises(UserError, match="dt is longer than") as told:
            closed_loop.run(replace(short(), dt=dt), "none")
        assert told.value.code == 2


@pytest.mark.parametrize(
    ("key", "field"), [("friction", "phi"), ("radius", "radius"), ("mass", "mass")]
)
def test_a_unit_may_take_its_vehicle_for_another(key: str, field: str) -> None:
    value = (1.05,) if key == "radius" else 1.05
    s = replace(short(), antiskid=replace(short().antiskid, **{key: value}))
    true, known = (physics.wheelset(v, 1) for v in (s.vehicle, closed_loop.taken_for(s)))
    assert getattr(known, field) == pytest.approx(1.05 * getattr(true, field))
    stop, right = closed_loop.run(s, "patent"), stopped("short", "patent")
    assert (stop.pressure[-1] != right.pressure[-1]) == (key != "radius")  # it finds that one
    on_dry = closed_loop.run(replace(s, rail=closed_loop.DRY), "none").distance[-1]
    assert on_dry == closed_loop.run(replace(short(), rail=closed_loop.DRY), "none").distance[-1]


NO_HOLD = {"brake": scenario.ScenarioBrake((scenario.Command(0.0, 1e3),))}
AT_ONCE = {
    "train": scenario.ScenarioTrain(speed=1e-3),
    "brake": scenario.ScenarioBrake((scenario.Command(0.0, 8e5),)),
    "antiskid": scenario.Antiskid(fill_rate=1e8),
}


@pytest.mark.parametrize(
    ("change", "controller", "algo", "settings", "says"),
    [
        ({}, "patnet", "kalman", {}, "patnet"),
        ({}, "patent", "kalmann", {}, "kalmann"),
        ({}, "patent", "kalman", {"patent": {"slip_hihg": 1.0}}, "slip_hihg"),
        ({}, "patent", "kalman", {"patnet": {}}, "patnet"),
        ({}, "rule", "kalman", {"patent": {"slip_low": 0.3}}, "slip_low = 0.3 is not below patent"),
        ({}, "none", "kalman", {"patent": {"slope_low": 0.0, "slope_high": 0.0}}, "patent.slope_"),
        ({}, "patent", "kalman", {"slope": {"delta": -1.0}}, "out of range"),
        ({"dt": 0.015}, "none", "kalman", {}, "dt"),
        ({}, "none", "leso", {"leso": {"euler": 1.0}}, "longest stable"),
        ({"brake": scenario.ScenarioBrake()}, "none", "kalman", {}, "no train that brakes"),
        (AT_ONCE, "none", "kalman", {}, "stands at once"),
        (NO_HOLD, "none", "kalman", {}, "does not stop within"),
    ],
)  # fmt: skip
def test_bad_requests_are_refused(change, controller, algo, settings, says) -> None:
    if "dt" in change:
        change = {**change, "antiskid": replace(short().antiskid, period=1e-3)}
    with pytest.raises(UserError, match=says):
        closed_loop.run(replace(short(), **change), controller, 0, algo, settings)


def test_a_train_too_slow_to_be_judged_has_a_distance_and_no_slip() -> None:
    crawl = replace(short(), train=scenario.ScenarioTrain(speed=0.5))
    dry = closed_loop.dry_distance(crawl)
    v = closed_loop.verdict(closed_loop.run(crawl, "patent"), crawl, dry)
    assert v.stopping_distance_m >= dry > 0.0
    assert (v.max_slip, v.utilisation, v.locked_s, v.slide_s) == (None, None, 0.0, 0.0)


def test_a_wheel_that_stands_in_the_last_metres_has_no_large_slip() -> None:
    """Logged stops have this one definition, too."""
    stop = closed_loop.run(short(), "none")
    fast = stop.train_speed > WORKING
    slip = np.where(fast[:, None], 0.03, 1.0)
    assert closed_loop.verdict(stop._replace(slip=slip), short(), 100.0).max_slip == 0.03


def test_a_brake_that_is_released_is_no_stop() -> None:
    with pytest.raises(UserError, match="does not stop within") as told:
        closed_loop.run(case("service-brake"), "none")
    assert "stays applied" in told.value.hint


def test_a_brake_may_be_released_when_the_train_stands() -> None:
    stop, s = stopped("short", "patent"), short()
    stands = float(stop.t[-1]) * 1e-9 + 1.0
    commands = (*s.brake.command, scenario.Command(stands, 0.0))
    again = closed_loop.run(replace(s, brake=replace(s.brake, command=commands)), "patent")
    assert again.distance[-1] == stop.distance[-1]


# --- files and command --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "stops.rrd"
    stops, bands = [stopped("short", c) for c in registry()], {"patent": wsp_controller.bands({})}
    weight = short().vehicle.axle_mass.value * physics.G
    verdict, origin = "75 m on dry rail\n```\n![](http://evil)", {"rule": {"slip": "a|b"}}
    rrd.write_stops(path, "short", rrd.StopsPage(stops, weight, bands, verdict, origin))
    return path


def test_stops_are_written_side_by_side(recording: Path) -> None:
    (text,) = static(recording, "/verdict", "text")
    assert "75 m on dry rail" in text
    assert text.count("```") == 2  # what a log says stays in its block
    (about,) = static(recording, "/about", "text")
    assert '| rule.slip | "a\\|b" |' in about
    (batch,) = batches(recording, "/lines")
    named = [text[0].removeprefix("\u25a0 ") for text in batch["TextLog:text"].to_pylist()]
    assert named == list(registry())
    widths = [static(recording, f"/train/{law}", "widths")[0] for law in sorted(registry())]
    assert all(np.diff(widths) <= -2.0)  # drawn by name: where lines coincide, each has an edge
    for stop in (stopped("short", c) for c in registry()):
        place = f"/{stop.controller}/axle/1"
        for name, columns in (
            ("speed", [stop.train_speed * 3.6, stop.rim_speed[:, 0] * 3.6]),
            ("pressure", [stop.demand * 1e-5, stop.pressure[:, 0] * 1e-5]),
            ("judged", [stop.measured_slip[:, 0] * 100.0, stop.judged_slip[:, 0] * 100.0]),
            ("slope", [stop.slope[:, 0]]),
            ("confidence", [stop.confidence[:, 0]]),
        ):
            t, values = column(recording, f"{place}/{name}", "scalars")
            np.testing.assert_array_equal(t, stop.t)
            np.testing.assert_array_equal(values, np.stack(columns, axis=1))
        order = static(recording, f"{place}/force", "names")
        assert order == [f"estimated ({stop.algo})", "true", "peak of the rail"]  # last on top
        t, states = column(recording, f"{place}/state/valve", "state")
        code = np.append(stop.valve[:, 0], -1)  # none after the stop
        at = np.flatnonzero(np.diff(code, prepend=-2))
        assert [x for (x,) in states] == [("apply", "hold", "vent", "")[c] for c in code[at]]
        np.testing.assert_array_equal(t[:-1], stop.t[at[:-1]])
        assert t[-1] > stop.t[-1]


def test_operating_point_peak_and_bands_are_where_the_axes_say(recording: Path) -> None:
    weight, bands = short().vehicle.axle_mass.value * physics.G, wsp_controller.bands({})
    for stop in (stopped("short", c) for c in registry()):
        place = f"/{stop.controller}/axle/1"
        names = [x for x in static(recording, f"{place}/slip/labels", "labels") if x[0].isdigit()]
        strips = static(recording, f"{place}/slip/grid", "strips")[: len(names)]
        ruled = [(float(n), line) for n, line in zip(names, strips, strict=True)]
        upright = [(n, a[0]) for n, (a, b) in ruled if a[0] == b[0]]
        level = [(n, a[1]) for n, (a, b) in ruled if a[1] == b[1]]
        x, y = (np.poly1d(np.polyfit(*zip(*of, strict=True), 1)) for of in (upright, level))
        (left, _), _, (right, top) = static(recording, f"{place}/slip/grid", "strips")[-1][:3]
        for name, s, force in (
            ("now", stop.slip, stop.force), ("peak", stop.peak_slip, stop.peak)
        ):  # fmt: skip
            (batch,) = batches(recording, f"{place}/slip/{name}")
            t = batch["time"].cast(pa.int64()).to_numpy(zero_copy_only=False)
            places = batch["Points2D:positions"].to_pylist()
            rows = np.searchsorted(stop.t, t)
            of_slip, of_mu = x(100.0 * s[rows, 0]), y(force[rows, 0] / weight)
            inside = (of_slip >= left) & (of_slip <= right) & (of_mu <= 0.0) & (of_mu >= top)
            assert [len(p) for p in places] == inside.tolist()  # outside there is no point
            assert inside.any()
            at = np.array([p[0] for p in places if p])
            of_slip, of_mu = of_slip[inside], of_mu[inside]
            np.testing.assert_allclose(at[:, 0], of_slip, rtol=1e-5, atol=1e-3)
            np.testing.assert_allclose(at[:, 1], of_mu, rtol=1e-5, atol=1e-3)
            assert len(t) > 100
        drawn = batches(recording, f"{place}/slip/band", static=True)
        assert bool(drawn) == (stop.controller == "patent")
        if drawn:
            edges = [x(100.0 * s) for s in (bands.slip_low, bands.slip_high)]
            edges = [e for e in edges if left < e < right]
            assert edges
            for edge, line in zip(
                edges, static(recording, f"{place}/slip/band", "strips"), strict=True
            ):
                np.testing.assert_allclose(line, [(edge, 0.0), (edge, top)], atol=1e-3)
            for name, band in (
                ("slope", [bands.slope_low, bands.slope_high]),
                ("judged", [100.0 * bands.slip_low, 100.0 * bands.slip_high]),
            ):
                t, edges = column(recording, f"{place}/{name}/band", "scalars")
                assert edges.tolist() == [band] * 2
                assert t.tolist() == [stop.t[0], stop.t[-1]]
        else:
            assert not batches(recording, f"{place}/slope/band")


def test_a_stop_reads_as_a_log(tmp_path: Path) -> None:
    stop, vehicle = stopped("short", "rule"), short().vehicle
    path = tmp_path / "short.rule.antiskid.mcap"
    exact = settings.AnalysisSettings(vehicle="stated")
    carried = settings.tree(settings.Settings(vehicle, analysis=exact), [])
    mcap.write_stop(path, "short", stop, vehicle, carried, "{}", ["a book"])
    result = analyze.analyze(path, settings.load(folder=False), ["kalman"])
    assert not [f for f in result.findings if f.lossy]
    assert result.vehicle == vehicle
    (axle,) = result.axles
    np.testing.assert_array_equal(axle.record.t, stop.t)
    np.testing.assert_array_equal(axle.record.wheel_speed, stop.measured_wheel_speed[:, 0])
    np.testing.assert_array_equal(axle.record.train_speed, stop.measured_train_speed)
    np.testing.assert_allclose(
        axle.record.clamping_force, stop.measured_clamping_force[:, 0], rtol=1e-9
    )
    np.testing.assert_array_equal(axle.record.truth, stop.force[:, 0])
    moves = stop.train_speed > 2.0
    assert np.abs(axle.slip - stop.slip[:, 0])[moves].max() < 0.05  # one is what sensors say
    assert len(sliding.slides(axle)) > 0
    with path.open("rb") as file:
        stated = {m.name: m.metadata for m in make_reader(file).iter_metadata()}
    assert stated["adhesion.provenance"]["sources"] == "a book"


def test_events_of_a_stop_are_what_truly_happened(tmp_path: Path) -> None:
    stop, path = stopped("short", "none"), tmp_path / "short.none.antiskid.mcap"
    mcap.write_stop(path, "short", stop, short().vehicle, {}, "{}", [])
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        told = [x.decoded_message for x in reader.iter_decoded_messages(["/events"])]
    codes = [m.code for m in told]
    assert {"slide", "wheel-locked", "region-change"} == set(codes)
    assert [m.timestamp.ToNanoseconds() for m in told] == sorted(
        m.timestamp.ToNanoseconds() for m in told
    )
    (locked,) = [m for m in told if m.code == "wheel-locked"]
    stands = float((stop.sliding()[:, 0] == LOCKED).sum()) * 0.01
    assert locked.message == f"axle 1: locked for {stands:.2f} s"
    (slide,) = [m for m in told if m.code == "slide"]
    assert f"slip up to {np.nanmax(stop.slip):.0%}" in slide.message


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_receiver_of_1_hz_where_every_wheel_slides_has_no_known_delay(
    tmp_path: Path, seed: int
) -> None:
    stop, vehicle = (
        closed_loop.run(case("slippery-stop"), "rule", seed),
        case("slippery-stop").vehicle,
    )
    t = (stop.t - stop.t[0]) * 1e-9
    lines = ["time [s],train speed [m/s]"]
    lines[0] += "".join(f",axle {i} speed [rad/s],axle {i} clamping force [N]" for i in range(1, 5))
    late = np.interp(t - 1.5, t, stop.measured_train_speed)
    for j in range(0, len(t), 2):
        pairs = zip(stop.measured_wheel_speed[j], stop.measured_clamping_force[j], strict=True)
        own = f"{late[j]:.3f}" if j % 100 == 0 else ""
        lines.append(f"{t[j]:.3f},{own}" + "".join(f",{x:.4f},{K:.1f}" for x, K in pairs))
    log = tmp_path / "gnss.csv"
    log.write_text("\n".join(lines) + "\n")
    stated = settings.load(folder=False)
    one = read(open_source(log, stated.read), (), vehicle)
    records = prepare(one, vehicle).records
    assert [record.train_speed_late for record in records] == [None] * 4
    assert all(record.train_speed_interval == pytest.approx(1.0) for record in records)


def test_antiskid_command(tmp_path: Path) -> None:
    adhesion = functools.partial(in_process, tmp_path, "antiskid")

    done = adhesion("leaf-film", "--json")
    assert done.returncode == 0, done.stderr
    doc = json.loads(done.stdout)
    assert set(doc) == {
        "schema", "scenario", "seed", "estimator", "parameters", "dry_distance_m", "controllers",
        "outputs",
    }  # fmt: skip
    assert doc["estimator"] == closed_loop.ESTIMATOR
    assert list(doc["outputs"]) == ["rrd", "none.mcap", "patent.mcap", "rule.mcap"]
    assert all((tmp_path / name).is_file() for name in doc["outputs"].values())
    assert (doc["schema"], doc["scenario"]) == ("adhesion.antiskid/1", "leaf-film")
    assert list(doc["controllers"]) == ["none", "patent", "rule"]
    for verdict in doc["controllers"].values():
        assert list(verdict) == [
            "stopping_distance_m", "extension", "utilisation", "max_slip", "locked_s", "air_nl",
            "mean_slip_error", "slide_s", "limited_s",
        ]  # fmt: skip
        ratio = verdict["stopping_distance_m"] / doc["dry_distance_m"] - 1.0
        assert verdict["extension"] == pytest.approx(ratio)
    (text,) = static(tmp_path / "leaf-film.antiskid.rrd", "/verdict", "text")
    for value in ("over dry", "utilisation", "air", "slip error", "limited"):
        assert any(line.startswith(f"{value}: ") for line in text.splitlines())
    laws = [f"leaf-film.{law}.antiskid" for law in registry()]
    written = {*(f"leaf-film.antiskid.{kind}" for kind in ("rrd", "sha256"))}
    written |= {f"{name}.mcap" for name in laws}
    assert {p.name for p in tmp_path.iterdir()} == written
    assert "--force" in adhesion("leaf-film").stderr
    bad = adhesion("leaf-film", "--set", "patent.slip_high")
    assert bad.returncode == 2
    assert "Traceback" not in bad.stderr


SLIPPERY = """
description = "One axle from 9 m/s on a slippery rail"
duration = 60.0
brake = {command = [{at = 1.0, pressure = 4e5}]}
rail = {section = [{at = 0.0, condition = "low"}]}
train = {speed = 9.0}
"""


# The loop of each other estimator compiles for 40 s.
@pytest.mark.parametrize(
    ("algo", "parameter"),
    [("kalman", "q"), pytest.param("neso", "beta1", marks=pytest.mark.slow)],
)
def test_a_stop_has_the_settings_of_every_command_and_records_them(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    algo: str,
    parameter: str,
) -> None:
    own = estimator.registry()[algo].Params()._asdict()[parameter] * 1.25
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text(SLIPPERY)
    Path("adhesion.toml").write_text(
        "[patent]\nslip_low = 0.01\nslip_high = 0.06\n[slope]\nrho = 0.7\n[vehicle]\nphi = 0.2\n"
    )
    Path("given.toml").write_text(
        f"[patent]\nslip_high = 0.05\npatience = 0.2\n[{algo}]\n{parameter} = {own}\n"
    )
    arguments = ["antiskid", "short.toml", "--json", "-a", algo, "-c", "given.toml"]
    arguments += ["--set", "patent.slip_high=0.04"]
    assert app(arguments, standalone_mode=False) == 0
    out, err = capsys.readouterr()
    assert "[vehicle] has no effect" in err
    doc = json.loads(out)
    used = doc["parameters"]
    assert [used["patent"][k] for k in ("slip_low", "slip_high", "patience")] == [0.01, 0.04, 0.2]
    assert (used["slope"]["rho"], used["slope"]["delta"]) == (
        0.7,
        wsp_controller.SLOPE_IN_LOOP["delta"],
    )
    assert (doc["estimator"], used[algo][parameter]) == (algo, own)
    stated = {name: used[name] for name in ("patent", "slope", algo)}
    best = scenario.load("short.toml")
    again = closed_loop.run(best, "patent", algo=algo, settings=stated)
    for law in registry():
        with open(doc["outputs"][f"{law}.mcap"], "rb") as file:
            records = {m.name: m.metadata for m in make_reader(file).iter_metadata()}
        carried = settings.nested(records["adhesion.settings"])
        assert {name: carried.get(name, {}) for name in (algo, "slope", law)} == {
            name: used[name] for name in (algo, "slope", law)
        }
        assert carried["bands"]["slip_high"] == 0.04
        loop = carried["antiskid"]
        assert (loop["controller"], loop["estimator"]) == (law, algo)
        assert loop["scenario"]["train"]["speed"] == 9.0
        assert loop["scenario"]["brake"]["command"] == [{"at": 1.0, "pressure": 4e5, "ramp": 0.0}]
        assert loop["scenario"]["antiskid"]["period"] == best.antiskid.period
        assert records["adhesion.provenance"]["input_format"] == "closed loop"
        assert "outputs" not in json.loads(records["adhesion.metrics"]["json"])
    found = doc["controllers"]["patent"]["stopping_distance_m"]
    assert found == closed_loop.verdict(again, best, 1.0).stopping_distance_m
    read = analyze.analyze(Path(doc["outputs"]["patent.mcap"]), settings.load(), [algo])
    assert (read.settings["slope"]["rho"], read.settings[algo][parameter]) == (0.7, own)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--set", "patnet.slip_high=0.1"], "'patnet'"),
        (["--set", "patent.slip_hihg=0.1"], "'slip_hihg'"),
        (["--set", "patent.slip_high"], "no '='"),
        (["--set", "phi=0.3"], "--set vehicle: no effect with SCENARIO"),
        (["--set", "bands.slip_high=0.1"], "--set bands: no effect with SCENARIO"),
        (["--from", "0", "--axle", "2"], "--axle, --from: no effect with SCENARIO"),
        (["-c", "missing.toml"], "no such file"),
    ],
)
def test_what_would_do_nothing_is_refused(arguments: list[str], says: str) -> None:
    with pytest.raises(UserError, match=says) as told:
        app(["antiskid", "slippery-stop", *arguments], standalone_mode=False)
    assert told.value.code == 2
