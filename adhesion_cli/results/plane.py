"""Places on a plane, for maps without a network."""

from typing import NamedTuple

import numpy as np

from ..core.model import Floats
from ..records.route import Route

_KM_PER_DEGREE = 111.195  # of a mean meridian


class Plane(NamedTuple):
    """Kilometres to the east and to the north of a place: a map without distortion around it."""

    latitude: float
    longitude: float

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """East and north of latitudes and longitudes (n, 2), each (n,) [km]."""
        scale = _KM_PER_DEGREE * float(np.cos(np.radians(self.latitude)))
        east = scale * (places[:, 1] - self.longitude)
        return east, _KM_PER_DEGREE * (places[:, 0] - self.latitude)


def kilometre_posts(route: Route, most: int = 12) -> tuple[list[str], Floats]:
    """Names of whole kilometres of the line along a way, and latitudes and longitudes, (n, 2).

    So many at most; none without positions on the line.
    """
    trace = route.positions
    if route.coordinates is None or route.position_from != "position":
        return [], np.empty((0, 2))
    km = trace.value / 1e3
    spacing = next(x for x in (1, 2, 5, 10, 20, 50, 100, 10**9) if np.ptp(km) / x <= most)
    counts = np.floor(km / spacing)
    passed = np.flatnonzero((np.diff(counts) != 0.0) & ~trace.jumps) + 1
    places = route.coordinates.at(trace.t[passed])
    known = np.isfinite(places).all(axis=1)
    whole = spacing * np.maximum(counts[passed], counts[passed - 1])[known]
    return [f"km {x:g}" for x in whole], places[known]
