"""One axle's pressure that departs from the others': one brake feeds all of them."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding, Severity
from ...core.model import Quantity
from ...core.units import others
from ...dynamics.pressure_comparison import Odd, odd
from ...dynamics.train_grid import Scene
from ..registry import About
from .impossible_values import named

ABOUT = About("Pressures against each other", "axles", 10)


class Params(NamedTuple):
    """Thresholds."""

    braked_less: Annotated[
        float, Quantity("-", "of the others' pressure: an axle by design has more", 0.0, 1.0)
    ] = 0.6
    least: Annotated[
        float, Quantity("-", "of the others' pressure: no axle is braked by less", 0.0, 1.0)
    ] = 0.3


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Pressures that are stuck, lost, offset, delayed or drift while the others do not."""
    for o, either in odd(s.axles, s.grid):
        yield _found(p, s, o, either)


def _found(p: Params, s: Scene, o: Odd, either: bool) -> Finding:
    a = s.axles[o.axle]
    names = {
        "quantity": str(a.brake.meaning).replace("_", " ").capitalize(),
        "reference": "the other axle" if either else "the others",
    }
    values = {"delay_s": o.late} if o.late else {"factor": o.ratio}
    code = "axle-pressure-differs"
    severity: Severity = "warning"
    likely = others(a.brake, s.vehicle, lambda f: 0.8 < f * o.ratio < 1.25)
    if o.late:
        code = "axle-pressure-delay"
    elif o.steady:
        code = "axle-pressure-share"
        severity = "info" if p.braked_less < o.ratio < 1.0 / p.braked_less else "warning"
    elif likely and not p.least < o.ratio < 1.0 / p.least:
        code, names["units"] = "pressure-unit-differs", named(likely)
    else:
        most = float(np.median(o.off[o.where]))
        force = a.record.pressure is None
        values = {"offset_n": most} if force else {"offset_pa": most}
        size = f"{abs(most):.0f} N" if force else f"{abs(most) / 1e5:.2g} bar"
        names["offset"] = f"{size} {'above' if most > 0.0 else 'below'}"
    return s.found(code, severity, a.brake, o.where, o.axle, values, names)
