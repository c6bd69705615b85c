"""`live` on files, in this process and in one of its own."""

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from adhesion_cli.analysis.request import choose_estimators
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.core import bundled
from adhesion_cli.core.finding import Finding
from adhesion_cli.live.axle import LiveSample
from adhesion_cli.live.feed import Feed
from adhesion_cli.live.run import Tally, follow, wheels_of
from helpers.forked import Forked

LOGS = bundled.folder("sample_logs")


class Kept:
    """A sink that keeps every sample, by axle."""

    def __init__(self) -> None:
        self.of: dict[int, list[LiveSample]] = {}

    def take(self, samples: Sequence[LiveSample]) -> None:
        for s in samples:
            self.of.setdefault(s.axle, []).append(s)

    def idle(self) -> None:
        pass

    def close(self) -> None:
        pass


def followed(
    feed: Feed, settings: Settings, algos: Sequence[str] = ()
) -> tuple[dict[int, list[LiveSample]], list[Finding]]:
    """Every sample of a sender by axle, and the findings."""
    kept, tally = Kept(), Tally(lambda _: None)
    own = {e.name: (e, settings.params(e)) for e in choose_estimators(algos)}
    follow(feed, wheels_of(feed, settings, ()), settings, own, [kept], tally)
    feed.close()
    return kept.of, tally.findings


@contextmanager
def running(folder: Path, *arguments: str | Path) -> Iterator[Forked]:
    """`adhesion live` in the background; it is killed if it still runs at the end."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with Forked(folder, ["live", *map(str, arguments)], **pipes) as process:
        try:
            yield process
        finally:
            process.kill()
