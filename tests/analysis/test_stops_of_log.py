"""Stops of an analysed log: the adhesion and the energy of their slides, against truth."""

from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.stops_of_log import _over_locks
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.physics import G

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def test_slides_of_a_stop_have_their_initial_adhesion_and_energy() -> None:
    result = analyze(
        SAMPLES / "low-adhesion.csv", settings.load(None, ["analysis.vehicle=stated"]), ["td"]
    )
    summary = summarise(result, {})
    (stop,) = summary.stops
    axle, row = result.axles[0], stop.axles[0]
    record, t = axle.record, (axle.record.t - result.log.start_ns()) * 1e-9
    assert record.truth is not None
    assert record.train_speed is not None
    radius, weight = result.vehicle.radius(1).value, result.vehicle.axle_mass.value * G
    spans = [
        (x.start_s, x.start_s + x.duration_s)
        for a in summary.axles[0].applications
        for x in a.slide_list
    ]
    first = (t >= spans[0][0]) & (t <= spans[0][0] + 0.1)
    assert row.initial_coefficient == pytest.approx(
        np.nanmean(record.truth[first]) / weight, rel=0.1
    )
    power = record.truth * (record.train_speed - radius * record.wheel_speed)
    inside = np.any([(t >= a) & (t <= b) for a, b in spans], axis=0) & np.isfinite(power)
    interval = float(np.median(np.diff(t)))
    assert row.energy_j == pytest.approx(float(np.sum(power[inside])) * interval, rel=0.1)
    assert row.utilisation == summary.axles[0].applications[0].utilisation
    assert (row.locked_s, row.lock_energy_j) == (0.0, None)
    rolled = stop.axles[2]
    assert (rolled.initial_coefficient, rolled.energy_j) == (None, None)


def test_command_valves_and_sanding_of_a_log_are_read(tmp_path: Path) -> None:
    """They need no unit."""
    head, *lines = (SAMPLES / "low-adhesion.csv").read_text().splitlines()
    rows = [f"{head},brake command,vent valve axle 1,sanding"]
    for line in lines:
        t = float(line.split(",")[0])
        command, opened, sand = t >= 2.0, t >= 10.0 and t % 2.0 < 0.5, 10.0 <= t < 15.0
        rows.append(f"{line},{command:d},{opened:d},{sand:d}")
    log = tmp_path / "states.csv"
    log.write_text("\n".join(rows) + "\n")
    stated = settings.load(None, ["analysis.vehicle=stated"])
    (stop,) = summarise(analyze(log, stated, ["td"]), {}).stops
    assert stop.command_from == "channel"
    assert stop.start_s == pytest.approx(2.0, abs=0.05)
    assert stop.sanding_s == pytest.approx(5.0, abs=0.05)
    first, second, *_ = stop.axles
    assert (first.valves_from, second.valves_from) == ("valves", "pressure")
    assert first.vented_s == pytest.approx(0.5 * first.valve_actions, rel=0.1)


def test_a_lock_has_the_force_before_and_after_it() -> None:
    t = np.arange(5.0)
    force = np.array([1.0, np.nan, np.nan, 4.0, np.nan])
    assert _over_locks(t, force).tolist() == [1.0, 2.0, 3.0, 4.0, 4.0]
    assert np.isnan(_over_locks(t, np.full(5, np.nan))).all()
