"""One axle, sample by sample: faults as `analyze` finds them, band, regime."""

from pathlib import Path

import numpy as np
import pytest
from helpers.blended import VEHICLE, blended
from helpers.live_runs import LOW, SERVICE, axle, followed, lines_of, running

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.core import toml
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.live.open import Replay
from adhesion_cli.live.run import with_any_brake


def faulty(folder: Path, column: int, value: str | None, to: float) -> Path:
    """The service brake with a fault from 10 s on; None: the value at its begin."""
    rows = [line.split(",") for line in SERVICE.read_text().splitlines()]
    own = [row for row in rows[1:] if 10.0 <= float(row[0]) < to]
    stays = own[0][column]
    for row in own:
        row[column] = stays if value is None else value
    log = folder / "faulty.csv"
    log.write_text("".join(",".join(row) + "\n" for row in rows))
    return log


@pytest.mark.parametrize(
    ("column", "value", "to", "code", "sees"),
    [
        (1, "", 14.0, "no-pressure", 0.2),
        pytest.param(1, "NaN", 99.0, "no-pressure", 0.2, marks=pytest.mark.slow),
        (1, None, 14.0, "pressure-stuck", 0.5),
        pytest.param(2, "54321", 10.1, "speed-outlier", 0.0, marks=pytest.mark.slow),
        (2, "0", 10.5, "speed-outlier", 0.0),
        (2, None, 13.0, "speed-stuck", 1.0),
    ],
)
def test_faults_are_found_as_analyze_finds_them(
    tmp_path: Path, column: int, value: str | None, to: float, code: str, sees: float
) -> None:
    log = faulty(tmp_path, column, value, to)
    assert code in {f.code for f in analyze(log, load()).findings}
    with log.open() as rows, running(tmp_path, "-", "--json", "-a", "imm") as process:
        out, told = process.communicate(rows.read(), timeout=60)
    assert (process.returncode, code in told) == (3, True)
    samples = lines_of(out)
    lasting = [s for s in samples if 10.0 + sees <= float(str(s["t"])) < to]
    assert {s["status"] for s in lasting} == {code}
    assert not [s for s in lasting if s["force_n"] is not None]
    others = [s for s in samples if not 10.0 <= float(str(s["t"])) < to + 0.1]
    assert {s["status"] for s in others} <= {"ok", "start"}


def test_the_band_has_the_tolerances_of_the_vehicle(tmp_path: Path) -> None:
    """As the budget of the reference has them."""
    settings, w = load(), wheelset(Vehicle(), 1)
    found, _ = followed(Replay(SERVICE, settings.read, 0.0), settings, ["imm"])
    axle = analyze(SERVICE, load(None, ["analysis.vehicle=stated"]), ["imm"]).axles[0]
    known = np.isfinite(axle.reference.tolerance) & (axle.record.clamping_force > 1e3)
    of = {s.t: s.estimates["imm"] for s in found[1]}
    mine = np.array([of[t].tolerance for t in axle.record.t.tolist()])
    np.testing.assert_allclose(
        np.median(mine[known]), np.median(axle.reference.tolerance[known]), rtol=0.02
    )
    friction = [s.estimates["imm"].tolerance for s in found[1] if s.clamping > 1e4]
    assert min(friction) > 0.1 * w.phi * 1e4  # friction alone has 10 %


def test_the_band_holds_any_brake_where_nobody_states_one(tmp_path: Path) -> None:
    """A live run has no log in which it could find the brake."""
    settings, w = load(), wheelset(Vehicle(), 1)
    unstated = with_any_brake(settings, by_pressure=True)
    samples, _ = followed(Replay(SERVICE, settings.read, 0.0), unstated, ["imm"])
    with running(tmp_path, "--replay", SERVICE, "--speed", "0", "--json", "-a", "imm") as process:
        out, _ = process.communicate(timeout=60)
    u95 = {round(float(str(s["t"])) * 1e9): s["u95_n"] for s in lines_of(out)}
    for s in samples[1][::100]:
        e = s.estimates["imm"]
        assert u95[s.t] == pytest.approx(1.959964 * np.hypot(e.sigma, e.tolerance), rel=1e-6)
    braked = [u95[s.t] for s in samples[1] if s.clamping > 1e4]
    assert min(braked) > 1.9 * w.phi * 1e4


def test_the_band_has_what_is_not_stated() -> None:
    brake = ["discs", "lever_ratio", "radius_ratio", "friction", "cylinder_diameter"]
    options = [f"vehicle.{name}={getattr(Vehicle(), name).value}" for name in brake]
    without_mass = with_any_brake(load(None, options), by_pressure=True).vehicle
    assert without_mass.friction.tolerance < 0.2 * without_mass.friction.value
    assert without_mass.axle_mass.tolerance > 0.4 * without_mass.axle_mass.value
    stated = load(None, [*options, "vehicle.axle_mass=12000"])
    assert with_any_brake(stated, by_pressure=True).vehicle == stated.vehicle


