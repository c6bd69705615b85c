"""The loop: rows of a sender through the axles to whoever wants the samples."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..analysis.settings import Settings
from ..core.errors import UserError
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import Parameter, Vehicle
from ..diagnostics.registry import sensor_thresholds
from ..formats.source import Source
from ..train.brake_line import ANY_SHARE
from ..train.motor_mass import MASS
from .axle import LiveAxle, LiveSample, Measuring, Sink
from .feed import FARTHEST, Feed, FeedRow
from .wheels import LiveWheels, Places

_SPANS = 20  # of a finding that grows


class Tally:
    """Findings as they come, new kinds reported; with `strict`, damaged data end the run."""

    def __init__(
        self, report: Callable[[Sequence[Finding]], None], name: str = "", strict: bool = False
    ) -> None:
        self._report, self._name, self._strict = report, name, strict
        self._kinds: dict[tuple[str, ...], Finding] = {}
        self._lock = threading.Lock()  # files are written in threads of their own

    def add(self, findings: Sequence[Finding]) -> None:
        """Counts these; damaged data are a UserError with `strict`."""
        if findings:
            with self._lock:
                self._add(findings)

    def _add(self, findings: Sequence[Finding]) -> None:
        fresh = []
        for f in findings:
            key = (f.code, f.severity, f.channel, f.names.get("reason", ""))
            previous = self._kinds.get(key)
            if previous is None:
                self._kinds[key] = f
                if self._strict and f.severity == "error":
                    raise UserError(f"{self._name}: {f.message}", "go on without --strict")
                fresh.append(f)
                continue
            spans = (*previous.spans, *f.spans)[:_SPANS]
            values = {k: max(x, f.values.get(k, x)) for k, x in previous.values.items()}
            self._kinds[key] = replace(
                previous, count=previous.count + f.count, spans=spans, values=values
            )
        if fresh:
            self._report(fresh)

    @property
    def findings(self) -> list[Finding]:
        """All of them."""
        return list(self._kinds.values())


def with_any_brake(settings: Settings, by_pressure: bool) -> Settings:
    """Settings whose vehicle has the uncertainty of what nobody stated of its brake and mass.

    `analyze` finds these in the log. A live run has none, and its band must hold any brake.
    """
    unstated = settings.unstated_brake(by_pressure)
    shares = {"axle_mass": MASS.share} if "axle_mass" in unstated else {}
    if {*unstated} - {"axle_mass"}:
        shares["friction"] = ANY_SHARE

    def widened(vehicle: Vehicle) -> Vehicle:
        for name, share in shares.items():
            value = getattr(vehicle, name).value
            vehicle = replace(vehicle, **{name: Parameter(value, share * value)})  # type: ignore[arg-type]
        return vehicle

    axles = tuple(x._replace(vehicle=widened(x.vehicle)) for x in settings.vehicle.axles)
    return replace(settings, vehicle=replace(widened(settings.vehicle), axles=axles))


def follow(
    feed: Feed,
    wheels: LiveWheels,
    settings: Settings,
    algos: Mapping[str, tuple[Estimator, Any]],
    sinks: Sequence[Sink],
    tally: Tally,
) -> None:
    """Takes every row of a sender, until it ends; a UserError where it cannot be read on."""
    tally.add(wheels.findings)
    start, axles = None, list[LiveAxle]()

    def add_source(source: Source) -> None:
        tally.add(wheels.add_source(source))

    for row in feed.rows(wheels.fields, add_source):
        tally.add(feed.findings())
        tally.add(wheels.lacking())
        for p in wheels.axles[len(axles) :]:
            axles.append(LiveAxle(_measuring(p, settings), settings.vehicle, algos))
        if row is not None and abs(row.t) > FARTHEST:
            example = "after 2116" if row.t > 0 else "before 1824"
            names = {"reason": "time is more than 146 years from 1970", "example": example}
            tally.add([Finding("messages-unreadable", "warning", names=names)])
        elif row is not None:
            start = row.t if start is None else start
            if samples := axle_samples(row, wheels, axles, start):
                for sink in sinks:
                    sink.take(samples)
            for axle in axles:
                if axle.findings:
                    tally.add(axle.findings)
                    axle.findings.clear()
        for sink in sinks:
            sink.idle()
    tally.add(feed.findings())


def _measuring(p: Places, settings: Settings) -> Measuring:
    analysis, pressure = settings.analysis, True if p.is_pressure else None
    thresholds = sensor_thresholds(settings.checks)
    limits = analysis.slowest, analysis.max_gap
    return Measuring(p.axle, *limits, pressure, p.of_rim, p.zero, thresholds)


def axle_samples(
    row: FeedRow, wheels: LiveWheels, axles: Sequence[LiveAxle], start: int
) -> list[LiveSample]:
    """What the axles make of one row: the brake and the train first, then the wheel."""
    si, samples = wheels.si(row), []
    for p, axle in zip(wheels.axles, axles, strict=True):
        if p.train in si:
            axle.train(*si[p.train])
        for motor in p.motors:
            if motor.place in si:
                t, force = si[motor.place]
                axle.motor(motor.place, t, motor.sign * force, motor.tolerance)
        if p.brake in si:
            axle.brake(*si[p.brake], start)
        if p.speed in si and (sample := axle.wheel(*si[p.speed], start)):
            samples.append(sample)
    return samples
