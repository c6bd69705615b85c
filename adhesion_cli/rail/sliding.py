"""When an axle slides, and when it creeps at the rail's limit."""

import numpy as np

from ..core.masks import runs_within
from ..core.model import AxleRecord, AxleResult, Floats
from ..core.physics import SLIDE
from . import events
from .events import END_SLIP, Slide
from .speed_errors import CLEAR_SIGMAS, has_uncertain_delay, speed_error

_SHORTEST_CREEP = 0.5  # least duration of creep that is no oscillation of the speeds [s]


def slides(axle: AxleResult) -> list[Slide]:
    """Slides of a braked axle, in the order of time; none reaches across segments.

    Slip within the error and noise of the train speed is no slide. With an uncertain delay, the
    slides have the least slip that is certain.
    """
    if axle.slip is None:
        return []
    clear = certain_slip(axle.record, axle.slip)
    return find_slides(axle, clear if has_uncertain_delay(axle.record) else axle.slip, clear)


def find_slides(axle: AxleResult, s: Floats, certain: Floats) -> list[Slide]:
    """The same of a slip, and of the part of it that is certain, shape (n,).

    The brake is applied in a slide, or was a second before.
    """
    record, slides = axle.record, []
    assert record.train_speed is not None
    columns = record.segments, record.t, record.train_speed, s, certain, axle.reference.force
    is_lower_bound = record.train_speed_made or has_uncertain_delay(record)
    depth = None if axle.slip_noise is None else CLEAR_SIGMAS * axle.slip_noise
    error = None if is_lower_bound else lasting_error(axle, s)
    for x in events.slides(*columns, is_lower_bound, depth, axle.reference.brake, error):
        earlier_t = record.t[: x.samples.start]
        brake_start = int(np.searchsorted(earlier_t, record.t[x.samples.start] - 1_000_000_000))
        if (record.clamping_force[brake_start : x.samples.stop] > 0.0).any():
            slides.append(x)
    return slides


def possible_begin(axle: AxleResult, start: int, earliest: int) -> tuple[int, int]:
    """First and last sample at which the first slide may begin, which is seen at sample `start`.

    A slide that the error of the slip hides may begin before it, from the sample `earliest` on. As
    its slip crosses `END_SLIP`, the error moves the begin.
    """
    s = axle.slip
    assert s is not None  # there is no slide without
    error = lasting_error(axle, s)
    if axle.slip_noise is not None:
        error = np.hypot(error, CLEAR_SIGMAS * axle.slip_noise)
    first, t = start, axle.record.t
    for run in runs_within(s + error > SLIDE, [slice(earliest, start)]):
        if t[run.stop - 1] - t[run.start] > 1e9 * events.SHORTEST_SLIDE:
            first = run.start
            break
    rolls = ~(s + np.minimum(error, events.ROLLS) > END_SLIP)
    rolling = earliest + np.flatnonzero(rolls[earliest:first])
    surely = start + np.flatnonzero(s[start:] - error[start:] > END_SLIP)
    last = int(surely[0]) if len(surely) else start
    return int(rolling[-1]) + 1 if len(rolling) else earliest, last


def lasting_error(axle: AxleResult, s: Floats) -> Floats:
    """Expanded error of a slip by the train speed's delay and the wheel's radius, shape (n,)."""
    by_radius = CLEAR_SIGMAS * axle.radius_share * np.clip(1.0 - s, 0.0, 1.0)
    error: Floats = np.hypot(s - certain_slip(axle.record, s), by_radius)
    return error


def certain_slip(record: AxleRecord, s: Floats) -> Floats:
    """Slip minus the possible error of the train speed, shape (n,); a locked wheel has none."""
    return s - CLEAR_SIGMAS * speed_error(record) * np.clip(1.0 - s, 0.0, 1.0)


def limited_from(axle: AxleResult, start_ns: int, end_ns: int) -> int | None:
    """When adhesion first limits the wheel, between two times [ns]; None where it does not.

    With a WSP this is before the first slide: at the first lasting creep above a rolling wheel's.
    """
    record, s = axle.record, axle.slip
    if s is None or record.train_speed is None:
        return None
    runs = [x.samples for x in slides(axle)] + find_creep(record, s)
    starts = [int(record.t[x.start]) for x in runs]
    return min((t for t in starts if start_ns <= t <= end_ns), default=None)


def find_creep(record: AxleRecord, s: Floats) -> list[slice]:
    """Where a braked wheel has lasting slip above a rolling wheel's, in the order of time.

    Slip s has shape (n,). Its certain part counts; all of it where nothing is known of the train
    speed's delay, which may hide a wheel at its limit.
    """
    s = s if record.train_speed_late is None else certain_slip(record, s)
    runs = runs_within((s > END_SLIP) & (record.clamping_force > 0.0), record.segments)
    shortest = _SHORTEST_CREEP * 1e9
    return [x for x in runs if record.t[x.stop - 1] - record.t[x.start] >= shortest]
