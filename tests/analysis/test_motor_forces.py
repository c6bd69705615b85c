"""The ED brake and the traction force in the balance of a whole analysis."""

from pathlib import Path

import numpy as np
import pytest
from helpers.blended import MASS, PHI, PISTON, RADIUS, RATIO, SPRING, VEHICLE, Blended, blended

from adhesion_cli.analysis import analyze as run
from adhesion_cli.analysis.settings import load, tree
from adhesion_cli.analysis.stops_of_log import stops_of_result
from adhesion_cli.analysis.summarise import brake_applications, summarise
from adhesion_cli.core import toml
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Floats, Result
from adhesion_cli.results.stop_rows import stop_row
from adhesion_cli.results.vehicle_text import describe_motors

MOTOR_BOGIE = (2.0, 2.0, 0.0, 0.0)


def analyzed(path: Path, *assignments: str, axles: tuple[int, ...] = (1, 4)) -> Result:
    """An axle of each bogie, if no other is asked for."""
    settings = load(toml.parsed(VEHICLE, "test"), assignments, folder=False)
    return run.analyze(path, settings, ["td"], axles)


def check(result: Result, log: Blended, within: float = 0.05) -> None:
    """Every mean adhesion coefficient is in its band, and near the truth."""
    for axle, applications in brake_applications(result).items():
        braked = [a for a in applications if (a.from_mps or 0.0) > 3.0]
        assert len(braked) == len(log.stops)
        for a, (start, stop) in zip(braked, log.stops, strict=True):
            true_mean = log.mean_coefficient(axle, a.start_s, a.end_s)
            assert a.coefficient is not None
            assert abs(a.start_s - start) < 1.0
            assert abs(a.end_s - stop) < 2.0
            assert abs(a.coefficient.mean - true_mean) < a.coefficient.mean_u95
            assert a.coefficient.mean == pytest.approx(true_mean, rel=within)


def codes(result: Result) -> set[str]:
    return {f.code for f in result.findings}


@pytest.fixture(scope="module")
def even() -> Blended:
    return blended()


def test_the_ed_force_of_each_bogie(tmp_path: Path) -> None:
    log = blended(ed_share=MOTOR_BOGIE)
    columns = {f"ED brake force bogie {b} [kN]": log.ed[2 * b - 1] * 2e-3 for b in (1, 2)}
    result = analyzed(log.write(tmp_path / "bogies.csv", columns))
    check(result, log)
    assert "force-spread" in codes(result)
    assert "other-brake" not in codes(result)
    rows = {row.quantity: row for row in brake_applications(result)[1][-1].budget or ()}
    assert rows["ed_force"].u == pytest.approx(0.05 * rows["ed_force"].value, rel=0.05)


def test_an_ed_brake_that_brakes_alone_shows_no_delay_of_the_pressure(tmp_path: Path) -> None:
    log = blended((119.0,), (1.6,), ed_part=1.0, coasting=1.0)
    columns = {"ED brake force per axle [kN]": log.ed[0] * 1e-3}
    path = log.write(tmp_path / "ed.csv", columns)
    result = run.analyze(path, load({}, [], folder=False), ["td"], [1])
    (stop,) = stops_of_result(result, brake_applications(result).values())
    assert stop.distance_m is not None
    assert stop.distance_m.u95 < 0.05 * stop.distance_m.value


def test_noise_of_an_ed_force_is_no_traction(tmp_path: Path, even: Blended) -> None:
    noise = np.random.default_rng(2).normal(0.0, 0.05, len(even.t))
    columns = {"ED brake force per axle [kN]": even.ed[0] * 1e-3 + noise}
    result = analyzed(even.write(tmp_path / "noise.csv", columns), axles=(1,))
    assert "traction" in codes(result)  # no channel has the force that drives
    drives = np.interp(result.axles[0].record.t * 1e-9, even.t, even.traction[0]) > 5e3
    assert np.isnan(result.axles[0].reference.force[drives]).mean() > 0.9


