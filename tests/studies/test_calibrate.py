"""A calibrated vehicle: what its logs show, what they cannot, and what is refused."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.vehicle_logs import STATED, WHOLE, log, true

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Z95, Parameter, Train, Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.results import mcap
from adhesion_cli.studies import calibrate


def found(*paths: Path, vehicle: Vehicle = STATED) -> calibrate.CalibrationRun:
    """The calibration by logs of all axles of a train."""
    stated = settings.Settings(vehicle=vehicle, train=Train(alike=0.0))
    return calibrate.calibrate(paths, stated, lambda _: None)


def bands(of: calibrate.CalibrationRun) -> list[float]:
    """Standard uncertainty of the force as stated and calibrated, relative."""
    return [u / Z95 / F for u, F in zip(of.result.band, of.result.force, strict=True)]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three logs of a vehicle with 20 % less friction than stated, which falls with speed."""
    of = true(
        friction=0.8, friction_fade=Parameter(-0.004, 0.0), friction_speed=Parameter(20.0, 0.0)
    )
    folder = tmp_path_factory.mktemp("logs")
    return [log(folder / f"{i}.csv", of, seed=i) for i in range(3)]


@pytest.fixture(scope="module")
def calibrated(logs: list[Path]) -> calibrate.CalibrationRun:
    return found(*logs)


def test_the_logs_show_force_over_mass(calibrated: calibrate.CalibrationRun) -> None:
    row = calibrated.result.rows["force_over_mass"]
    at = calibrated.settings.vehicle.friction_speed.value
    assert row.posterior == pytest.approx(0.8 * (1.0 - 0.004 * (at - 20.0)), rel=0.03)
    assert row.posterior_u == pytest.approx(0.02 * math.sqrt(4.0 / 3.0) * row.posterior, rel=0.1)
    fade = calibrated.result.rows["friction_fade"]
    assert fade.posterior == pytest.approx(-0.004, abs=3.0 * fade.posterior_u)
    assert fade.posterior_u < 0.5 * fade.prior_u


def test_the_force_is_no_better_than_the_mass(calibrated: calibrate.CalibrationRun) -> None:
    """The share of the mass's variance is by linear regression: 5 % against 10.4 %."""
    chain, mass = math.hypot(0.1, 0.03, 0.002), 0.05
    rows, w = calibrated.result.rows, wheelset(STATED, 1).rolling
    limit = chain * w * mass / math.hypot(chain, w * mass)
    share = rows["friction"].posterior_u / rows["friction"].posterior
    assert limit <= share < 1.2 * limit
    before, after = bands(calibrated)
    assert 0.04 < after < 0.5 * before
    names = [*rows]
    i, j = names.index("friction"), names.index("axle_mass")
    assert calibrated.result.correlation[i, j] > 0.8


def test_a_weighed_train_gives_a_narrower_band(
    logs: list[Path], calibrated: calibrate.CalibrationRun
) -> None:
    weighed = replace(STATED, axle_mass=Parameter(4797.0, 47.97))
    one = found(*logs, vehicle=weighed)
    assert bands(one)[1] < 0.7 * bands(calibrated)[1]
    assert one.result.rows["axle_mass"].posterior == pytest.approx(4797.0, rel=0.01)


def test_analyze_takes_the_toml_and_has_that_band(
    logs: list[Path], calibrated: calibrate.CalibrationRun, tmp_path: Path
) -> None:
    path = tmp_path / "train.toml"
    path.write_text(calibrate.as_toml(calibrated))
    assert "`discs` counts clamping forces" in path.read_text()
    shown = {row["parameter"] for row in calibrate.as_rows(calibrated)}
    assert "discs" not in shown
    again = settings.load(path, folder=False)
    for name, row in calibrated.result.rows.items():
        if hasattr(again.vehicle, name):
            p = getattr(again.vehicle, name)
            assert p == pytest.approx((row.posterior, row.posterior_u), rel=1e-6)
    assert again.vehicle.correlation == calibrated.settings.vehicle.correlation
    (axle,) = analyze.analyze(logs[0], again, ["td"]).axles
    rolls = np.abs(axle.reference.force / calibrated.result.force[1] - 1.0) < 0.1
    band = Z95 * axle.reference.tolerance[rolls] / axle.reference.force[rolls]
    assert np.median(band) == pytest.approx(Z95 * bands(calibrated)[1], rel=0.05)
    assert axle.reference.mass is not None
    shared = axle.reference.mass[rolls] / axle.reference.force[rolls]
    mass = calibrated.result.rows["axle_mass"]
    assert np.median(shared) > 0.8 * (mass.posterior_u / mass.posterior) ** 2


def test_air_drag_is_no_friction(tmp_path: Path) -> None:
    """Drag grows with speed, as friction that rises with speed would."""
    drag = 6e-5
    logs = [log(tmp_path / f"{i}.csv", true(friction=0.9), i, drag=drag) for i in range(3)]
    rows = found(*logs).result.rows
    fade, air = rows["friction_fade"], rows["air_drag"]
    assert abs(fade.posterior) < 2.0 * fade.posterior_u < 0.002
    assert air.posterior == pytest.approx(drag, abs=2.0 * air.posterior_u)
    assert air.posterior_u < 0.6 * air.prior_u


