"""A log to one record per axle that can be trusted as far as the checks see.

1. choose: which channels are which axle's.
2. screen: samples that a working sensor cannot give are left out.
3. resample: each axle gets one time axis, the times of its wheel speed.
4. align: all channels get one clock.
5. identify: the stated vehicle and the log give the vehicle that everything after uses.
6. diagnose: what the channels say about each other, and what physics forbids. How the train slows
   shows the delay of the pressure.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ..core.finding import Finding
from ..core.model import Z95, AxleRecord, Log, Track, Train, Vehicle
from ..diagnostics.registry import Checks, diagnose, sensor_thresholds
from ..diagnostics.scene import Scene
from ..records.axle_channels import AxleChannels
from ..records.choose import choose, no_records_error
from ..records.faults import View
from ..records.faults import Window as Window
from ..records.motor_forces import judge_motor_forces
from ..records.resample import resample
from ..records.screen import screen
from ..train.align import align
from ..train.deceleration_cause import explain_deceleration
from ..train.grid import Grids, build_grids, on_gradient, without_pressures
from ..train.mean_axle import mass_at_rim, mean_axle
from ..train.other_brakes import find_brake_steps, other_brake_findings
from ..train.track import Gradient, find_gradient


class AlignedLog(NamedTuple):
    """The axles of a log on one clock, with what was found on the way."""

    path: str
    axles: list[AxleChannels]  # every axle: some things only all axles together show
    requested: tuple[int, ...]  # the axles asked for
    grids: Grids | None  # all axles together; None where a clock jumps back
    gradient: Gradient | None  # of the line; None where it is not known
    vehicle: Vehicle  # of the axles' clamping force
    view: View
    findings: list[Finding]
    other_brakes: tuple[Finding, ...] = ()  # brakes that act by a channel, and are not in K
    motors_by_axle: bool = True  # whether no force is one of a vehicle or train, spread over all

    def clamped_by(self, vehicle: Vehicle) -> "AlignedLog":
        """The log with the clamping force that another vehicle makes of the pressures."""
        if vehicle == self.vehicle:
            return self
        axles = [a.clamped_by(vehicle) for a in self.axles]
        return self._replace(axles=axles, vehicle=vehicle).on_grids()

    def on_grids(self) -> "AlignedLog":
        """The log with its axles on grids, on its gradient and without what other brakes do."""
        grids = build_grids(self.axles)
        grids = grids and on_gradient(grids, self.gradient, self.vehicle)
        grids = grids and without_pressures(grids, self.view.start_ns, self.other_brakes)
        return self._replace(grids=grids)

    def as_mean_axles(self, mean: Vehicle) -> "AlignedLog":
        """The log of a train that has this mean axle at every place, and brakes alike.

        Where another load gives it another mass, its forces are scaled so that it slows alike.
        """
        if mean == self.vehicle:
            return self
        own_mean = mean_axle(self.vehicle, self.numbers)
        heavier = 1.0 if own_mean == mean else mass_at_rim(mean) / mass_at_rim(own_mean)
        axles = [a.as_mean_axle(mean, heavier) for a in self.axles]
        return self._replace(axles=axles, vehicle=mean).on_grids()

    @property
    def numbers(self) -> list[int]:
        """The numbers of its axles."""
        return [a.record.axle for a in self.axles]


class Prepared(NamedTuple):
    """The records of a log, and what checks may look at."""

    records: list[AxleRecord]  # of the axles asked for
    all_records: list[AxleRecord]  # of every axle
    findings: list[Finding]
    scene: Scene | None  # all axles together; None where a clock jumps back


def align_log(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: Window = (None, None),
    checks: Checks | None = None,
    track: Track = Track(),  # noqa: B008 (a value that cannot change)
) -> AlignedLog:
    """The first four steps. Arguments and errors as of `prepare`, and `track`, the line."""
    view = View(log.start_ns(), window)
    choice = choose(log, axles, vehicle)
    screened = screen(choice, view, sensor_thresholds(checks))
    channels, motor_findings = judge_motor_forces(screened.channels, vehicle)
    screened = screened._replace(channels=channels)
    sampled, resample_findings = resample(choice, screened, view)
    sensor_findings = [f for f in screened.findings if f.channel in choice.titles]
    findings = [*choice.findings, *sensor_findings, *motor_findings, *resample_findings]
    if not any(a.record.axle in choice.requested for a in sampled):
        raise no_records_error(log, choice, view, findings)
    aligned, clock_findings = align(sampled, choice.acceleration, view)
    gradient = find_gradient(log, track)
    axle_names = ", ".join(str(a.record.axle) for a in aligned)
    if track.profile and gradient is None:
        findings.append(Finding("no-position", "warning"))
    if track.gradients_of_logs:
        findings.append(Finding("gradient-not-stated", "info"))
    aligned_log = AlignedLog(
        log.path,
        aligned,
        choice.requested,
        None,
        gradient,
        vehicle,
        view,
        findings + clock_findings,
        other_brake_findings(log, aligned, view),
        not any(f.names["axles"] == axle_names for f in log.findings if f.code == "force-spread"),
    ).on_grids()
    grids = aligned_log.grids
    if not grids or not (steps := find_brake_steps(grids.coarse, view.start_ns)):
        return aligned_log
    other_brakes = (*aligned_log.other_brakes, *steps)
    return aligned_log._replace(other_brakes=other_brakes).on_grids()


def diagnose_log(
    log: AlignedLog,
    vehicle: Vehicle,
    checks: Checks | None = None,
    train: Train = Train(),  # noqa: B008 (a value that cannot change)
) -> Prepared:
    """The last step: after it, everything uses this vehicle."""
    log = log.clamped_by(vehicle)
    mean = mean_axle(vehicle, log.numbers)
    equal_axles = log.as_mean_axles(mean)
    explanation = explain_deceleration(equal_axles.axles, equal_axles.grids, mean, train)
    delay = explanation.pressure_delay
    axles = [a._replace(record=replace(a.record, pressure_late=delay)) for a in log.axles]
    requested = [a for a in axles if a.record.axle in log.requested]
    findings, scene = [*log.findings], None
    if log.grids:
        grid = log.grids.coarse
        scene = Scene(axles, grid, vehicle, log.view.start_ns, explanation, train)
        titles = {"", *(c.title for a in requested for c in (a.speed, a.brake, a.train) if c)}
        checked = diagnose(scene, checks)
        findings += [f for f in checked if f.channel in titles]
        axles = [_doubted(a, checked) for a in axles]
        requested = [a for a in axles if a.record.axle in log.requested]
    return Prepared([a.record for a in requested], [a.record for a in axles], findings, scene)


def _doubted(axle: AxleChannels, findings: Sequence[Finding]) -> AxleChannels:
    """The axle; its force is as uncertain as the creepage differs from it, where it surely does."""
    suspects = (f for f in findings if f.code == "axle-force-suspect")
    for f in suspects:
        if f.channel == axle.brake.title and f.names["axle"] == str(axle.record.axle):
            doubt = abs(1.0 - f.values["share"]) / Z95
            return axle._replace(record=replace(axle.record, creepage_doubt=doubt))
    return axle


def prepare(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: Window = (None, None),
    checks: Checks | None = None,
) -> Prepared:
    """One record per axle that has a wheel speed and a pressure (or K), by a known vehicle.

    Only these `axles` are taken, all if empty, and only samples in the window of seconds after the
    log's start.

    Raises:
        UserError: where a needed channel is missing, an axle asked for is not there, or no two
            channels share any time.
    """
    return diagnose_log(align_log(log, vehicle, axles, window, checks), vehicle, checks)
