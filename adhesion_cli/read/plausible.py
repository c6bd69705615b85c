"""What the channels of one log say about each other, and what physics forbids.

Nothing is changed here: every finding names what to state so that the log is understood. All of it
is looked at on one coarse grid, on which an hour is 14 400 numbers.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..model import AxleRecord, Bools, Channel, Finding, Floats, Meaning, Severity, Vehicle
from ..physics import clamping_force, true_runs, wheelset
from .units import UNITS

_STEP = 0.25  # of the grid, where the log is fast enough [s]
_SLOW = 5.0  # a log with longer intervals has more likely the wrong time unit than noise [s]
_MOST = 20_000  # samples on it
_LEAST = 8  # samples on it that show anything
_FASTEST = 500.0 / 3.6  # no train is faster [m/s]
_CRAWL = 1.0  # slower, speeds say little about each other [m/s]
_HIGHEST = 12e5  # no brake cylinder has more [Pa]
_HARDEST = 3.0  # no rail brakes a rolling wheel harder for long [m/s²]
_LOCKING = 30.0  # no brake stops a wheel harder, even without adhesion [m/s²]
_GRADIENT = 0.4  # deceleration that a gradient of 4 % explains [m/s²]
_UNBRAKED = 0.5  # deceleration without pressure that no gradient explains [m/s²]
_UNBRAKED_FOR = 3.0  # and no slide protection [s]
_CLEAR = 0.8  # share of the deceleration that goes with K where both are right
_CLEARER = 0.9  # the same where K hardly varies: a wheel that locks slows evenly, too
_NEAR = 1.15  # as near as this to a unit's factor, the unit is the likely cause
_ABSURD = 30.0  # no slide explains that either
_ANY_VEHICLE = 6.0  # no vehicle is that far from another
_FLOOR = 0.05  # by which two speeds that agree may differ [m/s]
_SIGMAS = 2.0  # of the wheel radius are tolerated
_SWAP = 12  # samples of a slide that show whose pressure it follows
_LATE = 0.4  # a clock offset that matters [s]
_REACH = 5.0  # and the largest looked for [s]
_USUAL: dict[Meaning, tuple[str, ...]] = {
    "pressure": ("Pa", "kPa", "bar", "MPa", "psi"),
    "wheel_speed": ("rad/s", "rpm", "rps", "m/s", "km/h", "mph"),
    "train_speed": ("m/s", "km/h", "mph"),
    "clamping_force": ("N", "kN"),
}


class Axle(NamedTuple):
    """One axle's record and the channels it comes from."""

    record: AxleRecord
    speed: Channel
    brake: Channel
    train: Channel | None


