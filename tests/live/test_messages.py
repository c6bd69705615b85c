"""Messages in JSON that hold no samples."""

import json
from pathlib import Path

from helpers.live_runs import (
    lines_of,
    running,
)


def test_messages_that_are_none_are_counted(tmp_path: Path) -> None:
    good = [
        json.dumps({"t": 0.1 * k, "axle": 1, "speed": {"kmh": 80 - 0.1 * k}, "bc": 1.0})
        for k in range(50)
    ]
    bad = ["{", "[1, 2]", '{"t": "soon", "bc": 1}', '{"t": 1e400, "bc": 1}', "\x00\xff", "null"]
    text = "\n".join([*good[:25], *bad, *good[25:]])
    stated = (
        'channels.speed = {channel = "speed.kmh", unit = "km/h"}',
        ('channels.pressure = {channel = "bc", unit = "bar"}'),
    )
    with running(tmp_path, "-", "--json", "--set", stated[0], "--set", stated[1]) as process:
        out, told = process.communicate(text, timeout=60)
    assert (process.returncode, len(lines_of(out))) == (3, 50), told
    assert "messages-unreadable" in told
