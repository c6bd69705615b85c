"""`live` on files, in this process and in one of its own."""

import json
import signal
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from adhesion_cli.analysis.request import choose_estimators
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.core import bundled
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Vehicle
from adhesion_cli.live.axle import LiveAxle, LiveSample, Measuring
from adhesion_cli.live.feed import Feed
from adhesion_cli.live.run import Tally, follow
from adhesion_cli.live.wheels import LiveWheels
from helpers.forked import Forked

LOGS = bundled.folder("sample_logs")
SERVICE, LOW = LOGS / "service-brake.csv", LOGS / "low-adhesion.csv"


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
    follow(
        feed,
        LiveWheels(feed.head(), settings.mappings, settings.vehicle, ()),
        settings,
        own,
        [kept],
        tally,
    )
    feed.close()
    return kept.of, tally.findings


@contextmanager
def running(folder: Path, *arguments: str | Path, code: str = "") -> Iterator[Forked]:
    """`adhesion live` in the background, after `code`; it is killed if it still runs at the end."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with Forked(folder, ["live", *map(str, arguments)], code, **pipes) as process:
        try:
            yield process
        finally:
            process.kill()


def lines_of(text: str) -> list[dict[str, object]]:
    return [json.loads(line) for line in text.splitlines()]


def message(t: float, axle: int, kmh: float, bar: float | None = 1.0) -> str:
    said = {"t": t, "axle": axle, "speed [km/h]": kmh, "bc pressure [bar]": bar}
    return json.dumps({k: x for k, x in said.items() if x is not None})


def taken(process: Forked, count: int) -> list[dict[str, object]]:
    """The next lines that it prints."""
    assert process.stdout
    return [json.loads(process.stdout.readline()) for _ in range(count)]


def read_all(process: Forked, lines: list[dict[str, Any]]) -> None:
    """Every line that it prints, as they come."""
    assert process.stdout
    while line := process.stdout.readline():
        lines.append(json.loads(line))


def ended(process: Forked, lines: int) -> tuple[list[dict[str, Any]], str]:
    """That many lines, then Ctrl-C; every line and what was said on stderr."""
    first = taken(process, lines)
    process.send_signal(signal.SIGINT)
    out, told = process.communicate(timeout=60)
    return [*first, *lines_of(out)], told


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def axle() -> LiveAxle:
    algos = {e.name: (e, Settings().params(e)) for e in choose_estimators(["td", "imm"])}
    return LiveAxle(Measuring(1), Vehicle(), algos)


def samples_of(count: int) -> list[LiveSample]:
    one = axle()
    for k in range(count):
        one.brake(k * 10_000_000, 2e5, 0)
    return [s for k in range(count) if (s := one.wheel(k * 10_000_000, 40.0 - 0.01 * k, 0))]


def jsonl(folder: Path, lines: Sequence[str]) -> Path:
    log = folder / "log.jsonl"
    log.write_text("\n".join(lines) + "\n")
    return log
