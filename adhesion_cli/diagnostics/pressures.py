"""One pressure that departs from the other axles', or from zero while nothing slows the train."""

from collections.abc import Iterator

import numpy as np

from ..core.finding import Finding, Severity
from ..core.physics import clamping_force, force_line
from ..core.units import listed, others
from ..dynamics.pressure_comparison import Odd
from ..dynamics.pressure_comparison import odd as odd_pressures
from ..dynamics.train_grid import Scene, lasting

_LASTS = 1.5  # so long must it depart [s]
_OWNS = 0.6  # of the others' pressure, or they of its: less is hardly a brake's
_RATIOS = 0.3, 3.0  # no axle is braked by less, or more, of what the others are
_CRAWL = 1.0  # slower, no force is known either [m/s]
_REST = 0.03  # of the highest pressure, within which a released one stays
_ZERO = 0.04, 1e4  # of the highest pressure, and [Pa]: a sensor's zero is not as far off
_APPLIED = 0.3  # of the highest pressure above that: a brake
_HELD = 0.5  # of what it would slow the train by: less is no brake


def odd(s: Scene) -> Iterator[Finding]:
    """Pressures that are stuck, lost, offset, drift or late while the others say something else."""
    for o, either in odd_pressures(s.axles, s.grid):
        yield _told(s, o, either)


def released(s: Scene) -> Iterator[Finding]:
    """Pressures that have another level than zero where no brake slows the train."""
    g = s.grid
    for i, (a, p) in enumerate(zip(s.axles, g.pressure, strict=True)):
        top = float(np.nanmax(p, initial=0.0))
        moves = np.isfinite(p) & (g.fastest > _CRAWL)
        low = float(np.min(p[moves], initial=top))
        rests = lasting(moves & (p < low + _REST * top), _LASTS, g)
        slowing = -g.slope(g.fastest)[rests]
        if not np.isfinite(slowing).any():
            continue
        level = float(np.median(p[rests]))
        if abs(level) < max(_ZERO[0] * top, _ZERO[1]) or top - level < _APPLIED * top:
            continue
        slowed = s.by_rolling * float(clamping_force(np.array(level), s.vehicle))
        if slowed and np.nanmedian(slowing) > _HELD * slowed:
            continue
        wrong = force_line(s.vehicle).per_pascal * abs(level)
        way, more = ("above", "large") if level > 0.0 else ("below", "small")
        text = (
            f"the pressure stays {abs(level) / 1e5:.2g} bar {way} zero where nothing slows the "
            f"train: the sensor's zero is off, and K is up to {wrong:.0f} N too {more}; take it "
            "off the log's values"
        )
        if level > 0.0:
            text += ", unless the brake keeps its pads on by that, or holds against a gradient"
        yield s.told("pressure-zero", "warning", text, a.brake, rests, i)


def _told(s: Scene, o: Odd, either: bool) -> Finding:
    a = s.axles[o.axle]
    name = str(a.brake.meaning).replace("_", " ")
    whose = "the other axle's, or that is wrong" if either else "the others'"
    if o.late:
        way = "behind" if o.late > 0.0 else "ahead of"
        text = (
            f"the {name} is {abs(o.late):.1f} s {way} {whose}, and the force is wrong by that "
            "wherever it changes: correct its time stamps, unless its brake answers that much later"
        )
        return s.told("pressure-clock-offset", "warning", text, a.brake, o.where, o.axle)
    if o.steady:
        text = (
            f"the {name} is {o.ratio:.2g} times {whose} all along: an axle braked that much "
            f"{'less' if o.ratio < 1.0 else 'more'}, or a sensor of another scale, and this axle's "
            "force is wrong by that; nothing in the log tells which"
        )
        severity: Severity = "info" if _OWNS < o.ratio < 1.0 / _OWNS else "warning"
        return s.told("pressure-suspect", severity, text, a.brake, o.where, o.axle)
    likely = others(a.brake, s.vehicle, lambda f: 0.8 < f * o.ratio < 1.25)
    if likely and not _RATIOS[0] < o.ratio < _RATIOS[1]:
        text = (
            f"the {name} is {o.ratio:.2g} times {whose}: "
            f"state the unit in [channels] {a.brake.meaning}{listed(likely)}"
        )
        return s.told("unit-suspect", "warning", text, a.brake, o.where, o.axle)
    most = float(np.median(o.off[o.where]))
    what = f"{abs(most):.0f} N" if a.record.pressure is None else f"{abs(most) / 1e5:.2g} bar"
    text = (
        f"the {name} is {what} {'above' if most > 0.0 else 'below'} {whose}, and no slide explains "
        "it: a stuck, lost, offset or drifting sensor, or a brake of its own; this axle's force is "
        "wrong there, or its brake is; leave these times out with --from and --to, or the axle "
        "with --axle"
    )
    return s.told("pressure-suspect", "warning", text, a.brake, o.where, o.axle)
