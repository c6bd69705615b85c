"""Where a train was over time: its position on the line, its latitude and longitude.

The position is what a channel of it shows, else the distance since the start of the log, else the
length of the way between the coordinates.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.masks import edges, spans_of
from ..core.model import PLACES, Bools, Channel, Column, Floats, Log, Meaning, Times, Vehicle
from ..core.signals import in_order, running_integral
from ..core.summary import PositionSource
from ..core.text import iso
from ..core.time_axis import gap_limit

_ALONG: tuple[Literal["position", "distance"], ...] = ("position", "distance")
_EARTH = 6_371_008.8  # mean radius [m]
_FASTEST = 120.0  # no train is faster [m/s]
_SPEED_MARGIN = 1.5  # a place may move so much faster than the speed says
_LEAST_JUMP = 50.0  # corrections of an odometer are shorter [m]
_LEAST_GAP = 5.0  # places further apart are not interpolated [s]
_MOVING = 1.0  # below, the noise of a receiver is no way [m/s]
_WAY_INTERVAL = 1.0  # between coordinates whose distances are added [s]
_CONTRADICTION = 0.05  # of the way against the speed, as a share
_CONTRADICTION_TO_WHEELS = 0.25  # the same of wheels, which may all slide
_LEAST_WAY = 200.0  # a shorter way shows no contradiction [m]
_POINT_DISTANCE = 5.0  # between points of a drawn way [m]


class Location(NamedTuple):
    """When and where the train was; None where not known."""

    time: str | None = None  # ISO 8601
    position_m: float | None = None
    latitude: float | None = None
    longitude: float | None = None

    @property
    def position_km(self) -> float | None:
        """The position [km]."""
        return None if self.position_m is None else round(self.position_m / 1e3, 6)


class Trace(NamedTuple):
    """Places over time; times rise."""

    t: Times  # (n,) [ns]
    value: Floats  # positions [m], (n,), or latitudes and longitudes [°], (n, 2)
    jumps: Bools  # whether the place jumps between a sample and the next one, (n - 1,)
    joined: Bools  # whether what is between them is known: no jump and no gap, (n - 1,)

    def at(self, t: Times) -> Floats:
        """Places at other times, (m,) or (m, 2); NaN beyond the ends, over jumps and over gaps."""
        places = np.full((len(t), *self.value.shape[1:]), np.nan)
        if len(self.t) < 2:
            return places
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        share = (t - self.t[i]) / (self.t[i + 1] - self.t[i])
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        inside &= self.joined[i] | np.isin(share, [0.0, 1.0])
        weight = share.reshape(len(t), *[1] * (self.value.ndim - 1))
        places[inside] = ((1.0 - weight) * self.value[i] + weight * self.value[i + 1])[inside]
        return places

    def distances(self) -> Floats:
        """Distances between successive places, (n - 1,) [m]."""
        if self.value.ndim == 1:
            return np.abs(np.diff(self.value))
        latitude, longitude = np.radians(self.value).T
        north = np.diff(latitude)
        east = np.diff(longitude) * np.cos((latitude[1:] + latitude[:-1]) / 2.0)
        lengths: Floats = _EARTH * np.hypot(north, east)
        return lengths

    def thinned(self, interval: float) -> "Trace":
        """One sample per interval [s]."""
        _, first_rows = np.unique(self.t // round(1e9 * interval), return_index=True)
        break_counts = np.cumsum([self.jumps, ~self.joined], axis=1)  # each one
        jumps, breaks = np.diff(np.insert(break_counts, 0, 0, axis=1)[:, first_rows]) > 0
        return Trace(self.t[first_rows], self.value[first_rows], jumps, ~breaks)


_EMPTY = Trace(np.empty(0, np.int64), np.empty(0), *[np.empty(0, np.bool_)] * 2)


class Route(NamedTuple):
    """Where a train was."""

    positions: Trace = _EMPTY
    position_from: PositionSource | None = None  # None where no position is known
    coordinates: Trace | None = None
    has_calendar: bool = False

    def at(self, t: int) -> Location:
        """The place at a time [ns]."""
        times = np.array([t], np.int64)
        position = float(self.positions.at(times)[0])
        latitude, longitude = self.coordinates.at(times)[0] if self.coordinates else [np.nan] * 2
        return Location(
            iso(t) if self.has_calendar else None,
            round(position, 3) if np.isfinite(position) else None,
            round(float(latitude), 7) if np.isfinite(latitude) else None,
            round(float(longitude), 7) if np.isfinite(longitude) else None,
        )

    def lines(self) -> list[Floats]:
        """Latitudes and longitudes of the way, (points, 2) each; a new line after each jump."""
        if self.coordinates is None:
            return []
        trace, lines = self.coordinates.thinned(_WAY_INTERVAL), []
        distances = trace.distances()
        for start, stop in edges(~trace.jumps).tolist():
            travelled = np.concatenate([[0.0], np.cumsum(distances[start:stop])])
            _, first_rows = np.unique(np.floor(travelled / _POINT_DISTANCE), return_index=True)
            if len(first_rows) > 1:
                lines.append(np.round(trace.value[start : stop + 1][first_rows], 7))
        return lines


NOWHERE = Route()


def find_route(log: Log) -> Route:
    """Where the train of a log was, by the channels' meanings."""
    columns = {meaning: c.data for meaning, c in _channels(log).items()}
    route = make_route(columns, _speed(log, Vehicle())) if columns else NOWHERE
    return route._replace(has_calendar=log.absolute)


