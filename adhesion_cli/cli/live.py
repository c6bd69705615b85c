"""`adhesion live`: the estimators while samples arrive."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import Shared, checked, option, shared

if TYPE_CHECKING:
    from ..analysis.settings import Settings
    from ..live.feed import Feed
    from ..live.run import Sink

_OPTIONS = ("config", "set_", "dbc", "algo", "axle", "json", "force", "out", "strict")
_SHOWN = "imm"  # the estimator with a band of its own


@shared(*_OPTIONS)
def command(
    shared: Shared,
    source: Annotated[
        str, typer.Argument(metavar="[SOURCE]", help="A growing file, - or udp://HOST:PORT.")
    ] = "",
    replay: Annotated[
        Path | None, option("--replay", "LOG", "Play a log of any format, instead of SOURCE.")
    ] = None,
    speed: Annotated[
        float | None,
        option("--speed", "X", "With --replay: X times as fast as measured; 0: at once.", min=0.0),
    ] = None,
) -> int:
    """Adhesion while the samples arrive, by the same estimators as in a log.

    SOURCE is a CSV file or a file of JSON lines to which a logger appends, - for
    the same on standard input, or udp://HOST:PORT for datagrams in JSON. The
    header or the first messages say what is measured, or -c does. Ctrl-C ends.

    -o DIR also writes a recording, <name>.live.mcap. It can be read at any time,
    even after a kill. --json prints a line per sample and axle.

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
    if replay:
        feed: Feed = Replay(replay, settings.read, 1.0 if speed is None else speed)
    else:
        feed = opened(source, settings.read)
    try:
        return _follow(feed, settings, shared)
    finally:
        feed.close()


def _follow(feed: "Feed", settings: "Settings", shared: Shared) -> int:
    from ..analysis.analyze import chosen
    from ..live.run import Tally, follow, wheels_of
    from . import terminal

    algos = {e.name: (e, settings.params(e)) for e in chosen(shared.algo)}
    first = shared.algo or [_SHOWN]
    tally = Tally(lambda f: terminal.show([f], shared.quiet))
    wheels = wheels_of(feed, settings, shared.axle)
    with ExitStack() as ends:
        sinks: list[Sink] = []
        for sink in _sinks(
            feed.name, settings, algos, first, [p.axle for p in wheels.axles], shared
        ):
            ends.callback(sink.close)
            sinks.append(sink)
        follow(feed, wheels, settings, algos, sinks, tally)
    return 3 if any(f.lossy for f in tally.findings) else 0


def _sinks(
    name: str, settings: "Settings", algos: dict[str, "Any"], first: list[str], axles: list[int],
    shared: Shared,
) -> "Iterator[Sink]":  # fmt: skip
    """Who takes the samples: the file first, so that it has what the others fail on."""
    import sys

    from ..live.recording import Recording
    from ..live.shown import JsonLines, StatusLine
    from ..results import atomic_files

    if shared.out:
        stem = re.sub(r"\W+", "-", Path(name).stem if "://" not in name else name).strip("-")
        path = shared.out / f"{stem}.live.mcap"
        atomic_files.check([path], shared.force, inputs=[*shared.config, *shared.dbc])
        yield Recording(path, name, settings, algos, axles)
    if shared.json:
        yield JsonLines(first, settings.vehicle)
    elif not shared.quiet and sys.stderr.isatty():
        yield StatusLine(first[0], settings.vehicle)
