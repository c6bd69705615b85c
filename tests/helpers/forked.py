"""Commands in processes of their own, without the start of Python and the imports.

These take 1.5 s, three quarters of a short command. A server takes them once, and forks for every
command. So signals, exit codes, limits, streams and what a kill leaves behind are real. What a test
holds of the start itself, as of what is imported, needs `subprocess`.
"""

import atexit
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

_NUMBER = struct.Struct("i")
_NONE: Mapping[str, str] = MappingProxyType({})
_STARTS = "import os, signal, sys, time; from adhesion_cli import __main__\n"


class Forked(subprocess.Popen[str]):
    """`adhesion` with these arguments, as `subprocess.Popen` has it.

    Args:
        folder: in which it runs.
        arguments: after the program's name.
        code: what the process does before the command, as Python.
        bare: from a server that has imported what `--help` needs, and no more.
        environ: variables of the command. A server of its own begins with `LD_PRELOAD`.
        streams: `stdin`, `stdout`, `stderr` as of `Popen`.
    """

    def __init__(
        self, folder: Path, arguments: list[str], code: str = "", *, bare: bool = False,
        environ: Mapping[str, str] = _NONE, **streams: Any,
    ) -> None:  # fmt: skip
        if sys.platform == "win32":
            import pytest

            pytest.skip("Windows cannot fork")
        self._request = {
            "folder": str(folder), "arguments": arguments, "code": code,
            "environ": {**os.environ, **environ},
        }  # fmt: skip
        self._server = _server(bare, environ.get("LD_PRELOAD", ""))
        super().__init__(arguments, text=True, **streams)

    def _execute_child(self, *given: Any) -> None:
        """In place of fork and exec; `given` has the ends of the pipes from its 11th on."""
        pipes = given[10:16]
        ends = [x if x != -1 else k for k, x in enumerate((pipes[0], pipes[3], pipes[5]))]
        self._status, theirs = os.pipe()
        socket.send_fds(self._server, [json.dumps(self._request).encode()], [*ends, theirs])
        os.close(theirs)
        self._close_pipe_fds(*pipes)
        self._child_created = True
        (self.pid,) = _NUMBER.unpack(os.read(self._status, _NUMBER.size))

    def poll(self) -> int | None:
        """The exit code, None while it runs."""
        try:
            return self.wait(0.0)
        except subprocess.TimeoutExpired:
            return None

    def wait(self, timeout: float | None = None) -> int:
        """The exit code; negative: the signal that ended it."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
            (state,) = _NUMBER.unpack(os.read(self._status, _NUMBER.size))
            os.close(self._status)
            self.returncode = os.waitstatus_to_exitcode(state)
        return self.returncode


@cache
def _server(bare: bool, preload: str) -> socket.socket:
    """The end of a channel to a server, which ends with this process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    subprocess.Popen(
        [sys.executable, __file__, str(theirs.fileno()), "bare" * bare],
        pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "LD_PRELOAD": preload},
    )  # fmt: skip
    theirs.close()
    return ours


def _import_all() -> None:
    """Imports the package, and loads the compiled loops of an analysis and what draws a figure."""
    import gc
    import importlib
    import pkgutil
    import tempfile

    import adhesion_cli
    from adhesion_cli.analysis import analyze, settings
    from adhesion_cli.cli.app import app
    from adhesion_cli.core import bundled

    for module in pkgutil.walk_packages(adhesion_cli.__path__, "adhesion_cli."):
        importlib.import_module(module.name)
    # Nothing of Rerun may run before the fork: its threads would be missing after it.
    importlib.import_module("rerun")
    low, service = (
        bundled.folder("sample_logs") / f"{x}.csv" for x in ("low-adhesion", "service-brake")
    )
    analyze.analyze(low, settings.load(folder=False), axles=[1])
    with tempfile.TemporaryDirectory() as folder:
        output = ["-o", f"{folder}/a.toml"]
        app(["calibrate", str(low), str(service), *output], standalone_mode=False)
    gc.freeze()  # else every fork looks through all of this for garbage as it ends, 2 s long


def _serve(channel: socket.socket) -> None:
    """Forks for every request; the process that is the command returns from here."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        message, ends, *_ = socket.recv_fds(channel, 1 << 20, 4)
        if not message:  # the tests have ended
            os._exit(0)
        *streams, status = ends
        if not os.fork():
            break
        for end in (*streams, status):
            os.close(end)
    channel.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    if pid := os.fork():
        for end in streams:
            os.close(end)
        os.write(status, _NUMBER.pack(pid))
        os.write(status, _NUMBER.pack(os.waitpid(pid, 0)[1]))
        os._exit(0)
    os.close(status)
    _become(json.loads(message), streams)


def _become(request: dict[str, Any], streams: list[int]) -> None:
    """Takes folder, environment, streams and arguments of the command, and runs it."""
    for number, end in enumerate(streams):
        os.dup2(end, number)
        os.close(end)
    sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environ"])
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    sys.argv = ["adhesion", *request["arguments"]]
    try:
        exec(_STARTS + request["code"] + "\n__main__.main()", {"__name__": "adhesion"})
    except SystemExit as ended:
        _end(ended)
        raise


def _end(ended: SystemExit) -> None:
    """Ends as Python does, without taking all that is imported apart: 0.2 s of each command.

    Returns where Python has more to say: a text as exit code, or an output that nobody takes.
    """
    if not isinstance(ended.code, int | None):
        return
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return
    os._exit(ended.code or 0)


if __name__ == "__main__":
    from adhesion_cli.cli import app  # noqa: F401

    if not sys.argv[2]:
        _import_all()
    _serve(socket.socket(fileno=int(sys.argv[1])))
