"""One axle while it is measured: each sample goes through the estimators once."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from ..core import estimator, physics, time_axis
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import Z95, AxleRecord, Parameter, Vehicle
from ..core.physics import SLIDE
from ..rail.events import END_SLIP
from ..records import outliers, screen
from ..reference.force import by_tolerances
from .sensors import Leaps, StuckPressure, StuckSpeed, pressure_leaps

_MEDIAN_WINDOW = 100  # intervals whose median is the usual one
_LONGEST_FIRST_INTERVAL = 10.0  # longest interval before the usual one is known [s]
_CLOCK_SET_BACK = 2.0  # an older stamp than this is a clock that was set back [s]
_OLDER_STAMPS = 5  # older ones in a row: it was set back by less, and the train went on meanwhile
_EDGE_GAPS = 2.0  # gaps that a pressure may end before the speed, or begin after it
_REGIMES = ("rolling", "sliding", "changing")

Status = Literal[
    "start",
    "ok",
    "no-pressure",
    "pressure-stuck",
    "pressure-saturated",
    "speed-stuck",
    "speed-outlier",
]


class LiveEstimate(NamedTuple):
    """What an estimator says of a sample."""

    force: float  # [N]
    sigma: float  # its standard uncertainty by noise [N], NaN where the method has none
    tolerance: float = math.nan  # and by the vehicle's tolerances [N]
    mass: float = 0.0  # covariance of the force with ln m, by the tolerances [N]

    @property
    def u95(self) -> float:
        """Expanded uncertainty (95 %): noise and vehicle tolerances [N]."""
        return Z95 * math.hypot(self.sigma, self.tolerance)


class LiveSample(NamedTuple):
    """One sample of one axle, and what the estimators say of it; NaN is not known."""

    t: int  # [ns]
    axle: int
    pressure: float  # [Pa]
    clamping: float  # K [N]
    speed: float  # ω [rad/s]
    train: float  # [m/s]
    slip: float  # [-]
    estimates: Mapping[str, LiveEstimate]  # by name, empty without speed or pressure
    status: Status
    regime: str = ""  # rolling or sliding by the slip; without slip as `imm` says, or changing


class Sink:
    """What takes samples."""

    def take(self, samples: Sequence[LiveSample]) -> None:
        """The samples of one row or several, in the order of time, then of the axles."""
        raise NotImplementedError

    def idle(self) -> None:
        """Called after each row, and while none comes."""

    def close(self) -> None:
        """Ends it; nothing that it has is lost."""


class Measuring(NamedTuple):
    """How an axle is measured and judged."""

    axle: int  # its number, as the log counts it
    slowest: float = 1.0  # no slip below this train speed [m/s]
    max_gap: float = 0.0  # longer intervals are gaps [s]; 0: five times the usual one
    pressure: object = True  # None where K itself is measured
    of_rim: bool = False  # the wheel speed is ωR, and was divided by the vehicle's R
    pressure_zero: Parameter = Parameter(0.0, 0.0)  # was taken off the pressure [Pa]
    thresholds: screen.Thresholds = screen.DEFAULT


class _Clock:
    """The stamps of one channel: which interval is a gap, and which stamp is old."""

    def __init__(self, longest: float) -> None:
        self._longest, self.limit = longest, longest or _LONGEST_FIRST_INTERVAL
        self._steps: deque[int] = deque(maxlen=_MEDIAN_WINDOW)  # [ns]
        self.last: int | None = None
        self._count = 0

    def step(self, t: int) -> float:
        """Seconds since the stamp before, which this one follows; NaN for the first."""
        previous, self.last = self.last, t
        if previous is None:
            return math.nan
        h = (t - previous) * 1e-9
        if h > 0.0 and (h <= self.limit or not self._longest):
            self._steps.append(t - previous)
            self._count += 1
            if not self._longest and (self._count < 20 or self._count % _MEDIAN_WINDOW == 0):
                limit = time_axis.gap_limit(np.array(self._steps)) * 1e-9
                self.limit = limit if self._count > 2 else _LONGEST_FIRST_INTERVAL
        return h

    def fresh(self, t: int) -> bool:
        """Whether the newest sample still holds at `t` [ns]."""
        return self.last is not None and (t - self.last) * 1e-9 <= self.limit


class LiveAxle:
    """An axle."""

    def __init__(
        self, measuring: Measuring, vehicle: Vehicle, algos: Mapping[str, tuple[Estimator, Any]]
    ) -> None:
        self.number, self._measuring = measuring.axle, measuring
        vehicle = vehicle.of_axle(measuring.axle)
        self._vehicle, self._algos = vehicle, algos
        self._wheelset = physics.wheelset(vehicle, measuring.axle)
        column = np.empty(0)
        columns = np.empty(0, np.int64), column, column, column, ()  # no sample
        self._record = AxleRecord(measuring.axle, *columns, of_rim=measuring.of_rim)
        pressure = None if measuring.pressure is None else column
        self._record = replace(
            self._record, pressure=pressure, pressure_zero=measuring.pressure_zero
        )
        self._line = physics.force_line(vehicle)
        self._states: dict[str, Any] = {}
        self._wheel, self._brake, self._run = (_Clock(measuring.max_gap) for _ in range(3))
        self._force, self._pressure, self._train = math.nan, math.nan, math.nan
        self._last_time: int | None = None  # time of the newest sample that was used [ns]
        self._first_time: int | None = None  # and of the first one
        self._motors: dict[int, tuple[float, float]] = {}  # force at the rim and its sigma [N]
        self._motor_clock = _Clock(measuring.max_gap)
        self._motor_part = 0.0, 0.0  # of the newest sample
        self._slides = False
        self._older_stamps = 0  # of the wheel speed, in a row
        p = measuring.thresholds
        self._speed_leaps = Leaps("wheel_speed", lambda _: outliers.wheel_limits(p.outliers))
        self._pressure_leaps = pressure_leaps(p.outliers)
        self._speed_stuck = StuckSpeed(p.stuck_speed)
        self._pressure_stuck = StuckPressure(p.stuck_pressure)
        self._vacuum = p.outliers.vacuum
        self._lasting = dict[str, bool]()  # faults that last, and whether they are reported
        self._pressure_lost_since: int | None = None  # since when no pressure is known [ns]
        self.findings: list[Finding] = []  # whoever reads them may empty the list

    def brake(self, t: int, value: float, start: int) -> None:
        """A pressure [Pa], or a clamping force [N]."""
        clock, is_pressure = self._brake, self._measuring.pressure is not None
        if clock.last is not None and 0 < clock.last - t < _CLOCK_SET_BACK * 1e9:
            self._report("time-out-of-order", t, start)
            self._pressure_leaps.restart()
            return
        if is_pressure and not self._is_sound(t, value, start):
            return
        if not clock.step(t) <= clock.limit:
            self._pressure_stuck.restart()
        if is_pressure:
            self._pressure_stuck.add(t, value, clock.limit)
        self._pressure = value if is_pressure else math.nan
        self._force = float(physics.clamping(self._line, value)) if is_pressure else value

    def _is_sound(self, t: int, value: float, start: int) -> bool:
        """Whether a cylinder can have this pressure."""
        if value < self._vacuum:
            self._report("pressure-negative", t, start)
            return False
        if self._brake.last is None or not self._brake.fresh(t):
            self._pressure_leaps.restart()
        if self._pressure_leaps.leaps(t, value):
            self._report("pressure-outlier", t, start)
            return False
        return True

    def motor(self, place: int, t: int, force: float, tolerance: float) -> None:
        """A force of the motors at the rim [N], the ED brake above zero, with its tolerance."""
        self._motor_clock.step(t)
        self._motors[place] = force, tolerance * abs(force)

    def _by_motors(self, t: int) -> tuple[float, float]:
        """The motors' part of K, and 1 sigma of their force [N]; NaN where it is too old."""
        if not self._motors:
            return 0.0, 0.0
        forces, sigmas = zip(*self._motors.values(), strict=True)
        K = sum(forces) / self._wheelset.phi if self._motor_clock.fresh(t) else math.nan
        return K, math.hypot(*sigmas)

    def train(self, t: int, value: float) -> None:
        """A train speed [m/s]."""
        self._run.step(t)
        self._train = value
        self._speed_stuck.train(t, value)

    def wheel(self, t: int, y: float, start: int) -> LiveSample | None:
        """A wheel speed [rad/s]; None where its stamp is not later than the one before."""
        if not self._in_order(t, start):
            return None
        y = abs(y)
        v = self._train if self._run.fresh(t) else math.nan
        if self._speed_leaps.leaps(t, y):
            self._report("speed-outlier", t, start)
            unknown = math.nan
            sample = t, self.number, self._pressure, unknown, y, v, unknown
            return LiveSample(*sample, {}, "speed-outlier")
        h = math.nan if self._last_time is None else (t - self._last_time) * 1e-9
        if not h <= self._wheel.limit:
            self._states.clear()
        self._last_time = t
        self._first_time = t if self._first_time is None else self._first_time
        self._motor_part = self._by_motors(t)
        radius, slowest = self._wheelset.radius, self._measuring.slowest
        share = float(physics.friction_share(y * radius, self._force, self._vehicle))
        K = self._force * share + self._motor_part[0]
        slip = float(physics.slip(v, y, radius, slowest))  # type: ignore[arg-type]
        status = self._fault(t, y, K, start)
        if status in ("no-pressure", "pressure-stuck", "speed-stuck"):
            self._states.clear()
            pressure = math.nan if status == "no-pressure" else self._pressure
            return LiveSample(t, self.number, pressure, math.nan, y, v, slip, {}, status)
        if not self._states:
            status = "start"
        estimates = {name: self._stepped(name, h, K, y) for name in self._algos}
        regime = self._regime(slip, y * radius if math.isnan(v) else v)
        return LiveSample(t, self.number, self._pressure, K, y, v, slip, estimates, status, regime)

    def _in_order(self, t: int, start: int) -> bool:
        """Whether the stamp of a wheel speed can be used; begins anew after a gap."""
        previous = self._wheel.last
        if previous is not None and t <= previous:
            if t == previous or previous - t < _CLOCK_SET_BACK * 1e9:
                self._report("time-duplicate" if t == previous else "time-out-of-order", t, start)
                self._older_stamps += t < previous
                return False
            self._report("time-backward", t, start, most_s=(previous - t) * 1e-9)
            self._wheel.last = self._last_time = self._first_time = None
        limit = self._wheel.limit
        h = self._wheel.step(t)
        if h > limit:
            self._report("gap", t, start, longest_s=h, limit_s=math.floor(h) + 1.0)
        clock_jumped, self._older_stamps = self._older_stamps >= _OLDER_STAMPS, 0
        if clock_jumped or not h <= limit:
            self._last_time = None
            self._speed_leaps.restart()
            self._speed_stuck.restart()
        return True

    def _fault(self, t: int, y: float, K: float, start: int) -> Status:
        """What is wrong with the sensors, "ok" for nothing; reports what is new."""
        fresh = self._brake.fresh(t) and math.isfinite(K)
        self._check_pressure(t, fresh, start)
        pressure = self._pressure_stuck
        force = K if fresh and not pressure.stuck else math.nan
        of_speed = self._speed_stuck.stuck(t, y, force, self._wheel.limit)
        faults: dict[Status, bool] = {
            "speed-stuck": of_speed,
            "pressure-stuck": fresh and pressure.stuck,
            "pressure-saturated": fresh and pressure.saturated,
        }
        for code, present in faults.items():
            if present and not self._lasting.get(code):
                self._report(code, t, start)
            self._lasting[code] = present
        if not fresh:
            return "no-pressure"
        return next((code for code, present in faults.items() if present), "ok")

    def _check_pressure(self, t: int, fresh: bool, start: int) -> None:
        """Reports a missing pressure: at its end, or earlier where it lasts.

        At the ends of a log it may last for some gaps, as in `records.resample`.
        """
        if fresh and self._pressure_lost_since is None:
            return
        if self._pressure_lost_since is None:
            self._pressure_lost_since = t
        began = self._brake.last is not None and self._pressure_lost_since != self._first_time
        is_gap = (t - self._pressure_lost_since) * 1e-9 > _EDGE_GAPS * max(
            self._brake.limit if began else 0.0, self._wheel.limit
        )
        if (is_gap or (fresh and began)) and not self._lasting.get("no-pressure"):
            quantity = "clamping force" if self._measuring.pressure is None else "pressure"
            gap_seconds = (self._pressure_lost_since - start) * 1e-9, (t - start) * 1e-9
            names, channel = {"quantity": quantity}, f"axle {self.number}"
            self.findings.append(
                Finding("no-pressure", "warning", channel, spans=(gap_seconds,), names=names)
            )
            self._lasting["no-pressure"] = True
        if fresh:
            self._pressure_lost_since, self._lasting["no-pressure"] = None, False

    def _stepped(self, name: str, h: float, K: float, y: float) -> LiveEstimate:
        est, p = self._algos[name]
        state = estimator.advance(est, p, self._wheelset, self._states.get(name), h, K, y)
        self._states[name] = state
        if not est.has_sigma:
            return LiveEstimate(state.F, math.nan)
        return LiveEstimate(state.F, state.sigma, *self._tolerance(K, state.F, y))

    def _tolerance(self, K: float, F: float, y: float) -> tuple[float, float]:
        """1 sigma of the force from the vehicle's tolerances, and its covariance with ln m [N]."""
        w, vehicle = self._wheelset, self._vehicle
        by_motors, sigma = self._motor_part
        columns: Any = (K - by_motors, w.a * (F - w.phi * K), y * w.radius, None)  # (1)
        variance, mass = by_tolerances(self._record, vehicle, *columns)
        return math.sqrt(max(float(variance), 0.0) + sigma**2), float(mass)

    def _regime(self, slip: float, speed: float) -> str:
        """By the slip, else as `imm` says; nothing of a train that hardly moves or is not known."""
        if math.isfinite(slip):
            self._slides = slip > (END_SLIP if self._slides else SLIDE)
            return "sliding" if self._slides else "rolling"
        self._slides = False
        if not speed >= self._measuring.slowest:
            return ""
        for name, state in self._states.items():
            if self._algos[name][0].State._fields[: len(_REGIMES)] == _REGIMES:
                return max(_REGIMES, key=lambda r: getattr(state, r).p)
        return ""

    def _report(self, code: str, t: int, start: int = 0, **values: float) -> None:
        spans = (((t - start) * 1e-9,) * 2,)
        channel = f"axle {self.number}"
        self.findings.append(Finding(code, "warning", channel, spans=spans, values=values))
