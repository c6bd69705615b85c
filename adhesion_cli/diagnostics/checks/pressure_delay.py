"""A pressure that is delayed against the wheel speed, as the joint fit of the train finds it."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

from ...core.finding import Finding, Severity
from ...core.model import Z95, Quantity
from ...train.longitudinal import EARLY
from ..registry import About
from ..scene import Scene

ABOUT = About("Delay of the pressure", "delay", 10)


class Params(NamedTuple):
    """Thresholds."""

    warns: Annotated[
        float, Quantity("s", "the force is wrong in every build-up; less is a valve's")
    ] = 0.25


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """The delay, if the fit is sure of one."""
    delay = s.explanation.pressure_delay
    if delay.value:
        values = {"delay_s": delay.value, "delay_u95_s": Z95 * delay.tolerance}
        names = {
            "sense": "late" if delay.value > 0.0 else "early",
            "amount": f"{abs(delay.value):.2f}",
            "why": " Other axles of the train may brake later." if delay.value < 0.0 else "",
        }
        # No sensor is early, so either a clock is wrong or the other axles brake later.
        severity: Severity = "warning" if not -EARLY <= delay.value <= p.warns else "info"
        yield s.finding("pressure-delay", severity, s.axles[0].brake, values=values, names=names)