class Grid(NamedTuple):
    """All axles on one even time axis; NaN where a channel has no sample nearby."""

    start_s: float  # of the grid after the log's start [s]
    step: float  # [s]
    rim: Floats  # ω R by the vehicle's radius, shape (k, n) [m/s]
    clamping: Floats  # K, shape (k, n) [N]
    pressure: Floats  # p, shape (k, n) [Pa]; NaN where the log has K
    train: Floats | None  # train speed, shape (n,) [m/s]

    @property
    def fastest(self) -> Floats:
        """The train speed, else the fastest axle's rim speed, shape (n,) [m/s]."""
        return _max(self.rim) if self.train is None else self.train

    @property
    def braking(self) -> Floats:
        """Deceleration of the train, else the mean one of the axles, shape (n,) [m/s²]."""
        return -self.slope(np.mean(self.rim, axis=0) if self.train is None else self.train)

    def since(self, where: Bools) -> float:
        """When a mask is first true, seconds after the log's start."""
        return self.start_s + float(np.argmax(where)) * self.step

    @property
    def half(self) -> int:
        """Grid steps in half a second, fewer where the whole log is short."""
        n = int(self.rim.shape[-1])
        return max(1, min(round(0.5 / self.step), n // 8))

    def slope(self, x: Floats) -> Floats:
        """Rate of change of x over about a second, shape (..., n) [1/s]."""
        j = self.half
        rate = np.full(x.shape, np.nan)
        rate[..., j:-j] = (x[..., 2 * j :] - x[..., : -2 * j]) / (2.0 * j * self.step)
        return rate

    def mean(self, x: Floats) -> Floats:
        """Mean over the same stretch, shape (..., n)."""
        j = self.half
        total = np.cumsum((x[..., 1:] + x[..., :-1]) / 2.0, axis=-1)
        total = np.concatenate([np.zeros((*x.shape[:-1], 1)), total], axis=-1)
        smooth = np.full(x.shape, np.nan)
        smooth[..., j:-j] = (total[..., 2 * j :] - total[..., : -2 * j]) / (2.0 * j)
        return smooth


def findings(axles: Sequence[Axle], vehicle: Vehicle, start_ns: int) -> list[Finding]:
    """Everything that cannot be true, or hardly.

    Silent where a clock jumps back: then it is not known what was at the same time.

    Args:
        axles: all axles of the log that have a record.
        vehicle: what the user states of it.
        start_ns: the log's start.
    """
    if not axles or any((np.diff(a.record.t) <= 0).any() for a in axles):
        return []
    g = _grid(axles, vehicle, start_ns)
    if g is None:
        return []
    return [*_units(axles, g, vehicle), *_speeds(axles, g, vehicle), *_swapped(axles, g)]


# The grid


def _grid(axles: Sequence[Axle], vehicle: Vehicle, start_ns: int) -> Grid | None:
    """None where all axles share too little time."""
    first = max(int(a.record.t[0]) for a in axles)
    last = min(int(a.record.t[-1]) for a in axles)
    usual = max(float(np.median(np.diff(a.record.t))) for a in axles) / 1e9
    span = (last - first) / 1e9
    step = max(usual, min(_STEP, span / 200.0), span / _MOST)
    if usual > _SLOW:
        step = max(step, span / 500.0)
    n = int(span / step) + 1
    if n < _LEAST:
        return None
    t = step * np.arange(n, dtype=np.float64)
    rim, clamping, pressure = np.full((3, len(axles), n), np.nan)
    train = None
    for i, a in enumerate(axles):
        r = a.record
        own = (r.t - first) / 1e9
        radius = vehicle.radius(r.axle).value
        rim[i] = radius * _even(own, r.wheel_speed, r.segments, t, step)
        clamping[i] = _even(own, r.clamping_force_smooth, r.segments, t, step)
        if r.pressure is not None:
            pressure[i] = _even(own, r.pressure, r.segments, t, step)
        if train is None and r.train_speed is not None:
            train = _even(own, r.train_speed, r.segments, t, step)
    return Grid((first - start_ns) / 1e9, step, rim, clamping, pressure, train)


def _even(own: Floats, x: Floats, segments: tuple[slice, ...], t: Floats, step: float) -> Floats:
    """Means over a step, at even times; NaN outside the segments."""
    found = np.full(len(t), np.nan)
    for s in segments:
        known = np.isfinite(x[s])
        u, y = own[s][known], x[s][known]
        if len(u) < 2:
            continue
        area = np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2.0 * np.diff(u))])
        low = np.clip(t - step / 2.0, u[0], u[-1])
        high = np.clip(t + step / 2.0, u[0], u[-1])
        inside = (t >= u[0]) & (t <= u[-1])
        mean = (np.interp(high, u, area) - np.interp(low, u, area))[inside]
        found[inside] = mean / (high - low)[inside]
    return found


def _max(x: Floats) -> Floats:
    """Largest finite value over the axles, NaN where there is none; shape (n,)."""
    top: Floats = np.max(np.where(np.isfinite(x), x, -np.inf), axis=0)
    return np.where(np.isfinite(top), top, np.nan)


def _far(mask: Bools, j: int) -> Bools:
    """True more than j samples from every False, shape (n,)."""
    wide = np.pad(mask, j, mode="edge")
    far = np.lib.stride_tricks.sliding_window_view(wide, 2 * j + 1).all(axis=-1)
    return np.asarray(far)


def _relative(g: Grid) -> Floats:
    """Rim speeds as shares of the train's, 1 while rolling whatever the diameters; shape (k, n).

    A braked wheel that slides turns slower than the train: the usual ratio is a high one.
    """
    fastest = g.fastest
    top = float(np.nanmax(fastest, initial=0.0))
    ratio = g.rim / np.where(fastest > max(0.1 * top, 1e-9), fastest, np.nan)
    return _of_usual(ratio, fastest > 0.3 * top)


def _of_usual(share: Floats, where: Bools) -> Floats:
    """Each row over its own high value; shape (k, n)."""
    found = np.full(share.shape, np.nan)
    for row, x in zip(found, share, strict=True):
        known = x[np.isfinite(x) & where]
        if len(known):
            row[:] = x / max(float(np.quantile(known, 0.9)), 1e-9)
    return found


