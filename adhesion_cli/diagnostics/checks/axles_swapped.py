"""Axles that follow another axle's pressure while they slide, not their own.

A wheel that slides is free: by the wheelset equation its acceleration follows the clamping force at
once, while adhesion changes slowly. A common delay of all pressures can look like a swap. So the
axle must follow the other pressure better than its own at any delay.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core import toml
from ...core.finding import Finding
from ...core.masks import true_runs
from ...core.model import Bools, Floats, Quantity, fraction
from ...train.grid import Grid
from ..registry import About
from ..scene import Scene

ABOUT = About("Swapped axles", "swapped", 10)


class Params(NamedTuple):
    """Thresholds."""

    share: Annotated[float, fraction("of the train's speed: a slower wheel slides")] = 0.97
    slides: Annotated[
        float, Quantity("-", "of an axle: in one alone another's valve may open by chance", 1.0)
    ] = 3.0
    samples: Annotated[float, Quantity("-", "of slides that show whose pressure it is", 3.0)] = 12.0
    reach: Annotated[float, Quantity("s", "by which all pressures may be delayed")] = 1.0
    follows: Annotated[float, fraction("correlation with the other axle's pressure")] = 0.7
    own: Annotated[float, fraction("a higher correlation with its own is no swap")] = 0.3
    pair: Annotated[
        float, fraction("mean correlation of two axles that follow each other, least: half of it")
    ] = 0.6


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding per axle that follows another."""
    axles, g = s.axles, s.grid
    indices, reach = range(len(axles)), min(round(p.reach / g.step), g.rim.shape[1] // 4)
    slides = [len(true_runs(g.share[i] < p.share)) >= p.slides for i in indices]
    if not any(slides):
        return
    shifts = sorted(range(-reach, reach + 1), key=abs)
    own_correlation = np.array([[_follows(p, g, i, i, k) for i in indices] for k in shifts])
    delayed_correlation = own_correlation[np.argmax(own_correlation.mean(axis=1))]
    follows = np.array(
        [[_follows(p, g, i, j) if slides[i] else 0.0 for j in indices] for i in indices]
    )
    for i in (i for i in indices if slides[i]):
        j = int(np.argmax(follows[i]))
        others = [follows[k, k] for k in indices if slides[k] and k not in (i, j)]
        if others and np.mean(others) < p.own:  # the log does not show which pressure is whose
            continue
        alone = (
            follows[i, j] > max(p.follows, delayed_correlation[i] / 0.9)
            and follows[i, i] < p.own
            and not follows[j, j] > max(p.follows, follows[j, i])
            and _in_every_slide(p, g, i, j)
        )
        if alone or is_pair(p, follows, i, j):
            values = {"axle": axles[i].record.axle, "other_axle": axles[j].record.axle}
            mask = g.share[i] < p.share
            entry = {"channel": axles[j].brake.name, "field": axles[j].brake.field}
            line = f"channels.{axles[j].brake.meaning}.axle{axles[i].record.axle} = "
            names = {"option": toml.option(line + toml.table(entry))}
            yield s.finding("axles-swapped", "warning", axles[i].speed, mask, i, values, names)


def is_pair(p: Params, follows: Floats, i: int, j: int) -> bool:
    """Whether two axles follow each other, and the rest follow themselves.

    Neither is as sure alone: `follows` has the correlations of all axles, (axles, pressures).
    """
    crossed = np.array([follows[i, j], follows[j, i]])
    own = max(follows[i, i], follows[j, j])
    others = np.delete(np.diag(follows), [i, j])
    works = others.size > 0 and float(others.mean()) > p.follows
    least = p.pair if works else p.follows
    is_mutual = crossed.mean() > least and crossed.min() > least / 2.0
    return i != j and bool(is_mutual) and own < crossed.mean() / 2.0


def _in_every_slide(p: Params, g: Grid, i: int, j: int) -> bool:
    """Whether axle i follows axle j rather than itself also without any one of its slides.

    In a single slide the valves of another axle may move alike by chance.
    """
    slides = g.share[i] < p.share
    for start, stop in true_runs(slides):
        other_slides = slides.copy()
        other_slides[start:stop] = False
        other_correlation = _follows(p, g, i, j, slides=other_slides)
        if not other_correlation > max(p.follows, _follows(p, g, i, i, slides=other_slides)):
            return False
    return True


def _follows(
    p: Params, g: Grid, i: int, j: int, shift: int = 0, slides: Bools | None = None
) -> float:
    """Correlation of the changes of axle i's ω̇ in slides with the pressure of axle j.

    0 where there is too little; the shift is a delay of the pressure, in steps of the grid.
    `slides`, (n,), says which samples count; all slides of axle i without it.
    """
    change, release = _kink(_kink(g.rim[i])), np.full(g.rim.shape, np.nan)
    kinks = -_kink(g.clamping)
    n = len(change)
    release[:, max(-shift, 0) : n - max(shift, 0)] = kinks[:, max(shift, 0) : n - max(-shift, 0)]
    slides = g.share[i] < p.share if slides is None else slides
    selected = slides & np.isfinite(change) & np.isfinite(release).all(axis=0)
    x, y = change[selected], release[j][selected]
    if len(x) < p.samples or not np.ptp(x) or np.ptp(y) <= 0.2 * float(np.nanmax(g.clamping)):
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])


def _kink(x: Floats) -> Floats:
    """Change from the sample before to the one behind, shape (..., n)."""
    change = np.full(x.shape, np.nan)
    change[..., 1:-1] = x[..., 2:] - x[..., :-2]
    return change
