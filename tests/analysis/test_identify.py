"""The vehicle of a run: stated values are the prior, the log's deceleration is the evidence."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.commands import Run
from helpers.vehicle_logs import STATED, WHOLE, blended_log, log, true

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.identify import car_brakes
from adhesion_cli.analysis.stated_friction import friction_table
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.analysis.vehicle_findings import with_friction_findings, without_force_findings
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import IdentifiedVehicle, Parameter, Result, Vehicle, quantities
from adhesion_cli.core.physics import (
    G,
    braked,
    clamping_force,
    force_line,
    friction_share,
    wheelset,
)
from adhesion_cli.core.summary import MeanAndHighest
from adhesion_cli.results.vehicle_text import VehicleOfLog, describe_vehicle, describe_vehicles
from adhesion_cli.studies.calibrate import calibrate
from adhesion_cli.studies.named_together import identify_together

METRO = replace(
    Vehicle(), lever_ratio=Parameter(8.0, 0.0), axle_mass=Parameter(14e3, 0.0),
    spring_force=Parameter(600.0, 0.0),
)  # fmt: skip
STATEMENT = {**WHOLE, "lever_ratio": 2.4}


def run(path: Path, vehicle: dict[str, object] | None = None, **sections: object) -> Result:
    stated = settings.load({"vehicle": vehicle or {}, **sections}, folder=False)
    return analyze(path, stated, ["td"], train_speed=True)


def coefficients(result: Result) -> list[MeanAndHighest]:
    axles = summarise(result, {}).axles
    found = [a.coefficient for axle in axles for a in axle.applications]
    assert found
    assert all(found)
    return [c for c in found if c]


def true_coefficients(path: Path, vehicle: Vehicle, result: Result) -> list[float]:
    """The mean µ of each brake application, by the vehicle as it is."""
    w, line = wheelset(vehicle, 1), force_line(vehicle)
    (axle,) = result.axles
    assert axle.record.pressure is not None
    means = []
    for s in axle.applications:
        force = w.phi * np.maximum(line.per_pascal * axle.record.pressure[s] - line.at_zero, 0.0)
        turning = np.isfinite(axle.reference.force[s])
        means.append(float(np.mean(w.rolling * force[turning])) / (w.mass * G))
    return means


def first(result: Result) -> Finding:
    return result.findings[0]


def test_a_brake_that_holds_the_speed_on_a_downhill_shows_no_force(tmp_path: Path) -> None:
    """A minute of it, and a stop on the level, which shows the brake of both."""
    t, path, rng = np.arange(0.0, 115.0, 0.05), tmp_path / "log.csv", np.random.default_rng(1)
    p = np.interp(t, [10, 12, 70, 71, 85, 87], [0, 1.2e5, 1.2e5, 0, 0, 2.5e5])
    brake = braked(clamping_force(p, METRO), wheelset(METRO, 1))
    downhill = np.where((t > 11.0) & (t < 70.5), np.max(brake[t < 70.0]), 0.0)
    v = np.maximum(25.0 - np.cumsum(brake - downhill + 0.012) * 0.05, 0.0)
    rim = np.maximum(3.6 * (v + rng.normal(0.0, 0.004, len(t))), 0.0)
    rows = [f"{a:.2f},{b / 1e5:.4f},{c:.4f}" for a, b, c in zip(t, p, rim, strict=True)]
    path.write_text("\n".join(["time [s],bc pressure [bar],wheel speed [km/h]", *rows]) + "\n")
    result = run(path)
    (held,) = [f for f in result.findings if f.code == "brake-holds-speed"]
    assert held.spans[0] == pytest.approx((12.0, 70.0), abs=3.0)
    means = true_coefficients(path, METRO, result)
    assert len(means) == 2
    for coefficient, mean in zip(coefficients(result), means, strict=True):
        assert coefficient.mean == pytest.approx(mean, abs=coefficient.mean_u95)
        assert coefficient.mean_u95 < 0.3 * mean


@pytest.mark.parametrize("wheel", [{}, {"wheel_diameter": 0.7}])
def test_turns_of_wheels_that_nobody_states_have_the_band_of_any_wheel(
    wheel: dict[str, object], tmp_path: Path
) -> None:
    """The wheels turn as those of 0.7 m do, and the program would take 0.84 m."""
    lines = log(tmp_path / "log.csv", METRO).read_text().splitlines()[1:]
    cells = [line.split(",") for line in lines]
    rows = [f"{t},{p},{float(v) / 3.6 / 0.35 * 30.0 / np.pi:.3f}" for t, p, v in cells]
    path = tmp_path / "turns.csv"
    path.write_text("\n".join(["time [s],bc pressure [bar],wheel speed [rpm]", *rows]) + "\n")
    result = run(path, wheel)
    codes = [f.code for f in result.findings]
    assert ("wheel-diameter-unknown" in codes) == (not wheel)
    widest = 0.3 if wheel else 1.0
    for coefficient, mean in zip(
        coefficients(result), true_coefficients(path, METRO, result), strict=True
    ):
        assert coefficient.mean == pytest.approx(mean, abs=coefficient.mean_u95)
        assert coefficient.mean_u95 < widest * mean


@pytest.mark.parametrize("stops", [1, 4])
@pytest.mark.parametrize("seed", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_nobody_stated_the_vehicle_and_the_log_shows_its_brake(
    seed: int, stops: int, tmp_path: Path
) -> None:
    path = log(tmp_path / "log.csv", METRO, seed, stops)
    result = run(path)
    found = result.identified
    assert (found.source, found.known, found.stops) == ("log", True, stops)
    assert result.vehicle.axle_mass.tolerance > 0.2 * result.vehicle.axle_mass.value
    for c, mu in zip(coefficients(result), true_coefficients(path, METRO, result), strict=True):
        assert c.mean == pytest.approx(mu, abs=c.mean_u95)
        assert 0.05 * mu < c.mean_u95 < 0.2 * mu
    forces = [a.force_n for a in summarise(result, {}).axles[0].applications]
    assert all(f and f.mean_u95 > 0.4 * f.mean for f in forces)


def test_light_stops_are_seen(tmp_path: Path) -> None:
    """The default's spring takes 1.1 bar: nothing would be left of these."""
    path = log(tmp_path / "log.csv", METRO, applications=4)
    text = path.read_text().splitlines()
    rows = [line.split(",") for line in text[1:]]
    assert max(float(p) for _, p, _ in rows) < 3.6
    assert len(run(path).axles[0].applications) == 4