@pytest.mark.parametrize("offset", [-120.0, 0.0, 120.0])
def test_an_ed_brake_that_is_off_is_a_friction_brake(offset: float, tmp_path: Path) -> None:
    log = blended(ed_share=(0.0,) * 4)
    noise = np.random.default_rng(3).normal(offset, 30.0, (2, len(log.t))) * 1e-3
    columns = {f"ED brake force bogie {b} [kN]": noise[b - 1] for b in (1, 2)}
    result = analyzed(log.write(tmp_path / "off.csv", columns))
    alone = analyzed(log.write(tmp_path / "alone.csv", {}))
    assert codes(result) - codes(alone) == {"force-spread", "motor-force-idle"}
    assert brake_applications(result) == brake_applications(alone)
    assert not describe_motors([summarise(result, {})])


def test_an_axle_whose_ed_brake_is_off_has_no_share_of_it(tmp_path: Path) -> None:
    log = blended(ed_share=MOTOR_BOGIE)
    noise = np.random.default_rng(4).normal(0.0, 0.03, len(log.t))
    columns = {
        "ED brake force bogie 1 [kN]": log.ed[1] * 2e-3,
        "ED brake force bogie 2 [kN]": noise,
    }
    result = analyzed(log.write(tmp_path / "trailer.csv", columns))
    by_axle = brake_applications(result)
    assert all(a.ed_share is None for a in by_axle[4])
    assert any(a.ed_share and a.ed_share.value > 0.2 for a in by_axle[1])
    assert describe_motors([summarise(result, {})])


def test_the_share_of_a_vehicle_in_percent(tmp_path: Path) -> None:
    log = blended(ed_share=MOTOR_BOGIE, decelerations=(0.6, 0.9, 1.0))
    path = log.write(tmp_path / "share.csv", {"E-Bremse [%]": 100.0 * log.ed.sum(0) / 80e3})
    entry = '{channel = "E-Bremse [%]", axles = [1, 2], full_force = 80e3, tolerance = 0.03}'
    result = analyzed(path, f"channels.ed_force.vehicle={entry}")
    check(result, log)
    with pytest.raises(UserError, match="the force of 100 % is unknown") as error:
        analyzed(path)
    assert "channels.ed_force.full_force=60000" in (error.value.hint or "")


def test_torques_at_the_wheelset_and_traction(tmp_path: Path, even: Blended) -> None:
    columns = {}
    for axle in range(1, 5):
        columns[f"ED brake torque axle {axle} [kNm]"] = even.ed[axle - 1] * RADIUS * 1e-3
        columns[f"traction torque axle {axle} [kNm]"] = even.traction[axle - 1] * RADIUS * 1e-3
    result = analyzed(even.write(tmp_path / "torque.csv", columns))
    check(result, even)
    assert "traction" not in codes(result)
    record, force = result.axles[0].record, result.axles[0].reference.force
    driven = np.interp(record.t * 1e-9, even.t, even.traction[0]) > 5e3
    true_force = np.interp(record.t * 1e-9, even.t, even.force[0])
    assert np.isfinite(force[driven]).mean() > 0.95
    assert float(np.nanmedian(force[driven] - true_force[driven])) == pytest.approx(0.0, abs=200.0)


