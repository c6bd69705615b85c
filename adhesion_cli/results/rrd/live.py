"""Samples as a recording that grows in a viewer."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import errors, physics
from ...core.model import Z95, Floats, Samples, Times, Vehicle
from ...core.text import printable
from .. import palette
from . import overview, parts


def check_viewer(url: str) -> None:
    """Refuses, by a UserError, what is no address of a viewer; whether one is there shows later."""
    try:
        rr.GrpcSink(url)
    except RuntimeError as error:  # the binding's word for what it cannot read
        text = f"--connect {printable(url)}: is no address of a Rerun viewer"
        hint = "name host and port of the viewer, as rerun+http://127.0.0.1:9876/proxy"
        raise errors.UserError(text, hint, code=2) from error


class LiveRecording:
    """Samples that arrive, to a viewer's address; all axles by the first estimator."""

    def __init__(
        self,
        name: str,
        vehicle: Vehicle,
        axles: Sequence[int],
        algos: Sequence[str],
        url: str,
    ) -> None:
        self._vehicle, self._axles, self._algos = vehicle, list(axles), list(algos)
        self._start: int | None = None
        self._sent: set[str] = set()  # entities with their style, and names of lines
        rr.set_strict_mode(True)
        self._rec = rr.RecordingStream("adhesion")
        self._rec.set_sinks(rr.GrpcSink(url), default_blueprint=self._layout())
        self._rec.send_recording_name(name)

    def add(self, samples: Mapping[int, Samples]) -> None:
        """Sends the new samples of some axles."""
        if arrived := [axle for axle in samples if axle not in self._axles]:
            self._axles += arrived
            self._rec.send_blueprint(self._layout())
        for axle, x in samples.items():
            if self._start is None:
                self._start = int(x.t[0])
            for path, plot in self._plots(axle, x):
                is_first = path not in self._sent
                parts.send_plot(self._rec, path, self._times, x.t, plot, is_first)
                if is_first:
                    self._sent.add(path)
                    self._name("all" if path.startswith("all/") else f"axle/{axle}", plot)

    def _name(self, tab: str, plot: parts.SeriesPlot) -> None:
        """Sends the names of lines that are not in the list of their tab yet."""
        lines = zip(plot.series, plot.colours, strict=True)
        if fresh := [(name, c) for name, c in lines if f"{tab}/{name}" not in self._sent]:
            self._sent |= {f"{tab}/{name}" for name, _ in fresh}
            parts.send_names(self._rec, f"lines/{tab}", self._times, self._start or 0, fresh)

    def finish(self) -> None:
        """Ends the recording as `add`; a viewer that does not answer is not waited for."""
        self._rec.flush(timeout_sec=2.0)
        self._rec.disconnect()

    def _plots(self, axle: int, x: Samples) -> list[tuple[str, parts.SeriesPlot]]:
        name = f"axle {axle}"
        colour = palette.rgba(palette.nth(self._axles.index(axle)))
        force, sigma, tolerance = x.estimates[self._algos[0]]
        rim = x.wheel_speed * self._vehicle.radius(axle).value
        mu = physics.coefficient(force, self._vehicle, axle)

        def line(line_name: str, values: Floats, colour: int = colour) -> parts.SeriesPlot:
            return parts.lines("", [(line_name, colour, values)])

        plots = [
            (f"all/speed/{axle}", line(name, 3.6 * rim)),
            (f"all/force/{axle}", line(name, force / 1e3)),
            (f"all/coefficient/{axle}", line(name, mu)),
        ]
        if np.isfinite(x.train_speed).any():
            plots.append((f"all/slip/{axle}", line(name, 100.0 * x.slip)))
            if axle == self._axles[0]:
                plots.append(("all/speed/train", line("train", 3.6 * x.train_speed, parts.TRAIN)))
        axle_path = f"axle/{axle}"
        if np.isfinite(sigma).any():
            grey, half_width = palette.rgba(palette.LIGHT), Z95 * np.hypot(sigma, tolerance) / 1e3
            band = f"{self._algos[0]}, 95 % band", grey, force / 1e3, half_width
            plots.append((f"{axle_path}/force/band", parts.bands("", [band])))
        # One entity for all estimators: each has a price, whatever it holds.
        colours = {algo: palette.rgba(palette.of_method(algo)) for algo in self._algos}
        forces = [(algo, c, x.estimates[algo][0] / 1e3) for algo, c in colours.items()]
        plots.append((f"{axle_path}/force/estimates", parts.lines("", forces)))
        clamping = line("clamping force of the axle", x.clamping / 1e3, parts.CLAMPING)
        return [*plots, (f"{axle_path}/clamping", clamping)]

    def _times(self, t: Times) -> list[rr.TimeColumn]:
        return [rr.TimeColumn("time", duration=(t - (self._start or 0)).astype("timedelta64[ns]"))]

    def _layout(self) -> parts.Layout:
        """All axles first, then a tab for each."""
        titles = overview.titles(self._algos[0]).items()
        charts = [parts.chart(f"all/{path}", f"All axles: {name}") for path, name in titles]
        tabs = [parts.named_charts("All axles", charts, "lines/all", [1, 1, 1, 1])]
        for n in self._axles:
            forces = [
                parts.chart(f"axle/{n}/force", f"Axle {n}: adhesion force [kN]"),
                parts.chart(
                    f"axle/{n}/clamping", f"Axle {n}: clamping force K of the axle, all pads [kN]"
                ),
            ]
            tabs.append(parts.named_charts(f"Axle {n}", forces, f"lines/axle/{n}", [3, 1]))
        return parts.Layout([rrb.Tabs(*tabs)], "time", live=True)
