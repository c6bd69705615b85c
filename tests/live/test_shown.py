"""What `adhesion live` shows on a terminal, and what it says."""

import json
import os
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from helpers.forked import Forked
from helpers.live_runs import (
    SERVICE,
    free_port,
    message,
    read_all,
    running,
)

NO_TERMINAL = "Windows has no terminals of this kind"
fcntl = pytest.importorskip("fcntl", reason=NO_TERMINAL)
pty = pytest.importorskip("pty", reason=NO_TERMINAL)
termios = pytest.importorskip("termios", reason=NO_TERMINAL)

# So long without a sample is silence.
SOON = "from adhesion_cli.live import shown; shown._SILENCE = 1.0"


def shown_on_a_terminal(folder: Path, columns: int, text: Sequence[str]) -> tuple[list[str], str]:
    """The lines that stay on a terminal, and every state of the line that does not."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": slave}
    with Forked(folder, ["live", "-", "-a", "imm"], **pipes) as process:
        os.close(slave)
        seen = bytearray()

        def read() -> None:
            with suppress(OSError):
                while piece := os.read(master, 1 << 16):
                    seen.extend(piece)

        reading = threading.Thread(target=read)
        reading.start()
        assert process.stdin
        for k, line in enumerate(text):
            process.stdin.write(line + "\n")
            process.stdin.flush()
            time.sleep(0.005 if k > 100 else 0.0)
        process.stdin.close()
        assert process.wait(timeout=60) == 3
    reading.join()
    os.close(master)
    *stays, last = seen.decode().replace("\r\n", "\n").split("\n")
    states = [x for line in (*stays, last) for x in line.split("\r\x1b[2K")[1:-1] if x]
    return [line.rsplit("\r\x1b[2K", 1)[-1] for line in stays], "\n".join(states)


@pytest.mark.parametrize(("columns", "worst"), [(30, "4"), (60, "1"), (200, "1")])
def test_the_line_fits_the_terminal_and_leaves_no_rests(
    tmp_path: Path, columns: int, worst: str
) -> None:
    """Axle 4 slides most; a repeated sample is reported in between."""
    slip = {1: 0.0, 2: 0.01, 3: 0.02, 4: 0.3}
    text = []
    for k in range(300):
        said: dict[str, float] = {"t": 0.01 * k, "train speed [km/h]": 80.0 - 0.01 * k}
        for n, s in slip.items():
            said[f"speed {n} [km/h]"] = (80.0 - 0.01 * k) * (1.0 - s)
            said[f"bc pressure {n} [bar]"] = 2.0
        text += [json.dumps(said)] * (2 if k == 200 else 1)
    stays, states = shown_on_a_terminal(tmp_path, columns, text)
    assert states
    assert max(map(len, states.split("\n"))) < columns
    assert {line[0] for line in states.split("\n")[1:]} == {worst}
    assert not [line for line in stays if "\r" in line or "Hz" in line or "30 %" in line]
    assert any("time-duplicate" in line for line in stays)
    assert [f"axle {n}: 300 samples" in stays for n in slip] == [True] * 4


def test_what_was_taken_and_written_is_said_at_the_end(tmp_path: Path) -> None:
    for quiet in ((), ("-q",)):
        with running(
            tmp_path, "--replay", SERVICE, "--speed", "0", "-o", "out", "--force", *quiet
        ) as process:
            _, told = process.communicate(timeout=120)
        assert process.returncode == 0
        said = told.splitlines()
        lines = "axle 1: 2601 samples", "wrote out/service-brake.live.mcap"
        assert [x in said for x in lines] == [not quiet] * 2
        assert ("vehicle-default" in told) is not quiet


def test_that_no_sample_comes_is_said_once(tmp_path: Path) -> None:
    source = f"udp://127.0.0.1:{(port := free_port())}"
    with (
        running(tmp_path, source, "--json", code=SOON) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        assert process.stderr
        said, lines = [process.stderr.readline()], list[dict[str, Any]]()
        reading = threading.Thread(target=read_all, args=(process, lines))
        reading.start()
        for pause, begin in ((2.0, 0), (0.5, 300)):
            for k in range(begin, begin + 300):
                sender.sendto(message(0.01 * k, 1, 80.0).encode(), ("127.0.0.1", port))
                time.sleep(0.001)
            time.sleep(pause)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
        reading.join()
        said += process.stderr.read().splitlines()
    assert sum(source in line for line in said) == 4  # nothing comes, it comes; twice
    assert len(lines) > 500
    assert all("t" in one for one in lines)


def test_ctrl_c_before_the_first_sample_is_no_error(tmp_path: Path) -> None:
    source = f"udp://127.0.0.1:{free_port()}"
    with running(tmp_path, source, "--json", "-o", "out", code=SOON) as process:
        assert process.stderr
        process.stderr.readline()  # it waits
        process.send_signal(signal.SIGINT)
        out, told = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert "error" not in told