def test_a_result_of_it_is_a_log_again(tmp_path: Path, even: Blended) -> None:
    from adhesion_cli.results import mcap

    columns = {"ED force per axle [kN]": even.ed[0] * 1e-3}
    path = even.write(tmp_path / "axle.csv", columns)
    result = analyzed(path, "channels.ed_force.tolerance=0.02", axles=(3,))
    assert "force-spread" not in codes(result)
    mcap.write_results(tmp_path / "axle.adhesion.mcap", [result], "{}")
    again = run.analyze(tmp_path / "axle.adhesion.mcap", load(None, folder=False), ["td"])
    first, second = (r.axles[0].reference for r in (result, again))
    np.testing.assert_allclose(second.force, first.force, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(second.tolerance, first.tolerance, rtol=1e-9, atol=1e-3)


def test_a_sign_that_contradicts_the_train_is_turned_and_reported(
    tmp_path: Path, even: Blended
) -> None:
    columns = {"ED force per axle [kN]": -even.ed[0] * 1e-3}
    result = analyzed(even.write(tmp_path / "negative.csv", columns))
    assert "motor-force-sign" in codes(result)
    check(result, even)


@pytest.mark.parametrize(
    ("name", "column", "error", "remedy"),
    [
        ("ED brake force per axle", 1e-3, "its unit is not stated", "channels.ed_force"),
        ("ED brake force per axle [bar]", 1e-3, "cannot be in 'bar'", "kN"),
    ],
)
def test_an_ed_force_without_the_unit_of_a_force(
    tmp_path: Path, even: Blended, name: str, column: float, error: str, remedy: str
) -> None:
    path = even.write(tmp_path / "unit.csv", {name: even.ed[0] * column})
    with pytest.raises(UserError, match=error) as raised:
        analyzed(path)
    assert remedy in (raised.value.hint or "")


def test_an_ed_brake_without_any_unit_is_reported(tmp_path: Path, even: Blended) -> None:
    on: Floats = (even.ed[0] > 0.0).astype(float)
    result = analyzed(even.write(tmp_path / "state.csv", {"E-Bremse": on}), axles=(1,))
    (finding,) = [f for f in result.findings if f.code == "ed-force-unit"]
    assert "channels.ed_force" in (finding.hint or "")


def test_an_ed_force_that_begins_some_rows_late_is_no_warning(
    tmp_path: Path, even: Blended
) -> None:
    slow = np.where(np.arange(len(even.t)) % 4 == 1, even.ed[0] * 1e-3, np.nan)
    result = analyzed(even.write(tmp_path / "late.csv", {"ED force per axle [kN]": slow}))
    (finding,) = {f.code: f for f in result.findings if f.code == "no-pressure"}.values()
    assert (finding.severity, finding.count) == ("info", 1)
    check(result, even, 0.06)


def test_k_is_the_clamping_force_of_electric_and_air_brake(tmp_path: Path, even: Blended) -> None:
    columns = {"ED force per axle [kN]": even.ed[0] * 1e-3}
    result = analyzed(even.write(tmp_path / "k.csv", columns), "analysis.vehicle=stated")
    record = result.axles[0].record
    by_ed = np.interp(record.t * 1e-9, even.t, even.ed[0]) / 0.35
    np.testing.assert_allclose(record.clamping_force - record.friction_clamping, by_ed, atol=50.0)
    check(result, even, 0.005)


@pytest.mark.parametrize("coasting", [0.0, 3.0])
def test_traction_without_a_channel_is_no_brake_and_no_fault(
    tmp_path: Path, coasting: float
) -> None:
    decelerations = (0.5, 0.7, 0.9, 1.1, 0.6, 0.8)
    log = blended(6 * (80.0,), decelerations, ed_part=0.0, coasting=coasting)
    result = analyzed(log.write(tmp_path / "traction.csv", {}))
    assert [f.code for f in result.findings if f.severity != "info"] == []
    assert sum(f.code == "traction" for f in result.findings) == 2
    assert result.identified.force_per_bar is not None
    assert result.identified.force_per_bar.value == pytest.approx(6329.0, rel=0.03)


def test_a_magnetic_brake_that_acts_is_another_brake(tmp_path: Path) -> None:
    from adhesion_cli.results import mcap

    log = blended(ed_part=0.0)
    start, stop = log.stops[1]
    on = ((log.t > start + 1.0) & (log.t < stop - 5.0)).astype(float)
    path = log.write(tmp_path / "magnetic.csv", {"magnetic track brake": on})
    result = analyzed(path, axles=(1,))
    first = result.findings[0]
    assert first.code == "other-brake"
    assert first.spans == (pytest.approx((start + 1.0, stop - 5.0), abs=0.1),)
    assert "magnetic track brake is on" in first.message
    stops = stops_of_result(result, brake_applications(result).values())
    marked = [stop_row(s)["µ"].endswith("*") for s in stops]
    assert marked == [s.start_s < stop and s.end_s > start for s in stops]
    assert any(marked)
    mcap.write_results(tmp_path / "magnetic.adhesion.mcap", [result], "{}")
    again = run.analyze(tmp_path / "magnetic.adhesion.mcap", load(None, folder=False), ["td"])
    assert [f.spans for f in again.findings if f.code == "other-brake"] == [first.spans]


@pytest.mark.parametrize("ed_part", [0.45, 0.7])
def test_an_ed_brake_without_a_channel_shows_where_it_fades_out(
    ed_part: float, tmp_path: Path
) -> None:
    """The pressure rises at the end of each stop, and the deceleration stays."""
    path = blended(ed_part=ed_part).write(tmp_path / "hidden.csv", {})
    result = run.analyze(path, load(None, folder=False), ["td"], [1])
    assert result.findings[0].code == "other-brake"
    assert not result.identified.known
    assert "deceleration-unit-suspect" not in {f.code for f in result.findings}


@pytest.mark.parametrize(("acts_in", "is_known"), [(slice(1, 2), True), (slice(None), False)])
def test_a_stop_with_a_track_brake_shows_no_brake_by_pressure(
    acts_in: slice, is_known: bool, tmp_path: Path
) -> None:
    log = blended(ed_part=0.0)
    on = np.zeros(len(log.t))
    for start, stop in log.stops[acts_in]:
        on[(log.t > start) & (log.t < stop)] = 1.0
    path = log.write(tmp_path / "tram.csv", {"track brake active [-]": on})
    result = run.analyze(path, load(None, folder=False), ["td"], [1])
    assert result.findings[0].code == "other-brake"
    assert result.identified.known is is_known


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ('channels.ed_force.vehicle = {channel = "F", axles = [0]}', "are no axles"),
        ('channels.ed_force."car B" = {channel = "F"}', "axles of 'car B' are not known"),
        ("channels.ed_force = {full_force = -1.0}", "is out of range"),
        ('channels.ed_force."bogie 1" = {unit = "kN"}', "names no channel"),
        ("channels.ed_force = {zero = 0.1}", "zero"),
    ],
)
def test_a_wrong_statement_of_a_force_names_key_and_remedy(line: str, error: str) -> None:
    with pytest.raises(UserError, match=error) as raised:
        load(toml.parsed(line, "test"), folder=False)
    assert raised.value.hint


