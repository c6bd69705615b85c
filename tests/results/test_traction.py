"""Pictures show no adhesion where motors drive."""

from dataclasses import replace

import numpy as np
from helpers.pages import analysed

from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.model import AxleResult, Channel, Column, Result
from adhesion_cli.results.report.run import of_result
from adhesion_cli.results.traction import gains_speed, without_traction


def starting() -> Result:
    """A made stop whose train gains speed for the second before the brake is applied."""
    result = analysed(axles=1, n=3000)

    def axle(x: AxleResult) -> AxleResult:
        t = (x.record.t - x.record.t[0]) * 1e-9
        v = 30.0 - np.clip(1.0 - t, 0.0, 1.0)
        assert x.record.train_speed is not None
        train = np.where(t < 1.0, v, x.record.train_speed)
        return replace(x, record=replace(x.record, train_speed=train))

    return replace(result, axles=tuple(map(axle, result.axles)))


def test_a_train_gains_speed_outside_of_its_brake_applications() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    speed = np.where(t < 4.0, t, 4.0)
    assert gains_speed(t, speed, []).tolist() == gains_speed(t, speed + 1.0, []).tolist()
    gains = t[gains_speed(t, speed, [])]
    assert (gains[0], gains[-1]) == (0.0, gains[-1])
    assert 3.8 < gains[-1] < 4.2
    assert not gains_speed(t, speed, [(0.0, 5.0)]).any()
    assert not gains_speed(t, 0.3 * speed, []).any()  # as down a gradient
    assert not gains_speed(t, np.full(len(t), np.nan), []).any()


def test_no_picture_has_a_force_of_motors() -> None:
    result = starting()
    (axle,) = result.axles
    assert np.isfinite(axle.reference.force[:50]).all()
    (shown,) = without_traction(result).axles
    assert np.isnan(shown.reference.force[:50]).all()
    assert np.array_equal(shown.reference.force[200:], axle.reference.force[200:], equal_nan=True)
    run = of_result(result, summarise(result, {}))
    assert np.isnan(run.axles[0].force[:50]).all()
    assert np.isnan(run.axles[0].errors["td"][:50]).all()
    assert np.isfinite(axle.reference.force[:50]).all()  # the result keeps it


def test_a_traction_force_that_the_log_has_is_shown() -> None:
    result = starting()
    (axle,) = result.axles
    known = replace(axle, record=replace(axle.record, traction_known=True))
    assert without_traction(replace(result, axles=(known,))).axles == (known,)
    data = Column(axle.record.t, 0.0 * axle.record.clamping_force, np.ones(len(axle.record), bool))
    force = Channel("traction", "", "traction_force", 1, "N", "", data)
    log = replace(result.log, channels=(*result.log.channels, force))
    result = replace(result, log=log)
    run = of_result(result, summarise(result, {}))
    assert np.isfinite(run.axles[0].force[:50]).all()
