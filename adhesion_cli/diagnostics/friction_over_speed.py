"""A brake that slows the train harder at low speed than at high speed, at the same pressure.

Cast iron does, and so do some pads and blocks. A straight line over the speed, as the log shows
one, is no friction of cast iron: the highest µ at the end of a stop is not in its band.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

from ..core import physics
from ..core.finding import Finding
from ..core.model import SpeedEffect, Vehicle

_SIGMAS = 2.5  # from which the friction changes with the speed
_FACTOR = 1.25  # and by how much at least: gradients that change on the way look alike


def check(stated: Vehicle, effect: SpeedEffect | None) -> Iterator[Finding]:
    """One finding, where the friction changes with the speed by more than is stated.

    Args:
        stated: vehicle. What its friction table says is not in the effect.
        effect: as the log shows it; None where it does not.
    """
    if effect is None:
        return
    without_table = replace(stated, friction_table=None)
    share_at_low, share_at_high = (
        physics.friction_share(v, 0.0, without_table) for v in (effect.low, effect.high)
    )
    unexplained = abs(math.log(effect.ratio * share_at_high / share_at_low))
    if unexplained > max(_SIGMAS * effect.sigma, math.log(_FACTOR)):
        speeds = {"low_kmh": 3.6 * effect.low, "high_kmh": 3.6 * effect.high}
        values = {"factor": effect.ratio, **speeds}
        yield Finding("friction-over-speed", "warning", values=values)