def test_the_statements_of_a_force_survive_a_settings_file() -> None:
    line = 'channels.ed_force."bogie 1" = {channel = "F", unit = "Nm", arm = 0.4, tolerance = 0.0}'
    stated = load(toml.parsed(line, "test"), folder=False)
    (mapping,) = stated.mappings
    assert (mapping.axles, mapping.arm, mapping.tolerance) == ((1, 2), 0.4, 0.0)
    written = {"channels": tree(stated, [])["channels"]}
    assert load(written, folder=False).mappings == stated.mappings


def test_the_share_of_the_ed_brake_is_that_of_its_work(tmp_path: Path) -> None:
    log = blended(ed_share=MOTOR_BOGIE)
    forces = {f"ED force axle {axle} [kN]": log.ed[axle - 1] / 1e3 for axle in (1, 2, 3, 4)}
    result = analyzed(log.write(tmp_path / "x.csv", forces))
    friction = RATIO * PHI * np.maximum(PISTON * 1e5 * log.pressure - SPRING, 0.0)

    def true_share(axles: slice, start: float, stop: float) -> float:
        inside = (log.t >= start) & (log.t <= stop)
        works = [float(np.sum((x[axles] * log.v)[:, inside])) for x in (log.ed, friction)]
        return works[0] / sum(works)

    applications = brake_applications(result)
    stops = stops_of_result(result, applications.values())
    assert len(stops) == len(log.stops)
    for stop in stops:
        assert stop.ed_share is not None
        true = true_share(slice(0, 4), stop.start_s, stop.end_s)
        assert abs(stop.ed_share.value - true) < min(stop.ed_share.u95, 0.05)
    for a in applications[1]:
        assert a.ed_share is not None
        true = true_share(slice(0, 1), a.start_s, a.end_s)
        assert abs(a.ed_share.value - true) < min(a.ed_share.u95, 0.05)
    assert all(a.ed_share is None for a in applications[4])  # no motor


