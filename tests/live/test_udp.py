"""Samples as datagrams."""

import json
import socket
import time
from pathlib import Path

import numpy as np
from helpers.live_runs import (
    free_port,
    running,
    taken,
)

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load


def test_datagrams_are_taken_and_kept_through_a_kill(tmp_path: Path) -> None:
    place = f"127.0.0.1:{free_port()}"
    host, port = place.split(":")
    with (
        running(tmp_path, f"udp://{place}", "--json", "-o", "out") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        seen: list[dict[str, object]] = []
        process.stdout and process.stdout.reconfigure()  # type: ignore[attr-defined]
        begin, k = time.monotonic(), 0
        while time.monotonic() - begin < 8.0:
            said = {"t": 0.01 * k, "speed 1 [km/h]": 80.0 - 0.01 * k, "bc pressure [bar]": 1.0}
            sender.sendto(json.dumps(said).encode(), (host, int(port)))
            k += 1
            time.sleep(0.01)
        seen = taken(process, 200)
        process.kill()
    steps = np.diff([float(str(one["t"])) for one in seen])
    assert np.allclose(steps, 0.01)
    kept = analyze(tmp_path / "out" / f"udp-127-0-0-1-{port}.live.mcap", load())
    assert len(kept.axles[0].record.t) >= 200
