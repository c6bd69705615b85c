"""`adhesion live`: the estimators while samples arrive."""

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import UserError
from .options import Ended, Shared, check_display, check_settings, option, shared

if TYPE_CHECKING:
    from ..analysis.settings import Settings
    from ..core.finding import Finding
    from ..live.axle import Sink
    from ..live.feed import Feed
    from ..live.shown import StatusLine

_OPTIONS = ("config", "set_", "dbc", "algo", "axle", "json", "force", "out", "strict", "view")
_TEXTS = {  # of shared options that mean something else here
    "dbc": "Signals of the frames on a CAN bus; repeatable.",
    "out": "Folder for <name>.live.mcap, made if missing; else no file.",
    "algo": "Only this estimator; repeatable. The terminal shows the first one.",
    "json": "One JSON object per line on stdout for each sample and axle.",
    "view": "Show the samples in the Rerun viewer as they arrive.",
}
_CHUNK = 0.5  # between two chunks of the file [s]
_FRAME = 0.1  # between two frames of the viewer [s]
_LINES = 0.02  # between two batches of JSON lines [s]
_INTERRUPTED = Ended(130)  # after Ctrl-C
_BAND_ESTIMATOR = "imm"  # the estimator with a band of its own


@shared(*_OPTIONS, texts=_TEXTS)
def command(
    shared: Shared,
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="A growing file, -, udp://, mqtt:// or can:.")
    ] = "",
    replay: Annotated[
        Path | None, option("--replay", "LOG", "Play a log of any format, instead of SOURCE.")
    ] = None,
    speed: Annotated[
        float | None,
        option("--speed", "X", "With --replay: X times as fast as measured; 0: at once.", min=0.0),
    ] = None,
    connect: Annotated[
        str, option("--connect", "URL", "A Rerun viewer, as rerun+http://HOST:9876/proxy.")
    ] = "",
) -> int:
    """Compute the adhesion while samples arrive.

    The estimators are those of `analyze`, and so are their values.

    SOURCE is a CSV, MCAP or JSON-lines file to which a logger appends, - for text
    on standard input, udp://HOST:PORT or mqtt://HOST/TOPIC for JSON
    messages, or can:CHANNEL with --dbc. The header or the first messages say
    what is measured, or -c does. Ctrl-C ends.

    -o DIR also writes <name>.live.mcap. It can be read at any time, even after
    a kill, and `adhesion view` shows it. --view and --connect show the samples
    in the Rerun viewer. --json prints a line per sample and axle.

    Example: adhesion live --replay sample_logs/service-brake.csv --speed 0
    """
    settings = check_settings(shared)
    if (replay is None) == (not source):
        raise UserError("name SOURCE, or --replay LOG", "adhesion live --help", code=2)
    if speed is not None and replay is None:
        raise UserError("--speed is for --replay", "leave it out, or add --replay", code=2)
    if replay is None and shared.dbc and not source.startswith("can:"):
        text = f"--dbc {shared.dbc[0]}: is for frames of a CAN bus, and {source} has none"
        raise UserError(text, "leave it out, or name a bus as can:can0", code=2)
    viewer = _viewer(shared, connect)
    try:
        feed = _open_feed(source, replay, speed, settings)
        try:
            return _Run(feed, settings, shared, viewer).go()
        finally:
            feed.close()
    except KeyboardInterrupt:  # before the first sample: the normal end as well
        return _INTERRUPTED


def _open_feed(
    source: str, replay: Path | None, speed: float | None, settings: "Settings"
) -> "Feed":
    if replay:
        from ..live.open import Replay

        return Replay(replay, settings.read, 1.0 if speed is None else speed)
    from ..live.open import open_feed

    return open_feed(source, settings.read)


def _viewer(shared: Shared, connect: str) -> str:
    """The address of the viewer that shows the samples, "" for none; starts one for --view."""
    if connect:
        from ..results.rrd.live import check_viewer

        check_viewer(connect)
    if not shared.view or connect:
        return connect
    from .view import start_viewer

    check_display("adhesion live ... -o DIR")
    return start_viewer()