def test_a_stop_begins_with_its_brake_and_not_where_traction_falls(tmp_path: Path) -> None:
    log = blended(ed_part=0.5)
    limited = log.traction * np.minimum(1.0, 8.0 / np.maximum(log.v, 1.0))  # by the power
    columns = {
        "ED force per axle [kN]": log.ed[0] / 1e3,
        "traction per axle [kN]": limited[0] / 1e3,
    }
    result = analyzed(log.write(tmp_path / "x.csv", columns))
    stops = stops_of_result(result, brake_applications(result).values())
    assert len(stops) == len(log.stops)
    for stop, (begin, _) in zip(stops, log.stops, strict=True):
        assert stop.valid
        assert abs(stop.start_s - begin) < 0.5


def test_without_a_motor_there_is_no_share_of_it(tmp_path: Path) -> None:
    result = analyzed(blended(ed_part=0.0).write(tmp_path / "x.csv", {}), axles=(1,))
    (stop, *_) = stops_of_result(result, brake_applications(result).values())
    assert stop.coefficient is not None
    assert stop.ed_share is None


@pytest.mark.parametrize("ed_part", [0.0, 0.5])
def test_the_forces_of_motors_show_a_mass_that_nobody_states(
    tmp_path: Path, ed_part: float
) -> None:
    log = blended(ed_part=ed_part)
    columns = {}
    for b in (1, 2):
        columns[f"ED brake force bogie {b} [kN]"] = log.ed[2 * b - 1] * 2e-3
        columns[f"traction force bogie {b} [kN]"] = log.traction[2 * b - 1] * 2e-3
    result = run.analyze(log.write(tmp_path / "log.csv", columns), load(folder=False), ["td"])
    check(result, log, within=0.15)
    mass = next(f.values for f in result.findings if f.code == "mass-by-motors")
    assert abs(mass["mass_t"] - MASS / 1e3) < 0.3 * mass["u95_t"]
    assert mass["u95_t"] < 0.5 * MASS / 1e3


def test_a_car_with_all_motors_of_its_train_shows_no_narrow_mass(tmp_path: Path) -> None:
    """The motors of two logged axles drive a train of four: each axle seems twice as heavy."""
    log = blended(ed_part=0.5)
    columns = {}
    for b in (1, 2):
        columns[f"ED brake force bogie {b} [kN]"] = log.ed[2 * b - 1] * 4e-3
        columns[f"traction force bogie {b} [kN]"] = log.traction[2 * b - 1] * 4e-3
    result = run.analyze(log.write(tmp_path / "log.csv", columns), load(folder=False), ["td"], [1])
    mass = next(f.values for f in result.findings if f.code == "mass-by-motors")
    assert abs(mass["mass_t"] - MASS / 1e3) < mass["u95_t"]


@pytest.mark.parametrize(
    ("share", "names"), [(MOTOR_BOGIE, ("bogie 1", "bogie 2")), ((1.0,) * 4, ("",))]
)
def test_unlike_motors_and_those_of_a_train_show_no_mass(
    tmp_path: Path, share: tuple[float, ...], names: tuple[str, ...]
) -> None:
    log = blended(ed_share=share)
    columns = {}
    for i, name in enumerate(names):
        columns[f"traction force {name} [kN]"] = log.traction[2 * i] * 4e-3 / len(names)
        columns[f"ED brake force {name} [kN]"] = log.ed[2 * i] * 4e-3 / len(names)
    result = run.analyze(log.write(tmp_path / "log.csv", columns), load(folder=False), ["td"], [1])
    assert "mass-by-motors" not in codes(result)


def test_motors_that_never_act_without_the_brake_do_not_show_the_mass(tmp_path: Path) -> None:
    """Their share of each braking is the same: only their sum with the air brake is known."""
    log = blended(ed_part=0.5)
    columns = {"ED brake force per axle [kN]": 1e-3 * log.pressure[0] * 3e3}
    result = run.analyze(log.write(tmp_path / "log.csv", columns), load(folder=False), ["td"], [1])
    assert "mass-by-motors" not in codes(result)
    assert "vehicle-unknown" in codes(result)
