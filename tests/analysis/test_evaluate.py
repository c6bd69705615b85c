"""A log as its summary: of its axles, or of its stops alone."""

from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.analysis import request
from adhesion_cli.analysis.analyze import evaluate
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.core import bundled
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.memory import Signals
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions, Source


@pytest.fixture
def train_log(tmp_path: Path) -> Path:
    """A stop of which the log has the speed of the train alone."""
    t = np.arange(0.0, 45.0, 0.05)
    speed = 3.6 * np.clip(25.0 - (t - 10.0).clip(0.0), 0.0, None)
    rows = (f"{x:.2f},{v:.3f}" for x, v in zip(t, speed, strict=True))
    path = tmp_path / "train.csv"
    path.write_text("\n".join(["time [s],train speed [km/h]", *rows, ""]))
    return path


def test_a_wrong_estimator_is_refused_before_the_log_is_read(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="unknown algorithm 'nesso'"):
        evaluate(tmp_path / "none.csv", Settings(), ["nesso"], (), (None, None))


def test_a_log_that_has_no_axle_is_read_once(
    train_log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources: list[Source] = []

    def open_counted(path: Path | Signals, options: ReadOptions) -> Source:
        sources.append(open_source(path, options))
        return sources[-1]

    monkeypatch.setattr(request, "open_source", open_counted)
    evaluated = evaluate(train_log, Settings(), ["td"], (), (None, None))
    assert evaluated.result is None
    assert [stop.valid for stop in evaluated.summary.stops] == [True]
    assert [f.code for f in evaluated.findings][-1] == "stops-alone"
    assert len(sources) == 1


def test_what_a_log_does_not_have_is_an_error_and_no_stop_alone() -> None:
    path = bundled.folder("sample_logs") / "low-adhesion.csv"
    with pytest.raises(UserError, match="no axle 9"):
        evaluate(path, Settings(), ["td"], (9,), (None, None))