def test_the_default_vehicle_is_kept_where_the_log_agrees(tmp_path: Path) -> None:
    result = run(log(tmp_path / "log.csv", Vehicle(), applications=3))
    assert result.identified.source == "default"
    assert first(result).code == "vehicle-default"
    assert result.vehicle.friction.value == pytest.approx(0.3, rel=0.1)
    assert result.vehicle.friction.tolerance < 0.03


def test_motors_that_drive_until_the_brake_begins_are_no_downhill(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", true(), traction=0.15)
    result = run(path)
    for c, mu in zip(coefficients(result), true_coefficients(path, true(), result), strict=True):
        assert c.mean == pytest.approx(mu, abs=c.mean_u95)


@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_a_stated_friction_that_is_wrong_is_mended_by_half(factor: float, tmp_path: Path) -> None:
    path, as_is = tmp_path / "log.csv", true(factor)
    log(path, as_is, applications=4)
    result = run(path, STATEMENT)
    assert result.identified.source == "stated"
    for c, mu in zip(coefficients(result), true_coefficients(path, as_is, result), strict=True):
        assert abs(c.mean / mu - 1.0) < 0.6 * abs(1.0 / factor - 1.0)
        assert c.mean == pytest.approx(mu, abs=c.mean_u95)


def test_a_stated_vehicle_that_the_log_contradicts_stays_and_is_the_first_finding(
    tmp_path: Path,
) -> None:
    path = log(tmp_path / "log.csv", true(2.0), applications=4)
    result = run(path, STATEMENT)
    assert result.vehicle.friction.value == 0.3
    for c, mu in zip(coefficients(result), true_coefficients(path, true(2.0), result), strict=True):
        assert 0.5 * c.mean_u95 < mu - c.mean < c.mean_u95
    told = first(result)
    assert (told.code, told.severity) == ("vehicle-suspect", "warning")
    assert told.values["factor"] == pytest.approx(2.0, rel=0.15)
    assert [f.code for f in result.findings].count("vehicle-suspect") == 1


# Of the force per bar that the stop at 2.2 bar shows: what engineers would state.
BLENDED = {**WHOLE, "lever_ratio": 4.0, "axle_mass": 12e3, "spring_force": 200}


@pytest.mark.parametrize("stated", [None, BLENDED])
def test_a_brake_without_a_pressure_is_the_first_finding(
    stated: dict[str, object] | None, tmp_path: Path
) -> None:
    result = run(blended_log(tmp_path / "log.csv"), stated)
    assert (first(result).code, first(result).severity) == ("other-brake", "warning")
    assert result.identified.known == (stated is not None)
    assert not {"vehicle-suspect", "vehicle-in-doubt"} & {f.code for f in result.findings}
    if stated:
        assert first(result).values["factor"] > 1.2
        assert result.vehicle.friction == settings.load({"vehicle": stated}).vehicle.friction
        assert "those of the air brake alone" in describe_vehicle(summarise(result, {}).vehicle)


def test_calibrate_refuses_a_log_with_another_brake(tmp_path: Path) -> None:
    stated = settings.load({"vehicle": BLENDED}, folder=False)
    with pytest.raises(UserError, match=r"log\.csv: .* another brake may act"):
        calibrate([blended_log(tmp_path / "log.csv")], stated)


def test_where_all_wheels_slide_the_inertia_is_as_sure_as_its_statement(tmp_path: Path) -> None:
    """A true friction is in no doubt. The log says more of it where the inertia is known better."""
    path = simulated.write(tmp_path / "log.csv", simulated.recordings("slippery-stop"))
    inertias = ({}, {"value": 145.0, "tolerance": 29.0}, {"value": 145.0, "tolerance": 0.0})
    results = [
        run(path, {"friction": 0.3, **({"wheelset_inertia": i} if i else {})}) for i in inertias
    ]
    for result in results:
        assert result.identified.doubt is None
        assert abs(result.vehicle.friction.value - 0.3) < 2.0 * result.vehicle.friction.tolerance
    _, rough, exact = (r.vehicle.friction.tolerance for r in results)
    assert exact < 0.95 * rough


def test_what_has_no_tolerance_never_moves(tmp_path: Path) -> None:
    exact = {name: {"value": value, "tolerance": 0.0} for name, value in STATEMENT.items()}
    for name in ("axle_mass", "efficiency", "cylinder_diameter", "wheelset_inertia"):
        exact[name] = {"value": getattr(STATED, name).value, "tolerance": 0.0}
    result = run(log(tmp_path / "log.csv", true(1.1), applications=4), exact)
    for name in exact:
        assert getattr(result.vehicle, name).value == pytest.approx(exact[name]["value"], rel=1e-9)


def test_a_run_may_keep_the_stated_vehicle(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", true(1.2), applications=3)
    result = run(path, STATEMENT, analysis={"vehicle": "stated"})
    assert result.vehicle == settings.load({"vehicle": STATEMENT}, folder=False).vehicle
    assert result.identified.stops == 0


def test_stated_parts_are_kept_where_the_brake_is_not_stated(tmp_path: Path) -> None:
    result = run(log(tmp_path / "log.csv", METRO, applications=3), {"axle_mass": 14e3})
    assert result.identified.source == "log"
    assert result.vehicle.axle_mass.value == pytest.approx(14e3, rel=0.02)
    force = summarise(result, {}).axles[0].applications[0].force_n
    assert force
    assert force.mean_u95 < 0.25 * force.mean


IRON = {"speed": [0.0, 4.0, 10.0, 20.0, 45.0], "value": [0.26, 0.17, 0.13, 0.1, 0.08]}


def test_a_friction_over_speed_alone_takes_its_level_from_the_log(tmp_path: Path) -> None:
    """The rest of the vehicle is nobody's: the paper's would give a tenth of the force."""
    (friction, table), loaded = friction_table({**IRON, "tolerance": 0.05}), Parameter(18e3, 0.0)
    iron = replace(METRO, friction=friction, friction_table=table, axle_mass=loaded)
    path = log(tmp_path / "log.csv", iron, applications=5)
    result = run(path, {"friction": {**IRON, "tolerance": 0.1}})
    assert (result.identified.source, first(result).code) == ("log", "vehicle-incomplete")
    assert "axle_mass" in first(result).names["unstated"]
    assert result.vehicle.friction_table
    assert "stated in part" in describe_vehicle(summarise(result, {}).vehicle)
    (axle,) = result.axles
    w, line, record = wheelset(iron, 1), force_line(iron), axle.record
    assert record.pressure is not None
    K = np.maximum(line.per_pascal * record.pressure - line.at_zero, 0.0)
    rim = record.wheel_speed * w.radius
    force = w.rolling * w.phi * K * friction_share(rim, K, iron)
    applications = summarise(result, {}).axles[0].applications
    for s, a in zip(axle.applications, applications, strict=True):
        c, newtons = a.coefficient, a.force_n
        assert c
        assert newtons
        mean = float(np.mean(force[s][np.isfinite(axle.reference.force[s])]))
        assert c.mean == pytest.approx(mean / w.mass / G, abs=c.mean_u95)
        assert c.mean_u95 < 0.25 * c.mean
        assert newtons.mean == pytest.approx(mean, abs=newtons.mean_u95)  # 18 t are in the band
        assert c.max_u95 < 0.3 * c.max  # the mass has no part in µ


@pytest.mark.parametrize(
    "stated", [{"wheel_diameter": 0.92}, {"wheelset_inertia": 110}, {"friction_lag": 0.1}]
)
def test_a_wheel_or_a_lag_alone_is_no_part_of_the_brake(
    stated: dict[str, object], tmp_path: Path
) -> None:
    result = run(log(tmp_path / "log.csv", METRO, applications=3), stated)
    assert result.identified.source == "log"
    assert "vehicle-incomplete" not in {f.code for f in result.findings}


def test_without_a_brake_in_the_log_nothing_is_known(run_in: Run, tmp_path: Path) -> None:
    log(tmp_path / "log.csv", METRO, applications=0)
    done = run_in("analyze", "log.csv", "--json", "-a", "td")
    (result,) = json.loads(done.stdout)["results"]
    assert not result["vehicle"]["known"]
    assert result["findings"][0]["code"] == "vehicle-unknown"
    assert not any(a["force_n"] for axle in result["axles"] for a in axle["applications"])
    assert done.returncode == 0
    again = run_in("analyze", "log.adhesion.mcap", "--json", "-a", "td", "-o", "again")
    assert not json.loads(again.stdout)["results"][0]["vehicle"]["known"]


def test_a_force_that_nobody_knows_is_not_too_noisy() -> None:
    judged, logged = (Finding(code, "warning") for code in ("reference-noise", "gap"))
    assert without_force_findings([judged, logged]) == [logged]


@pytest.fixture(name="run_in")
def _run_in(request: pytest.FixtureRequest, tmp_path: Path) -> Run:
    (tmp_path / "again").mkdir()
    fixture: Run = request.getfixturevalue("run")
    return fixture


def force_of(identified: IdentifiedVehicle | None) -> tuple[Parameter | None, float]:
    assert identified
    return identified.force_per_bar, identified.vehicle.friction.value


def test_logs_that_are_named_together_are_one_trains(tmp_path: Path) -> None:
    stated = settings.load(folder=False)
    logs = [log(tmp_path / f"{i}.csv", METRO, i, 2) for i in range(3)]
    together, *others = identify_together(logs, stated)
    assert together
    assert all(force_of(x) == force_of(together) for x in others)
    assert (together.stops, together.logs, together.differing) == (6, 3, ())
    alone = run(logs[0]).identified
    assert together.vehicle.friction.tolerance <= alone.vehicle.friction.tolerance
    sigmas = [x.vehicle.friction.tolerance for x in (together, *others) if x]
    assert len({*sigmas}) == 3  # each holds the brake of its own log
    weak = replace(METRO, friction=Parameter(0.12, 0.0))
    foreign = log(tmp_path / "foreign.csv", weak, 7, 2)
    *like, other = identify_together([*logs, foreign], stated)
    assert all(force_of(x) == force_of(together) for x in like)
    assert other
    assert other.factor_of_logs == pytest.approx(0.12 / METRO.friction.value, rel=0.15)
    results = [analyze(logs[0], stated, ["td"], identified=together)]
    results.append(analyze(foreign, stated, ["td"], identified=other))
    for result in with_friction_findings(results):
        assert first(result).code == "friction-differs"


@pytest.mark.parametrize("statement", [{}, {**STATEMENT, "lever_ratio": 8.0, "axle_mass": 14e3}])
def test_logs_with_other_pads_have_their_own_adhesion(
    statement: dict[str, object], tmp_path: Path
) -> None:
    stated = settings.load({"vehicle": statement}, folder=False)
    pads = replace(METRO, friction=Parameter(0.7 * METRO.friction.value, 0.0))
    vehicles = [METRO, METRO, pads]
    logs = [log(tmp_path / f"{i}.csv", vehicle, i, 2) for i, vehicle in enumerate(vehicles)]
    summaries = []
    for path, vehicle, own in zip(logs, vehicles, identify_together(logs, stated), strict=True):
        result = analyze(path, stated, ["td"], identified=own)
        truths = true_coefficients(path, vehicle, result)
        for c, mu in zip(coefficients(result), truths, strict=True):
            assert abs(c.mean - mu) < c.mean_u95 < 0.25 * mu
        summary = summarise(result, {})
        summaries.append(VehicleOfLog("", path.name, summary.vehicle, summary.axles))
    first_line, second_line = describe_vehicles(summaries)
    assert first_line.startswith("Vehicle of '0.csv', '1.csv': ")
    assert second_line.startswith("Vehicle of '2.csv': ")
    assert describe_vehicles(summaries[:2]) == [first_line.replace(" of '0.csv', '1.csv'", "")]


def test_cast_iron_at_several_pressures_has_no_common_brake(tmp_path: Path) -> None:
    iron = replace(METRO, friction_fade=Parameter(-0.012, 0.0), friction_speed=Parameter(20.0, 0.0))
    stated = settings.load(folder=False)
    logs = [log(tmp_path / f"{i}.csv", iron, i, 3) for i in range(5)]
    vehicles = identify_together(logs, stated)
    frictions = {vehicle.vehicle.friction for vehicle in vehicles if vehicle}
    assert len(frictions) == len(logs)
    of_logs = []
    for path, vehicle in zip(logs, vehicles, strict=True):
        summary = summarise(analyze(path, stated, ["td"], identified=vehicle), {})
        of_logs.append(VehicleOfLog("", path.name, summary.vehicle, summary.axles))
    assert "found from each log" in describe_vehicles(of_logs)[0]


@pytest.mark.parametrize("order", [range(7), (3, 6, 1, 5, 0, 4, 2)])
def test_pads_that_bed_in_have_another_friction_in_each_log(
    order: Sequence[int], tmp_path: Path
) -> None:
    """Not the same frictions in any order: those may be gradients."""
    final, stated = METRO.friction.value, settings.load(folder=False)
    logs = []
    for place, number in enumerate(order):
        pads = replace(METRO, friction=Parameter((1.0 - 0.04 * number) * final, 0.0))
        logs.append(log(tmp_path / f"{place}.csv", pads, place, 1))
    vehicles = [x.vehicle for x in identify_together(logs, stated) if x]
    drifts = order == range(7)
    assert len({x.friction.value * x.lever_ratio.value for x in vehicles}) == (7 if drifts else 1)
    if drifts:
        forces = [x.friction.value * x.lever_ratio.value / x.axle_mass.value for x in vehicles]
        assert forces[-1] / forces[0] == pytest.approx(0.76, abs=0.06)


def test_a_stop_under_another_brake_is_told_where_it_is(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", METRO, applications=5)
    head, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    weak = [
        f"{t},{0.4 * float(p) if 58.0 < float(t) < 84.0 else float(p):.4f},{v}" for t, p, v in cells
    ]
    path.write_text("\n".join([head, *weak, ""]))
    (told,) = [f for f in run(path).findings if f.code == "stops-differ"]
    assert told.values["share"] > 1.5
    ((begin, end),) = told.spans
    assert 58.0 < begin < end < 84.0


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_friction_that_rises_as_the_train_gets_slower_is_told(seed: int, tmp_path: Path) -> None:
    iron = replace(METRO, friction_fade=Parameter(-0.012, 0.0), friction_speed=Parameter(20.0, 0.0))
    codes = {}
    for name, vehicle in {"pads": METRO, "iron": iron}.items():
        result = run(log(tmp_path / f"{name}.csv", vehicle, seed, applications=5))
        codes[name] = [f for f in result.findings if f.code == "friction-over-speed"]
    # The vehicle has the slope of the log, which is as uncertain as it is large.
    fade = result.vehicle.friction_fade
    assert -0.025 < fade.value < -0.005
    assert fade.tolerance >= abs(fade.value)
    assert not codes["pads"]
    (finding,) = codes["iron"]
    assert finding.severity == "warning"
    assert finding.values["factor"] > 1.3
    assert 0.0 < finding.values["low_kmh"] < finding.values["high_kmh"]
    # Pads that somebody states as cast iron: the strong part at high speed is weak by that table.
    wrong = run(tmp_path / "pads.csv", {"friction": "cast-iron"})
    (finding,) = [f for f in wrong.findings if f.code == "friction-over-speed"]
    assert finding.values["factor"] < 0.8
    # The table stays, and its band holds what the log shows beside it.
    assert wrong.vehicle.friction_fade.value == 0.0
    assert wrong.vehicle.friction_fade.tolerance > 0.01
    stated = {"friction_fade": -0.012, "friction_speed": 20.0}
    path = tmp_path / "iron.csv"
    of_stated = run(path, stated)
    assert all(f.code != "friction-over-speed" for f in of_stated.findings)
    assert of_stated.vehicle.friction_fade.tolerance < 0.001


def test_the_line_says_what_is_known(tmp_path: Path) -> None:
    paths = [log(tmp_path / f"{i}.csv", METRO, applications=n) for i, n in enumerate((3, 0))]
    lines = []
    for path in paths:
        summary = summarise(run(path), {})
        lines.append(describe_vehicle(summary.vehicle, summary.axles))
    assert "3 brake applications of this log" in lines[0]
    assert "not known" in lines[1]
    stated = summarise(run(paths[0], {**WHOLE, "lever_ratio": 8.0, "axle_mass": 14e3}), {})
    kilonewtons = 0.3 * 1e5 * force_line(METRO).per_pascal / 1e3
    assert f"{kilonewtons:.3g} kN" in describe_vehicle(stated.vehicle, stated.axles)
    friction, table = friction_table({**IRON, "tolerance": 0.05})
    (brake,) = car_brakes(replace(METRO, friction=friction, friction_table=table))
    assert brake.state == (10.0, 0.0)
    (car,) = stated.vehicle.cars
    for force, text in ((None, "36 km/h (friction changes with speed)."), (68e3, "68 kN per axle")):
        iron = replace(car, speed_mps=10.0, clamping_force_n=force)
        assert text in describe_vehicle(replace(stated.vehicle, cars=(iron,)))


def test_the_vehicle_of_a_result_is_said_to_be_its(run_in: Run, tmp_path: Path) -> None:
    """The log has shown it: it is not stated, and its values are no defaults."""
    path = log(tmp_path / "log.csv", METRO, applications=3)
    shown = run_in("analyze", path, "-o", tmp_path)
    assert "found from 3 brake applications" in " ".join(shown.stdout.split())
    again = run_in("compare", tmp_path / "log.adhesion.mcap", "--algo", "td")
    assert again.stdout.startswith("Vehicle: that of the result file")
    assert "vehicle-default" not in again.stderr
    assert "empty-channel" not in again.stderr


def with_columns(path: Path, target: Path, change: Callable[[list[str], float], list[str]]) -> Path:
    """A log with other cells; `change` takes those of a row and its time."""
    head, *rows = path.read_text().splitlines()
    changed = [change(row.split(","), float(row.split(",")[0])) for row in rows]
    names = head.split(",") + [f"axle {i} speed [km/h]" for i in range(2, len(changed[0]) - 1)]
    target.write_text("\n".join([",".join(names), *map(",".join, changed), ""]))
    return target


def test_a_window_without_a_brake_is_no_fault(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", METRO, applications=2)
    noise = np.random.default_rng(1).normal(0.0, 0.01, 10_000)
    rows = iter(noise)
    noisy = with_columns(
        path, tmp_path / "noise.csv", lambda c, _: [c[0], f"{float(c[1]) + next(rows):.3f}", c[2]]
    )
    stated = settings.load(folder=False)
    assert not analyze(noisy, stated, ["td"], window=(0.0, 7.0)).identified.known
    known = settings.load({"vehicle": STATEMENT}, folder=False)
    assert analyze(noisy, known, ["td"], window=(0.0, 7.0)).identified.known


def test_a_vehicle_that_is_exactly_known_is_taken_as_it_is(tmp_path: Path) -> None:
    exact = {
        name: {"value": np.atleast_2d(getattr(STATED, name))[0][0], "tolerance": 0.0}
        for name in quantities(Vehicle)
    }
    result = run(log(tmp_path / "log.csv", true(1.1), applications=2), exact, train={"alike": 0.0})
    assert result.vehicle.friction == Parameter(0.3, 0.0)


def test_a_sensor_that_ends_leaves_the_others(tmp_path: Path) -> None:
    """A second axle without values after a third of the log."""
    path = log(tmp_path / "log.csv", METRO, applications=4)
    lost = with_columns(path, tmp_path / "lost.csv", lambda c, t: [*c, c[2] if t < 30.0 else ""])
    assert run(lost).identified.source == "log"


def test_logs_of_pressures_and_of_forces_are_not_one_evidence(tmp_path: Path) -> None:
    pressures = log(tmp_path / "log.csv", METRO, applications=3)
    line = force_line(METRO)
    forces = tmp_path / "forces.csv"
    rows = pressures.read_text().splitlines()[1:]
    cells = [row.split(",") for row in rows]
    K = [max(line.per_pascal * 1e5 * float(p) - line.at_zero, 0.0) for _, p, _ in cells]
    lines = [f"{t},{k:.1f},{v}" for (t, _, v), k in zip(cells, K, strict=True)]
    forces.write_text("\n".join(["time [s],clamping force [N],wheel speed [km/h]", *lines, ""]))
    assert identify_together([pressures, forces], settings.load(folder=False)) == [None] * 2
    found = run(forces)
    assert found.identified.source == "log"
    assert found.identified.force_per_bar is None