def make_route(columns: Mapping[Meaning, Column], speed: Column | None = None) -> Route:
    """Where a train was.

    `columns` are positions and distances [m], latitudes and longitudes [°], by meaning. No place
    moves faster than `speed` [m/s].
    """
    traces = _traces(columns, speed)
    coordinates = traces.get("latitude")
    for source in _ALONG:
        if trace := traces.get(source):
            start = trace.value[0] if source == "distance" else 0.0
            return Route(trace._replace(value=trace.value - start), source, coordinates)
    if coordinates is None:
        return NOWHERE
    thinned = coordinates.thinned(_WAY_INTERVAL)  # noise of every sample would add up
    is_at_rest = speed is not None and _larger_speeds(thinned.t, speed) <= _MOVING
    steps = np.where(thinned.jumps | is_at_rest, 0.0, thinned.distances())
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    return Route(thinned._replace(value=distance), "coordinates", coordinates)


def check_route(log: Log, vehicle: Vehicle) -> list[Finding]:
    """Findings on places that jump, and on a way that contradicts the speed."""
    speed = _speed(log, vehicle)
    has_train = any(c.meaning == "train_speed" and len(c.data.t) > 1 for c in log.channels)
    share = _CONTRADICTION if has_train else _CONTRADICTION_TO_WHEELS
    channels, findings = _channels(log), list[Finding]()
    columns = {meaning: c.data for meaning, c in channels.items()}
    route = make_route(columns, speed)
    for meaning, trace in _traces(columns, speed).items():
        title = channels[meaning].title
        # a counter beside it may begin anew
        if meaning in (route.position_from, "latitude") and trace.jumps.any():
            spans = spans_of(trace.t[:-1][trace.jumps], trace.t[1:][trace.jumps], log.start_ns())
            values = {"largest_m": float(trace.distances()[trace.jumps].max())}
            count = int(trace.jumps.sum())
            findings.append(Finding("position-jumps", "warning", title, count, spans, values))
        if speed:
            findings += _contradiction(trace.thinned(_WAY_INTERVAL), title, speed, share)
    return findings


def _traces(columns: Mapping[Meaning, Column], speed: Column | None) -> dict[Meaning, Trace]:
    """The places by their meaning, those of the coordinates by `latitude`."""
    traces: dict[Meaning, Trace] = {}
    for meaning in _ALONG:
        t, value = _usable_samples(columns.get(meaning))
        if len(t) > 1:
            traces[meaning] = _trace(t, value, speed)
    coordinates = _coordinates(columns, speed)
    return traces | ({"latitude": coordinates} if coordinates else {})


def _contradiction(trace: Trace, title: str, speed: Column, share: float) -> list[Finding]:
    """A finding where the way of the places is not that of the speed."""
    travelled = _travelled(trace.t, speed)
    is_moving = _larger_speeds(trace.t, speed) > _MOVING
    counted = ~trace.jumps & is_moving & np.isfinite(travelled)
    distance, by_speed = (float(x[counted].sum()) for x in (trace.distances(), travelled))
    if by_speed < _LEAST_WAY or abs(distance - by_speed) <= share * by_speed + _LEAST_JUMP:
        return []
    values = {"way_m": distance, "by_speed_m": by_speed, "share": distance / by_speed}
    return [Finding("distance-contradicts-speed", "warning", title, values=values)]