def _rolling(g: Grid) -> Bools:
    """Where an axle does not slide, as far as the log can tell, nor within a second; (k, n)."""
    return np.array([_far(np.abs(r - 1.0) < 0.03, 2 * g.half) for r in _relative(g)])


# Units and vehicle: does the pressure explain the deceleration?


class _Fit(NamedTuple):
    """Deceleration of the rolling train as a line over the mean K of its axles."""

    slope: float  # [m/s² per N]
    explained: float  # share of the deceleration's square
    top: float  # highest mean K [N]
    varied: bool  # K did, so that the slope is the brake's alone


def _fit(g: Grid) -> _Fit | None:
    """None where the log has too little of a brake application without slides."""
    used = _rolling(g).all(axis=0)
    braking = g.braking
    K = g.mean(np.mean(g.clamping, axis=0))
    used = used & np.isfinite(braking) & np.isfinite(K)
    if used.sum() < _LEAST or not (K[used] > 0.0).any():
        return None
    x, y = K[used], braking[used]
    low, high = np.percentile(x, [5.0, 95.0])
    level = 0.0  # braked all the time: no telling a gradient from the brake
    slope = float(x @ y / (x @ x))
    whole = float(y @ y)
    varied = bool(high - low > 0.5 * float(x.max()))
    if varied:
        slope, level = (float(c) for c in np.polyfit(x, y, 1))
        whole = float(np.sum((y - y.mean()) ** 2))
    left = float(np.sum((y - slope * x - level) ** 2))
    return _Fit(slope, 1.0 - left / whole if whole else 0.0, float(x.max()), varied)


def _units(axles: Sequence[Axle], g: Grid, vehicle: Vehicle) -> list[Finding]:
    """Values that cannot be, or a deceleration that the pressure does not explain."""
    found = [*_impossible(axles, g, vehicle)]
    if found:
        return found
    w = wheelset(vehicle, axles[0].record.axle)
    radius = vehicle.radius(axles[0].record.axle).value
    by_rolling = w.a * w.phi * (1.0 - w.rolling) * radius  # deceleration of the train per N of K
    found = _unbraked(axles, g, vehicle, by_rolling)
    fit = _fit(g)
    if found or fit is None:
        return found
    factor = fit.slope / by_rolling
    absurd = not 1.0 / _ABSURD < factor < _ABSURD
    if fit.explained < (0.5 if absurd else _CLEAR if fit.varied else _CLEARER):
        return found
    if factor <= 0.0 or abs(factor - 1.0) * fit.top * by_rolling < _GRADIENT:
        return found
    if 0.5 < factor < 2.0:
        return found
    # Braked all the time and slow to slow down: a rig or a gradient does that too.
    severity: Severity = "warning" if fit.varied or factor > 1.0 else "info"
    suspects = "axle_mass, lever_ratio, friction and the cylinder in [vehicle]"
    units = _that_explain(axles, g, factor, vehicle)
    text = f"the train slows {factor:.3g} times as hard as the pressure explains by (1)"
    if units:
        text += f": it would fit with {' or '.join(units)}; state the unit in [channels]"
        return [Finding("unit-suspect", severity, f"{text}, or check {suspects}")]
    if 1.0 / _ANY_VEHICLE < factor < _ANY_VEHICLE:
        return [Finding("vehicle-suspect", "info", f"{text}: check {suspects}")]
    text = f"{text}: check the units in [channels], and {suspects}"
    return [Finding("unit-suspect", severity, text)]


