"""The axle mass of a log by its load pressure."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import unlike_train
from helpers.unlike_train import TRAIN

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Result
from adhesion_cli.studies.calibrate import as_tables, calibrate
from adhesion_cli.studies.named_together import identify_together

LOAD = {"pressure": [1.5, 3.8], "axle_mass": [9500, 15000], "unit": "bar"}
CAR = {
    "vehicle": {
        "wheel_diameter": 0.92, "friction": 0.35, "wheelset_inertia": 110,
        "disc_brake": TRAIN["car"]["motor"]["disc_brake"],
    }
}  # fmt: skip


def load(*layers: dict[str, Any]) -> settings.Settings:
    return settings.load(list(layers), folder=False)


def written(path: Path, mass: float, bar: float) -> dict[int, Any]:
    """A log of two axles of this mass, with their load pressure."""
    vehicle = load(CAR, {"axle_mass": mass}).vehicle
    return unlike_train.write(path, vehicle, [1, 2], np.array([bar, bar]), seed=round(mass))


def errors(result: Result, truth: dict[int, Any]) -> list[float]:
    """Estimated over true mean µ of every brake application, less 1."""
    return [
        a.coefficient.mean / float(np.mean(truth[axle.axle][span(a.start_s, a.end_s)])) - 1.0
        for axle in summarise(result, {}).axles
        for a in axle.applications
        if a.coefficient
    ]


def span(start: float, end: float) -> slice:
    return slice(round(start / 0.05), round(end / 0.05) + 1)


def test_empty_and_loaded_logs_of_one_train(tmp_path: Path) -> None:
    paths = [tmp_path / "empty.csv", tmp_path / "loaded.csv"]
    truths = [written(paths[0], 9500, 1.5), written(paths[1], 15000, 3.8)]
    stated = load(CAR, {"load": LOAD})
    together = identify_together(paths, stated)
    assert {x.logs for x in together if x} == {2}  # the loads differ, the brake does not
    for path, truth, mass, vehicle in zip(paths, truths, (9500, 15000), together, strict=True):
        for identified in (None, vehicle):
            result = analyze(path, stated, ["td"], identified=identified)
            assert max(map(abs, errors(result, truth))) < 0.01
            assert result.vehicle.of_axle(2).axle_mass.value == pytest.approx(mass, rel=0.02)
            codes = {f.code for f in result.findings}
            assert "mass-by-load" in codes
            assert "log-differs" not in codes
    again = load(as_tables(calibrate(paths, stated))).vehicle
    assert again.load is not None
    assert again.load.mass(1.5e5).value == pytest.approx(9500, rel=0.02)
    assert again.load.tolerance < stated.vehicle.load.tolerance  # type: ignore[union-attr]


def test_each_axle_has_its_own_load(tmp_path: Path) -> None:
    vehicle = load(CAR, {"axle_mass": [9500, 15000]}).vehicle
    truth = unlike_train.write(tmp_path / "log.csv", vehicle, [1, 2], np.array([1.5, 3.8]))
    result = analyze(tmp_path / "log.csv", load(CAR, {"load": LOAD}), ["td"])
    assert max(map(abs, errors(result, truth))) < 0.012
    (said,) = (f for f in result.findings if f.code == "mass-by-load")
    assert "15000 kg" in said.message
    carried = settings.Settings().over(result.settings)
    assert carried.vehicle.of_axle(2).axle_mass == pytest.approx(
        result.vehicle.of_axle(2).axle_mass
    )
    assert carried.vehicle.load is None


def test_without_its_channel_the_stated_mass_is_used(tmp_path: Path) -> None:
    vehicle = load(CAR, {"axle_mass": 11000}).vehicle
    unlike_train.write(tmp_path / "log.csv", vehicle, [1])
    result = analyze(tmp_path / "log.csv", load(CAR, {"load": LOAD, "axle_mass": 11000}), ["td"])
    assert "no-load-pressure" in {f.code for f in result.findings}
    assert result.vehicle.axle_mass.value == pytest.approx(11000, rel=0.03)


def test_another_pressure_is_not_taken_for_the_load(tmp_path: Path) -> None:
    written(tmp_path / "log.csv", 12000, 7.5)
    result = analyze(tmp_path / "log.csv", load(CAR, {"load": LOAD}), ["td"])
    assert "load-out-of-range" in {f.code for f in result.findings}
    assert result.vehicle.axle_mass.value == pytest.approx(12250, rel=0.05)


def test_a_mass_for_this_log_replaces_the_line() -> None:
    vehicle = load({"load": LOAD}, {"axle_mass": 9000}).vehicle
    assert vehicle.load is None
    assert vehicle.axle_mass.value == 9000
    assert load({"load": LOAD}).vehicle.axle_mass.value == pytest.approx(12250)


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"pressure": [3.8, 1.5]}, "does not rise"),
        ({"pressure": [1.5]}, "two numbers"),
        ({"unit": "kg"}, "unit of pressure"),
        ({"unit": None}, "lacks unit"),
        ({"axle_mass": [9500, 9e5]}, "out of range"),
        ({"tolerance": -1}, "tolerance"),
        ({"masses": 1}, "unknown key"),
    ],
)
def test_a_wrong_line_is_refused(changed: dict[str, Any], error: str) -> None:
    line = {k: v for k, v in {**LOAD, **changed}.items() if v is not None}
    with pytest.raises(UserError, match=error) as refused:
        load({"load": line})
    assert refused.value.code == 2
