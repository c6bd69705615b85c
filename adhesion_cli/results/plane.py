"""Places on a plane, for maps without a network."""

from typing import NamedTuple

import numpy as np

from ..core.model import Floats
from ..records.route import Route

_KM_PER_DEGREE = 111.195  # of a mean meridian
_MOST_POSTS = 12  # whole kilometres that a map names


class Plane(NamedTuple):
    """Kilometres to the east and to the north of a place: a map without distortion around it."""

    latitude: float
    longitude: float

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """East and north of latitudes and longitudes (n, 2), each (n,) [km]."""
        scale = _KM_PER_DEGREE * float(np.cos(np.radians(self.latitude)))
        east = scale * (places[:, 1] - self.longitude)
        return east, _KM_PER_DEGREE * (places[:, 0] - self.latitude)


def position_label(route: Route) -> str:
    """What the position along a way is."""
    of_line = route.position_from == "position"
    return "position on the line [km]" if of_line else "way since the start of the log [km]"


def kilometre_posts(route: Route) -> tuple[list[str], Floats]:
    """Names of some whole kilometres along a way, and latitudes and longitudes, (n, 2)."""
    trace = route.positions
    if route.coordinates is None or route.position_from != "position":
        return [], np.empty((0, 2))
    km = trace.value / 1e3
    spacing = next(x for x in (1, 2, 5, 10, 20, 50, 100, 10**9) if np.ptp(km) / x <= _MOST_POSTS)
    counts = np.floor(km / spacing)
    passed = np.flatnonzero((np.diff(counts) != 0.0) & ~trace.jumps) + 1
    places = route.coordinates.at(trace.t[passed])
    known = np.isfinite(places).all(axis=1)
    whole = spacing * np.maximum(counts[passed], counts[passed - 1])[known]
    return [f"km {x:g}" for x in whole], places[known]
