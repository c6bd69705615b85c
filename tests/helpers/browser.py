"""A headless Chromium, driven over a pipe by the DevTools protocol."""

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PROGRAM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip


class Tab:
    """One page, and everything that it reported."""

    def __init__(self, out: int, back: int) -> None:
        self._out, self._back, self._id, self._rest = out, back, 0, b""
        self._session: str | None = None
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        found = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = found["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """What a method of the protocol returns."""
        self._id += 1
        message: dict[str, Any] = {"id": self._id, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._id:
            self.events.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            block = os.read(self._back, 1 << 20)
            assert block, "the browser ended"
            self._rest += block
        message, _, self._rest = self._rest.partition(b"\0")
        found: dict[str, Any] = json.loads(message)
        return found

    def value(self, script: str) -> Any:
        """The value of an expression in the page."""
        found = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, script: str, seconds: float = 120.0) -> None:
        """Waits until an expression is true."""
        end = time.monotonic() + seconds
        while not self.value(script):
            assert time.monotonic() < end, script
            time.sleep(0.1)

    def open(self, path: Path) -> None:
        """Shows a file, and waits for its figures."""
        self.call("Page.navigate", url=path.as_uri())
        self.until("document.documentElement?.dataset.drawn === 'yes'")
        self.value("new Promise((done) => setTimeout(done, 500))")

    def faults(self) -> list[Any]:
        """Errors that the page reported."""
        self.value("1")  # what it reported until now
        found = []
        for e in self.events:
            of, method = e.get("params", {}), e.get("method")
            if method == "Runtime.exceptionThrown":
                found.append(of["exceptionDetails"])
            elif method == "Runtime.consoleAPICalled" and of["type"] in ("error", "warning"):
                found.append(of["args"])
            elif method == "Log.entryAdded" and of["entry"]["level"] == "error":
                found.append(of["entry"])
        return found

    def requested(self) -> set[str]:
        """What the page asked for, by the scheme of its address."""
        sent = (e["params"] for e in self.events if e.get("method") == "Network.requestWillBeSent")
        return {of["request"]["url"].partition(":")[0] for of in sent}


@contextmanager
def tab(folder: Path) -> Iterator[Tab]:
    """A tab of a new browser whose data are in this empty folder."""
    assert PROGRAM
    (read, out), (back, write) = os.pipe(), os.pipe()

    def wire() -> None:
        os.dup2(read, 53)  # out of the way of what is put to 3 and 4
        os.dup2(write, 54)
        os.dup2(53, 3)
        os.dup2(54, 4)

    started = subprocess.Popen(
        [PROGRAM, *_FLAGS, f"--user-data-dir={folder}"], pass_fds=(3, 4), preexec_fn=wire,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(read)
    os.close(write)
    try:
        yield Tab(out, back)
    finally:
        os.close(out)
        os.close(back)
        started.terminate()
        started.wait(30)
