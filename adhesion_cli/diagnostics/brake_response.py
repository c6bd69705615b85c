"""Whether the train answers every change of the pressure by as much as it should.

Around one build-up, step or release (1), summed over the axles whether they slide or not, and (15)
give the speed

    v(t) + ι w(t) = α + βt + γt² − (1 + ι) (s ∫b dt + q b),   ι = I/(mR²),

with w the mean rim speed, b the deceleration by the pressure of wheels that roll, α, β, γ for
speed, gradient and what changes of it within seconds, q for creep and for a brake that is a little
later than its pressure. s is by how much the train answers. It is about one all along, but for
pads that vary with speed and heat. Pressures whose zero or scale changes in mid-log have another
one from then on, and none where only the sensors change.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.finding import Finding
from ..core.model import Bools, Floats
from ..core.physics import braked, wheelset
from ..core.signals import true_runs
from ..dynamics import longitudinal
from ..dynamics.train_grid import CRAWL, LEAST, Scene

_CHANGE = 0.08  # of the highest b within a second: the brake changes
_ONE = 1.0  # changes with less between them are one [s]
_AROUND = 6.0  # before and after it [s]
_BESIDE = 1.5  # of that there must be [s]
_SAMPLES = 12  # for five unknowns, with an error that can be seen
_LARGE = 0.1  # of the highest b: smaller changes tell nothing
_PADS = 0.2  # of itself: friction varies with speed and heat
_GRADIENT = 0.02  # 1 sigma of what another law than γt² makes of a gradient [m/s²]
_SIGMAS = 3.0
_KNOWN = 0.2  # 1 sigma of s: with more, something else than the pressure changes
_FLOOR = 0.003  # 1 sigma by which (1) misses a rolling wheel's speed [m/s]
_ALIKE = 0.95  # of what is left, from sample to sample
_MOST = 1000  # changes that are compared
_VALVES = 0.25  # within so long a slide protection's turn: coarser samples do not know ∫b [s]


class _Answer(NamedTuple):
    """How the train answers one change of the pressure."""

    first: int  # sample on the grid
    past: int
    times: float  # s
    sigma: float  # of s, gradients' part with it


class _Part(NamedTuple):
    """Means of s over changes that follow each other, and over all others; (k,) each."""

    first: NDArray[np.intp]  # the change that each begins with
    last: NDArray[np.intp]
    own: Floats
    of_own: Floats  # 1 sigma
    others: Floats  # NaN where there are none
    of_others: Floats


def unlike(s: Scene) -> Iterator[Finding]:
    """Changes that the train answers more, or less, than others do, as stated and as explained."""
    stated = list(_unlike(s._replace(explanation=longitudinal.AS_STATED)))
    if stated and (s.explanation == longitudinal.AS_STATED or any(_unlike(s))):
        yield from stated


def _unlike(s: Scene) -> Iterator[Finding]:
    answers = _answers(s)
    p = _parts(answers)
    sure = _SIGMAS * np.hypot(p.of_own, p.of_others)
    clearly = np.abs(p.own - p.others) - _PADS * np.maximum(p.own, p.others) - sure
    yield from _told(s, answers, p, clearly)


def unstated(s: Scene) -> Iterator[Finding]:
    """Changes that the train answers more, or less, than what is stated allows."""
    answers = _answers(s)
    p = _parts(answers)
    stated = longitudinal.SIGMAS * longitudinal.tolerance(s.vehicle)
    clearly = np.abs(p.own - 1.0) - stated * np.maximum(p.own, 1.0) - _SIGMAS * p.of_own
    yield from _told(s, answers, p, clearly)


def _told(s: Scene, answers: list[_Answer], p: _Part, clearly: Floats) -> Iterator[Finding]:
    """The changes that are clearest, and of two parts alike in that the one further from 1."""
    clearly = np.nan_to_num(clearly, nan=-1.0)
    if clearly.max(initial=-1.0) <= 0.0:
        return
    best = np.flatnonzero(clearly > clearly.max() - 1e-9)
    k = int(best[np.argmax(np.abs(np.log(np.maximum(p.own[best], 1e-3))))])
    first, past = answers[p.first[k]].first, answers[p.last[k]].past
    where = np.zeros(s.grid.rim.shape[-1], dtype=np.bool_)
    where[first:past] = True
    beside = f", others {_times(p.others[k])}" if np.isfinite(p.others[k]) else ""
    name = str(s.axles[0].brake.meaning).replace("_", " ")
    text = (
        f"what the {name} changes by between {s.seconds(first):.1f} and {s.seconds(past):.1f} s "
        f"the train answers {_times(p.own[k])} as hard as (1) gives{beside}: the sensors' zero or "
        "scale changes within the log (converter, supply, amplifier), or another brake or "
        "traction comes and goes with this one; where the answer is not about 1 the force is "
        "wrong: leave these times out with --from and --to, or correct the log's values"
        f"{s.unless_sliding}"
    )
    yield s.told("pressure-suspect", "warning", text, s.axles[0].brake, where)


def _times(x: float) -> str:
    return f"{max(x, 0.0):.2f} times"


def _parts(answers: list[_Answer]) -> _Part:
    """Every run of changes beside all others."""
    times = np.array([a.times for a in answers])
    weight = np.array([a.sigma for a in answers]) ** -2.0
    first, last = np.triu_indices(len(answers))
    whole, sums = (np.append(0.0, np.cumsum(x)) for x in (weight, weight * times))
    own = whole[last + 1] - whole[first]
    others = whole[-1] - own
    others[others <= 1e-9 * whole[-1]] = np.nan
    inside = sums[last + 1] - sums[first]
    return _Part(first, last, inside / own, own**-0.5, (sums[-1] - inside) / others, others**-0.5)


def _answers(s: Scene) -> list[_Answer]:
    """How the train answers each change that is seen well enough, by what explains it best."""
    g, w = s.grid, wheelset(s.vehicle, s.axles[0].record.axle)
    K: Floats = np.mean(g.clamping, axis=0)
    known: Bools = np.isfinite(K)
    if known.sum() < LEAST:
        return []
    t: Floats = g.step * np.arange(len(K), dtype=np.float64)
    K = np.interp(t + s.explanation.late.value, t[known], K[known])
    if line := s.explanation.line:
        K = line.scale * np.maximum(K - line.offset, 0.0)
    b: Floats = braked(K, w)
    top = float(b.max())
    v = np.mean(g.rim, axis=0) if g.train is None else g.train
    share = w.inertia / (w.mass * w.radius**2)
    together = (v + share * np.mean(g.rim, axis=0)) / (1.0 + share)
    # Without a train speed, only wheels that all roll say how fast the train is.
    rolls = g.rolling.all(axis=0)
    if g.train is not None and g.step <= _VALVES:
        rolls = np.nan_to_num(g.train) > CRAWL
    used = known & rolls & (g.rim > CRAWL).all(axis=0) & np.isfinite(together)
    used &= ~g.gains  # a motor's beginning or end would count as part of the answer
    area = np.concatenate([[0.0], np.cumsum((b[1:] + b[:-1]) / 2.0)]) * g.step
    changes = _changes(t, b, g.step)
    ends = [0, *(past for _, past in changes)], [*(first for first, _ in changes[1:]), len(t)]
    around, beside = round(_AROUND / g.step), _BESIDE / g.step
    found: list[_Answer] = []
    for (first, past), low, high in zip(changes, *ends, strict=False):
        low, high = max(low, first - around), min(high, past + around)
        low, high = _within(used, first, past, low, high)
        if min(first - low, high - past) < beside or high - low < _SAMPLES:
            continue
        by = b[high - 1] - b[low]
        if abs(by) < _LARGE * top:
            continue
        i = slice(low, high)
        times, sigma = _answer(t[i], together[i], b[i], area[i])
        if sigma < _KNOWN:
            found.append(_Answer(low, high, times, float(np.hypot(sigma, _GRADIENT / by))))
    return found[:_MOST]


def _changes(t: Floats, b: Floats, step: float) -> list[tuple[int, int]]:
    """Where the brake builds up, changes or is released: first sample and that past it."""
    within = np.abs(np.interp(t + 0.5, t, b) - np.interp(t - 0.5, t, b))
    found: list[tuple[int, int]] = []
    for first, past in true_runs(within > _CHANGE * b.max()):
        if found and (first - found[-1][1]) * step < _ONE:
            first = found.pop()[0]
        found.append((first, past))
    return found


def _within(used: Bools, first: int, past: int, low: int, high: int) -> tuple[int, int]:
    """What is used without a break around a change, at most from low to high; empty if not it."""
    if not used[first:past].all():
        return first, first
    breaks = np.flatnonzero(~used[low:high]) + low
    return (
        int(max(breaks[breaks < first] + 1, default=low)),
        int(min(breaks[breaks >= past], default=high)),
    )


def _answer(t: Floats, v: Floats, b: Floats, area: Floats) -> tuple[float, float]:
    """The answer to one change and its 1 sigma, of samples around it, (n,) each."""
    t = t - t.mean()
    A = np.stack([np.ones_like(t), t, t * t, b, -area], axis=1)
    scale = np.abs(A).max(axis=0) + 1e-12
    A /= scale
    x = np.linalg.lstsq(A, v, rcond=None)[0]
    left = v - A @ x
    squares = float(left @ left)
    alike = min(max(float(left[1:] @ left[:-1]) / max(squares, 1e-12), 0.0), _ALIKE)
    noise = squares / (len(t) - len(x)) * (1.0 + alike) / (1.0 - alike) + _FLOOR**2
    spread = float(np.linalg.pinv(A.T @ A)[-1, -1])
    return float(x[-1] / scale[-1]), float(np.sqrt(spread * noise) / scale[-1])
