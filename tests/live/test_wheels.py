"""Axles that begin later."""

import json
import signal
import socket
import threading
import time
from pathlib import Path
from typing import Any

from helpers.live_runs import followed, free_port, jsonl, message, read_all, running

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.live.open import open_feed


def test_an_axle_that_boots_later_is_taken_in(tmp_path: Path) -> None:
    """Two brake units; the second begins 2 s later, first with its speed, then with all."""
    port = free_port()
    source, to = f"udp://127.0.0.1:{port}", ("127.0.0.1", port)
    with (
        running(tmp_path, source, "--json", "-o", "out", "-a", "imm") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        lines: list[dict[str, Any]] = []
        reading = threading.Thread(target=read_all, args=(process, lines))
        reading.start()
        k, late = 0, 0
        while late < 250:
            sender.sendto(message(0.02 * k, 1, 80 - 0.02 * k).encode(), to)
            if len(lines) > 100:
                said = message(0.02 * k, 2, 79 - 0.02 * k, None if late < 10 else 2.0)
                sender.sendto(said.encode(), to)
                late += 1
            k += 1
            time.sleep(0.01)
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
        reading.join()
        assert process.stderr
        told = process.stderr.read()
    second = [one for one in lines if one["axle"] == 2]
    assert len(second) > 50, told
    assert "axle-began-late" in told
    assert {one["status"] for one in second[1:]} == {"ok"}
    assert set(lines[0]) <= set(second[0])
    assert all(one["force_n"] is not None for one in second)
    stem = tmp_path / "out" / f"udp-127-0-0-1-{port}.live"
    kept = {a.record.axle: a.record for a in analyze(stem.with_suffix(".live.mcap"), load()).axles}
    assert kept.keys() == {1, 2}
    assert len(kept[2].t) == len(second)


def test_a_late_channel_without_a_unit_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    text = [message(0.01 * k, 1, 80.0 - 0.01 * k) for k in range(400)]
    text += [json.dumps({"t": 4.0 + 0.01 * k, "axle": 2, "speed": 70.0}) for k in range(5)]
    text += [message(4.05 + 0.01 * k, 1, 76.0 - 0.01 * k) for k in range(100)]
    feed = open_feed(str(jsonl(tmp_path, text)), load().read)
    threading.Timer(2.0, (tmp_path / "log.jsonl").write_text, [""]).start()  # ends the feed
    found, findings = followed(feed, load(), ["td"])
    assert {f.code for f in findings} >= {"late-channels-left-out"}
    assert len(found[1]) == 500
