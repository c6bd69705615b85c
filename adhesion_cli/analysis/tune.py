"""Parameters of an estimator for a fleet, by its own logs.

The rmse over brake applications, against the truth where a log has it, else against the reference,
is made least on some of the logs. It counts on the others, which the search never saw: parameters
that are not better there are refused.

A parameter that spans decades is searched in its logarithm. Switches, which are 0 by default, stay.
The search draws parameter sets from a normal distribution, within the stated bounds. The best of
each generation give mean and covariance of the next. The covariance is about the mean before, so
that it grows towards a far minimum (Hansen, Ostermeier: Evolutionary Computation 9 (2001) 159). The
random numbers are the same in each run.
"""

import math
import random
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core import compiled, methods, physics, toml
from ..core.errors import UserError
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import AxleResult, Bools, Floats, Result, Times, Wheelset, quantities
from ..evaluation import metrics
from .analyze import analyze
from .request import choose_estimators
from .settings import Settings

_DIGITS = 4  # of a parameter: more do not change the rmse
_CLOSE = 1e-4  # of the rmse's logarithm, from the best to the last kept: the search ends
_MOST = 12  # generations
_KEPT = 0.375  # share of a generation that gives the next
_EACH = 3  # parameters for which a generation has `_ROW` more sets
_ROW = 32
_DECADE, _SHARE = 0.5, 0.2  # first standard deviation of a parameter: in decades, or of its range


class Axle(NamedTuple):
    """One axle with brake applications; columns of shape (n,)."""

    wheelset: Wheelset
    t: Times
    clamping_force: Floats
    wheel_speed: Floats
    starts: Any  # first sample of each segment
    target: Floats  # true force, else the reference [N]
    judged: Bools  # which samples count


class Errors(NamedTuple):
    """Of a share of the logs: their names, and the rmse tuned and before [N]."""

    logs: tuple[str, ...]
    rmse: float
    before: float


class Tuned(NamedTuple):
    """The result."""

    estimator: Estimator
    before: dict[str, float]
    parameters: dict[str, float]  # all of them, those that were not searched as before
    train: Errors
    held_back: Errors
    findings: tuple[Finding, ...]


def tune(
    paths: Sequence[Path], load: Callable[..., Settings], algo: str, *,
    hold_back: float, seed: int, tell: Callable[[str], None],
) -> Tuned:  # fmt: skip
    """Tunes one estimator.

    Args:
        paths: at least two logs.
        load: gives the settings, see `analyze`.
        algo: the estimator's name.
        hold_back: share of the logs that the search does not see.
        seed: of their choice.
        tell: receives a line at each step.

    Raises:
        UserError: a log cannot be read, too few have a brake application, or the result is not
            better on the logs held back.
    """
    (est,) = choose_estimators([algo])
    before = load().params(est)
    paths = list({p.resolve(): p for p in paths}.values())  # no log is on both sides
    _refuse_one(len(paths))
    logs: dict[str, list[Axle]] = {}
    findings: list[Finding] = []
    for path in paths:
        result = analyze(path, load, [algo], tell=tell)
        findings += result.findings
        if axles := [a for axle in result.axles if (a := _axle(axle, result)) is not None]:
            logs[str(path)] = axles
    _refuse_one(len(logs), " with a brake application")
    train, held = _split(list(logs), hold_back, seed)
    tell(f"searching {est.name} on {len(train)} logs")
    sets = [[a for name in names for a in logs[name]] for names in (train, held)]
    found = _search(est, before, lambda some: errors(est, some, sets[0]))
    tuned, checked = (
        Errors(tuple(names), rmse(est, found, axles), rmse(est, before, axles))
        for names, axles in zip((train, held), sets, strict=True)
    )
    if not checked.rmse < checked.before:
        raise UserError(
            f"{est.name}: no parameters are better. Tuned, the rmse is {tuned.rmse:.4g} N "
            f"({tuned.before:.4g} N before) on the logs of the search, but {checked.rmse:.4g} N "
            f"({checked.before:.4g} N before) on those held back",
            "keep the parameters, or name more logs that are alike",
        )
    return Tuned(
        est, before._asdict(), found._asdict(), tuned, checked, tuple(dict.fromkeys(findings))
    )


def rmse(est: Estimator, p: Any, axles: Sequence[Axle]) -> float:
    """Root of the mean over axles of the mean square error [N]; inf where the loop is unstable."""
    squares = []
    for a in axles:
        try:
            columns = a.t, a.clamping_force, a.wheel_speed, a.starts
            F = compiled.batch(est, p, a.wheelset, *columns)[0]
        except UserError:  # an interval is too long for these parameters
            return math.inf
        with np.errstate(over="ignore", invalid="ignore"):
            squares.append(float(np.mean((F - a.target)[a.judged] ** 2)))
    mean = float(np.mean(squares))
    return math.sqrt(mean) if math.isfinite(mean) else math.inf


