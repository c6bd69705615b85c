"""A train that for a while slows more, or less, than its pressure explains.

The joint fit gives every piece of the log the gradient that would explain what the pressure of the
stated vehicle does not. A gradient that no railway has is another brake or a wrong pressure.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding, Severity
from ...core.model import Quantity
from ...core.physics import RELEASED_SHARE, G
from ..registry import About
from ..scene import Scene

ABOUT = About("Deceleration by the pressure", "force", 60)


class Params(NamedTuple):
    """Thresholds."""

    gradient: Annotated[float, Quantity("m/s²", "that no gradient has for long: 3.5 %")] = 0.35
    sigmas: Annotated[float, Quantity("-", "from that, so that it is no noise")] = 1.0
    lasts: Annotated[float, Quantity("s", "a turn of slide protection is shorter")] = 3.0


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Pieces with an impossible gradient; slower than explained is positive."""
    g = s.grid
    K = np.max(np.nan_to_num(g.clamping), axis=0)
    released = RELEASED_SHARE * K.max(initial=0.0) > K
    mask, largest = np.zeros(g.rim.shape[-1], dtype=np.bool_), 0.0
    for start, stop, gradient in s.explanation.pieces:
        is_significant = abs(gradient.value) - p.sigmas * gradient.tolerance > p.gradient
        samples = slice(round(start / g.step), round(stop / g.step) + 1)
        is_traction = gradient.value > 0.0 and bool(released[samples].all())
        if is_significant and stop - start > p.lasts and not is_traction:
            mask[samples] = True
            largest = max(largest, -gradient.value, key=abs)
    if mask.any():
        values = {"difference_mps2": largest, "gradient_share": abs(largest) / G}
        # A wheel that slows too little may slide: nothing else tells how fast the train is.
        slides = g.train is None and len(s.axles) == 1 and largest < 0.0
        severity: Severity = "info" if slides else "warning"
        yield s.finding("deceleration-unexplained", severity, s.axles[0].brake, mask, 0, values)
