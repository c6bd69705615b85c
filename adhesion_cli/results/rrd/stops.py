"""Stops in closed loop: a tab for each axle, its controllers side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core.model import Times
from ...core.stop import Stop
from ...core.text import printable
from ...rail.slope import Bands
from . import parts
from .curve import curve_view, send_curve
from .parts import (
    CLAMPING,
    ESTIMATORS,
    MARKDOWN,
    PRESSURE,
    REFERENCE,
    REGION_STATES,
    SLOPE,
    TRAIN,
    TRUTH,
    VALVES,
    WHEEL,
    WHEELS,
    chart,
    lines,
    send_band,
    send_plot,
    send_states,
    slope_charts,
    span_of,
    states_view,
)

_SLIPS = (-10.0, 50.0)  # drawn: what is judged ahead may be far more [%]
_AHEAD = " of the slip judged ahead; points: true slip"


def write_stops(
    path: Path, name: str, stops: Sequence[Stop], weight: float, bands: Mapping[str, Bands],
    verdict: str,
) -> None:  # fmt: skip
    """Write stops of one train under several controllers, side by side, a tab for each axle.

    Args:
        path: file to write; its old content is lost.
        name: of the scenario.
        stops: one per controller.
        weight: of an axle on the rail [N].
        bands: of the AND-test, by the controllers that make it; theirs alone are drawn.
        verdict: text of the first tab.

    Raises:
        OSError: the file cannot be written or does not read back.
    """
    key = repr([name, *((s.controller, s.seed, s.air, len(s.t)) for s in stops)])
    parts.write(path, printable(name), key, [_Stops(stops, weight, bands, verdict)])


class _Stops:
    """Stops under several controllers and the views that show them."""

    def __init__(
        self, stops: Sequence[Stop], weight: float, bands: Mapping[str, Bands], verdict: str
    ) -> None:
        self.stops, self.weight, self.bands, self.verdict = stops, weight, bands, verdict

    def send(self, rec: rr.RecordingStream) -> int:
        """Send everything; returns the number of rows on a timeline."""
        told = self.verdict.replace("`", "'")  # a log's words do not end the block
        fixed = f"```\n{told}\n```"
        rec.log("verdict", rr.TextDocument(fixed, media_type=MARKDOWN), static=True)
        rows = 0
        for n, stop in enumerate(self.stops):
            train = [(stop.controller, ESTIMATORS[n], stop.train_speed * 3.6)]
            rows += send_plot(
                rec, f"train/{stop.controller}", _since_start, stop.t, lines("", train)
            )
            for i in range(stop.pressure.shape[1]):
                rows += self._send_axle(rec, f"{stop.controller}/axle/{i + 1}", stop, i)
        return rows

    def _send_axle(self, rec: rr.RecordingStream, path: str, stop: Stop, i: int) -> int:
        speeds = [
            ("train", TRAIN, stop.train_speed * 3.6), ("wheel", WHEEL, stop.rim_speed[:, i] * 3.6)
        ]  # fmt: skip
        pressures = [
            ("without controller", REFERENCE, stop.demand * 1e-5),
            ("cylinder", PRESSURE, stop.pressure[:, i] * 1e-5),
        ]
        forces = [
            ("most the rail gives", REFERENCE, stop.peak[:, i]),
            ("true", TRUTH, stop.force[:, i]),
            (f"estimated ({stop.algo})", CLAMPING, stop.estimate[:, i]),
        ]
        slips = [
            ("measured", WHEEL, 100.0 * stop.measured_slip[:, i]),
            ("judged", CLAMPING, 100.0 * stop.judged_slip[:, i]),
        ]
        rows = 0
        for plot in (
            lines("speed", speeds), lines("pressure", pressures), lines("force", forces),
            lines("judged", slips), lines("slope", [("slope dµ/ds", SLOPE, stop.slope[:, i])]),
            lines("confidence", [("confidence", REFERENCE, stop.confidence[:, i])]),
        ):  # fmt: skip
            rows += send_plot(rec, f"{path}/{plot.name}", _since_start, stop.t, plot)

        over = np.append(stop.t, 2 * stop.t[-1] - stop.t[-2])  # a state lasts until the next
        for name, codes, states in (
            ("valve", stop.valve, VALVES), ("region", stop.region, REGION_STATES),
            ("wheel", stop.sliding(), WHEELS),
        ):  # fmt: skip
            lane = f"{path}/state/{name}"
            rows += send_states(rec, lane, _since_start, over, np.append(codes[:, i], -1), states)

        bands = self.bands.get(stop.controller)
        if bands:
            for name, low, high in (
                ("judged", 100.0 * bands.slip_low, 100.0 * bands.slip_high),
                ("slope", bands.slope_low, bands.slope_high),
            ):
                rows += send_band(rec, f"{path}/{name}", _since_start, stop.t, low, high)
        slip, mu = stop.slip[:, i], stop.force[:, i] / self.weight
        peak = stop.peak_slip[:, i], stop.peak[:, i] / self.weight
        return rows + send_curve(
            rec, f"{path}/slip", _since_start, stop.t, slip, mu, bands, peak, judged=_AHEAD
        )

    def layout(self) -> rrb.Container:
        """Tabs: the verdict, then one per axle with a column per controller."""
        first = rrb.Vertical(
            rrb.TextDocumentView(origin="verdict", name="Verdict"),
            chart("train", "Train speed [km/h]", legend="RightTop"),
            row_shares=[1.0, 1.0],
            name="Verdict",
        )
        axles = self.stops[0].pressure.shape[1]
        return rrb.Tabs(first, *(self._axle_tab(i + 1) for i in range(axles)))

    def _axle_tab(self, axle: int) -> rrb.Container:
        """Two tabs: where the wheel and its brake were, and what the unit made of it."""
        wheel, judged, i, every = [], [], axle - 1, self.stops
        speed = span_of([x.train_speed * 3.6 for x in every], [])  # the same range in each
        pressure = span_of([x * 1e-5 for s in every for x in (s.demand, s.pressure[:, i])], [])
        forces = [s.force[:, i] for s in every]
        top = 1.2 * max(float(np.nanmax(F)) for F in forces)  # what dry rail gives is far more
        near = [np.minimum(s.peak[:, i], top) for s in every]
        force = span_of([*forces, *near], [s.estimate[:, i] for s in every])
        for stop in every:
            path, who = f"{stop.controller}/axle/{axle}", stop.controller
            views = [
                chart(f"{path}/speed", f"{who}: speed [km/h]", speed, legend="RightTop"),
                chart(f"{path}/pressure", f"{who}: pressure [bar]", pressure, legend="RightBottom"),
                states_view(f"{path}/state", f"{who}: valves, region on the curve, wheel"),
                curve_view(f"{path}/slip", who),
            ]
            wheel.append(rrb.Vertical(*views, row_shares=[3.0, 3.0, 2.0, 4.0]))
            views = [
                chart(f"{path}/force", f"{who}: adhesion force [N]", force, legend="RightTop"),
                chart(f"{path}/judged", f"{who}: slip as judged [%]", _SLIPS, legend="RightTop"),
                *slope_charts(path, who, stop.slope[:, i], self.bands.get(who)),
            ]
            judged.append(rrb.Vertical(*views, row_shares=[2.0, 2.0, 2.0, 1.0]))
        return rrb.Tabs(
            rrb.Horizontal(*wheel, name="Wheel, valves, slip"),
            rrb.Horizontal(*judged, name="Force, slip, slope"), name=f"Axle {axle}",
        )  # fmt: skip


def _since_start(t: Times) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("time", duration=t.astype("timedelta64[ns]"))]
