"""Brakes that are in no pressure: those of which a channel says that they act, and others.

A brake without a channel ends, or begins, while the pressure of all axles is constant.

A magnetic track brake drops at low speed within some tenths of a second. All axles then slow less
at the same pressure. The speed of each is a parabola with a bend:

    v(s) = a + b s + c s² + d max(s, 0)

fitted to the seconds before and after each time. What lies close to the bend is left out. No
gradient, no friction and no slide that leaves the wheels together has a sudden and large d.

A retarder or a motor fades out in some seconds at low speed: there more is left out, and c is 0.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..core.finding import Finding
from ..core.masks import erode, spans_of_mask, true_runs
from ..core.model import OTHER_BRAKES, Bools, Channel, Log
from ..core.physics import CRAWL, RELEASED_SHARE
from ..records.axle_channels import AxleChannels
from ..records.faults import View
from .grid import Grid

_ACTING_SHARE = 0.1  # of the highest value of a channel: from there its brake acts
_COARSEST_STEP = 0.5  # of a grid that shows a sudden change [s]
_FLAT_TIME = 2.1  # before and after a change [s]
# a change's own half [s]: a track brake drops within tenths of a second, a retarder in seconds
_SUDDEN, _FADING = 0.4, 2.0
# a gradient that changes by 2.5 % does so over the length of a train [m/s²]
_LEAST_CHANGE = {_SUDDEN: 0.25, _FADING: 0.3}
_LEAST_SHARE = {_SUDDEN: 0.15, _FADING: 0.2}  # least change over the deceleration
_FADING_SPEED = 12.0  # highest speed at which a retarder or a motor fades out [m/s]
_SIGMAS = 8.0  # from which a change is no noise; it is coloured
_AXLE_SHARE = 0.5  # of the change of all axles, that each one shows at least
_SLIP = 0.03  # of a wheel that rolls, at most
_CONSTANT = 0.05  # change of a constant K, as a share of it


def other_brake_findings(
    log: Log, axles: Sequence[AxleChannels], view: View
) -> tuple[Finding, ...]:
    """A finding for each brake that acts while the train moves, with its times."""
    findings = []
    for c in log.channels:
        if c.meaning not in OTHER_BRAKES or not len(c.data.t):
            continue
        size = np.abs(c.data.value)
        acting = size > _ACTING_SHARE * float(np.max(size, initial=0.0))
        acting &= _is_moving(c, axles) & view.contains(c.data.t)
        if not (runs := true_runs(acting)):
            continue
        spans = spans_of_mask(acting, c.data.t, view.start_ns)
        name = str(c.meaning).replace("_", " ").replace("magnetic", "magnetic track")
        names = {"reason": f"The {name} is on while the train moves"}
        findings.append(Finding("other-brake", "warning", c.title, len(runs), spans, {}, names))
    return tuple(findings)


def _is_moving(c: Channel, axles: Sequence[AxleChannels]) -> Bools:
    """Whether any wheel turns at the times of a channel, (n,)."""
    is_moving = np.zeros(len(c.data.t), dtype=np.bool_)
    for a in axles:
        r = a.record
        order = np.argsort(r.t, kind="stable")
        rim = r.wheel_speed[order] * a.vehicle.wheel_radius[0].value
        is_moving |= np.interp(c.data.t, r.t[order], rim, left=0.0, right=0.0) > CRAWL
    return is_moving


def find_brake_steps(g: Grid, start_ns: int) -> tuple[Finding, ...]:
    """Findings with the times when another brake acts, after the start of the log [ns]."""
    top = g.smooth(np.max(g.clamping, axis=0))
    places = np.flatnonzero(np.isfinite(top))
    if not len(places):
        return ()
    top = np.interp(np.arange(len(top)), places, top[places])  # a gap ends no brake application
    braked = top > RELEASED_SHARE * np.max(top)
    mask, largest = np.zeros(len(braked), dtype=np.bool_), (0.0, 0.0)
    for half_time in (_SUDDEN, _FADING):
        for place, change in _steps(g, half_time):
            begin, stop = next((x for x in true_runs(braked) if x[0] <= place < x[1]), (0, 0))
            mask[slice(begin, place) if change > 0.0 else slice(place, stop)] = True
            largest = max(largest, (change, half_time), key=lambda x: abs(x[0]))
    if not mask.any():
        return ()
    change, half_time = largest
    verb = "falls" if change > 0.0 else "rises"
    amount = f"{abs(change):.2g} m/s² within {2.0 * half_time:.2g} s"
    names = {"reason": f"The deceleration {verb} by {amount} at the same pressure"}
    spans = spans_of_mask(mask, g.t, start_ns)
    return (Finding("other-brake", "warning", "", len(spans), spans, {}, names),)


def _steps(g: Grid, half_time: float) -> Iterator[tuple[int, float]]:
    """The place of each change of acceleration on the grid, and the change [m/s²].

    It lasts twice `half_time` [s]. Only a sudden one may slow the train more: so does, in some
    seconds, the friction of cast iron at low speed. No friction slows it less in so short a time.
    """
    j, n = round((_FLAT_TIME + half_time) / g.step), g.rim.shape[-1]
    if g.step > _COARSEST_STEP or n < 4 * j:
        return
    s = g.step * np.arange(-j, j + 1)
    is_fitted = np.abs(s) > half_time
    parabola = [s**2] if half_time == _SUDDEN else []  # a slow trend is no change in some seconds
    basis = np.stack([np.ones_like(s), s, *parabola, np.maximum(s, 0.0)], axis=1)[is_fitted]
    inverse = np.linalg.pinv(basis)
    by_axle = sliding_window_view(g.rim + g.climb, len(s), axis=-1)[..., is_fitted]
    v = np.mean(by_axle, axis=0)
    x = v @ inverse.T
    freedom = len(basis) - basis.shape[1]
    noise = np.sqrt(np.sum((v - x @ basis.T) ** 2, axis=-1) / freedom)
    sigma, change = noise * float(np.linalg.norm(inverse[-1])), x[:, -1]
    least_change = np.maximum(_LEAST_CHANGE[half_time], -_LEAST_SHARE[half_time] * x[:, 1])
    change_of_axles = by_axle @ inverse[-1] * np.sign(change)
    is_change = np.abs(change) > np.maximum(least_change, _SIGMAS * sigma)
    if half_time == _FADING:
        is_change &= (change > 0.0) & (x[:, 0] < _FADING_SPEED)
    is_change &= (change_of_axles > _AXLE_SHARE * np.abs(change)).all(axis=0) & _is_steady(g, j)
    for begin, stop in true_runs(is_change):
        k = begin + int(np.argmax(np.abs(change[begin:stop]) / sigma[begin:stop]))
        yield j + k, float(change[k])


def _is_steady(g: Grid, j: int) -> Bools:
    """Whether all axles roll and are braked alike j steps before and after, (n - 2 j,)."""
    K = sliding_window_view(g.clamping, 2 * j + 1, axis=-1)
    highest = np.max(K, axis=-1)
    constant: Bools = np.all(highest - np.min(K, axis=-1) < _CONSTANT * highest, axis=0)
    slides = np.abs(g.share - 1.0) > _SLIP  # at low speed there is no share
    rolls: Bools = np.all(~slides & (g.rim > CRAWL), axis=0)
    return constant & erode(rolls, j)[j:-j]