class _Run:
    """A run on a feed, shown in a viewer at an address, "" for none."""

    def __init__(self, feed: "Feed", settings: "Settings", shared: Shared, viewer: str) -> None:
        from ..analysis.request import choose_estimators
        from ..live.run import Tally
        from ..live.shown import Counts, Waiting

        self._feed, self._shared, self._viewer = feed, shared, viewer
        self._stated = self._settings = settings  # as stated, and as this run uses them
        self._algos = {e.name: (e, settings.params(e)) for e in choose_estimators(shared.algo)}
        self._algos_shown = list(dict.fromkeys(shared.algo)) or [_BAND_ESTIMATOR]
        self._tally = Tally(self._report, feed.name, shared.strict)
        self._status: StatusLine | None = None
        self._file: Path | None = None
        self._counts = Counts()
        self._waiting = Waiting(feed.name, self._say)

    def go(self) -> int:
        """Follows the sender to its end, or to Ctrl-C; returns the exit code."""
        from ..analysis.vehicle_findings import live_findings
        from ..live.run import follow, with_any_brake
        from ..live.shown import StatusLine
        from ..live.wheels import LiveWheels

        try:
            with ExitStack() as stack:
                stack.callback(self._waiting.close)
                stated, axles = self._stated, self._shared.axle
                wheels = LiveWheels(self._feed.head(), stated.mappings, stated.vehicle, axles)
                by_pressure = any(p.is_pressure for p in wheels.axles)
                self._tally.add(live_findings(stated, by_pressure))
                self._settings = with_any_brake(stated, by_pressure)
                if not (self._shared.json or self._shared.quiet) and sys.stderr.isatty():
                    self._status = StatusLine(self._algos_shown[0], self._settings.vehicle)
                sinks: list[Sink] = [self._counts, self._waiting]
                axles = [p.axle for p in wheels.axles]
                self._file = self._new_file(stack)
                for sink in self._sinks(axles):
                    stack.callback(sink.close)
                    sinks.append(sink)
                follow(self._feed, wheels, self._settings, self._algos, sinks, self._tally)
        except KeyboardInterrupt:
            self._sum_up()
            return _INTERRUPTED
        self._sum_up()
        return 3 if any(f.lossy for f in self._tally.findings) else 0

    def _say(self, text: str) -> None:
        """Text on stderr, above the line of the samples."""
        from . import terminal

        if self._status:
            self._status.clear()
        terminal.message(text, self._shared.quiet)

    def _report(self, findings: "Sequence[Finding]") -> None:
        from . import terminal

        self._say(terminal.findings(findings))

    def _sum_up(self) -> None:
        from . import terminal

        lines = self._counts.lines()
        if findings := self._tally.findings:
            warnings = sum(f.severity != "info" for f in findings)
            lines.append(f"findings: {len(findings)} (warnings and errors: {warnings})")
        self._say("\n".join([*lines, *([terminal.wrote(self._file)] if self._file else [])]))

    def _new_file(self, stack: ExitStack) -> Path | None:
        """The file of -o, empty; nobody else writes it before the end of the stack."""
        from ..live.recording import new_file

        if not (out := self._shared.out):
            return None
        name = self._feed.name
        stem = re.sub(r"\W+", "-", name if "://" in name else Path(name).stem).strip("-")
        file = out / f"{stem}.live.mcap"
        inputs = [*self._shared.config, *self._shared.dbc, Path(name)]
        stack.enter_context(new_file(file, self._shared.force, inputs))
        return file

    def _sinks(self, axles: list[int]) -> "Iterator[Sink]":
        """Who takes the samples: the file first, so that it has what the others fail on."""
        from ..live.recording import Batches
        from ..live.shown import JsonLines

        names = list(dict.fromkeys([*self._algos_shown, *sorted(self._algos)]))
        yield from self._recordings(axles, names)
        if self._shared.json:
            outlives_reader = bool(self._file or self._viewer)
            lines = JsonLines(self._algos_shown, self._settings.vehicle, outlives_reader)
            yield Batches(
                lines, _LINES, self._say if outlives_reader else None, "the reader of --json"
            )
        elif self._status:
            yield self._status

    def _recordings(self, axles: list[int], names: list[str]) -> "Iterator[Sink]":
        """The file, and the viewer."""
        from ..live.recording import Batches, LiveView, Mcap
        from ..results.rrd.live import LiveRecording

        name = self._feed.name
        if self._file:
            target = Mcap(self._file, name, self._stated, self._algos, axles, self._tally.add)
            yield Batches(target, _CHUNK)
        if self._viewer:
            live = LiveRecording(name, self._settings.vehicle, axles, names, self._viewer)
            view = LiveView(live, names, lambda error: self._say(f"the viewer ends here: {error}"))
            yield Batches(view, _FRAME, self._say)
