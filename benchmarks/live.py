"""`adhesion live` by the clock: processor time, latency from sender to line, memory over the time.

    python benchmarks/live.py [--seconds 60] [--axles 4] [--rate 200] [-o]

A sender on this machine gives a datagram per sample with speed and pressure of all axles. The
program computes all estimators and prints a line per axle, with -o also writes both files. The
latency is the time from the sending of a datagram to the moment at which the last line of it was
read. The first five seconds are left out of latency and processor time, and so is loading. The
memory is what the program itself holds (anonymous pages). Its rise is that of a straight line over
the second half of the time.
"""

import argparse
import json
import math
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

WARM = 5.0  # [s]
SPEED, LEAST = 40.0, 5.0  # m/s, at which the train brakes and is let go


def main() -> None:
    parse = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parse.add_argument("--seconds", type=float, default=60.0)
    parse.add_argument("--axles", type=int, default=4)
    parse.add_argument("--rate", type=float, default=200.0)
    parse.add_argument("-o", "--out", action="store_true", help="write both files, too")
    asked = parse.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.bind(("127.0.0.1", 0))
        port = sender.getsockname()[1] + 1
        command = [
            sys.executable,
            "-m",
            "adhesion_cli",
            "live",
            f"udp://127.0.0.1:{port}",
            "--json",
        ]
        command += ["-o", "out"] * asked.out
        with subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        ) as process:
            try:
                run = Run(process, sender, port, asked)
                run.go()
            finally:
                process.kill()
        run.show()
        for path in sorted(Path(folder).glob("out/*")):
            print(f"{path.suffix}: {path.stat().st_size / 1e6:.1f} MB")


class Run:
    """One run: samples sent, lines read, processor time and memory."""

    def __init__(
        self, process: "subprocess.Popen[str]", sender: socket.socket, port: int,
        asked: argparse.Namespace,
    ) -> None:  # fmt: skip
        self.process, self.sender, self.to, self.asked = process, sender, ("127.0.0.1", port), asked
        self.latency: list[float] = []
        self.memory: list[tuple[float, float]] = []
        self.sent = self.lines = 0
        self.busy = (0.0, 0.0)

    def go(self) -> None:
        """Sends until the time is over."""
        reading = threading.Thread(target=self._read, daemon=True)
        reading.start()
        while not self.lines:  # it loads
            self._send()
            time.sleep(1.0 / self.asked.rate)
        begin = time.monotonic()
        self.sent, at, warm = 0, 0.0, False
        while at < WARM + self.asked.seconds:
            if not warm and at > WARM:
                warm, self.busy = True, (time.monotonic(), self._processor())
                self.latency.clear()
            self._send()
            if self.sent % max(round(self.asked.rate), 1) == 0:
                self.memory.append((at, self._megabytes()))
            at = self.sent / self.asked.rate
            if (wait := begin + at - time.monotonic()) > 0.0:
                time.sleep(wait)
        self.busy = (time.monotonic() - self.busy[0], self._processor() - self.busy[1])

    def _send(self) -> None:
        """One sample of all axles: brake applications, one after the other."""
        x = self.sent / self.asked.rate
        speed = SPEED - (x % (SPEED - LEAST))
        said: dict[str, float] = {"t": time.time()}
        for n in range(1, self.asked.axles + 1):
            said[f"speed {n} [m/s]"] = speed * (1.0 - 0.01 * math.sin(x + n) ** 8)
            said[f"bc pressure {n} [bar]"] = 2.0 + 0.1 * math.sin(0.1 * x)
        self.sender.sendto(json.dumps(said).encode(), self.to)
        self.sent += 1

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            said, now = json.loads(line), time.time()
            self.lines += 1
            if said["axle"] == self.asked.axles:
                self.latency.append(now - said["t"])

    def _processor(self) -> float:
        """Seconds that the program has computed."""
        part = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(part[11]) + int(part[12])) / os.sysconf("SC_CLK_TCK")

    def _megabytes(self) -> float:
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(text.partition("RssAnon:")[2].split()[0]) / 1024.0

    def show(self) -> None:
        """Prints what was measured."""
        wall, busy = self.busy
        p50, p99, most = (1e3 * float(np.quantile(self.latency, q)) for q in (0.5, 0.99, 1.0))
        print(f"{self.asked.axles} axles at {self.asked.rate:.0f} Hz for {wall:.0f} s")
        print(f"processor: {100.0 * busy / wall:.1f} % of a core")
        print(f"latency: median {p50:.2f} ms, 99th percentile {p99:.2f} ms, highest {most:.1f} ms")
        t, m = np.array(self.memory).T
        late = t >= t[-1] / 2.0
        rise = 3600.0 * np.polyfit(t[late], m[late], 1)[0]
        print(
            f"memory: {m[0]:.0f} MB at first, {m[-1]:.0f} MB at last, rise {rise:+.1f} MB an hour"
        )
        print(f"samples: {len(self.latency)} of {round(wall * self.asked.rate)} read")


if __name__ == "__main__":
    main()
