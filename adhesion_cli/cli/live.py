"""`adhesion live`: the estimators while samples arrive."""

import re
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from .options import Shared, checked, option, shared

if TYPE_CHECKING:
    from ..analysis.settings import Settings
    from ..live.feed import Feed
    from ..live.run import Sink

_OPTIONS = ("config", "set_", "dbc", "algo", "axle", "json", "force", "out", "strict", "view")
_TEXTS = {  # of shared options that mean something else here
    "dbc": "Signals of the frames on a CAN bus; repeatable.",
    "out": "Folder for <name>.live.mcap and .live.rrd, made if missing; else no files.",
    "algo": "Only this estimator; repeatable. The terminal shows the first one.",
    "json": "One JSON object per line on stdout for each sample and axle.",
    "view": "Show the samples in the Rerun viewer as they arrive.",
}
# Between two chunks of a file [s]. The Rerun SDK keeps a note of each one up to the end.
_CHUNK, _RERUN_CHUNK = 0.5, 0.9
_FRAME = 0.1  # between two frames of the viewer [s]
_SHOWN = "imm"  # the estimator with a band of its own


@shared(*_OPTIONS, texts=_TEXTS)
def command(
    shared: Shared,
    source: Annotated[
        str,
        typer.Argument(metavar="SOURCE", help="A growing file, -, udp://, mqtt:// or can:."),
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
    serve: Annotated[
        int | None,
        option("--serve", "PORT", "Foxglove on this computer: ws://127.0.0.1:PORT.", min=0),
    ] = None,
) -> int:
    """Compute the adhesion while samples arrive.

    The estimators are those of `analyze`, and so are their values.

    SOURCE is a CSV, MCAP or JSON-lines file to which a logger appends, - for text
    on standard input, udp://HOST:PORT or mqtt://HOST/TOPIC for JSON
    messages, or can:CHANNEL with --dbc. The header or the first messages say
    what is measured, or -c does. Ctrl-C ends.

    -o DIR also writes <name>.live.mcap and <name>.live.rrd. They can be read at
    any time, even after a kill. --view and --connect show the samples in the
    Rerun viewer, --serve in Foxglove. --json prints a line per sample and axle.

    Example: adhesion live --replay sample_logs/service-brake.csv --speed 0
    """
    from ..core.errors import UserError
    from ..live.open import opened
    from ..live.replay import Replay

    settings = checked(shared)()
    if (replay is None) == (not source):
        raise UserError("name SOURCE, or --replay LOG", "adhesion live --help", code=2)
    if speed is not None and replay is None:
        raise UserError("--speed is for --replay", "leave it out, or add --replay", code=2)
    viewer = _viewer(shared, connect)
    if replay:
        feed: Feed = Replay(replay, settings.read, 1.0 if speed is None else speed)
    else:
        _check_dbc(source, shared)
        feed = opened(source, settings.read)
    try:
        return _follow(feed, settings, shared, _Screens(viewer, serve))
    finally:
        feed.close()


class _Screens(NamedTuple):
    """Where the samples are shown: a Rerun viewer, "" for none; the port for Foxglove."""

    viewer: str
    serve: int | None


def _viewer(shared: Shared, connect: str) -> str:
    """The address of the viewer that shows the samples, "" for none; starts one for --view.

    Raises:
        UserError: where there is no display, or the address is none.
    """
    if connect:
        from ..results.rrd.live import check_viewer

        check_viewer(connect)
    if not shared.view or connect:
        return connect
    from .view import check_display, start_viewer

    check_display("adhesion live ... -o DIR")
    return start_viewer()


def _check_dbc(source: str, shared: Shared) -> None:
    """Refuses a DBC that no frame is decoded with.

    Raises:
        UserError: as said.
    """
    if shared.dbc and not source.startswith("can:"):
        from ..core.errors import UserError

        text = f"--dbc {shared.dbc[0]}: is for frames of a CAN bus, and {source} has none"
        raise UserError(text, "leave it out, or name a bus as can:can0", code=2)


def _follow(feed: "Feed", settings: "Settings", shared: Shared, screens: _Screens) -> int:
    from ..analysis.analyze import chosen
    from ..live.run import Tally, follow, wheels_of
    from . import terminal

    algos = {e.name: (e, settings.params(e)) for e in chosen(shared.algo)}
    tally = Tally(lambda f: terminal.show([f], shared.quiet), feed.name, shared.strict)
    wheels = wheels_of(feed, settings, shared.axle)
    axles = [p.axle for p in wheels.axles]
    with ExitStack() as ends:
        sinks: list[Sink] = []
        for sink in _sinks(feed.name, settings, algos, axles, shared, screens):
            ends.callback(sink.close)
            sinks.append(sink)
        follow(feed, wheels, settings, algos, sinks, tally)
    return 3 if any(f.lossy for f in tally.findings) else 0


def _sinks(
    name: str, settings: "Settings", algos: dict[str, Any], axles: list[int], shared: Shared,
    screens: _Screens,
) -> "Iterator[Sink]":  # fmt: skip
    """Who takes the samples: the file first, so that it has what the others fail on."""
    from ..live.recording import Batches, Mcap, Shown
    from ..live.shown import JsonLines, StatusLine
    from ..results import atomic_files
    from ..results.rrd.live import LiveRecording
    from . import terminal

    shown = list(shared.algo) or [_SHOWN]
    names = [*shown, *(a for a in sorted(algos) if a not in shown)]
    recording = None
    if shared.out:
        stem = re.sub(r"\W+", "-", name if "://" in name else Path(name).stem).strip("-")
        record, recording = (shared.out / f"{stem}.live{kind}" for kind in (".mcap", ".rrd"))
        inputs = [*shared.config, *shared.dbc]
        atomic_files.check([record, recording], shared.force, inputs=inputs)
        yield Batches(Mcap(record, name, settings, algos, axles), sorted(algos), axles, _CHUNK)

    def tell(error: str) -> None:
        terminal.message(f"the recording ends here: {error}", shared.quiet)

    for to, every in ((recording, _RERUN_CHUNK), (screens.viewer, _FRAME)):
        if to:
            live = LiveRecording(name, settings.vehicle, axles, names, to)
            yield Batches(Shown(live, tell), names, axles, every)
    if screens.serve is not None:
        from ..live.served import Served

        server = Served(screens.serve, settings.vehicle, axles, names)
        terminal.message(f"Foxglove: open {server.url}", shared.quiet)
        yield server
    if shared.json:
        alone = not recording and screens == _Screens("", None)
        yield JsonLines(
            shown, settings.vehicle, alone, lambda text: terminal.message(text, shared.quiet)
        )
    elif not shared.quiet and sys.stderr.isatty():
        yield StatusLine(shown[0], settings.vehicle)