def errors(est: Estimator, sets: Sequence[Any], axles: Sequence[Axle]) -> Floats:
    """`rmse` of each parameter set [N], shape (sets,)."""
    with ThreadPoolExecutor() as threads:
        return np.array(list(threads.map(lambda p: rmse(est, p, axles), sets)))


def as_toml(found: Tuned) -> str:
    """The parameters as `-c` takes them; comments say what they are from."""
    lines = [f"# {found.estimator.name} by `adhesion tune`; rmse over brake applications."]
    for of, what in ((found.train, "Tuned"), (found.held_back, "Held back")):
        lines.append(f"# {what}: {of.rmse:.4g} N, {of.before:.4g} N before.")
        lines += [f"# - {Path(name).name!r}" for name in of.logs]
    lines += ["", f"[{found.estimator.name}]"]
    lines += [f"{name} = {toml.value(x)}" for name, x in found.parameters.items()]
    return "\n".join([*lines, ""])


def _refuse_one(logs: int, which: str = "") -> None:
    """Raises: UserError, where no log could be held back."""
    if logs < 2:
        some = "one log" if logs else "no log"
        raise UserError(
            f"there is {some}{which}: parameters are tuned on some logs and checked on others",
            "name more logs of the fleet",
        )


def _axle(axle: AxleResult, result: Result) -> Axle | None:
    """What a search needs of an axle; None without a sample that counts."""
    record = axle.record
    target, applications = metrics.choose_target(record, axle.reference, axle.applications)[1:]
    some = np.zeros(len(record), dtype=np.bool_)
    for s in applications:
        some[s] = np.isfinite(target[s])
    if not some.any():
        return None
    return Axle(
        physics.wheelset(result.vehicle, record.axle), record.t,
        physics.with_fade(record, result.vehicle).clamping_force, record.wheel_speed,
        np.array([s.start for s in record.segments], dtype=np.int64), target, some,
    )  # fmt: skip


def _split(names: Sequence[str], hold_back: float, seed: int) -> tuple[list[str], list[str]]:
    """The logs to tune on, and at least one that is held back; both in the order named."""
    n = min(max(round(hold_back * len(names)), 1), len(names) - 1)
    held = set(random.Random(seed).sample(sorted(names), n))
    return [x for x in names if x not in held], [x for x in names if x in held]


class _Space:
    """The parameters that are searched, as coordinates: logarithms where they span decades.

    Args:
        est: the estimator.
        before: its parameters; those that are 0 by default stay.
    """

    def __init__(self, est: Estimator, before: Any) -> None:
        of = quantities(est.Params)
        free = [name for name in of if getattr(est.Params(), name) != 0.0]
        self._est, self._before = est, before
        self._highest = {name: of[name].maximum for name in free}
        self._wide = {name: of[name].maximum > 1.0 for name in free}  # else a share
        self.low = self._coded({n: max(of[n].minimum, 1e-12 * self._wide[n]) for n in free})
        self.high = self._coded(self._highest)
        self.start = np.clip(
            self._coded({n: max(getattr(before, n), 1e-12) for n in free}), self.low, self.high
        )
        wide = np.array(list(self._wide.values()))
        self.spread = np.where(wide, _DECADE, _SHARE * (self.high - self.low))

    def _coded(self, values: dict[str, float]) -> Floats:
        return np.array([math.log10(x) if self._wide[n] else x for n, x in values.items()])

    def parameters(self, x: Floats) -> Any:
        """What the estimator takes, to as many digits as are told."""
        values = {
            name: min(float(f"{10.0**v if wide else v:.{_DIGITS}g}"), self._highest[name])
            for (name, wide), v in zip(self._wide.items(), x.tolist(), strict=True)
        }
        return methods.validate(self._est, self._before._asdict() | values)


def _search(est: Estimator, before: Any, errors: Callable[[Sequence[Any]], Floats]) -> Any:
    """The parameters with the least error."""
    space, random_numbers = _Space(est, before), np.random.default_rng(0)
    d = len(space.start)
    many = _ROW * math.ceil(d / _EACH)
    kept = math.ceil(_KEPT * many)
    weights = np.log(kept + 0.5) - np.log(np.arange(kept) + 1.0)
    weights /= weights.sum()
    mean, root = space.start, np.diag(space.spread)
    least, found = math.inf, before
    for generation in range(_MOST):
        half = random_numbers.standard_normal((many // 2, d))
        x = np.clip(mean + np.concatenate([half, -half]) @ root.T, space.low, space.high)
        if generation == 0:
            x[0] = space.start
        sets = [space.parameters(row) for row in x]
        height = np.log(np.clip(errors(sets), 1e-9, 1e99))
        order = np.argsort(height, kind="stable")[:kept]
        if height[order[0]] < least:
            least, found = height[order[0]], sets[order[0]]
        if height[order[-1]] - height[order[0]] < _CLOSE:
            break
        step = x[order] - mean
        mean = mean + weights @ step
        root = np.linalg.cholesky((step.T * weights) @ step + 1e-12 * np.eye(d))
    return found
