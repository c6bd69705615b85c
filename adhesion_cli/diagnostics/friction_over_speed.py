"""A brake that slows the train harder at low speed than at high speed, at the same pressure.

Cast iron does, and so do some pads and blocks. A straight line over the speed, as the log shows
one, is no friction of cast iron.
"""

from collections.abc import Iterator

from ..core.finding import Finding
from ..core.model import SpeedEffect, Vehicle
from ..core.physics import friction_change


def check(stated: Vehicle, effect: SpeedEffect | None) -> Iterator[Finding]:
    """One finding, where the friction changes with the speed by more than is stated.

    What the friction table of the stated vehicle says is not in the `effect`.
    """
    if effect and friction_change(effect, stated):
        speeds = {"low_kmh": 3.6 * effect.low, "high_kmh": 3.6 * effect.high}
        values = {"factor": effect.ratio, **speeds}
        states_change = stated.friction_table or stated.friction_fade.value
        names = {
            "more": " after the stated friction is taken into account" if states_change else ""
        }
        yield Finding("friction-over-speed", "warning", values=values, names=names)
