"""A log's stop run again, against the closed loop on the rail that the log was simulated on."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from recordings import static
from simulated import recordings, simulation, write

from adhesion_cli import analysis, antiskid, rail, railfit, replay, scenario, settings, slip
from adhesion_cli.cli.app import app
from adhesion_cli.errors import UserError
from adhesion_cli.model import Parameter, Result

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
    return analysis.analyze(path, settings.load, ["kalman"], train_speed=True)


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(railfit, "_DRAWS", 12)


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
    assert len(case.draws) == 12
    assert [f.code for f in case.findings] == ["rail-not-observable"] * 2


def test_the_interval_holds_the_stop_on_the_true_rail(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["antiskid", "--from-log", str(log), "--json", "-o", str(tmp_path)]
    arguments += [x for text in KNOWN for x in ("--set", text)]
    assert app(arguments, standalone_mode=False) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "adhesion.antiskid/1"
    assert document["draws"] == 12
    assert {p.name for p in tmp_path.iterdir()} == {
        "low.antiskid.rrd", "low.antiskid.sha256",
        *(f"low.{law}.antiskid.mcap" for law in ("none", "patent", "rule")),
    }  # fmt: skip
    (told,) = static(tmp_path / "low.antiskid.rrd", "/verdict", "text")
    assert all(f["code"] in told for f in document["findings"])
    beside = document["beside"]
    assert beside["patent"]["patent_less_this_m"] is None
    assert beside["none"]["patent_less_this_m"][2] < -20.0  # though their own intervals overlap
    assert sum(x["shortest"] for x in beside.values()) <= 1.0
    assert beside["none"]["shortest"] == 0.0
    s = scenario.load(NAME)
    for law in ("none", "patent", "rule"):
        stop = antiskid.run(s, law)
        start = np.interp(document["start_s"], stop.t * 1e-9, stop.distance)
        low, high = document["intervals"][law]["stopping_distance_m"]
        assert low < stop.distance[-1] - start < high, law
        assert high < 1.2 * low, law  # and it says something
        value = document["controllers"][law]["stopping_distance_m"]
        assert low <= value <= high
        assert value == pytest.approx(stop.distance[-1] - start, rel=0.02)
        true = antiskid.verdict(stop, s, antiskid.dry_distance(s))
        found = document["controllers"][law]
        assert found["utilisation"] == pytest.approx(true.utilisation, abs=0.03)
        assert found["extension"] == pytest.approx(true.extension, abs=0.02)
        assert found["max_slip"] == pytest.approx(true.max_slip, abs=0.04)


def test_a_train_in_part_is_told(log: Path) -> None:
    """Axles left out, or a train that slows harder than its axles say, as one with others does."""
    part = analysis.analyze(log, settings.load, ["kalman"], [1, 2], train_speed=True)
    (told,) = (f for f in replay.case(part).findings if f.code == "train-in-part")
    assert "without axle 3, 4" in told.message
    whole = analysed(log)
    heavy = replace(whole.vehicle, axle_mass=Parameter(1.5 * 4797.0, 10.0))
    for result, many in ((whole, 0), (replace(whole, vehicle=heavy), 1)):
        codes = [f.code for f in replay.case(result).findings]
        assert codes.count("train-in-part") == many


def test_a_draw_steeper_than_dry_rail_is_one_that_can_be_run() -> None:
    steep = rail.Condition(k_a=8.0, k_s=5.0, f0=0.04, A=0.5, B=0.2)
    track = replay._track([10.0], [steep])
    assert track.values[0, -1] == pytest.approx([1.0, 1.0, steep.f0, steep.A, steep.B])


def test_a_log_whose_rail_cannot_be_told_is_refused(tmp_path: Path) -> None:
    film = write(tmp_path / "film.csv", recordings("leaf-film"))
    with pytest.raises(UserError, match="no rail to replay under axle 1: slides too short") as told:
        replay.case(analysed(film))
    assert "--from" in told.value.hint
    blind = write(tmp_path / "blind.csv", recordings(NAME, train=False))
    with pytest.raises(UserError, match="no rail to replay under axle 1: the train speed") as told:
        replay.case(analysed(blind))
    assert "train speed" in told.value.hint  # no other slides would help
    service = write(tmp_path / "service.csv", recordings("service-brake", train=True))
    with pytest.raises(UserError, match="no axle slides"):
        replay.case(analysed(service))


def test_where_every_axle_slides_the_demand_is_the_largest_so_far(log: Path) -> None:
    result = analysed(log)
    two = Result(result.log, result.vehicle, result.axles[:2], result.findings, result.settings)
    case = replay.case(two)
    assert [f.severity for f in case.findings if f.code == "demand-guessed"] == ["warning"]
    assert not case.demanded  # they slide while the brake fills
    asked = np.array([c.clamping_force for c in case.scenario.brake.command])
    first = min(x.start for a in two.axles for x in slip.slides(a))
    begin = case.start_s * 1e9 + result.log.start_ns()
    after = asked[int((first - begin) * 1e-9 / replay._EVERY) + 1 :]
    assert (np.diff(after) >= 0.0).all()
    assert after[-1] == pytest.approx(simulation(NAME).clamping_force[:, 0].max(), rel=0.02)


def test_a_demand_that_nobody_saw_is_none() -> None:
    """Both axles slide while the brake still fills; one alone slides when it had stood."""
    t = np.arange(100, dtype=np.int64) * round(1e9 * replay._EVERY)
    K = np.minimum(np.arange(100.0), 40.0) * 500.0
    limited = np.where(np.arange(100) < 20, K, 7000.0)
    stop = replay._Braking(t, np.linspace(20.0, 0.0, 100), np.array([limited, limited]))
    asked, known, told = replay._demand(stop, [int(t[15]), int(t[20])])
    assert [(f.code, f.severity) for f in told] == [("demand-guessed", "warning")]
    assert known.tolist() == [True] * 20 + [False] * 80
    assert (asked <= K).all()
    assert (np.diff(asked) >= 0.0).all()
    stop = stop._replace(K=np.array([limited, np.where(np.arange(100) < 60, K, 9000.0)]))
    asked, known, told = replay._demand(stop, [int(t[15]), int(t[60])])
    assert [(f.code, f.severity) for f in told] == [("demand-guessed", "info")]
    assert known.all()
    assert asked == pytest.approx(K)


@pytest.mark.slow
def test_a_guessed_demand_is_in_every_interval(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All axles are at the limit from the first moment, and slide past it 640 m later."""
    monkeypatch.setattr(railfit, "_DRAWS", 40)
    there = ["-o", str(tmp_path), "--json"]
    assert app(["antiskid", "slippery-stop", "--seed", "1", *there], standalone_mode=False) == 0
    true = json.loads(capsys.readouterr().out)["controllers"]
    log = str(tmp_path / "slippery-stop.patent.antiskid.mcap")
    assert app(["antiskid", "--from-log", log, *there], standalone_mode=False) == 3
    document = json.loads(capsys.readouterr().out)
    assert "demand-guessed" in {f["code"] for f in document["findings"]}
    assert document["dry_distance_m"] is None
    for law, values in document["controllers"].items():
        assert values["extension"] is None
        for name in values.keys() - {"extension"}:
            low, high = document["intervals"][law][name]
            assert 0.98 * low <= true[law][name] <= 1.02 * high, (law, name)  # 24 of 95 % each


@pytest.mark.parametrize(
    "arguments",
    [[], ["slippery-stop", "--from-log", "a.csv"], ["slippery-stop", "--axle", "1"],
     ["--from-log", "a.csv", "--rails"]],
)  # fmt: skip
def test_a_stop_has_one_source(arguments: list[str]) -> None:
    with pytest.raises(UserError) as told:
        app(["antiskid", *arguments], standalone_mode=False)
    assert told.value.code == 2