def _impossible(axles: Sequence[Axle], g: Grid, vehicle: Vehicle) -> list[Finding]:
    """Speeds and pressures that no train has."""
    found = []
    for a, rim in zip(axles, g.rim, strict=True):
        if (fast := rim > _FASTEST).any():
            peak = float(np.nanmax(rim))
            likely = _others(a.speed, vehicle, lambda x: 5.0 < x * peak < 120.0)  # noqa: B023
            text = (
                f"the wheel runs at up to {3.6 * peak:.0f} km/h: "
                f"state the unit in [channels] speed{_listed(likely)}"
            )
            found.append(
                Finding(
                    "unit-suspect", "warning", text, a.speed.title, int(fast.sum()), g.since(fast)
                )
            )
        p = a.record.pressure
        if p is not None and (high := p > _HIGHEST).any():
            top = float(p.max())
            likely = _others(a.brake, vehicle, lambda x: 1e5 < x * top < 1e6)  # noqa: B023
            text = (
                f"a cylinder pressure of up to {top / 1e5:.0f} bar: "
                f"state the unit in [channels] pressure{_listed(likely)}"
            )
            t = a.record.t
            first = (int(t[np.argmax(high)]) - int(t[0])) / 1e9 + g.start_s
            found.append(
                Finding("unit-suspect", "warning", text, a.brake.title, int(high.sum()), first)
            )
    slowing = -g.slope(g.rim)
    moving = np.isfinite(slowing) & (g.rim > 0.1 * np.nanmax(g.rim, initial=0.0))
    if not found and (slowing[moving] > _LOCKING).mean() > 0.25:
        peak = float(np.median(slowing[moving & (slowing > _LOCKING)]))
        text = (
            f"the wheels slow by {peak:.0f} m/s² at the rim, more than any brake does: "
            "state the units of time and speed in [channels]"
        )
        hard = _max(slowing) > _LOCKING
        found.append(
            Finding(
                "unit-suspect", "warning", text, axles[0].speed.title, int(hard.sum()),
                g.since(hard),
            )
        )  # fmt: skip
    return found


def _unbraked(axles: Sequence[Axle], g: Grid, vehicle: Vehicle, by_rolling: float) -> list[Finding]:
    """The train brakes, and no cylinder has the pressure for it."""
    braking = g.braking
    alone = (braking > _UNBRAKED) & (braking < _HARDEST) & _rolling(g).any(axis=0)
    alone &= g.mean(_max(g.clamping)) * by_rolling < 0.1 * _UNBRAKED
    long = np.zeros(len(alone), dtype=np.bool_)
    for first, past in true_runs(alone):
        long[first:past] = (past - first) * g.step > _UNBRAKED_FOR
    if not long.any():
        return []
    brake, top = axles[0].brake, float(np.nanmax(g.pressure, initial=0.0))
    text = f"the wheels slow by {float(np.median(braking[long])):.1f} m/s²"
    likely = _others(brake, vehicle, lambda x: 1e5 < x * top < 1e6)
    if likely and _alike(np.mean(g.pressure, axis=0), braking):
        code = "unit-suspect"
        text += (
            f" with a pressure of at most {top / 1e5:.2g} bar: "
            f"state its unit in [channels] pressure{_listed(likely)}"
        )
    else:
        code = "brake-unknown"
        text += (
            f" without pressure: a stuck sensor, a wrong unit{_listed(likely)}, or another brake, "
            "whose force (1) does not know; name pressure and unit in [channels], or leave these "
            "times out with --from and --to"
        )
    return [Finding(code, "warning", text, brake.title, int(long.sum()), g.since(long))]


