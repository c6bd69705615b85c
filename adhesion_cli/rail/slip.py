"""Slip of every axle, its slope and region, slides, and the rail under them: [S1] to [S4].

[S1], whose formula is missing in the text that we have: at the rim the brake acts on the wheelset
with φK and the rail with F, so I ω̇ = (F − φK) R, which is (1), and

    μ = F/(m g) = (φK + I ω̇/R)/(m g).                                                        [S1]

F is the offline reference's. The estimators lag, and a lag in μ alone bends every slope. `fit` has
[S2], the curve through the points, and `slope` has [S3] and [S4].
"""

from dataclasses import replace

import numpy as np

from ..core import compiled, physics
from ..core.finding import Finding
from ..core.model import AxleResult, Floats, Regions, Times, Vehicle
from . import events
from .sliding import find_slides, slides
from .slope import Bands, Params, State, init, region, step
from .speed_errors import (
    COASTING_RATE,
    deceleration,
    delay_sigma,
    has_slow_receiver,
    has_uncertain_delay,
    speed_error,
    speed_noise,
)
from .wheel_calibration import calibrate_radius


def _slope_of_segment(  # noqa: PLR0913 (compiled: one array each)
    p: Params,
    bands: Bands,
    t: Times,
    slip: Floats,
    mu: Floats,
    slip_noise: Floats,
    mu_noise: Floats,
    slope: Floats,
    confidence: Floats,
    code: Regions,
) -> None:
    """`slope.step` over one segment."""
    s: State = init(p, slip[0], mu[0])
    for i in range(len(t)):
        if i > 0:
            h = (t[i] - t[i - 1]) * 1e-9
            s = step(p, s, h, slip[i], mu[i], slip_noise[i], mu_noise[i])
        slope[i] = s.slope
        confidence[i] = s.confidence
        code[i] = region(slip[i], s.slope, bands)


def observe_slip(
    axle: AxleResult, vehicle: Vehicle, slowest: float, p: Params, bands: Bands
) -> tuple[AxleResult, list[Finding]]:
    """The result of an axle with a train speed, with its slip, slope, regions and their events.

    Noise of either speed, over v, raises the excitation that a slope needs. There is no slip below
    the `slowest` train speed [m/s].
    """
    record = axle.record
    assert record.train_speed is not None
    radius, findings = calibrate_radius(record, vehicle)
    slip = physics.slip(record.train_speed, record.wheel_speed, radius.value, slowest)
    mu = physics.coefficient(axle.reference.force, vehicle, record.axle)  # [S1]
    with np.errstate(divide="ignore", invalid="ignore"):
        speed_slip_noise = speed_noise(record, radius.value) / record.train_speed  # noise of (2)
        lasting = speed_error(record)
        # The slope's filter passes only the change within 1/δ of an error that follows −v̇/v.
        change = lasting * deceleration(record) / record.train_speed / p.delta
        slip_noise = np.hypot(speed_slip_noise, change)
    mu_noise = physics.coefficient(axle.reference.sigma, vehicle, record.axle)
    n = len(record)
    slope, confidence, code = np.full(n, np.nan), np.zeros(n), np.zeros(n, np.int8)
    march = compiled.function(_slope_of_segment)
    for s in record.segments:
        noise = slip_noise[s], mu_noise[s]
        march(p, bands, record.t[s], slip[s], mu[s], *noise, slope[s], confidence[s], code[s])
    completed = replace(axle, slip=slip, slip_noise=speed_slip_noise, region=code)
    share = radius.tolerance / radius.value
    completed = replace(completed, slope=slope, slope_confidence=confidence, radius_share=share)
    is_unknown = record.train_speed_late is None or record.train_speed_late.value == 0.0
    is_unknown = is_unknown and has_uncertain_delay(record)
    possible = [x.samples for x in find_slides(completed, slip, slip)] if is_unknown else []
    if any(np.median(deceleration(record)[x]) > COASTING_RATE for x in possible):
        name, delay = f"axle {record.axle}", {"delay_s": 2.0 * delay_sigma(record)}
        finding = Finding("train-speed-delay-unknown", "info", channel=name, values=delay)
        if has_slow_receiver(record):
            finding = replace(finding, code="train-speed-slow", severity="warning")
        findings.append(finding)
    axle_events = events.axle_events(
        record.axle, slides(completed), record.segments, record.t, code
    )
    return replace(completed, events=axle_events), findings
