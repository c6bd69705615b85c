"""Parameters of an estimator for a fleet, by its own logs.

The rmse over brake applications, against the truth where a log has it, else against the reference,
is made least on some of the logs. It counts on the others, which the search never saw: parameters
that are not better there are refused.

A parameter that spans decades is searched in its logarithm. Switches, which are 0 by default, stay.
The search is differential evolution within the stated bounds (Storn, Price: Journal of Global
Optimization 11 (1997) 341). It begins with sets drawn about the parameters before. The random
numbers are the same in each run.
"""

import math
import random
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..analysis.analyze import analyze
from ..analysis.request import choose_estimators
from ..analysis.settings import Settings
from ..core import compiled, methods, physics, toml
from ..core.annotated import Json
from ..core.document import findings_document, tagged
from ..core.errors import UserError
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import AxleResult, Bools, Floats, Result, Times, Wheelset, quantities
from ..scores import metrics

_DIGITS = 4  # of a parameter: more do not change the rmse
_CONVERGED = 3e-3  # standard deviation of the rmse's logarithm in a generation: the search ends
_GENERATIONS = 20  # at most, after the first
_FEWEST_SETS, _SETS_PER_PARAMETER = 16, 6  # of a generation
_DECADE, _SHARE = 0.5, 0.2  # first standard deviation of a parameter: in decades, or of its range


class TunedAxle(NamedTuple):
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
    default_rmse: float


class Tuned(NamedTuple):
    """The result."""

    estimator: Estimator
    default_parameters: dict[str, float]
    parameters: dict[str, float]  # all of them, those that were not searched as before
    train: Errors
    held_back: Errors
    findings: tuple[Finding, ...]


def tune(
    paths: Sequence[Path],
    settings: Settings,
    algo: str,
    *,
    hold_back: float,
    seed: int,
    progress: Callable[[str], None],
) -> Tuned:
    """Tunes one estimator.

    `hold_back` is the share of the logs that the search does not see, `seed` that of their choice.

    Raises:
        UserError: a log cannot be read, too few have a brake application, or the result is not
            better on the logs held back.
    """
    (est,) = choose_estimators([algo])
    default_parameters = settings.params(est)
    paths = list({p.resolve(): p for p in paths}.values())  # no log is on both sides
    _refuse_one(len(paths))
    logs: dict[str, list[TunedAxle]] = {}
    findings: list[Finding] = []
    for path in paths:
        result = analyze(path, settings, [algo], progress=progress)
        findings += result.findings
        if axles := [a for axle in result.axles if (a := _axle(axle, result)) is not None]:
            logs[str(path)] = axles
    _refuse_one(len(logs), " with a brake application")
    train, held_names = _split(list(logs), hold_back, seed)
    progress(f"searching {est.name} on {len(train)} logs")
    sets = [[a for name in names for a in logs[name]] for names in (train, held_names)]
    best = _search(est, default_parameters, lambda some: errors(est, some, sets[0]))
    tuned, checked = (
        Errors(tuple(names), rmse(est, best, axles), rmse(est, default_parameters, axles))
        for names, axles in zip((train, held_names), sets, strict=True)
    )
    if not checked.rmse < checked.default_rmse:
        raise UserError(
            f"{est.name}: no parameters are better. Tuned, the rmse is {tuned.rmse:.4g} N "
            f"({tuned.default_rmse:.4g} N before) on the logs of the search, "
            f"but {checked.rmse:.4g} N ({checked.default_rmse:.4g} N before) on those held back",
            "keep the parameters, or name more logs that are alike",
        )
    return Tuned(
        estimator=est,
        default_parameters=default_parameters._asdict(),
        parameters=best._asdict(),
        train=tuned,
        held_back=checked,
        findings=tuple(dict.fromkeys(findings)),
    )


def rmse(est: Estimator, p: Any, axles: Sequence[TunedAxle]) -> float:
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


def errors(est: Estimator, sets: Sequence[Any], axles: Sequence[TunedAxle]) -> Floats:
    """`rmse` of each parameter set [N], shape (sets,)."""
    with ThreadPoolExecutor() as threads:
        return np.array(list(threads.map(lambda p: rmse(est, p, axles), sets)))


def as_toml(tuned: Tuned) -> str:
    """The parameters as `-c` takes them; comments say what they are from."""
    lines = [f"# {tuned.estimator.name} by `adhesion tune`; rmse over brake applications."]
    for share, title in ((tuned.train, "Tuned"), (tuned.held_back, "Held back")):
        lines.append(f"# {title}: {share.rmse:.4g} N, {share.default_rmse:.4g} N before.")
        lines += [f"# - {Path(name).name!r}" for name in share.logs]
    lines += ["", f"[{tuned.estimator.name}]"]
    lines += [f"{name} = {toml.value(x)}" for name, x in tuned.parameters.items()]
    return "\n".join([*lines, ""])


