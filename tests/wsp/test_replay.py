"""A log's stop run again, against the closed loop on the rail that the log was simulated on."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.recordings import static
from helpers.simulated import recordings, simulation, write

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.cli.app import app
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import AxleResult, Parameter, Result, Vehicle
from adhesion_cli.rail import creep_law, fit, sliding
from adhesion_cli.wsp import closed_loop, replay, replay_rail, scenario, simulate
from adhesion_cli.wsp.scenario import Command, Rail, Section, Wsp

NAME = "low-adhesion"
KNOWN = (
    "vehicle.friction={value=0.3, tolerance=0.003}",
    "vehicle.efficiency={value=0.97, tolerance=0.0}",
    "vehicle.axle_mass={value=4797.0, tolerance=10.0}",
)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("log") / "low.csv", recordings(NAME))


@cache
def analysed(path: Path) -> Result:
    return analyze.analyze(path, settings.load(), ["kalman"], train_speed=True)


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "DRAWS", 8)


def test_the_stop_is_the_logs(log: Path) -> None:
    case, true = replay.case(analysed(log)), simulation(NAME)
    at = int(np.searchsorted(true.t, case.start_s * 1e9))
    assert case.logged_m == pytest.approx(true.distance[-1] - true.distance[at], abs=1.0)
    assert case.scenario.train.axles == 4
    assert case.scenario.train.speed == pytest.approx(true.train_speed[at], abs=0.1)
    asked = [c.clamping_force for c in case.scenario.brake.command]
    assert max(asked) == pytest.approx(true.clamping_force[:, 3].max(), rel=0.01)  # it only rolls
    slid = true.distance[np.argmax(true.slip[:, 0] > 0.01)] - true.distance[at]
    assert case.track.knots[1] == pytest.approx(slid, abs=3.0)
    assert np.ptp(case.track.values[2:], axis=(0, 1)).max() == 0.0  # axles 3 and 4 never leave dry
    assert len(case.draws) == 8
    assert [f.code for f in case.findings] == ["rail-parameters-unknown"] * 2


def test_a_friction_table_is_in_the_demand(log: Path) -> None:
    table = {"speed": [59, 60, 61], "value": [0.15, 0.3, 0.3]}  # half of φ at every speed of it
    stated = settings.load(
        {"vehicle": {"friction": table, "lever_ratio": 2}, "analysis": {"vehicle": "stated"}},
        folder=False,
    )
    case = replay.case(analyze.analyze(log, stated, ["kalman"], train_speed=True))
    asked = [c.clamping_force for c in case.scenario.brake.command]
    whole = float(simulation(NAME).clamping_force[:, 3].max())
    assert max(asked) == pytest.approx(whole, rel=0.01)  # twice the K, half the φ
    assert case.scenario.vehicle.friction_table is None


def test_the_interval_holds_the_stop_on_the_true_rail(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["antiskid", "--from-log", str(log), "--json", "-o", str(tmp_path)]
    arguments += [x for text in KNOWN for x in ("--set", text)]
    assert app(arguments, standalone_mode=False) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "adhesion.antiskid/1"
    assert document["draws"] == 8
    assert {p.name for p in tmp_path.iterdir()} == {
        "low.antiskid.rrd", "low.antiskid.sha256",
        *(f"low.{law}.antiskid.mcap" for law in ("none", "patent", "rule")),
    }  # fmt: skip
    (told,) = static(tmp_path / "low.antiskid.rrd", "/verdict", "text")
    assert all(f["code"] in told for f in document["findings"])
    compared = document["compared"]
    assert compared["patent"]["patent_less_this_m"] is None
    assert compared["none"]["patent_less_this_m"][2] < -20.0  # though their own intervals overlap
    assert sum(x["shortest"] for x in compared.values()) <= 1.0
    assert compared["none"]["shortest"] == 0.0
    s = scenario.load(NAME)
    for law in ("none", "patent", "rule"):
        stop = closed_loop.run(s, law)
        start = np.interp(document["start_s"], stop.t * 1e-9, stop.distance)
        low, high = document["intervals"][law]["stopping_distance_m"]
        assert low < stop.distance[-1] - start < high, law
        assert high < 1.2 * low, law  # and it says something
        value = document["controllers"][law]["stopping_distance_m"]
        assert low <= value <= high
        assert value == pytest.approx(stop.distance[-1] - start, rel=0.02)
        true = closed_loop.verdict(stop, s, closed_loop.dry_distance(s))
        found = document["controllers"][law]
        assert found["utilisation"] == pytest.approx(true.utilisation, abs=0.03)
        assert found["extension"] == pytest.approx(true.extension, abs=0.02)
        assert found["max_slip"] == pytest.approx(true.max_slip, abs=0.04)


def test_the_rail_does_not_end_while_the_train_stops(log: Path) -> None:
    """The force of the last metre is that of a train that comes to rest, not of a better rail."""
    result = analysed(log)
    (first, *rest), begin = result.axles, int(result.axles[0].record.t[0])
    assert first.record.train_speed is not None
    last = first.record.train_speed < 1.0
    assert last.sum() * 0.01 > 0.5
    force = np.where(last, 2.0 * np.nanmax(first.reference.force), first.reference.force)
    more = replace(first, reference=replace(first.reference, force=force))
    of = first, more
    rails = [
        replay_rail.rail_under_axle(
            a, result.vehicle, sliding.slides(a), begin, int(a.record.t[-1])
        )[0]
        for a in of
    ]
    spans = [rail.spans for rail in rails]
    assert spans[0] == spans[1]
    assert [f.code for f in replay.case(replace(result, axles=(more, *rest))).findings] == [
        "rail-parameters-unknown"
    ] * 2


def test_a_train_in_part_is_told(log: Path) -> None:
    """Axles left out, or a train that slows harder than its axles say, as one with others does."""
    part = analyze.analyze(log, settings.load(), ["kalman"], [1, 2], train_speed=True)
    (told,) = (f for f in replay.case(part).findings if f.code == "replay-axles-missing")
    assert told.names == {"axles": "3, 4"}
    whole = analysed(log)
    heavy = replace(whole.vehicle, axle_mass=Parameter(1.5 * 4797.0, 10.0))
    for result, many in (
        (whole, 0),
        (replace(whole, identified=replace(whole.identified, vehicle=heavy)), 1),
    ):
        found = [f for f in replay.case(result).findings if f.code == "replay-axles-differ"]
        assert len(found) == many
        for f in found:
            assert f.values["lost_mps"] > 1.2 * f.values["explained_mps"]


def test_what_slows_the_train_beside_its_axles_acts_in_the_replay(log: Path) -> None:
    seconds = 0.1 * np.arange(400)
    speed = 30.0 - 0.6 * seconds
    impulse = 30.0 - speed - 0.02 * seconds - 6e-5 * np.cumsum(0.1 * speed**2)
    t = np.round(seconds * 1e9).astype(np.int64)
    braking = replay._Braking(t, speed, np.zeros((1, 400)))
    track = replay._track([replay._AxlePlaces([], Vehicle())], [None])
    slowed = replay._with_resistance(track, braking, impulse, 1.0, 0.0)
    assert (slowed.resistance, slowed.drag) == pytest.approx((0.02, 6e-5), rel=1e-6)
    pushed = replay._with_resistance(track, braking, impulse + 0.05 * seconds, 1.0, 0.0)
    assert pushed.resistance < 0.0
    assert replay._with_resistance(track, braking, None, 1.0, 0.0) == track
    case = replay.case(analysed(log))
    against = case.track._replace(resistance=1.0, drag=1e-3)
    slower, faster = (
        closed_loop.run(case.scenario, "rule", track=x).distance[-1] for x in (against, case.track)
    )
    assert slower < 0.8 * faster


def test_the_logged_wsp_on_the_fitted_rail_stops_where_it_did(log: Path) -> None:
    case = replay.case(analysed(log))
    stop = closed_loop.follow(case.scenario, case.track, case.logged)
    assert case.logged_m is not None
    assert stop.distance[-1] == pytest.approx(case.logged_m, rel=0.02)

    def findings(logged_m: float) -> list[str]:
        interval = {"stopping_distance_m": (500.0, 490.0, 510.0)}
        answer = replay.Answer(stop, interval, replay.Compared(None, 0.0))
        told = replay.distance_findings(
            case._replace(logged_m=logged_m), {closed_loop.LOGGED: answer}
        )
        return [f.code for f in told]

    assert findings(485.0) == []
    assert findings(450.0) == ["replay-train-differs"]


def test_a_rail_whose_level_changes_under_a_long_slide_is_replayed(tmp_path: Path) -> None:
    """The wheels slide all the way, on a rail that gives a third more, and then a third less."""
    s, knots = scenario.load("slippery-stop"), ((0.0, 1.0), (150.0, 1.35), (330.0, 0.8))
    rail = replace(s.rail, section=tuple(Section(x, "low", scale) for x, scale in knots))
    train = replace(s.train, axles=1, positions=(), cleaning=())
    true = simulate.run(replace(s, rail=rail, wsp=Wsp(), train=train, duration=75.0))
    log = write(tmp_path / "log.csv", simulate.log(true))
    case = replay.case(analyze.analyze(log, settings.load(), ["kalman"], train_speed=True))
    assert case.logged_m is not None
    assert "replay-rail-ends" not in {f.code for f in case.findings}
    for who, track in [(case.scenario, case.track), *case.draws[::4]]:
        stop = closed_loop.follow(who, track, case.logged)
        assert stop.distance[-1] == pytest.approx(case.logged_m, rel=0.03)
    f0 = case.track.values[0, :, 2]
    level = [float(np.interp(x, case.track.knots, f0)) for x in (80.0, 250.0, 420.0)]
    assert level[1] / level[0] == pytest.approx(1.35, rel=0.1)
    assert level[2] / level[0] == pytest.approx(0.8, rel=0.1)


def test_the_balance_of_the_train_narrows_forces_of_unknown_scale() -> None:
    seconds = 0.1 * np.arange(400)
    t = np.round(seconds * 1e9).astype(np.int64)
    braking = replay._Braking(t, 30.0 - 0.6 * seconds, np.zeros((1, 400)))
    wide = np.exp(0.3 * np.random.default_rng(0).standard_normal(200))
    impulse = 0.55 * seconds  # resistance takes the rest
    scales = replay._balanced(wide, braking, impulse)
    assert float(np.median(scales)) == pytest.approx(1.0, abs=0.05)
    assert float(np.std(scales)) < 0.5 * float(np.std(wide))
    weaker = replay._balanced(wide, braking, 0.8 * impulse)  # these forces are too small
    assert float(np.median(weaker)) > 1.1 * float(np.median(scales))
    assert replay._balanced(wide, braking, None) is wide


def test_a_draw_steeper_than_dry_rail_is_one_that_can_be_run() -> None:
    steep = creep_law.Condition(k_a=8.0, k_s=5.0, f0=0.04, A=0.5, B=0.2)
    place = replay._AxlePlaces([(10.0, scenario.INF)], Vehicle())
    track = replay._track([place], [steep])
    assert track.values[0, -1] == pytest.approx([1.0, 1.0, steep.f0, steep.A, steep.B])


def test_a_log_whose_rail_cannot_be_told_is_refused(tmp_path: Path) -> None:
    blind = write(tmp_path / "blind.csv", recordings(NAME, train=False))
    with pytest.raises(UserError, match="no rail to replay under axle 1") as told:
        replay.case(analysed(blind))
    assert "train speed" in told.value.hint  # no other slides would help
    service = write(tmp_path / "service.csv", recordings("service-brake", train=True))
    with pytest.raises(UserError, match="no axle slides"):
        replay.case(analysed(service))


def test_a_short_slide_is_replayed_on_every_rail_that_fits_it(tmp_path: Path) -> None:
    """Slippery from 60 to 141 m: axle 1 slides for 3 s, and the rail is dry again."""
    s = scenario.load(NAME)
    patch = [Section(x, name) for x, name in ((0.0, "dry"), (60.0, "low"), (141.0, "dry"))]
    true = simulate.run(replace(s, rail=replace(s.rail, section=tuple(patch))))
    log = write(tmp_path / "log.csv", simulate.log(true))
    result = analyze.analyze(log, settings.load(), ["kalman"], train_speed=True)
    case = replay.case(result)
    found = {f.code: f for f in case.findings if f.channel == "axle 1"}
    assert found["replay-slides-short"].severity == "warning"
    assert found["replay-slides-short"].values["slip_s"] == pytest.approx(3.1, abs=0.2)
    ((first, last),) = found["replay-rail-ends"].spans
    assert np.interp(last * 1e9, true.t, true.distance) == pytest.approx(141.0, abs=3.0)
    before = np.interp(case.start_s * 1e9, true.t, true.distance)
    low = case.track.values[0, :, 2] < creep_law.condition("dry").f0
    places = (case.track.knots[low] + before)[[0, -1]]
    assert places == pytest.approx(
        np.interp(np.array([first, last]) * 1e9, true.t, true.distance), abs=3.0
    )
    slips, vehicle = np.geomspace(1e-3, 0.5, 40), result.vehicle
    middle = np.flatnonzero(low)[1]
    rails = [creep_law.Condition(*track.values[0, middle]) for _, track in case.draws]
    peaks = [fit.curve(rail, 18.0, slips, vehicle).max() for rail in rails]
    true_peak = fit.curve(creep_law.condition("low"), 18.0, slips, vehicle).max()
    assert min(peaks) < true_peak < max(peaks)


def test_a_refusal_says_what_is_missing_and_what_helps(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Never to leave out the only axle that slid."""
    result = analysed(log)
    one = Result(
        result.log, result.identified, (result.axles[0], *result.axles[2:]), result.findings,
        result.settings,
    )  # fmt: skip
    under = replay.replay_rail.rail_under_axle

    def refused(axle: AxleResult, *of: Any) -> Any:
        with monkeypatch.context() as m:
            if axle.record.axle == 1:
                m.setattr(fit, "SHORTEST", 1e3)
                m.setattr(fit, "SHORTEST_FIT", 1e3)
            return under(axle, *of)

    monkeypatch.setattr(replay.replay_rail, "rail_under_axle", refused)
    with pytest.raises(UserError, match=r"under axle 1: .* of slip .* 1000 s are needed") as told:
        replay.case(one)
    assert "--axle" not in told.value.hint
    with pytest.raises(UserError, match="under axle 1") as told:
        replay.case(result)
    assert "--axle 2 --axle 3 --axle 4" in told.value.hint


