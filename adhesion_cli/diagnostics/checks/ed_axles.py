"""An ED force that is spread over axles which have no ED brake: their cylinders keep the pressure.

Blending takes pressure off the cylinders of the axles whose motors brake. So an axle that keeps its
pressure while others lose theirs has no part in the ED force.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import fraction
from ...core.physics import CRAWL
from ...train.grid import FEWEST
from ..registry import About
from ..scene import Scene

ABOUT = About("Axles of the ED force", "motors", 10)
_EQUAL = 0.05  # of the highest force: more, and each axle has its own


class Params(NamedTuple):
    """Thresholds."""

    acts: Annotated[float, fraction("of the highest ED force, which acts on the pressures")] = 0.3
    blended: Annotated[float, fraction("of an axle's highest pressure: ED replaces it")] = 0.5
    kept: Annotated[float, fraction("of the others' highest pressure: it replaces nothing")] = 0.8


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding where a force is spread evenly, and only some axles are blended."""
    g = s.grid
    if g.motors is None:
        return
    by_motors = np.nan_to_num(g.motors)
    highest = float(by_motors.max(initial=0.0))
    t = g.start_ns + 1e9 * g.step * np.arange(by_motors.shape[1])
    # while another brake acts, too: the grid has no pressure there
    rows = [(a.record.t, a.smooth_pressure) for a in s.axles]
    pressure = np.array([np.interp(t, own_t, x) for own_t, x in rows if x is not None])
    if len(pressure) < len(rows):
        return
    acts = (by_motors.min(axis=0) > p.acts * highest) & (g.fastest > CRAWL)
    if not highest or acts.sum() < FEWEST or np.ptp(by_motors, axis=0).max() > _EQUAL * highest:
        return
    tops = pressure.max(axis=1)
    usual = np.median(pressure[:, acts], axis=1)
    is_blended, keeps = usual < p.blended * tops, usual > p.kept * tops.max()
    if is_blended.any() and keeps.any() and (is_blended | keeps).all():
        first = int(np.argmax(keeps))
        numbers = [[a.record.axle for a, x in zip(s.axles, mask, strict=True) if x]
                   for mask in (is_blended, keeps)]  # fmt: skip
        blended, others = (", ".join(map(str, x)) for x in numbers)
        names = {"blended": blended, "others": others}
        yield s.finding("ed-force-axles", "warning", s.axles[first].brake, acts, first, {}, names)