def _alike(x: Floats, y: Floats) -> bool:
    """Whether two columns rise and fall together."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < _LEAST or not np.ptp(x) or not np.ptp(y):
        return False
    return float(np.corrcoef(x, y)[0, 1]) > 0.9


def _others(channel: Channel, vehicle: Vehicle, fits: Callable[[float], bool]) -> list[str]:
    """Units that a channel may be in instead, given what values that many times as large do."""
    taken = UNITS.get(channel.unit.strip().lower())
    if taken is None or channel.meaning is None:
        return []
    R = (
        vehicle.radius(channel.axle or 1).value
        if len(vehicle.wheel_radius) > 1
        else (vehicle.wheel_radius[0].value)
    )
    found = []
    for name in _USUAL[channel.meaning]:
        unit = UNITS[name.lower()]
        along = {"speed": 1.0, "angular speed": R}
        times = unit.factor * along.get(unit.dimension, 1.0)
        times /= taken.factor * along.get(taken.dimension, 1.0)
        if abs(math.log(times)) > 0.1 and fits(times):
            found.append(name)
    return found


def _that_explain(axles: Sequence[Axle], g: Grid, factor: float, vehicle: Vehicle) -> list[str]:
    """What could be in another unit, so that the pressure explains the deceleration."""
    near = _NEAR if 1.0 / _ANY_VEHICLE < factor < _ANY_VEHICLE else 1.6

    def one(x: float) -> bool:
        return abs(math.log(x)) < math.log(near)

    a = axles[0]
    K = float(np.nanmean(g.clamping))

    def pressed(times: float) -> bool:
        p = times * g.pressure[np.isfinite(g.pressure)]
        return one(factor * K / max(float(np.mean(clamping_force(p, vehicle))), 1e-9))

    speed = _others(a.speed, vehicle, lambda x: one(factor * x))
    by_pressure = a.brake.meaning == "pressure"
    brake = _others(a.brake, vehicle, pressed if by_pressure else lambda x: one(factor / x))
    found = [f"wheel speed in {u}" for u in speed]
    found += [f"{'pressure' if by_pressure else 'clamping force'} in {u}" for u in brake]
    for times, what in ((1e-3, "ms for s, or us for ms"), (1e3, "s for ms, or ms for us")):
        if one(factor / times):
            found.append(f"time in another unit ({what})")
    return found


# Wheel speeds against the train's, or each other


class _Match(NamedTuple):
    """How one speed follows another: reference(t) ≈ scale · speed(t − late)."""

    scale: float
    late: float  # [s]
    left: float  # median of what differs [m/s]


def _match(reference: Floats, x: Floats, step: float, late: float, scaled: bool = True) -> _Match:
    """The scale, 1 unless `scaled`, at which a speed that much later fits best."""
    n = np.arange(len(x)) * step
    y = np.interp(n - late, n, x, left=np.nan, right=np.nan)
    fast = reference > max(0.15 * float(np.nanmax(reference, initial=0.0)), _CRAWL)
    used = fast & np.isfinite(y) & (y > _CRAWL)
    if used.sum() < _LEAST:
        return _Match(1.0, late, math.inf)
    scale = float(np.median(reference[used] / y[used])) if scaled else 1.0
    return _Match(scale, late, float(np.median(np.abs(reference[used] - scale * y[used]))))


def _rounding(speed: Channel, step: float, vehicle: Vehicle) -> float:
    """What is left of a wheel speed's quantisation in the mean over a step of the grid [m/s]."""
    interval = 1.0 / speed.rate_hz if speed.rate_hz else 0.0
    rim = max(r.value for r in vehicle.wheel_radius) * speed.step
    return rim * min(1.0, interval / step) / 2.0


def _late(g: Grid, floor: float) -> float:
    """By how much the train speed is behind the fastest wheel [s], 0 where that is not clear.

    A wheel that is too large leads as a clock does that is behind: whichever explains more.
    """
    assert g.train is not None
    x = _max(g.rim)
    lates = np.arange(-_REACH, _REACH + 0.01, 0.1)

    def best(scaled: bool) -> _Match:
        every = (_match(g.train, x, g.step, late, scaled) for late in lates)  # type: ignore[arg-type]
        return min(every, key=lambda m: m.left)

    if _match(g.train, x, g.step, 0.0, scaled=False).left < floor:
        return 0.0
    either = min(_match(g.train, x, g.step, 0.0), best(scaled=False), key=lambda m: m.left)
    both = best(scaled=True)
    m = either if either.left < max(1.5 * both.left, floor) else both
    return m.late if m.left < 2.0 * floor and abs(m.late) < _REACH - 0.2 else 0.0


def _speeds(axles: Sequence[Axle], g: Grid, vehicle: Vehicle) -> list[Finding]:
    """Units, clocks and wheel diameters that do not go with the train's speed or each other."""
    floor = _FLOOR + max(_rounding(a.speed, g.step, vehicle) for a in axles)
    found: list[Finding] = []
    late = 0.0
    train = axles[0].train
    if g.train is not None and train is not None:
        floor += train.step / 3.0
        late = _late(g, floor)
        if abs(late) > max(_LATE, 0.75 * g.step):
            way = "behind" if late > 0.0 else "ahead of"
            text = (
                f"the train speed is {abs(late):.1f} s {way} the wheel speeds: slip is wrong "
                "by that; correct its time stamps, or leave it out"
            )
            found.append(Finding("train-clock-offset", "warning", text, train.title))
    for i, a in enumerate(axles):
        if g.train is not None:
            reference = g.train
        elif len(axles) > 2:
            reference = np.median(g.rim, axis=0)
        else:
            reference = g.rim[1 - i] if i == 0 and len(axles) == 2 else np.full(0, np.nan)
        if not len(reference):
            continue
        if not 0.8 < (kept := _kept_share(g, i)) < 1.25:
            found.append(_odd_wheel(a, 1.0 / kept, True, vehicle))
            continue
        m = _match(reference, g.rim[i], g.step, late)
        R = vehicle.radius(a.record.axle)
        allowed = _SIGMAS * R.tolerance / R.value
        differs = abs(m.scale - 1.0)
        if m.left > floor or differs < max(allowed, 0.005):
            continue
        if differs * float(np.nanmedian(reference)) < 2.0 * floor:
            continue
        found.append(_odd_wheel(a, m.scale, g.train is not None, vehicle))
    return found