def test_where_every_axle_slides_the_demand_is_the_largest_so_far(log: Path) -> None:
    result = analysed(log)
    two = Result(result.log, result.identified, result.axles[:2], result.findings, result.settings)
    case = replay.case(two)
    assert [f.severity for f in case.findings if f.code == "demand-unknown"] == ["warning"]
    assert not case.demanded  # they slide while the brake fills
    asked = np.array([c.clamping_force for c in case.scenario.brake.command])
    first = min(x.start for a in two.axles for x in sliding.slides(a))
    begin = case.start_s * 1e9 + result.log.start_ns()
    after = asked[int((first - begin) * 1e-9 / replay._KNOT_INTERVAL) + 1 :]
    assert (np.diff(after) >= 0.0).all()
    assert after[-1] == pytest.approx(simulation(NAME).clamping_force[:, 0].max(), rel=0.02)


def test_a_demand_that_nobody_saw_is_none() -> None:
    """Both axles slide while the brake still fills; one alone slides when it had stood."""
    t = np.arange(100, dtype=np.int64) * round(1e9 * replay._KNOT_INTERVAL)
    K = np.minimum(np.arange(100.0), 40.0) * 500.0
    limited = np.where(np.arange(100) < 20, K, 7000.0)
    stop = replay._Braking(t, np.linspace(20.0, 0.0, 100), np.array([limited, limited]))
    asked, known, told = replay._demand(stop, [int(t[15]), int(t[20])], 0)
    assert [(f.code, f.severity) for f in told] == [("demand-unknown", "warning")]
    assert told[0].spans == ((t[20] * 1e-9, t[-1] * 1e-9),)
    assert told[0].values == {"force_n": asked.max()}
    assert known.tolist() == [True] * 20 + [False] * 80
    assert (asked <= K).all()
    assert (np.diff(asked) >= 0.0).all()
    stop = stop._replace(K=np.array([limited, np.where(np.arange(100) < 60, K, 9000.0)]))
    asked, known, told = replay._demand(stop, [int(t[15]), int(t[60])], 0)
    assert [(f.code, f.severity) for f in told] == [("demand-estimated", "info")]
    assert known.all()
    assert asked == pytest.approx(K)