def test_the_regime_agrees_with_the_slip(tmp_path: Path) -> None:
    with running(tmp_path, "--replay", LOW, "--speed", "0", "--json", "-a", "imm") as process:
        out, _ = process.communicate(timeout=60)
    assert all(s["regime"] is None for s in lines_of(out) if float(str(s["t"])) > 35.0)  # stands
    known = [s for s in lines_of(out) if s["slip"] is not None and s["regime"]]
    assert {s["regime"] for s in known if float(str(s["slip"])) > 0.05} == {"sliding"}
    assert {s["regime"] for s in known if float(str(s["slip"])) < 0.01} == {"rolling"}


def test_gaps_repeats_and_late_samples_are_found_as_they_happen() -> None:
    one = axle()
    seconds = [*np.arange(0.0, 1.0, 0.01), 0.5, 0.99, 3.0, 3.01]
    samples = []
    for k, x in enumerate(seconds):
        one.brake(round(x * 1e9), 2e5, 0)
        samples.append(one.wheel(round(x * 1e9), 40.0 - 0.001 * k, 0))
    found = [(f.code, f.spans[0][0]) for f in one.findings if not f.code.startswith("time-out")]
    assert found == [("time-duplicate", pytest.approx(0.99)), ("gap", pytest.approx(3.0))]
    assert [s is None for s in samples[-4:]] == [True, True, False, False]
    assert [s and s.status for s in samples[-2:]] == ["start", "ok"]


def test_a_wheel_that_repeats_one_value_under_brake_is_stuck() -> None:
    one = axle()
    for k in range(1200):
        one.brake(k * 10_000_000, 2e5, 0)
        one.wheel(k * 10_000_000, 60.0 - 0.02 * min(k, 1000), 0)
    assert [(f.code, 10.3 < f.spans[0][0] < 11.0) for f in one.findings] == [("speed-stuck", True)]


def test_a_clock_that_is_set_back_starts_a_segment() -> None:
    one = axle()
    seconds = [*np.arange(20.0, 30.0, 0.01), *np.arange(0.0, 1.0, 0.01)]
    status = []
    for k, x in enumerate(seconds):
        one.brake(round(x * 1e9), 2e5, 0)
        sample = one.wheel(round(x * 1e9), 40.0 - 0.001 * k, 0)
        status.append(sample and sample.status)
    assert [f.code for f in one.findings] == ["time-backward"]
    assert status == ["start", *["ok"] * 999, "start", *["ok"] * 99]


def test_a_clock_set_back_by_a_second_is_no_jump_of_the_train() -> None:
    """The samples of that second are left out; then speed and pressure are other ones."""
    one = axle()
    seconds = [*np.arange(0.0, 10.0, 0.01), *np.arange(9.0, 12.0, 0.01)]
    known = []
    for k, x in enumerate(seconds):
        one.brake(round(x * 1e9), 2e5 if k < 1000 else 0.5e5, 0)
        sample = one.wheel(round(x * 1e9), 60.0 - 0.03 * k, 0)
        known += [sample] if sample else []
    assert {f.code for f in one.findings} == {"time-out-of-order", "time-duplicate"}
    status = [s.status for s in known]
    assert status == ["start", *["ok"] * 999, "start", *["ok"] * 199]
    forces = [s.estimates["imm"].force for s in known[1000:]]
    assert max(map(abs, forces)) < 2.0 * abs(forces[-1])


def test_a_train_speed_that_ends_gives_no_slip() -> None:
    one = axle()
    known = []
    for k in range(300):
        t = k * 10_000_000
        one.brake(t, 2e5, 0)
        if k < 200:
            one.train(t, 20.0)
        sample = one.wheel(t, 40.0 - 0.001 * k, 0)
        known.append(sample is not None and np.isfinite([sample.slip, sample.train]).all())
    assert all(known[:205])
    assert not any(known[206:])


def test_without_a_recent_pressure_there_is_no_force() -> None:
    one = axle()
    for k in range(200):
        if k < 100:
            one.brake(k * 10_000_000, 2e5, 0)
        last = one.wheel(k * 10_000_000, 40.0 - 0.001 * k, 0)
    assert last
    assert (last.status, dict(last.estimates)) == ("no-pressure", {})


def test_the_ed_force_is_in_the_clamping_force_of_live_samples(tmp_path: Path) -> None:
    log = blended((60.0,), (0.9,))
    columns = {"ED force per axle [kN]": log.ed[0] * 1e-3}
    path = log.write(tmp_path / "ed.csv", columns)
    settings = load(toml.parsed(VEHICLE, "test"), folder=False)
    samples, _ = followed(Replay(path, settings.read, 0.0), settings, ["imm"])
    braked = [s for s in samples[2] if s.t * 1e-9 > log.stops[0][0] + 5.0 and s.speed > 12.0]
    at = np.array([s.t * 1e-9 for s in braked])
    by_ed = np.interp(at, log.t, log.ed[1])
    true_force = np.interp(at, log.t, log.force[1])
    K = np.array([s.clamping for s in braked])
    assert (by_ed < 0.35 * K).all()
    estimates = [s.estimates["imm"] for s in braked]
    np.testing.assert_allclose([e.force for e in estimates], true_force, rtol=0.02)
    assert all(e.tolerance > 0.05 * F for e, F in zip(estimates, by_ed, strict=True))
