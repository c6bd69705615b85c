"""Wheel speeds that filters predict worse than the noise they assume explains.

Each filter says how sure it is of its prediction. NIS is the mean square of the reading's distance
from the prediction, in units of that. More than 1 means that the filter is too sure of itself.

Less than 1 is no fault: a filter takes a rounded speed for noisier than it is.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, NamedTuple

from ..core.finding import Finding
from ..core.methods import About
from ..core.model import Nis, Quantity

ABOUT = About(
    "Speeds against their prediction",
    "Bar-Shalom Y., Li X., Kirubarajan T.: Estimation with Applications to Tracking and "
    "Navigation, Wiley 2001, section 5.4",
)


class Params(NamedTuple):
    """Thresholds."""

    nis: Annotated[
        float,
        Quantity("-", "of a filter whose noise is fitted in steps of 20 %: up to 1.1", 1.0, 1e6),
    ] = 1.1
    widths: Annotated[
        float, Quantity("-", "of the 95 % interval about 1, so that it is no chance", 0.0, 1e6)
    ] = 1.5


def check(p: Params, channel: str, nis_by_filter: Mapping[str, Nis | None]) -> Iterator[Finding]:
    """One finding, where the speeds of an axle contradict a filter, by the NIS of each filter."""
    contradicted = {
        name: x
        for name, x in nis_by_filter.items()
        if x is not None and x.mean > p.nis * (1.0 + p.widths * (x.high - 1.0))
    }
    if contradicted:
        name = max(contradicted, key=lambda name: contradicted[name].mean)
        values = {"nis": contradicted[name].mean, "expected": contradicted[name].high}
        names = {"filters": ", ".join(contradicted)}
        yield Finding("noise-model", "warning", channel=channel, values=values, names=names)