def braked(
    path: Path, axles: int, duration: float, wsp: Wsp, *commands: Command, low: Rail | None = None
) -> tuple[replay.Case, simulate.Simulation]:
    """The replay of a log in which every axle slides, and which may end before the stop does."""
    s = simulate.load(NAME)
    cleaning = tuple(1.0 + 0.1 * i for i in range(axles))
    train = replace(s.train, axles=axles, positions=(), cleaning=cleaning)
    train = replace(train, speed=12.0) if low else train
    brake = replace(s.brake, command=commands)
    s = replace(s, duration=duration, train=train, brake=brake, wsp=wsp, rail=low or s.rail)
    true = simulate.run(s)
    log = write(path / "log.csv", simulate.log(true))
    return replay.case(analyze.analyze(log, settings.load(), ["kalman"], train_speed=True)), true


FULL = Command(2.0, pressure=6.5e5, ramp=1.5)


def test_a_vent_of_every_axle_is_no_release(tmp_path: Path) -> None:
    """It vents all there is for 0.4 s, and leaves the brake alone below 1 m/s."""
    case, true = braked(tmp_path, 1, 60.0, Wsp(period=0.4, vent_time=0.1), FULL)
    at = int(np.searchsorted(true.t, case.start_s * 1e9))
    assert (true.clamping_force[at + 3000 : -20000, 0] < 100.0).any()
    assert case.logged_m == pytest.approx(true.distance[-1] - true.distance[at], abs=1.0)
    assert "stop-extended" not in {f.code for f in case.findings}
    asked = np.array([c.clamping_force for c in case.scenario.brake.command])
    assert (np.diff(asked[10:]) >= 0.0).all()  # as the largest so far
    assert asked[30] == pytest.approx(13.8e3, rel=0.02)