def _channels(log: Log) -> dict[Meaning, Channel]:
    """The first channel of each meaning of a place."""
    channels = [c for c in reversed(log.channels) if len(c.data.t)]
    return {c.meaning: c for c in channels if c.meaning in PLACES}


def _speed(log: Log, vehicle: Vehicle) -> Column | None:
    """The speed of the train [m/s], else that of the fastest rim."""
    for c in log.channels:
        if c.meaning == "train_speed" and not c.is_rate and len(c.data.t) > 1:
            return c.data
    wheels = [c for c in log.channels if c.meaning == "wheel_speed" and len(c.data.t) > 1]
    if not wheels:
        return None
    t, _ = _usable_samples(max((c.data for c in wheels), key=lambda x: len(x.t)))
    radii = [vehicle.radius(c.axle or 1).value for c in wheels]
    speeds = [np.interp(t, *_usable_samples(c.data)) for c in wheels]
    fastest = np.max(np.array(radii)[:, None] * speeds, axis=0)
    return Column(t, fastest, np.ones(len(t), np.bool_))


def _usable_samples(column: Column | None) -> tuple[Times, Floats]:
    """The samples that may be used, in the order of time, one per time."""
    if column is None:
        return _EMPTY.t, _EMPTY.value
    usable = column.valid & np.isfinite(column.value)
    return in_order(column.t[usable], column.value[usable])


def _coordinates(columns: Mapping[Meaning, Column], speed: Column | None) -> Trace | None:
    """Latitudes and longitudes, without those that a receiver without a fix shows."""
    t, latitude = _usable_samples(columns.get("latitude"))
    other_t, longitude = _usable_samples(columns.get("longitude"))
    if min(len(t), len(other_t)) < 2:
        return None
    points = np.column_stack([latitude, np.interp(t, other_t, longitude)])
    is_fix = (np.abs(points) <= [90.0, 180.0]).all(axis=1) & (points != 0.0).any(axis=1)
    is_fix &= (t >= other_t[0]) & (t <= other_t[-1])
    return _trace(t[is_fix], points[is_fix], speed) if is_fix.sum() > 1 else None


def _trace(t: Times, value: Floats, speed: Column | None) -> Trace:
    """Places with their jumps: the steps that are longer than the train can be fast."""
    nowhere, intervals = np.zeros(len(t) - 1, np.bool_), np.diff(t)
    distances = Trace(t, value, nowhere, ~nowhere).distances()
    is_moving = distances > 0.0
    usual = float(np.median(distances[is_moving])) if is_moving.any() else 0.0  # of a coarse place
    fastest = np.full(len(distances), _FASTEST)
    if speed is not None and len(speed.t):
        fastest = _SPEED_MARGIN * _larger_speeds(t, speed)
    jumps = distances > _LEAST_JUMP + 2.0 * usual + fastest * intervals * 1e-9
    has_gap = intervals > max(gap_limit(intervals), 1e9 * _LEAST_GAP)
    return Trace(t, value, jumps, ~jumps & ~has_gap)


def _larger_speeds(t: Times, speed: Column) -> Floats:
    """The larger speed of each two successive times, (n - 1,) [m/s]."""
    v = np.interp(t, speed.t, speed.value)
    return np.maximum(v[1:], v[:-1])


def _travelled(t: Times, speed: Column) -> Floats:
    """Distances between successive times by the speed, (n - 1,) [m]; NaN over its gaps."""
    speed_times, v = _usable_samples(speed)
    seconds = speed_times * 1e-9 - speed_times[0] * 1e-9
    travelled = running_integral(seconds, v)
    gaps = np.concatenate([[0.0], np.cumsum(np.diff(seconds) > _LEAST_GAP)])
    distance: Floats = np.diff(np.interp(t, speed_times, travelled, np.nan, np.nan))
    distance[np.diff(np.interp(t, speed_times, gaps)) > 0.0] = np.nan
    return distance
