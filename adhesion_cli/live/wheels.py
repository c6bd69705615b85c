"""Which values of a row are which axle's, in SI."""

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..channels import log, to_si
from ..channels.meaning import Mapping, Meant
from ..core import errors, units
from ..core.finding import Finding
from ..core.model import MOTOR_FORCES, MOTOR_TOLERANCE, Parameter, Vehicle
from ..formats.source import Field, Source
from ..records.choose import Key, axle_numbers, brake_of, find, incomplete
from .feed import PAUSE, FeedRow

_COUNTERS = tuple(2.0**bits for bits in (8, 10, 12, 16, 24, 32))  # where counters start anew
_LARGEST = 1e15  # in SI: no sensor gives as much, and estimators need not compute with it
_LARGEST_TURN = 0.25  # of such a range in one interval: more is a reset


Conversion = Callable[[int, float], tuple[int, float] | None]  # to time [ns] and value in SI


class Places(NamedTuple):
    """Where the values of one axle are, among the fields that are wanted."""

    axle: int
    speed: int
    brake: int
    is_pressure: bool
    train: int | None
    of_rim: bool  # the wheel speed is ωR, and was divided by the vehicle's R
    zero: Parameter  # was taken off the pressure [Pa]
    motors: tuple["MotorPlace", ...] = ()  # ED and traction force


class MotorPlace(NamedTuple):
    """Where a force of motors is, among the fields that are wanted."""

    place: int
    sign: float  # −1 of one that drives
    tolerance: float  # 1 sigma, as a share


