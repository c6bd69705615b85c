"""All axles and the train speed on one clock.

A log without a train speed gets one from the acceleration of the car body, if it has that.
"""

import math
from dataclasses import replace

import numpy as np

from ..core.finding import Finding, Severity
from ..core.model import Z95, Channel, Parameter
from ..core.physics import RECEIVER_INTERVAL
from ..core.sample_times import SampleTimes
from ..records.axle_channels import AxleChannels
from ..records.faults import View
from . import acceleration, clock
from .grid import STEP, Grid, grid

_SIGMAS = 4.0  # from zero is a train speed that is delayed
_LATE = 0.3  # a receiver that seems later is, though by 2 sigma only: receivers are late [s]
_CORRECTED = "train-speed-delay"  # the code of a delay that is sure, and removed
_PULSE_DELAY = 0.75  # of an interval: a wheel speed by counted pulses is as late itself


def align(
    axles: list[AxleChannels], accelerometer: Channel | None, view: View
) -> tuple[list[AxleChannels], list[Finding]]:
    """The axles on one clock, where no clock jumps back, and what was found of it.

    `accelerometer` is that of a log without a train speed.
    """
    axles = [_shifted(a, a.train.delay) if a.train and a.train.delay else a for a in axles]
    is_integrated = all(a.train is None for a in axles)
    if is_integrated and not accelerometer:
        return axles, []
    g = grid(axles, acceleration.GRID_STEP if is_integrated else STEP)
    if is_integrated and accelerometer:
        return acceleration.give_train_speed(axles, g, accelerometer)
    return _on_one_clock(axles, g, view) if g else (axles, [])


def _on_one_clock(
    axles: list[AxleChannels], g: Grid, view: View
) -> tuple[list[AxleChannels], list[Finding]]:
    """The axles with a train speed shifted by its delay, where that is sure.

    Where an offset explains the same, the time stamps stay: slip's error includes the delay.
    """
    train = axles[0].train
    if train is None:
        return axles, []
    interval_s = axles[0].record.train_speed_interval
    levels = np.unique(np.round(train.data.value, 6))
    resolution = float(np.diff(levels).min(initial=math.inf))  # tiny, of a speed without steps
    delay, offset = clock.compare_clocks(g, interval_s, resolution)
    values = {}
    if offset is not None:
        values = {"offset_mps": offset.value, "offset_u95_mps": Z95 * offset.tolerance}
    if delay is None or (offset and train.delay):
        return axles, _clock_findings("train-speed-offset", train, values, view) if offset else []
    if train.delay:
        return _beside_stated_delay(axles, train, train.delay, delay, view)
    interval = max(float(np.median(np.diff(a.record.t))) for a in axles) * 1e-9
    findings: list[Finding] = []
    unknown = Parameter(0.0, math.hypot(*delay))  # what remains where nothing is shifted
    clear = _SIGMAS * delay.tolerance
    if interval_s > RECEIVER_INTERVAL:
        clear = min(clear, max(_LATE, 2.0 * delay.tolerance))
    if abs(delay.value) <= max(clear, _PULSE_DELAY * interval):
        delay = unknown
    else:
        values |= {"delay_s": delay.value, "delay_u95_s": Z95 * delay.tolerance}
        code = "train-speed-delay-or-offset" if offset else _CORRECTED
        findings = _clock_findings(code, train, values, view)
        delay = unknown if offset else delay
    is_shifted = [a.train and _same_samples(a.train, train) for a in axles]
    pairs = zip(axles, is_shifted, strict=True)
    return [_shifted(a, delay) if shift else a for a, shift in pairs], findings


def _beside_stated_delay(
    axles: list[AxleChannels],
    train: Channel,
    stated_delay: Parameter,
    residual: Parameter,
    view: View,
) -> tuple[list[AxleChannels], list[Finding]]:
    """The axles shifted by the mean of both delays by their errors, or by the stated one alone.

    They are shifted by the stated delay [s] so far; the wheels show `residual` beyond it [s].
    """
    error = math.hypot(*(x.tolerance for x in (stated_delay, residual)))
    if abs(residual.value) > _SIGMAS * error:
        values = {
            "stated_s": stated_delay.value,
            "delay_s": stated_delay.value + residual.value,
            "delay_u95_s": Z95 * residual.tolerance,
        }
        return axles, _clock_findings("train-speed-delay-differs", train, values, view)
    mean = stated_delay.value + (stated_delay.tolerance / error) ** 2 * residual.value
    delay = Parameter(mean, stated_delay.tolerance * residual.tolerance / error)
    return [_shifted(a, delay) if a.train is train else a for a in axles], []


def _clock_findings(
    code: str, train: Channel, values: dict[str, float], view: View
) -> list[Finding]:
    start, stop = view.seconds(train.data.t[[0, -1]]).tolist()
    severity: Severity = "info" if code == _CORRECTED else "warning"
    return [Finding(code, severity, train.title, train.rows, ((start, stop),), values)]


def _same_samples(channel: Channel, other_channel: Channel) -> bool:
    """Whether two channels hold the same samples: a result of this program repeats one per axle."""
    a, b = channel.data, other_channel.data
    return a is b or (np.array_equal(a.t, b.t) and np.array_equal(a.value, b.value))


def _shifted(axle: AxleChannels, delay: Parameter) -> AxleChannels:
    record, train = axle.record, axle.train
    assert train is not None
    record = replace(record, train_speed_late=delay)
    if delay.value:
        data = replace(train.data, t=train.data.t - round(delay.value * 1e9))
        shifted_train = replace(train, data=data)
        v = SampleTimes(record.t).interpolate(shifted_train)
        record = replace(record, train_speed=v)
        if alone := record.speeds_alone:
            v = SampleTimes(alone.t).interpolate(shifted_train)
            record = replace(record, speeds_alone=alone._replace(train_speed=v))
    return axle._replace(record=record)
