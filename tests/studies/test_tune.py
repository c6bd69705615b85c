"""Tuned parameters: better on logs that the search never saw, or refused."""

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import simulated

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.estimator import registry
from adhesion_cli.core.model import Floats, quantities
from adhesion_cli.scores import metrics
from adhesion_cli.studies import tune

KINDS = [("service-brake", 1), ("service-brake", 2), ("leaf-film", 3)]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    return [
        simulated.write(folder / f"{i}.csv", simulated.recordings(name, seed=seed, rate=20.0))
        for i, (name, seed) in enumerate(KINDS)
    ]


def tuned(logs: list[Path], algo: str = "leso", seed: int = 0, share: float = 0.3) -> tune.Tuned:
    return tune.tune(
        logs, settings.load(), algo, hold_back=share, seed=seed, progress=lambda _: None
    )


@pytest.fixture(scope="module")
def leso(logs: list[Path]) -> tune.Tuned:
    return tuned(logs)


def test_it_is_better_on_logs_held_back(leso: tune.Tuned, logs: list[Path]) -> None:
    assert len(leso.held_back.logs) == 1
    assert sorted([*leso.train.logs, *leso.held_back.logs]) == [str(p) for p in logs]
    assert leso.train.rmse < leso.train.default_rmse
    assert leso.held_back.rmse < 0.5 * leso.held_back.default_rmse
    assert leso.parameters["euler"] == leso.default_parameters["euler"] == 0.0


def test_its_figures_are_those_of_compare(leso: tune.Tuned, tmp_path: Path) -> None:
    """A vehicle's axle counts once, as in the row of all axles."""
    path = tmp_path / "leso.toml"
    path.write_text(tune.as_toml(leso))
    assert tomllib.loads(path.read_text()) == {"leso": leso.parameters}
    for of in (leso.train, leso.held_back):
        for config, rmse in ((path, of.rmse), (None, of.default_rmse)):
            stated = settings.load(config)
            scores = [
                a.scores for p in of.logs for a in analyze.analyze(Path(p), stated, ["leso"]).axles
            ]
            pooled = [s.rmse_n for s in metrics.pool_scores(scores)]
            assert np.sqrt(np.mean(np.square(pooled))) == pytest.approx(rmse, rel=1e-9)


def test_the_seed_decides_what_is_held_back(leso: tune.Tuned, logs: list[Path]) -> None:
    names = [str(p) for p in logs]
    held = {tuple(tune._split(names, 0.3, seed)[1]) for seed in range(20)}
    assert held == {(x,) for x in names}
    assert tuned(logs)[1:] == leso[1:]
    assert [len(x) for x in tune._split(names, 0.9, 0)] == [1, 2]


@pytest.mark.parametrize("algo", sorted(registry()))
def test_every_estimator_stays_within_its_bounds(algo: str) -> None:
    """The search follows an error that is least outside of the bounds, or beyond each end."""
    est = registry()[algo]
    of = quantities(est.Params)
    for sign in (1.0, -1.0):
        tried = []

        def errors(sets: Sequence[Any], sign: float = sign, tried: list[Any] = tried) -> Floats:
            tried += sets
            return np.exp([sign * sum(np.log10(max(x, 1e-12)) for x in p) for p in sets])

        found = tune._search(est, est.Params(), errors)
        for name, q in of.items():
            assert q.minimum <= getattr(found, name) <= q.maximum
        switches = [name for name, x in est.Params()._asdict().items() if x == 0.0]
        assert all(getattr(p, name) == 0.0 for p in tried for name in switches)
        assert errors([found]) <= errors([est.Params()])


def test_what_is_not_better_on_the_others_is_refused(
    logs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def worse(est: Any, before: Any, _: Callable[[Sequence[Any]], Floats]) -> Any:
        return before._replace(beta1=0.1, beta2=0.1)

    monkeypatch.setattr(tune, "_search", worse)
    with pytest.raises(UserError, match="no parameters are better") as caught:
        tuned(logs)
    assert caught.value.hint


@pytest.mark.parametrize("many", [0, 1])
def test_a_log_alone_is_refused(logs: list[Path], many: int) -> None:
    with pytest.raises(UserError, match="one log") as caught:
        tuned([logs[0]] * (many + 1))
    assert caught.value.hint


def test_a_log_is_never_on_both_sides(logs: list[Path], tmp_path: Path) -> None:
    """Whatever its names are: a log tuned on and held back would confirm itself."""
    again = tmp_path / "again.csv"
    again.symlink_to(logs[0])
    with pytest.raises(UserError, match="one log"):
        tuned([logs[0], again])
    found = tuned([logs[0], logs[1], again])
    assert len(found.train.logs) == len(found.held_back.logs) == 1
    assert {*found.train.logs, *found.held_back.logs} == {str(again), str(logs[1])}


def test_a_log_without_a_brake_does_not_count(logs: list[Path], tmp_path: Path) -> None:
    coasts = tmp_path / "coasts.csv"
    lines = logs[0].read_text().splitlines()
    coasts.write_text("\n".join(lines[:40]) + "\n")
    with pytest.raises(UserError, match="one log with a brake application"):
        tuned([logs[0], coasts])


def test_an_unstable_loop_is_the_worst(logs: list[Path]) -> None:
    """With euler = 1 the interval is too long for high gains: an error of no size."""
    stated = settings.load(None, ["leso.euler=1", "leso.beta1=20"])
    result = analyze.analyze(logs[0], stated, ["leso"])
    axles = [a for x in result.axles if (a := tune._axle(x, result))]
    est = registry()["leso"]
    sets = [stated.params(est), stated.params(est)._replace(beta1=1e5)]
    assert tune.rmse(est, sets[0], axles) < np.inf
    assert tune.rmse(est, sets[1], axles) == np.inf
    assert np.isinf(tune.errors(est, sets, axles)).tolist() == [False, True]
