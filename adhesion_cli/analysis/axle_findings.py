"""What must be reported about one axle: where it has no value, and where it may be wrong."""

from collections.abc import Iterator, Sequence

import numpy as np

from ..core import physics, signals
from ..core.finding import Finding, Severity
from ..core.masks import spans_of_mask
from ..core.model import AxleRecord, Bools, Reference, Vehicle
from ..rail import rail_under_slides
from ..rail.events import HIDDEN_TIME
from ..rail.locks import LockLimits, locks_of_axle
from ..records import brake_applications

_HIGHEST_COEFFICIENT = 0.7  # no rail has a higher adhesion coefficient [-]
_SURE_PROBABILITY = 0.99  # probability from which a speed is an average since the last one
_FEW_PULSES = 12.0  # pulses in 0.1 s: with fewer, slides do not exceed the rounding
_MODEL_ERROR = 0.02  # of the highest φK: as little is an error of the model


def find_axle_findings(
    record: AxleRecord,
    vehicle: Vehicle,
    ref: Reference,
    applications: Sequence[slice],
    start_ns: int,
    limits: LockLimits,
) -> Iterator[Finding]:
    """The findings of one axle.

    Spans count from `start_ns`, the log's start [ns]. `limits` say when a standing wheel is locked.
    """
    name = f"axle {record.axle}"
    masks = _without_value(record, vehicle, ref, limits) | _impossible_force(record, vehicle, ref)
    begins = np.zeros(len(record), dtype=np.bool_)
    begins[[s.start for s in brake_applications.find_start_ups(record, applications)]] = True
    masks["started-braked"] = ("info", begins)
    largest = np.nan_to_num(np.abs(ref.force))
    highest = float(physics.coefficient(largest, vehicle, record.axle).max(initial=0.0))
    values = {
        "started-braked": {"startup_s": brake_applications.START_UP},
        "coefficient-too-high": {"coefficient": highest},
    }
    for code, (severity, mask) in masks.items():
        if count := int(mask.sum()):
            spans = spans_of_mask(mask, record.t, start_ns)
            yield Finding(code, severity, name, count, spans, values.get(code, {}))
    if record.train_speed is not None:
        unknown, unknown_s = np.zeros(len(record), dtype=np.bool_), 0.0
        for s in applications:
            unknown[s], lasts = rail_under_slides.unknown_slip(record, s, vehicle)
            unknown_s += lasts
        if unknown_s > HIDDEN_TIME:
            count, spans = int(unknown.sum()), spans_of_mask(unknown, record.t, start_ns)
            yield Finding("slip-unknown", "warning", name, count, spans, {"unknown_s": unknown_s})
    if ref.runout:
        yield Finding("wheel-runout", "info", channel=name, values={"share": ref.runout})
    if ref.averaged > _SURE_PROBABILITY:
        yield Finding("speed-averaged", "info", channel=name)
    if ref.pad_lag:
        yield Finding("pads-lag", "info", channel=name, values={"lag_s": ref.pad_lag})
    if ref.pulses < _FEW_PULSES:
        yield Finding("few-pulses", "warning", channel=name, values={"pulses": ref.pulses})
    if not applications:
        yield Finding("no-application", "info", channel=name)


def _without_value(
    record: AxleRecord, vehicle: Vehicle, ref: Reference, limits: LockLimits
) -> dict[str, tuple[Severity, Bools]]:
    """Where the reference has no value, by the reason."""
    turning = np.zeros(len(record), dtype=np.bool_)
    for run in signals.moving(record):
        turning[run] = True
    driven = signals.driven(record, vehicle.radius(record.axle).value)
    brief_turns = turning & ~driven & ~np.isfinite(ref.force)
    locked = np.zeros(len(record), dtype=np.bool_)
    for lock in locks_of_axle(record, vehicle.radius(record.axle).value, limits):
        # without a brake, the sensor stands
        locked[lock.samples] = bool((record.clamping_force[lock.samples] > physics.NO_FORCE).any())
    brief_turn_finding: tuple[str, Severity] = "turns-too-briefly", "info"
    if any(brief_turns[s].any() and turning[s].all() for s in record.segments):
        brief_turn_finding = "no-reference", "warning"
    return {
        "standstill": ("info", ~turning & ~locked),
        "wheel-locked": ("warning", locked),
        "traction": ("info", driven),
        brief_turn_finding[0]: (brief_turn_finding[1], brief_turns),
    }


def _impossible_force(
    record: AxleRecord, vehicle: Vehicle, ref: Reference
) -> dict[str, tuple[Severity, Bools]]:
    """Where the force is one that no rail and no brake gives."""
    surely = np.nan_to_num(np.abs(ref.force) - ref.half_width)
    impossible = physics.coefficient(surely, vehicle, record.axle) > _HIGHEST_COEFFICIENT
    # Without adhesion the wheel slows by aφK, and no rail makes it slow harder.
    K, w = record.clamping_force_smooth, physics.wheelset(vehicle, record.axle)
    highest_K = float(K.max(initial=0.0))
    negative = np.nan_to_num(ref.upper) < -_MODEL_ERROR * w.phi * highest_K
    negative &= (physics.RELEASED_SHARE * highest_K < K) & ~impossible
    slowing = w.a * (w.phi * K - np.nan_to_num(ref.force)) * vehicle.radius(record.axle).value
    locks = slowing > physics.LOCKING
    return {
        "coefficient-too-high": ("warning", impossible),
        "speed-signal-loss": ("warning", negative & locks),
        "force-negative": ("warning", negative & ~locks),
    }