class LiveWheels:
    """What a sender measures, by its fields.

    `mappings` are what the user stated about the fields. Only these `axles` are taken, all if
    empty.

    Attributes:
        fields: those that are needed, in the order of the places; `add_source` appends to it.
        axles: the axles with a wheel speed and a brake, in the order in which they came.
        findings: what was noticed.

    Raises:
        UserError: where a field that is needed is missing, or its unit is not known.
    """

    def __init__(
        self, source: Source, mappings: Sequence[Mapping], vehicle: Vehicle, axles: Sequence[int]
    ) -> None:
        self._mappings, self._vehicle, self._axle_numbers = mappings, vehicle, tuple(axles)
        self._places: dict[Key, int] = {}
        self._conversions: list[Conversion] = []
        self._by_key: dict[Key, Meant] = {}
        self._lacking: tuple[list[Finding], float] = [], math.inf  # of axles that may get it yet
        self.fields: list[Field] = []
        self.axles: list[Places] = []
        self.findings = self._meant(source)
        self.findings += self._find_axles(self._numbers(source))

    def add_source(self, source: Source) -> list[Finding]:
        """Takes in fields that came later; returns which axles are new, and what cannot be used."""
        axles_before = {p.axle for p in self.axles}
        try:
            findings = self._meant(source)
            lacking = self._find_axles(self._numbers(source))
        except errors.UserError as error:
            names = {"reason": error.text, "hint": error.hint}
            return [Finding("late-channels-left-out", "warning", names=names)]
        self._lacking = lacking, time.monotonic() + PAUSE if lacking else math.inf
        added = [p.axle for p in self.axles if p.axle not in axles_before]
        findings += [Finding("axle-began-late", "info", values={"axle": n}) for n in added]
        return [f for f in findings if f not in self.findings]

    def lacking(self) -> list[Finding]:
        """Axles that began late, and still lack a channel some time after."""
        lacking, deadline = self._lacking
        if not lacking or time.monotonic() < deadline:
            return []
        self._lacking = [], math.inf
        fresh = [f for f in lacking if f not in self.findings]
        self.findings += fresh
        return fresh

    def _meant(self, source: Source) -> list[Finding]:
        """Learns what the fields mean."""
        chosen, findings = log.needed(source, self._mappings)
        for m in chosen:
            is_rate = m.meaning == "train_speed" and units.is_acceleration(m.unit)
            if m.meaning and not is_rate:
                self._by_key.setdefault((m.meaning, m.axle), m)
        return findings + [f for f in source.findings if f not in findings]

    def _numbers(self, source: Source) -> Sequence[int]:
        titles = [m.title for m in self._by_key.values()]
        numbers = axle_numbers(str(source.path), self._by_key, self._axle_numbers, titles)
        return self._axle_numbers or numbers

    def _find_axles(self, numbers: Sequence[int]) -> list[Finding]:
        """Gives places to the axles that have speed and brake; says what the others lack."""
        lacking, places = [], list[tuple[int, Key, Key, Key | None]]()
        for axle in numbers:
            speed, brake = find(self._by_key, "wheel_speed", axle), brake_of(self._by_key, axle)
            if speed and brake:
                places.append((axle, speed, brake, find(self._by_key, "train_speed", axle)))
            elif key := speed or brake:
                lacking.append(incomplete(axle, self._by_key[key].title, speed is not None))
        # Of one time, the brake and the train come before the wheel: so do their places.
        motors_by_axle = {axle: self._find_motors(axle) for axle, *_ in places}
        for _, _, brake, train in places:
            for key in (brake, train):
                if key:
                    self._place(key)
        index_of = {p.axle: i for i, p in enumerate(self.axles)}
        for axle, speed, brake, train in places:
            if axle not in index_of:
                m = self._by_key[speed]
                of_rim = to_si.is_rim(units.stated_unit(m.unit, speed[0], m.title))
                axle_places = self._place(speed), self._place(brake), brake[0] == "pressure"
                zero = to_si.zero(self._by_key[brake], self._vehicle)
                self.axles.append(Places(axle, *axle_places, None, of_rim, zero))
            i, train_place = index_of.get(axle, -1), self._place(train) if train else None
            self.axles[i] = self.axles[i]._replace(motors=motors_by_axle[axle], train=train_place)
        return lacking

    def _find_motors(self, axle: int) -> tuple[MotorPlace, ...]:
        """Gives places to the forces of an axle's motors."""
        motors = []
        for sign, meaning in zip((1.0, -1.0), MOTOR_FORCES, strict=True):
            if key := find(self._by_key, meaning, axle):
                mapping = self._by_key[key].mapping
                tolerance = mapping.tolerance if mapping else MOTOR_TOLERANCE
                motors.append(MotorPlace(self._place(key), sign, tolerance))
        return tuple(motors)

    def _place(self, key: Key) -> int:
        """The place of what has this meaning; it gets one if it has none."""
        if key not in self._places:
            m = self._by_key[key]
            unit = units.stated_unit(m.unit, key[0], m.title)
            factor = to_si.scale(m, unit, self._vehicle)
            offset = unit.offset - to_si.zero(m, self._vehicle).value
            total = to_si.is_total(unit)
            size = m.wrap or (2.0 * math.pi / unit.factor if unit.dimension == "angle" else 0.0)
            self._places[key] = len(self.fields)
            self.fields.append(m.field)
            self._conversions.append(
                _Total(factor, size).convert if total else lambda t, x: (t, factor * x + offset)
            )
        return self._places[key]

    def si(self, row: FeedRow) -> dict[int, tuple[int, float]]:
        """Time [ns] and value in SI of each place that has one."""
        values = {}
        for place, x in row.values.items():
            reading = self._conversions[place](row.t, x) if math.isfinite(x) else None
            if reading and abs(reading[1]) < _LARGEST:
                values[place] = reading
        return values


class _Total:
    """A counter of pulses or angle: its speed is the mean over an interval, at its middle.

    `counter_range` is the angle of one count [rad]. It starts anew at `size`; 0: at a power of two.
    """

    def __init__(self, counter_range: float, size: float) -> None:
        self._range, self._sizes = counter_range, (size,) if size else _COUNTERS
        self._previous: tuple[int, float] | None = None

    def convert(self, t: int, x: float) -> tuple[int, float] | None:
        """Time and speed [rad/s]; None for the first count, after a reset or without time."""
        previous, self._previous = self._previous, (t, x)
        if previous is None or t <= previous[0]:
            return None
        rise = x - previous[1]
        if rise < 0.0:
            candidates = (rise + size for size in self._sizes if previous[1] < size)
            rise = next((r for r in candidates if r >= 0.0), math.inf)
            smallest = min(size for size in self._sizes if previous[1] < size)
            if rise > _LARGEST_TURN * smallest:
                return None
        dt = t - previous[0]
        return previous[0] + dt // 2, rise * self._range / (dt / 1e9)
