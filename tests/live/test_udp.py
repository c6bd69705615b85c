"""Samples as datagrams."""

import json
import math
import socket
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from helpers.live_runs import free_port, read_all, running

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load


def test_datagrams_are_taken_and_kept_through_a_kill(tmp_path: Path) -> None:
    place = f"127.0.0.1:{free_port()}"
    host, port = place.split(":")
    with (
        running(tmp_path, f"udp://{place}", "--json", "-o", "out") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        lines: list[dict[str, Any]] = []
        reading = threading.Thread(target=read_all, args=(process, lines))
        reading.start()
        k, long_enough = 0, math.inf
        while len(lines) < 200 or time.monotonic() < long_enough:
            said = {"t": 0.01 * k, "speed 1 [km/h]": 80.0 - 0.01 * k, "bc pressure [bar]": 1.0}
            sender.sendto(json.dumps(said).encode(), (host, int(port)))
            k += 1
            time.sleep(0.01)
            if len(lines) >= 200 and long_enough == math.inf:
                long_enough = time.monotonic() + 1.5  # these are in the file by then
        process.kill()
        reading.join()
    steps = np.diff([float(str(one["t"])) for one in lines])
    assert np.allclose(steps, 0.01)
    kept = analyze(tmp_path / "out" / f"udp-127-0-0-1-{port}.live.mcap", load())
    assert len(kept.axles[0].record.t) >= 200
