"""The rail under an axle in one stop of a log: a fit to its slides, and where that rail lies.

Short slides have a fit here that `slip` does not report: its draws are all rails that go with the
slides, and differ widely. A slide on a short piece of slippery rail ends on better rail. The fit
uses the points before that.

The fitted rail begins where the axle first creeps. It ends where the axle transmits more than the
largest μ of the fitted rail, and begins again with the next slide. Elsewhere the rail counts as
dry.

In a long slide the axle shows the rail at each place: its μ is that of the rail at its slip. The
fitted curve has the mean level there. `levels` scales it over the way, so that the rail gives the
μ that the axle used.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..core import physics
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.masks import true_runs
from ..core.model import AxleResult, Bools, Floats, Times, Vehicle
from ..core.physics import JUDGED_FROM
from ..core.signals import means_around
from ..rail import fit, rail_under_slides, sliding
from ..rail.creep_law import Condition
from ..rail.events import Slide

_BETTER = 1.3  # least μ after the largest slip, over that before, if the rail is a better one
_LASTS = 0.5  # least time in which an axle transmits more than the fitted rail [s]
_LONG_SLIDE = 8.0  # least duration of a slide that shows the level of its rail over the way [s]
_PARTS = 2, 4  # equal parts of the slides, of which one lies on one rail where all do not
_LEVEL_TIME, _LEVEL_STEP = 4.0, 0.1  # over which a level is a mean, and between its samples [s]
_SPEEDS, _SLIPS, _DRAWS = 6, 40, 40  # at which the largest μ is computed, and of how many draws


class SlidCourse(NamedTuple):
    """What an axle does in its long slides, in the order of time; shape (n,) each."""

    t: Times  # [ns]
    speed: Floats  # of the train [m/s]
    slip: Floats
    mu: Floats


class RailUnderAxle(NamedTuple):
    """The rail under an axle that slid."""

    rail: fit.RailFit
    spans: list[tuple[int, int | None]]  # where it lies [ns]; None: up to the end of the stop
    course: SlidCourse | None = None  # of the slides that show its level; None without such


def rail_under_axle(
    axle: AxleResult, vehicle: Vehicle, slides: Sequence[Slide], begin: int, stop: int
) -> tuple[RailUnderAxle, list[Finding]]:
    """The rail under the slides of one stop, and findings about it.

    `slides` are those of the axle in the stop from `begin` to `stop` [ns], in the order of time.

    Raises:
        UserError: the slides show no rail, with the reason.
    """
    context = rail_under_slides.AxleContext(axle, vehicle)
    rail, findings = rail_under_slides.fit_rail(context, slides)
    better: int | None = None
    if rail is None:
        if findings[0].code not in ("slides-too-short", "rail-changes"):
            raise UserError(findings[0].message, findings[0].hint or "")
        rail, better, findings = _shortcomings(context, slides)
    exceeds, course = _above_curve(axle, vehicle, rail), None
    if better is not None:
        t = axle.record.t
        exceeds |= (t >= better) & (t < t[slides[-1].samples.stop - 1])
    elif long_slides := [x for x in slides if x.duration >= _LONG_SLIDE]:
        course = _course(axle, vehicle, long_slides)
        for x in long_slides:  # the rail that it slides on has not ended
            exceeds[x.samples] = False
    return RailUnderAxle(rail, _spans(axle, exceeds, begin, stop), course), findings


def _course(axle: AxleResult, vehicle: Vehicle, slides: Sequence[Slide]) -> SlidCourse | None:
    """Means of speed, slip and μ in slides; None where the force is not known."""
    record, v = axle.record, axle.record.train_speed
    assert v is not None
    assert axle.slip is not None
    mu = physics.coefficient(axle.reference.force, vehicle, record.axle)
    rows = np.concatenate([np.arange(x.samples.start, x.samples.stop) for x in slides])
    rows = rows[np.isfinite(mu[rows] + axle.slip[rows]) & (v[rows] >= JUDGED_FROM)]
    if not len(rows):
        return None
    step = (record.t[rows] - record.t[0]) // round(_LEVEL_STEP * 1e9)
    first_of_step = np.unique(step, return_index=True)[1]
    counts = np.diff(first_of_step, append=len(rows))
    means = (np.add.reduceat(x[rows], first_of_step) / counts for x in (v, axle.slip, mu))
    return SlidCourse(record.t[rows[first_of_step]], *means)


def levels(course: SlidCourse, rail: Condition, vehicle: Vehicle) -> Floats:
    """μ used over that of the rail at the same slip and speed, each a mean in time; shape (n,)."""
    mu, t = fit.curve(rail, course.speed, course.slip, vehicle), (course.t - course.t[0]) * 1e-9
    return means_around(t, course.mu, _LEVEL_TIME) / means_around(t, mu, _LEVEL_TIME)


def _shortcomings(
    context: rail_under_slides.AxleContext, slides: Sequence[Slide]
) -> tuple[fit.RailFit, int | None, list[Finding]]:
    """A fit to the slides up to where the rail gets better, and when that is [ns]."""
    record, radius = context.axle.record, context.radius
    points, mu_error = rail_under_slides.points(context, slides)
    peak_passed = _gets_better(points)
    better = None
    if peak_passed < len(points.t):
        better = int(record.t[0] + round(points.t[peak_passed] * 1e9))
    points = fit.Points._make(x[:peak_passed] for x in points)
    seconds = fit.clear_time(points)
    if seconds < fit.SHORTEST_FIT:
        text = f"its slides show {seconds:.1f} s of slip above the noise of the speeds"
        hint = "Log train and wheel speed at a higher rate or with less noise."
        raise UserError(f"{text}; {fit.SHORTEST_FIT:g} s are needed", hint)

    def fitted(part: fit.Points) -> fit.RailFit | None:
        return fit.fit(part, context.vehicle, radius.share, mu_error)

    rail = fitted(points)
    if rail is None and max(x.duration for x in slides) >= _LONG_SLIDE:
        points_by_part = (part for count in _PARTS for part in _parts(points, count))
        rail = next(filter(None, map(fitted, points_by_part)), None)  # `levels` has the other parts
    if rail is None:
        text = "its slides lie on different rails: no single adhesion curve fits them"
        raise UserError(text, "Log a stop on one kind of rail.")
    if seconds >= fit.SHORTEST:
        return rail, better, []
    values = {"slip_s": seconds, "needed_s": fit.SHORTEST}
    name = f"axle {record.axle}"
    return rail, better, [Finding("replay-slides-short", "warning", channel=name, values=values)]


def _parts(p: fit.Points, count: int) -> Iterator[fit.Points]:
    """Equal parts in time that show enough slip for a fit."""
    for k in range(count):
        bounds = np.searchsorted(p.t, p.t[0] + (p.t[-1] - p.t[0]) * np.array([k, k + 1]) / count)
        points_of_part = fit.Points._make(x[slice(*bounds)] for x in p)
        if len(points_of_part.t) and fit.clear_time(points_of_part) >= fit.SHORTEST:
            yield points_of_part


def _gets_better(p: fit.Points) -> int:
    """Index of the first point on better rail, after the largest slip; n without such points."""
    n = len(p.t)
    if n < 3:
        return n
    past_peak = int(np.argmax(p.slip)) + 1
    lowest_ahead = np.minimum.accumulate(p.mu[::-1])[::-1]
    for k in range(past_peak, n):
        if lowest_ahead[k] > _BETTER * float(np.quantile(p.mu[:k], 0.9)):
            return k
    return n


def _above_curve(axle: AxleResult, vehicle: Vehicle, rail: fit.RailFit) -> Bools:
    """Where the axle transmits more than the largest μ of the fitted rail, shape (n,).

    Not below `JUDGED_FROM`: no slip was fitted there, and the force is that of a train that stops.
    """
    v = axle.record.train_speed
    assert v is not None
    slips = np.geomspace(1e-3, 1.0, _SLIPS)
    speeds = np.linspace(1.0, max(float(np.nanmax(v)), 2.0), _SPEEDS)
    scaled = zip(rail.draws[:_DRAWS], rail.scales, strict=False)
    computed = [scaled_by(x, 1.0 / c) for x, c in scaled]  # the log's μ has the same error
    largest = [
        np.quantile([fit.curve(x, u, slips, vehicle).max() for x in computed], 0.975)
        for u in speeds.tolist()
    ]
    mu = physics.coefficient(axle.reference.force, vehicle, axle.record.axle)
    exceeds: Bools = (mu > np.interp(v, speeds, largest)) & (v >= JUDGED_FROM)
    return exceeds


def scaled_by(x: Condition, c: float) -> Condition:
    """The rail whose μ is c times as high; see `rail.fit`."""
    return x._replace(k_a=c * x.k_a, k_s=c * x.k_s, f0=c * x.f0)


def _spans(axle: AxleResult, exceeds: Bools, begin: int, stop: int) -> list[tuple[int, int | None]]:
    """Where the fitted rail lies [ns], in the order of time; `exceeds` is from `_above_curve`.

    A rail that proves better is so from the last creep at less μ: the wheel rolls since then.
    """
    record, spans = axle.record, list[tuple[int, int | None]]()
    t, creeping = record.t, np.zeros(len(record), dtype=np.bool_)
    assert axle.slip is not None
    for x in (*sliding.find_creep(record, axle.slip), *(x.samples for x in sliding.slides(axle))):
        creeping[x] = True
    runs = [(int(t[a]), int(t[b - 1])) for a, b in true_runs(exceeds) if t[a] < stop]
    position = begin
    while (limit_start := sliding.limited_from(axle, position, stop)) is not None:
        lasting = [max(a, limit_start) for a, b in runs if b - max(a, limit_start) >= _LASTS * 1e9]
        if not lasting:
            return [*spans, (limit_start, None)]
        creep_samples = np.flatnonzero(creeping & ~exceeds & (t >= limit_start) & (t < lasting[0]))
        if len(creep_samples):
            position = int(t[creep_samples[-1] + 1])
            spans.append((limit_start, position))
        else:
            position = next(b for _, b in runs if b > lasting[0])
    return spans
