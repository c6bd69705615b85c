"""Stops in closed loop: a tab for each axle, its controllers side by side."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core.model import Times
from ...core.text import printable
from ...core.toml import Table
from ...rail.slope import Bands
from ...wsp.stop import Stop
from .. import palette
from . import parts
from .curve import curve_view, send_curve

_SLIPS = (-10.0, 50.0)  # drawn: what is judged ahead may be far more [%]
_SPEEDS = "blue: wheel, grey: train"  # what the colours mean, in the titles of charts
_PRESSURES = "blue: cylinder, grey: demand"
_FORCES = "yellow: true, orange: estimated, grey: peak of the rail"
_JUDGED = "blue: measured, orange: judged"
_AHEAD = " of the slip judged ahead; points: true slip"


@dataclass(frozen=True, slots=True)
class StopsPage:
    """Stops of one train under several controllers and the views that show them."""

    stops: Sequence[Stop]  # one per controller
    weight: float  # of an axle on the rail [N]
    bands: Mapping[str, Bands]  # of the AND-test, by the controllers that make it
    verdict: str  # text of the first tab
    settings: Table  # that the stops were made from

    def send(self, rec: rr.RecordingStream) -> None:
        """Send everything."""
        verdict_text = self.verdict.replace("`", "'")  # a log's words do not end the block
        parts.send_text(rec, "verdict", f"```\n{verdict_text}\n```")
        parts.send_text(rec, "about", parts.settings_table(self.settings))
        colours = {x.controller: palette.rgba(palette.of_method(x.controller)) for x in self.stops}
        parts.send_names(rec, "lines", _since_start, int(self.stops[0].t[0]), [*colours.items()])
        # Lines may coincide: the viewer draws by name, so the last is the thinnest.
        widths = {name: 1.5 + 2.0 * i for i, name in enumerate(sorted(colours, reverse=True))}
        for stop in self.stops:
            train = [(stop.controller, colours[stop.controller], stop.train_speed * 3.6)]
            path = f"train/{stop.controller}"
            plot = parts.lines("", train, widths[stop.controller])
            parts.send_plot(rec, path, _since_start, stop.t, plot)
            for i in range(stop.pressure.shape[1]):
                self._send_axle(rec, f"{stop.controller}/axle/{i + 1}", stop, i)

    def _send_axle(self, rec: rr.RecordingStream, path: str, stop: Stop, i: int) -> None:
        series = {
            "speed": [
                ("train", parts.TRAIN, stop.train_speed * 3.6),
                ("wheel", parts.WHEEL, stop.rim_speed[:, i] * 3.6),
            ],
            "pressure": [
                ("without controller", parts.REFERENCE, stop.demand * 1e-5),
                ("cylinder", parts.PRESSURE, stop.pressure[:, i] * 1e-5),
            ],
            "force": [
                (f"estimated ({stop.algo})", parts.CLAMPING, stop.estimate[:, i]),
                ("true", parts.TRUTH, stop.force[:, i]),
                ("peak of the rail", parts.REFERENCE, stop.peak[:, i]),  # the last lies above
            ],
            "judged": [
                ("measured", parts.WHEEL, 100.0 * stop.measured_slip[:, i]),
                ("judged", parts.CLAMPING, 100.0 * stop.judged_slip[:, i]),
            ],
            "slope": [("slope dµ/ds", parts.SLOPE, stop.slope[:, i])],
            "confidence": [("confidence", parts.REFERENCE, stop.confidence[:, i])],
        }
        for name, columns in series.items():
            parts.send_plot(rec, f"{path}/{name}", _since_start, stop.t, parts.lines(name, columns))

        t = np.append(stop.t, 2 * stop.t[-1] - stop.t[-2])  # a state lasts until the next
        for name, codes, states in (
            ("valve", stop.valve, parts.VALVES),
            ("region", stop.region, parts.REGION_STATES),
            ("wheel", stop.sliding(), parts.WHEELS),
        ):
            codes_shown = np.append(codes[:, i], -1)
            parts.send_states(rec, f"{path}/state/{name}", _since_start, t, codes_shown, states)

        bands = self.bands.get(stop.controller)
        if bands:
            for name, lower, upper in (
                ("judged", 100.0 * bands.slip_low, 100.0 * bands.slip_high),
                ("slope", bands.slope_low, bands.slope_high),
            ):
                parts.send_band(rec, f"{path}/{name}", _since_start, stop.t, lower, upper)
        slip, mu = stop.slip[:, i], stop.force[:, i] / self.weight
        peak = stop.peak_slip[:, i], stop.peak[:, i] / self.weight
        send_curve(rec, f"{path}/slip", _since_start, stop.t, slip, mu, bands, peak, judged=_AHEAD)

    def layout(self) -> rrb.Container:
        """Tabs: the verdict, one per axle with a column per controller, the settings."""
        speed = parts.named_charts("", [parts.chart("train", "Train speed [km/h]")], "lines")
        verdict = rrb.TextDocumentView(origin="verdict", name="Verdict")
        first_tab = rrb.Vertical(verdict, speed, row_shares=[1, 1], name="Verdict")
        axles = (self._axle_tab(i + 1) for i in range(self.stops[0].pressure.shape[1]))
        return rrb.Tabs(first_tab, *axles, rrb.TextDocumentView(origin="about", name="Settings"))

    def _axle_tab(self, axle: int) -> rrb.Container:
        """Two tabs: where the wheel and its brake were, and what the unit made of it."""
        wheel, judged, i, all_stops = [], [], axle - 1, self.stops
        # Each chart has the same range for all controllers.
        speed = parts.span_of([x.train_speed * 3.6 for x in all_stops], [])
        pressures = [x * 1e-5 for s in all_stops for x in (s.demand, s.pressure[:, i])]
        pressure = parts.span_of(pressures, [])
        forces = [s.force[:, i] for s in all_stops]
        top = 1.2 * max(float(np.nanmax(F)) for F in forces)  # what dry rail gives is far more
        limited_peaks = [np.minimum(s.peak[:, i], top) for s in all_stops]
        # The estimate of a locked wheel can be anything.
        estimates = [np.clip(s.estimate[:, i], -0.1 * top, top) for s in all_stops]
        force = parts.span_of([*forces, *limited_peaks], estimates)
        for stop in all_stops:
            title, path = stop.controller, f"{stop.controller}/axle/{axle}"
            views = [
                parts.chart(f"{path}/speed", f"{title}: speed [km/h], {_SPEEDS}", speed),
                parts.chart(f"{path}/pressure", f"{title}: pressure [bar], {_PRESSURES}", pressure),
                parts.states_view(f"{path}/state", f"{title}: valves, region on the curve, wheel"),
                curve_view(f"{path}/slip", title),
            ]
            wheel.append(rrb.Vertical(*views, row_shares=[2.6, 2.5, 2.6, 4.0]))
            views = [
                parts.chart(f"{path}/force", f"{title}: force [N], {_FORCES}", force),
                parts.chart(f"{path}/judged", f"{title}: slip [%], {_JUDGED}", _SLIPS),
                *parts.slope_charts(path, title, stop.slope[:, i], self.bands.get(title)),
            ]
            judged.append(rrb.Vertical(*views, row_shares=[2.0, 2.0, 2.0, 1.0]))
        return rrb.Tabs(
            rrb.Horizontal(*wheel, name="Wheel, valves, slip"),
            rrb.Horizontal(*judged, name="Force, slip, slope"),
            name=f"Axle {axle}",
        )


def _since_start(t: Times) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("time", duration=t.astype("timedelta64[ns]"))]


def write_stops(path: Path, name: str, page: StopsPage) -> None:
    """Write stops side by side, a tab for each axle."""
    key = repr([name, *((s.controller, s.seed, s.air, len(s.t)) for s in page.stops)])
    parts.write(path, printable(name), key, [page])
