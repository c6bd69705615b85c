"""Brakes of which a channel says that they act: a magnetic track brake, a retarder."""

from collections.abc import Sequence

import numpy as np

from ..core.finding import Finding
from ..core.masks import spans_of_mask, true_runs
from ..core.model import OTHER_BRAKES, Bools, Channel, Log
from ..core.physics import CRAWL
from .axle_channels import AxleChannels
from .faults import View

_ACTING_SHARE = 0.1  # of the highest value of a channel: from there its brake acts


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