def test_a_release_is_one(tmp_path: Path) -> None:
    """By hand at 14 s from 15.1 m/s, while the axles slide; the log goes on."""
    case, _ = braked(tmp_path, 2, 36.0, Wsp(), FULL, Command(14.0, pressure=0.0))
    assert case.logged_m is None
    (told,) = (f for f in case.findings if f.code == "stop-extended")
    assert told.values["speed_mps"] == pytest.approx(15.0, abs=0.7)
    asked = np.array([c.clamping_force for c in case.scenario.brake.command])
    assert len(asked) * replay._KNOT_INTERVAL == pytest.approx(14.0 - case.start_s, abs=1.0)
    assert asked[-1] == asked.max()


def test_a_demand_larger_than_it_stood_is_not_known() -> None:
    t = np.arange(100, dtype=np.int64) * round(1e9 * replay._KNOT_INTERVAL)
    K = np.where(np.arange(100) < 30, 6e3, 2e3)
    K[60:65] = 8e3  # refilled to more than it stood at
    stop = replay._Braking(t, np.linspace(20.0, 0.0, 100), K[None])
    asked, known, _ = replay._demand(stop, [int(t[30])], 0)
    assert known[:30].all()
    assert not known[30:].any()
    assert asked[[40, 80]] == pytest.approx([6e3, 8e3])


