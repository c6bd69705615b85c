"""A log played as a source: the same numbers as of the whole log."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.live_runs import LOW, SERVICE, followed

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.core.finding import Finding
from adhesion_cli.live.axle import LiveSample
from adhesion_cli.live.open import Replay

each_log = pytest.mark.parametrize("log", [SERVICE, LOW.with_suffix(".mcap")], ids=lambda p: p.name)


def algos(log: Path) -> list[str]:
    """All of them of one axle, and some of four."""
    return [] if log == SERVICE else ["imm", "td"]


@cache
def replayed(log: Path) -> tuple[dict[int, list[LiveSample]], list[Finding]]:
    settings = load()
    return followed(Replay(log, settings.read, 0.0), settings, algos(log))


@each_log
def test_a_replay_gives_what_analyze_gives(log: Path) -> None:
    found, _ = replayed(log)
    result = analyze(log, load(None, ["analysis.vehicle=stated"]), algos(log))
    assert sorted(found) == [a.record.axle for a in result.axles]
    for axle in result.axles:
        of = {s.t: s for s in found[axle.record.axle]}
        mine = [of[t] for t in axle.record.t.tolist()]
        for algo, force in axle.estimates.items():
            live = np.array([s.estimates[algo].force for s in mine])
            np.testing.assert_allclose(live, force, rtol=1e-9, atol=1e-9)
        sigma = np.array([s.estimates["imm"].sigma for s in mine])
        np.testing.assert_allclose(sigma, axle.sigmas["imm"], rtol=1e-9)


@each_log
def test_a_sound_log_has_no_fault(log: Path) -> None:
    found, findings = replayed(log)
    assert [f for f in findings if f.severity != "info"] == []
    assert {s.status for of in found.values() for s in of[1:]} == {"ok"}
