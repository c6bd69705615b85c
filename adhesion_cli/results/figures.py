"""What `--figure` draws: an axle's slip, a stop under every controller, the stops of a sweep."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..core import physics
from ..core.model import AxleResult, Floats, Result, Vehicle
from ..rail.fit import RailFit, curve
from ..rail.rail_under_slides import Summary
from ..rail.slope import REGION_TITLES, Bands
from ..wsp.controller import APPLY, DUMP, HOLD
from ..wsp.stop import Stop
from .charts import Band, Line, Panel
from .palette import BLACK, BLUE, GREEN, GREY, ORANGE, RED, of_method

if TYPE_CHECKING:
    from ..wsp.sweep import SweepRow  # with the whole closed loop, which `slip` has no use for

_OF_REGION = dict(zip(REGION_TITLES, (GREY, BLUE, GREEN, RED), strict=True))
_OF_VALVE = (("apply", APPLY, GREEN), ("hold", HOLD, ORANGE), ("dump", DUMP, RED))
_SLIP, _TIME = "slip [%]", "time [s]"
_MU = "adhesion coefficient µ [-]"
_SLOPES = -0.3, 0.5  # drawn: those of a wheel that rolls are far larger
_DOT = 2.2  # diameter of a point of many


def of_slip(result: Result, summaries: Sequence[Summary], bands: Bands) -> list[Panel]:
    """Curve, slope and confidence of every axle that slid, or of all if none did."""
    pairs = list(zip(result.axles, summaries, strict=True))
    drawn_axles = [(a, s) for a, s in pairs if s.slides] or pairs
    start = result.log.start_ns()
    return [p for axle, s in drawn_axles for p in _axle(axle, s, result.vehicle, bands, start)]


def _axle(
    axle: AxleResult, summary: Summary, vehicle: Vehicle, bands: Bands, start_ns: int
) -> list[Panel]:
    record, name = axle.record, f"axle {axle.record.axle}"
    t = (record.t - start_ns) * np.float64(1e-9)
    slip = np.full(len(t), np.nan) if axle.slip is None else axle.slip
    slope = np.full(len(t), np.nan) if axle.slope is None else axle.slope
    confidence = slope if axle.slope_confidence is None else axle.slope_confidence
    code = np.zeros(len(t), np.int8) if axle.region is None else axle.region
    mu = physics.coefficient(axle.reference.force, vehicle)
    braked = np.zeros(len(t), np.bool_)
    for s in axle.applications:
        braked[s] = True
    slip = np.where(braked, slip, np.nan)
    points = [
        Line(region, 100.0 * np.where(code == i, slip, np.nan), mu, colour, dots=_DOT)
        for i, (region, colour) in enumerate(_OF_REGION.items())
    ]
    spans, curves = [], []
    if summary.rail and (v := record.train_speed) is not None:
        speeds = np.concatenate([v[x.samples] for x in summary.slides])
        largest_slip = max(x.max_slip for x in summary.slides)
        curves = list(_fitted(summary.rail, speeds, vehicle, largest_slip))
        if peak := summary.rail.peak_slip:
            spans = [Band("peak, 95 %", 100.0 * peak.lower, 100.0 * peak.upper, ORANGE)]
    slopes, confidences = Line("slope dµ/ds", t, slope, BLACK), Line("", t, confidence, BLACK)
    title, label = f"{name}: confidence", "confidence of the slope [-]"
    time = float(t[0]), float(t[-1])
    over_time = Panel(f"{name}: slope", _TIME, "slope dµ/ds [-]", [slopes], x_range=time)
    return [
        Panel(f"{name}: µ over slip, by region", _SLIP, _MU, [*points, *curves], bands=spans),
        replace(over_time, y_range=_SLOPES, bands=_slope_band(bands)),
        Panel(title, _TIME, label, [confidences], x_range=time, y_range=(0.0, 1.0)),
    ]


def _fitted(rail: RailFit, speeds: Floats, vehicle: Vehicle, largest_slip: float) -> Iterator[Line]:
    """The likeliest curve up to a slip, at the peak's speed and near the ends of the slides'."""
    slip = np.geomspace(1e-4, largest_slip, 200)
    slowest, fastest = np.quantile(speeds, [0.05, 0.95]).tolist()
    for v, colour in ((rail.speed, BLACK), (slowest, GREY), (fastest, GREY)):
        mu, name = curve(rail.best, v, slip, vehicle), f"fit at {3.6 * v:.0f} km/h"
        yield Line(name, 100.0 * slip, mu, colour, dashed=colour == GREY)


def _slope_band(bands: Bands) -> list[Band]:
    name = "slope band of the AND-test"
    return [Band(name, bands.slope_low, bands.slope_high, GREEN, of_x=False)]


def of_stops(stops: Sequence[Stop], weight: float, bands: Mapping[str, Bands]) -> list[Panel]:
    """Speeds, pressure with valves, operating points and slope of the first axle, a row each.

    Args:
        stops: one per controller.
        weight: of an axle on the rail [N].
        bands: of the AND-test, by the controllers that make it.
    """
    longest = max(float(s.t[-1]) * 1e-9 for s in stops)
    time, largest_demand = (0.0, longest), max(float(np.nanmax(s.demand)) for s in stops) * 1.05e-5
    columns = [
        (
            _speeds(stop, time),
            _pressures(stop, time, largest_demand),
            _operating_points(stop, weight, bands.get(stop.controller)),
            _slope_of_stop(stop, time, bands.get(stop.controller)),
        )
        for stop in stops
    ]
    return [panel for row in zip(*columns, strict=True) for panel in row]


def _speeds(stop: Stop, time: tuple[float, float]) -> Panel:
    t = stop.t * np.float64(1e-9)
    lines = [
        Line("train", t, stop.train_speed * 3.6, GREY),
        Line("wheel", t, stop.rim_speed[:, 0] * 3.6, BLUE),
    ]
    return Panel(f"{stop.controller}: speed, axle 1", _TIME, "speed [km/h]", lines, x_range=time)


def _pressures(stop: Stop, time: tuple[float, float], largest_demand: float) -> Panel:
    t, bar = stop.t * np.float64(1e-9), stop.pressure[:, 0] * 1e-5
    lines = [Line("demand", t, stop.demand * 1e-5, GREY, dashed=True)]
    for name, code, colour in _OF_VALVE:
        pressure = np.where(stop.valve[:, 0] == code, bar, np.nan)
        lines.append(Line(name, t, pressure, colour, dots=_DOT))
    title, y_range = f"{stop.controller}: cylinder, by valve", (0.0, largest_demand)
    return Panel(title, _TIME, "pressure [bar]", lines, x_range=time, y_range=y_range)


def _operating_points(stop: Stop, weight: float, bands: Bands | None) -> Panel:
    slip, mu = stop.slip[:, 0], stop.force[:, 0] / weight
    lines = [
        Line("operating point", 100.0 * slip, mu, BLUE, dots=_DOT),
        Line("the rail's peak", 100.0 * stop.peak_slip[:, 0], stop.peak[:, 0] / weight, RED),
    ]
    spans = []
    if bands:
        spans = [Band("slip band", 100.0 * bands.slip_low, 100.0 * bands.slip_high, GREEN)]
    slip_range = 0.0, 105.0 * min(float(np.nanmax(slip)), 1.0)
    title = f"{stop.controller}: µ over slip"
    return Panel(title, _SLIP, _MU, lines, x_range=slip_range, bands=spans)


def _slope_of_stop(stop: Stop, time: tuple[float, float], bands: Bands | None) -> Panel:
    t = stop.t * np.float64(1e-9)
    lines = [
        Line("slope dµ/ds", t, stop.slope[:, 0], BLACK),
        Line("confidence", t, stop.confidence[:, 0], ORANGE),
    ]
    spans = _slope_band(bands) if bands else []
    title = f"{stop.controller}: slope, confidence"
    return Panel(title, _TIME, "[-]", lines, x_range=time, y_range=(-0.3, 1.0), bands=spans)


_OF_SWEEP = (
    ("stopping_distance_m", "Stopping distance", "m"),
    ("utilisation", "Use of the rail's adhesion", "share"),
    ("air_nl", "Air", "normal litres"),
)


def of_sweep(rows: "Sequence[SweepRow]") -> list[Panel]:
    """Distance, utilisation and air on every rail: means with 2.5 to 97.5 % over the seeds."""
    rails = list(dict.fromkeys(r.rail for r in rows))
    laws = list(dict.fromkeys(r.controller for r in rows))
    panels = []
    for key, title, unit in _OF_SWEEP:
        lines = []
        for n, law in enumerate(laws):
            places, means, intervals = [], [], []
            for r in rows:
                if r.controller == law and (value := r.values[key]):
                    x_position = rails.index(r.rail) + 0.2 * (n - (len(laws) - 1) / 2)
                    places.append(x_position)
                    means.append(value[0])
                    intervals += [(x_position, value[1]), (x_position, value[2]), (np.nan, np.nan)]
            colour, spread = of_method(law), np.array(intervals).reshape(-1, 2)
            lines.append(Line("", spread[:, 0], spread[:, 1], colour))
            lines.append(Line(law, np.array(places), np.array(means), colour, dots=4.5))
        x = (-0.5, len(rails) - 0.5)
        panels.append(Panel(title, "", unit, lines, x_range=x, x_names=rails))
    return panels
