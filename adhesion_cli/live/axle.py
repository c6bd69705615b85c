"""One axle while it is measured: each sample goes through the estimators once."""

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from ..core import estimator, physics, time_axis
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import Vehicle

_MANY = 100  # intervals whose median is the usual one
_FIRST = 10.0  # longest interval before the usual one is known [s]
_STUCK = 1.0  # time for which a wheel that turns repeats one value exactly [s]
_FEWEST = 10  # samples that must do that
_TURNS = 0.5  # a wheel that is as slow may stand [rad/s]
_LATE = 2.0  # an older stamp than this is a clock that was set back [s]
_REGIMES = ("rolling", "sliding", "changing")

Status = Literal["start", "ok", "no-pressure"]


class Estimate(NamedTuple):
    """What an estimator says of a sample."""

    force: float  # [N]
    sigma: float  # its standard uncertainty [N], NaN where the method has none
    regime: str = ""  # of `imm`: rolling, sliding or changing


class Sample(NamedTuple):
    """One sample of one axle, and what the estimators say of it; NaN is not known."""

    t: int  # [ns]
    axle: int
    pressure: float  # [Pa]
    clamping: float  # K [N]
    speed: float  # ω [rad/s]
    train: float  # [m/s]
    slip: float  # [-]
    estimates: Mapping[str, Estimate]  # by name, empty without pressure
    status: Status


class _Clock:
    """The stamps of one channel: which interval is a gap, and which stamp is old."""

    def __init__(self, longest: float) -> None:
        self._stated, self.limit = longest, longest or _FIRST
        self._steps: deque[int] = deque(maxlen=_MANY)  # [ns]
        self.last: int | None = None
        self._seen = 0

    def step(self, t: int) -> float:
        """Seconds since the stamp before, which this one follows; NaN for the first."""
        before, self.last = self.last, t
        if before is None:
            return math.nan
        h = (t - before) * 1e-9
        if h > 0.0 and (h <= self.limit or not self._stated):
            self._steps.append(t - before)
            self._seen += 1
            if not self._stated and (self._seen < 20 or self._seen % _MANY == 0):
                limit = time_axis.gap_limit(np.array(self._steps)) * 1e-9
                self.limit = limit if self._seen > 2 else _FIRST
        return h

    def fresh(self, t: int) -> bool:
        """Whether the newest sample still holds at `t` [ns]."""
        return self.last is not None and (t - self.last) * 1e-9 <= self.limit


class Axle:
    """An axle.

    Args:
        number: as the log counts it.
        vehicle: its constants.
        algos: estimators with their parameters.
        slowest: no slip below this train speed [m/s].
        max_gap: longer intervals are gaps [s]; 0: five times the usual one.
    """

    def __init__(
        self, number: int, vehicle: Vehicle, algos: Mapping[str, tuple[Estimator, Any]],
        slowest: float, max_gap: float,
    ) -> None:  # fmt: skip
        self.number, self._vehicle, self._algos, self._slowest = number, vehicle, algos, slowest
        self._wheelset = physics.wheelset(vehicle, number)
        self._line = physics.force_line(vehicle)
        self._states: dict[str, Any] = {}
        self._wheel, self._brake, self._run = (_Clock(max_gap) for _ in range(3))
        self._force, self._pressure, self._train = math.nan, math.nan, math.nan
        self._same, self._repeats, self._told = (0, math.nan), 0, False
        self.findings: list[Finding] = []  # whoever reads them may empty the list

    def brake(self, t: int, value: float, is_pressure: bool, start: int) -> None:
        """A pressure [Pa], or a clamping force [N]."""
        if self._brake.last is not None and 0 < self._brake.last - t < _LATE * 1e9:
            self._report("time-out-of-order", t, start)
            return
        self._brake.step(t)
        self._pressure = value if is_pressure else math.nan
        self._force = float(physics.clamping(self._line, value)) if is_pressure else value

    def train(self, t: int, value: float) -> None:
        """A train speed [m/s]."""
        self._run.step(t)
        self._train = value

    def wheel(self, t: int, y: float, start: int) -> Sample | None:
        """A wheel speed [rad/s]; None where its stamp is not later than the one before."""
        before = self._wheel.last
        if before is not None and t <= before:
            code = "time-duplicate" if t == before else "time-out-of-order"
            if t == before or before - t < _LATE * 1e9:
                self._report(code, t, start)
                return None
            self._report("time-backward", t, start, most_s=(before - t) * 1e-9)
            self._wheel.last = None
        limit = self._wheel.limit
        h = self._wheel.step(t)
        if h > limit:
            self._report("gap", t, start, longest_s=h)
        if not h <= limit:
            self._states.clear()
        y = abs(y)
        self._check_stuck(t, y, start)
        K = self._force * self._share(y)
        v = self._train if self._run.fresh(t) else math.nan
        slip = self._slip(v, y)
        if not (self._brake.fresh(t) and math.isfinite(K)):
            self._states.clear()
            return Sample(t, self.number, math.nan, math.nan, y, v, slip, {}, "no-pressure")
        status: Status = "ok" if self._states else "start"
        found = {name: self._stepped(name, h, K, y) for name in self._algos}
        return Sample(t, self.number, self._pressure, K, y, v, slip, found, status)

    def _stepped(self, name: str, h: float, K: float, y: float) -> Estimate:
        est, p = self._algos[name]
        state = estimator.advanced(est, p, self._wheelset, self._states.get(name), h, K, y)
        self._states[name] = state
        regime = ""
        if est.State._fields[: len(_REGIMES)] == _REGIMES:
            regime = max(_REGIMES, key=lambda r: getattr(state, r).p)
        return Estimate(state.F, getattr(state, "sigma", math.nan), regime)

    def _share(self, y: float) -> float:
        """φ(v) / φ at this wheel speed."""
        if not self._vehicle.friction_fade.value:
            return 1.0
        rim = y * self._vehicle.radius(self.number).value
        return float(physics.friction_share(rim, self._vehicle))  # type: ignore[arg-type]

    def _slip(self, v: float, y: float) -> float:
        if not v >= self._slowest:
            return math.nan
        return float(
            physics.slip_over(v, y * self._vehicle.radius(self.number).value, self._slowest)
        )

    def _check_stuck(self, t: int, y: float, start: int) -> None:
        """Reports a wheel that turns and repeats one value exactly, once each time."""
        since, value = self._same
        if y != value:
            self._same, self._repeats, self._told = (t, y), 1, False
            return
        self._repeats += 1
        long = (t - since) * 1e-9 > _STUCK and self._repeats > _FEWEST
        if long and y > _TURNS and not self._told and self._force > physics.NO_FORCE:
            self._told = True
            self._report("speed-stuck", t, start)

    def _report(self, code: str, t: int, start: int = 0, **values: float) -> None:
        at = (t - start) * 1e-9
        self.findings.append(
            Finding(code, "warning", f"axle {self.number}", spans=((at, at),), values=values)
        )