def test_a_gradient_that_begins_with_the_brake_is_in_the_uncertainty(tmp_path: Path) -> None:
    """It looks like force: one that is constant or bends slowly is too sure of it by far."""
    errors = []
    for k in range(4):
        of = [log(tmp_path / f"{k}{i}.csv", true(), 10 * k + i, before=0.0) for i in range(2)]
        row = found(*of).result.rows["force_over_mass"]
        again = 0.02**2 * (1.0 + 1.0 / len(of))  # from log to log
        sigma = math.sqrt((row.posterior_u / row.posterior) ** 2 - again)
        assert sigma < 0.01
        errors.append(math.log(row.posterior) / sigma)
    assert math.sqrt(np.mean(np.square(errors))) < 1.5


def test_analyze_uses_what_calibrate_gives(logs: list[Path]) -> None:
    """The stated vehicle is the prior of both, and the same log the evidence."""
    stated = settings.load({"vehicle": {"friction": 0.3, "lever_ratio": 2.4}}, folder=False)
    calibrated = calibrate.calibrate(logs[:1], stated, lambda _: None).settings.vehicle
    assert analyze.analyze(logs[0], stated, ["td"]).vehicle == calibrated
    assert calibrated.friction.value < 0.9 * STATED.friction.value


def test_axles_outside_the_log_may_brake_otherwise(logs: list[Path]) -> None:
    """Then the deceleration says less of the axles in the log: 10 % of foreign brake is no harm."""
    alike, unlike = (
        settings.Settings(vehicle=STATED, train=Train(alike=share)) for share in (0.0, 0.1)
    )
    sure, unsure = (calibrate.calibrate(logs, x, lambda _: None) for x in (alike, unlike))
    friction = [c.settings.vehicle.friction.value for c in (sure, unsure)]
    assert friction[0] < friction[1] < STATED.friction.value
    assert bands(sure)[1] < bands(unsure)[1] < bands(sure)[0]


def test_mass_without_a_brake_is_braked_by_the_others(logs: list[Path]) -> None:
    heavy = settings.Settings(vehicle=STATED, train=Train(0.0, STATED.axle_mass.value))
    row = calibrate.calibrate(logs, heavy, lambda _: None).result.rows["force_over_mass"]
    light = found(*logs).result.rows["force_over_mass"]
    assert row.posterior > 1.2 * light.posterior


def test_a_calibrated_vehicle_calibrates_to_itself(
    logs: list[Path], calibrated: calibrate.CalibrationRun
) -> None:
    again = found(*logs, vehicle=calibrated.settings.vehicle)
    row = again.result.rows["force_over_mass"]
    assert row.posterior == pytest.approx(1.0, abs=0.01)
    assert row.prior_u < 0.04
    assert bands(again)[1] < 1.05 * bands(calibrated)[1]


def test_every_brake_application_in_which_the_wheels_roll_counts(
    calibrated: calibrate.CalibrationRun,
) -> None:
    assert calibrated.applications == 9


def test_logs_that_contradict_each_other_are_refused(logs: list[Path], tmp_path: Path) -> None:
    other = log(tmp_path / "other.csv", true(friction=1.1), seed=7)
    with pytest.raises(UserError, match="other") as caught:
        found(*logs, other)
    assert caught.value.hint


def test_one_application_says_less_than_many(
    calibrated: calibrate.CalibrationRun, tmp_path: Path
) -> None:
    """Its gradient is most of the band."""
    one = found(log(tmp_path / "one.csv", true(), applications=1))
    row = one.result.rows["force_over_mass"]
    assert abs(row.posterior - 1.0) < 2.0 * row.posterior_u
    assert bands(calibrated)[1] < bands(one)[1] < bands(one)[0]


def test_a_result_is_no_second_evidence(logs: list[Path], tmp_path: Path) -> None:
    stated = settings.Settings(vehicle=STATED)
    result = analyze.analyze(logs[0], stated, ["td"])
    mcap.write_results(tmp_path / "log.adhesion.mcap", [result], "{}")
    with pytest.raises(UserError, match=r"log\.adhesion\.mcap: a result"):
        calibrate.calibrate([tmp_path / "log.adhesion.mcap"], stated, lambda _: None)


def test_logs_without_brakes_are_refused_or_named(logs: list[Path], tmp_path: Path) -> None:
    coasts = log(tmp_path / "coasts.csv", replace(true(), spring_force=Parameter(5e4, 0.0)))
    with pytest.raises(UserError, match="all wheels roll"):
        found(coasts, vehicle=replace(STATED, spring_force=Parameter(5e4, 0.0)))
    short = tmp_path / "short.csv"
    short.write_text("\n".join(coasts.read_text().splitlines()[:120]) + "\n")
    codes = [f.names for f in found(*logs, short).findings if f.code == "calibration-log-unused"]
    assert codes == [{"log": "short.csv"}]


@pytest.mark.parametrize("name", ["friction", "axle_mass"])
def test_a_tolerance_of_zero_is_refused(name: str, logs: list[Path]) -> None:
    exact = replace(STATED, **{name: Parameter(getattr(STATED, name).value, 0.0)})
    with pytest.raises(UserError, match=name) as caught:
        found(logs[0], vehicle=exact)
    assert caught.value.code == 2


@pytest.mark.parametrize(
    ("friction", "cause"), [(2.0, "another brake acts"), (0.5, "counted twice")]
)
def test_a_vehicle_far_from_the_stated_one_is_refused_with_what_is_wrong(
    tmp_path: Path, friction: float, cause: str
) -> None:
    path = log(tmp_path / "other.csv", true(friction=friction))
    stated = settings.Settings(vehicle=STATED, train=Train(alike=0.0), tables={"vehicle": WHOLE})
    with pytest.raises(UserError, match=cause) as raised:
        calibrate.calibrate([path], stated)
    assert "adhesion vehicle" in (raised.value.hint or "")