def test_draws_of_an_unknown_demand_reach_what_locks_a_wheel(tmp_path: Path) -> None:
    """Though the log shows it in the end, when slide protection leaves the brake alone."""
    low = Rail((Section(0.0, "very-low"),))
    case, _ = braked(tmp_path, 1, 60.0, Wsp(slowest=3.0), FULL, low=low)
    asked = np.array([[c.clamping_force for c in s.brake.command] for s, _ in case.draws])
    assert not case.demanded
    best = np.array([c.clamping_force for c in case.scenario.brake.command])
    middle, last = len(best) // 2, len(best) - 1
    assert best[last] > 1.1 * best[middle]
    assert asked[:, middle].min() == pytest.approx(best[middle])
    assert asked[:, middle].max() > 1.1 * best[middle]


@pytest.mark.slow
def test_a_guessed_demand_is_in_the_intervals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All axles are at the limit from the first moment, and slide past it 640 m later."""
    monkeypatch.setattr(fit, "DRAWS", 40)
    there = ["-o", str(tmp_path), "--json"]
    assert app(["antiskid", "slippery-stop", "--seed", "1", *there], standalone_mode=False) == 0
    true = json.loads(capsys.readouterr().out)["controllers"]
    log = str(tmp_path / "slippery-stop.rule.antiskid.mcap")
    assert app(["antiskid", "--from-log", log, *there], standalone_mode=False) == 3
    document = json.loads(capsys.readouterr().out)
    assert "demand-unknown" in {f["code"] for f in document["findings"]}
    assert document["dry_distance_m"] is None
    outside = []
    for law, values in document["controllers"].items():
        assert values["extension"] is None
        # The log is the rule's. Its own slides are replayed for the distance.
        truth = true["rule" if law == "logged" else law]
        names = {"stopping_distance_m"} if law == "logged" else values.keys() - {"extension"}
        for name in names:
            low, high = document["intervals"][law][name]
            if not 0.98 * low <= truth[name] <= 1.02 * high:
                outside.append((law, name))
    assert len(outside) <= 2, outside  # of 25 of 95 % each


@pytest.mark.slow
def test_slides_that_an_unknown_delay_may_hide_are_not_taken_for_grip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The patent's law slides so little that the slip may be a delay of the train speed."""
    there = ["-o", str(tmp_path), "--json"]
    assert app(["antiskid", "slippery-stop", "--seed", "1", *there], standalone_mode=False) == 0
    capsys.readouterr()
    log = str(tmp_path / "slippery-stop.patent.antiskid.mcap")
    with pytest.raises(UserError, match="delay of the train speed is not known, and may hide"):
        app(["antiskid", "--from-log", log, *there], standalone_mode=False)


@pytest.mark.parametrize(
    "arguments",
    [[], ["slippery-stop", "--from-log", "a.csv"], ["slippery-stop", "--axle", "1"]],
)  # fmt: skip
def test_a_stop_has_one_source(arguments: list[str]) -> None:
    with pytest.raises(UserError) as told:
        app(["antiskid", *arguments], standalone_mode=False)
    assert told.value.code == 2