def _kept_share(g: Grid, i: int) -> float:
    """The share of the train's speed that a wheel keeps to, 1 where it keeps to none.

    A wheel without brake rolls. A braked one does where it keeps to one share again and again, the
    highest such share: one that slides all the time wanders and keeps to none.
    """
    if g.train is None:
        return 1.0
    fast = g.train > max(0.3 * float(np.nanmax(g.train, initial=0.0)), _CRAWL)
    fast &= g.rim[i] > _CRAWL / 10.0
    share = np.where(fast, g.rim[i], np.nan) / np.where(fast, g.train, 1.0)
    second = max(3, round(1.0 / g.step))
    free = np.sort(share[fast & _far(g.clamping[i] <= 0.0, 2 * g.half)])
    if len(free) >= second:
        return float(np.median(free))
    some = np.sort(share[np.isfinite(share)])
    near = np.searchsorted(some, 1.03 * some) - np.searchsorted(some, 0.97 * some)
    kept = some[near >= max(second, _LEAST, len(some) // 5)]
    return float(kept[-1]) if len(kept) else 1.0


def _odd_wheel(a: Axle, scale: float, by_train: bool, vehicle: Vehicle) -> Finding:
    """A wheel speed that is always the same share of what it should be."""
    other = "the train speed" if by_train else "the other axles"
    text = f"the wheel speed is {1.0 / scale:.3g} times that of {other}"
    if not 0.8 < scale < 1.25:
        likely = _others(a.speed, vehicle, lambda x: 0.87 < x / scale < 1.15)
        text += f": state the unit in [channels] speed{_listed(likely)}"
        if by_train and a.train:
            likely = _others(a.train, vehicle, lambda x: 0.87 < x * scale < 1.15)
            text += f" or train_speed{_listed(likely)}"
        return Finding("unit-suspect", "warning", text, a.speed.title)
    unit = UNITS.get(a.speed.unit.strip().lower())
    if unit is not None and unit.dimension == "speed":
        text += (
            f": the logger takes a wheel {100.0 * abs(1.0 - scale):.1f} % too "
            f"{'large' if scale < 1.0 else 'small'}, and slip is wrong by that; correct the "
            "diameter in the logger"
        )
    else:
        diameter = 2.0 * scale * vehicle.radius(a.record.axle).value
        text += (
            f": the wheel's diameter is {diameter:.4f} m; "
            "state it in [vehicle] wheel_diameter, one per axle"
        )
    return Finding("wheel-diameter", "warning", text, a.speed.title)


def _listed(units: list[str]) -> str:
    return f" ({' or '.join(units)}?)" if units else ""


# Swapped axles


def _swapped(axles: Sequence[Axle], g: Grid) -> list[Finding]:
    """Axles that answer to another axle's pressure while they slide, not to their own.

    A wheel that slides is free: by (1) its ω̇ follows −aφK at once, while F changes slowly.
    """
    change = _kink(_kink(g.rim))
    release = -_kink(g.clamping)
    slides = _relative(g) < 0.97
    follows = np.zeros((len(axles), len(axles)))
    for i, j in np.ndindex(*follows.shape):
        used = slides[i] & np.isfinite(change[i]) & np.isfinite(release).all(axis=0)
        x, y = change[i][used], release[j][used]
        if len(x) >= _SWAP and np.ptp(x) and np.ptp(y) > 0.2 * float(np.nanmax(g.clamping)):
            follows[i, j] = np.corrcoef(x, y)[0, 1]
    found = []
    for i, a in enumerate(axles):
        j = int(np.argmax(follows[i]))
        if follows[i, j] > 0.7 and follows[i, i] < 0.3:
            text = (
                f"where axle {a.record.axle} slides it follows the pressure of axle "
                f"{axles[j].record.axle}, not its own: swapped? "
                "State which channel is whose in [channels]"
            )
            count = int(slides[i].sum())
            found.append(
                Finding("axles-swapped", "warning", text, a.speed.title, count, g.since(slides[i]))
            )
    return found


def _kink(x: Floats) -> Floats:
    """Change from the sample before to the one behind, shape (..., n)."""
    change = np.full(x.shape, np.nan)
    change[..., 1:-1] = x[..., 2:] - x[..., :-2]
    return change
