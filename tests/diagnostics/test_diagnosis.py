"""The checks together: silent on good logs, each after the one that warns in its group."""

from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import DEFAULT, TRUE, VEHICLES, codes, found

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.finding import Finding, Severity
from adhesion_cli.diagnostics import registry
from adhesion_cli.diagnostics.scene import Scene
from adhesion_cli.formats.open import open_source
from adhesion_cli.train.explanation import AS_STATED
from adhesion_cli.train.grid import Grid
from adhesion_cli.wsp import simulate

ROOT = Path(__file__).parents[2]
GOOD: dict[str, dict[str, float]] = {
    "as it is": {},
    "1 Hz": {"rate": 1.0},
    "2 Hz, no noise": {"rate": 2.0, "noise": 0.0},
    "5 Hz, 1 km/h steps": {"rate": 5.0, "kmh": 1.0},
    "10 Hz, 0.1 km/h steps": {"rate": 10.0, "kmh": 0.1},
    "50 Hz, train speed": {"rate": 50.0, "train": True},
    "100 Hz, noisy": {"rate": 100.0, "noise": 1e-2},
}
MORE: dict[str, dict[str, float]] = {
    "no train speed": {"train": False},
    "10 Hz, 0.1 km/h steps, no train speed": {"rate": 10.0, "train": False, "kmh": 0.1},
    "100 Hz, no noise": {"rate": 100.0, "noise": 0.0, "train": True},
    "1 kHz": {"rate": 1000.0},
}


# Each scenario with two or three kinds of sensors, and each kind with two or three scenarios.
SOME = [
    (name, case)
    for i, name in enumerate(sorted(simulate.scenarios()))
    for j, case in enumerate(GOOD)
    if (i + j) % 3 == 0
]


@pytest.mark.parametrize(("name", "case"), SOME)
def test_a_good_log_is_not_accused(name: str, case: str, tmp_path: Path) -> None:
    assert codes(simulated.recordings(name, **GOOD[case]), tmp_path) <= TRUE.get(name, set())


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("case", {**GOOD, **MORE})
@pytest.mark.parametrize("name", sorted(simulate.scenarios()))
def test_no_good_log_is_accused(name: str, case: str, vehicle: str, tmp_path: Path) -> None:
    stated = settings.load(None, VEHICLES[vehicle])
    sensors = {**GOOD, **MORE}[case]
    other = stated.vehicle if vehicle != "paper" else None
    for seed in range(1 if case == "1 kHz" else 6):
        log = simulated.recordings(name, seed=seed, vehicle=other, **sensors)
        told = found(log, tmp_path, stated)
        if sensors.get("train") is False:
            # A wheel that slows too little is on a rig or slides: without a train speed a hint.
            told = [f for f in told if f.severity != "info"]
        assert {f.code for f in told} <= TRUE.get(name, set()), (seed, told)


@pytest.mark.parametrize("path", sorted((ROOT / "sample_logs").glob("low-adhesion.*")))
def test_the_sample_logs_are_not_accused(path: Path) -> None:
    log = read(open_source(path, DEFAULT.read), DEFAULT.mappings, DEFAULT.vehicle)
    assert not prepare(log, DEFAULT.vehicle).findings


def test_what_only_informs_hides_no_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    def telling(rank: int, severity: Severity) -> registry.Check:
        about = registry.About("", "one", rank)
        one = [Finding(severity, severity)]
        return registry.Check(str(rank), about, tuple, lambda *_: iter(one))

    checks = telling(1, "info"), telling(2, "warning"), telling(3, "error")
    monkeypatch.setattr(registry, "registry", lambda: {c.name: c for c in checks})
    x = np.zeros((1, 9))
    grid = Grid(0, 1.0, x, x, x, None)
    told = registry.diagnose(Scene([], grid, DEFAULT.vehicle, 0, AS_STATED))
    assert [f.code for f in told] == ["info", "warning"]
