"""Changes of the pressure to which the train responds otherwise than to the rest.

A sensor whose zero or scale changes within the log shows changes that the train does not follow, or
follows by another share than elsewhere. A vehicle that is stated wrong changes all shares alike.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import Quantity
from ...dynamics.train_grid import Scene
from ..registry import About

ABOUT = About("Response to changes of the pressure", "force", 30)


class Params(NamedTuple):
    """Thresholds."""

    pads: Annotated[
        float, Quantity("-", "of the response: friction varies with speed and heat", 0.0, 1.0)
    ] = 0.2
    sigmas: Annotated[float, Quantity("-", "of the difference, so that it is no noise", 0.0)] = 3.0
    known: Annotated[
        float, Quantity("-", "1 sigma of a response: with more, the log hardly shows it", 0.0)
    ] = 0.2


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """The run of changes that differs most clearly from all others."""
    known = [r for r in s.explanation.responses if r.value.tolerance < p.known]
    if len(known) < 2:
        return
    times, sigma = np.array([r.value for r in known]).T
    weight = sigma**-2.0
    first, last = np.triu_indices(len(known))
    whole, sums = (np.append(0.0, np.cumsum(x)) for x in (weight, weight * times))
    own = whole[last + 1] - whole[first]
    others = whole[-1] - own
    others[others <= 1e-9 * whole[-1]] = np.nan  # a run of all changes has no others
    inside = sums[last + 1] - sums[first]
    mean, rest = inside / own, (sums[-1] - inside) / others
    clearly = np.abs(mean - rest) - p.pads * np.maximum(mean, rest)
    clearly = np.nan_to_num(clearly - p.sigmas * np.hypot(own**-0.5, others**-0.5), nan=-1.0)
    if clearly.max() <= 0.0:
        return
    # Of two parts that differ from each other, the one further from 1.
    best = np.flatnonzero(clearly > clearly.max() - 1e-9)
    k = int(best[np.argmax(np.abs(np.log(np.maximum(mean[best], 1e-3))))])
    where = np.zeros(s.grid.rim.shape[-1], dtype=np.bool_)
    begin, end = known[first[k]].begin, known[last[k]].end
    where[round(begin / s.grid.step) : round(end / s.grid.step) + 1] = True
    values = {"factor": float(mean[k]), "others_factor": float(rest[k])}
    yield s.found("response-inconsistent", "warning", s.axles[0].brake, where, 0, values)