def document(tuned: Tuned, outputs: dict[str, str]) -> Json:
    """The document of `tune`; `outputs` are the files written, by format."""

    def errors(share: Errors) -> Json:
        figures = {"rmse_n": share.rmse, "default_rmse_n": share.default_rmse}
        return {"logs": len(share.logs), **figures, "paths": list(share.logs)}

    return tagged(
        "tune",
        algo=tuned.estimator.name,
        parameters=tuned.parameters,
        default_parameters=tuned.default_parameters,
        train=errors(tuned.train),
        held_back=errors(tuned.held_back),
        outputs=outputs,
        findings=findings_document(tuned.findings),
    )


def _refuse_one(logs: int, condition: str = "") -> None:
    if logs < 2:
        count = "one log" if logs else "no log"
        raise UserError(
            f"there is {count}{condition}: parameters are tuned on some logs and checked on others",
            "name more logs of the fleet",
        )


def _axle(axle: AxleResult, result: Result) -> TunedAxle | None:
    """What a search needs of an axle; None without a sample that counts."""
    record = axle.record
    target, applications = metrics.choose_target(record, axle.reference, axle.applications)[1:]
    counts = np.zeros(len(record), dtype=np.bool_)
    for s in applications:
        counts[s] = np.isfinite(target[s])
    if not counts.any():
        return None
    return TunedAxle(
        physics.wheelset(result.vehicle, record.axle),
        record.t,
        physics.with_fade(record, result.vehicle).clamping_force,
        record.wheel_speed,
        np.array([s.start for s in record.segments], dtype=np.int64),
        target,
        counts,
    )


def _split(names: Sequence[str], hold_back: float, seed: int) -> tuple[list[str], list[str]]:
    """The logs to tune on, and at least one that is held back; both in the order named."""
    n = min(max(round(hold_back * len(names)), 1), len(names) - 1)
    held_names = set(random.Random(seed).sample(sorted(names), n))
    return [x for x in names if x not in held_names], [x for x in names if x in held_names]


class _Space:
    """The parameters that are searched, as coordinates: logarithms where they span decades.

    Parameters that are 0 by default stay.
    """

    def __init__(self, est: Estimator, default_parameters: Any) -> None:
        all_quantities = quantities(est.Params).items()
        searched = {n: q for n, q in all_quantities if getattr(est.Params(), n) != 0.0}
        self._est, self._defaults = est, default_parameters
        self._highest = {n: q.maximum for n, q in searched.items()}
        self._widths = {n: highest > 1.0 for n, highest in self._highest.items()}  # else a share
        lowest = {n: max(q.minimum, 1e-12 * self._widths[n]) for n, q in searched.items()}
        start = {n: max(getattr(default_parameters, n), 1e-12) for n in searched}
        self.low, self.high = self._coded(lowest), self._coded(self._highest)
        self.start = np.clip(self._coded(start), self.low, self.high)
        spans_decades = np.array(list(self._widths.values()))
        self.spread = np.where(spans_decades, _DECADE, _SHARE * (self.high - self.low))

    def _coded(self, values: dict[str, float]) -> Floats:
        return np.array([math.log10(x) if self._widths[n] else x for n, x in values.items()])

    def parameters(self, x: Floats) -> Any:
        """What the estimator takes, to as many digits as are told."""
        values = {
            name: min(float(f"{10.0**v if spans_decades else v:.{_DIGITS}g}"), self._highest[name])
            for (name, spans_decades), v in zip(self._widths.items(), x.tolist(), strict=True)
        }
        return methods.validate(self._est, self._defaults._asdict() | values)


def _search(
    est: Estimator, default_parameters: Any, errors: Callable[[Sequence[Any]], Floats]
) -> Any:
    from scipy.optimize import differential_evolution

    def heights(x: Floats) -> Floats:
        return np.log(np.clip(errors([space.parameters(row) for row in x.T]), 1e-99, 1e99))

    space = _Space(est, default_parameters)
    d = len(space.start)
    count = max(_FEWEST_SETS, _SETS_PER_PARAMETER * d)
    draws = np.random.default_rng(0).standard_normal((count, d))
    about_start = np.clip(space.start + draws * space.spread, space.low, space.high)
    best = differential_evolution(
        heights, [*zip(space.low, space.high, strict=True)], x0=space.start, init=about_start,
        maxiter=_GENERATIONS, tol=0.0, atol=_CONVERGED, polish=False, seed=0, vectorized=True,
        updating="deferred",
    )  # fmt: skip
    return space.parameters(best.x)
