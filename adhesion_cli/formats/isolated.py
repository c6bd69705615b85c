"""Runs a format's library in a process of its own.

Libraries for binary logs trust the file. A damaged one can crash them, keep them busy without end
or make them take all memory. In a process of its own that is one clear error. The process serves
all logs of one format, so that the library is loaded once.
"""

import atexit
import contextlib
import dataclasses
import importlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..core.annotated import Json
from ..core.errors import UserError, installed_by
from .source import Field, ReadOptions
from .tables import Columns, Contents, Note, Reader, TableSamples, TableSource

_MEMORY = 3 << 30, 24  # bytes that reading a log may take, and for each byte of the file
_SECONDS = 120, 2e-6  # of processor time, and for each byte of the file
_START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
_START += "from adhesion_cli.formats.isolated import serve; serve(sys.argv[2])"


@dataclass(frozen=True, slots=True)
class Library:
    """What a format needs: the modules, who installs them, and a word for messages."""

    kind: str  # of the log; the module of the format in this package, too
    description: str  # the format, for people
    modules: tuple[str, ...]
    extra: str  # of this package, which installs them

    def open(self, path: Path, options: ReadOptions) -> TableSource:
        """Opens a log of this format.

        Raises:
            UserError: where the library is missing or cannot read the file.
        """
        if missing := [m for m in self.modules if importlib.util.find_spec(m) is None]:
            raise UserError(
                f"{path}: {self.description} needs {' and '.join(missing)}, not installed",
                installed_by(self.extra),
            )
        return TableSource(path, self.kind, options, _Remote(self, path, options))


class _Remote:
    """A `Reader` whose library runs in the other process."""

    def __init__(self, library: Library, path: Path, options: ReadOptions) -> None:
        options_table = dataclasses.asdict(options)
        options_table |= {"dbc": [str(Path(name).absolute()) for name in options.dbc]}
        self._library, self._path = library, path
        self._request = {"path": str(path.absolute()), "options": options_table}
        header, _ = self._ask()
        notes = [Note(**note) for note in header.pop("notes")]
        fields = [Field(**f) for f in header.pop("fields")]
        self.contents = Contents(**header, fields=fields, notes=notes)

    def read(self, wanted: Sequence[int]) -> Columns:
        """See `Reader`."""
        header, arrays = self._ask(wanted=list(wanted))
        axes = [arrays.pop(0) for _ in range(header["axes"])]
        series = [
            TableSamples(axis, arrays.pop(0), {code: arrays.pop(0) for code in masks})
            for axis, masks in header["series"]
        ]
        return Columns(axes, series, [Note(**note) for note in header["notes"]])

    def _ask(self, **more: Any) -> tuple[Json, list[Any]]:
        """The answer to a request; what went wrong there is raised here.

        Raises:
            UserError: where the file cannot be read.
        """
        server = _server(self._library.kind)
        request = self._request | more
        try:
            with server.lock:
                server.send(request)
                header = server.header()
                arrays = [server.array(*shape) for shape in header.pop("arrays", ())]
        except (OSError, EOFError):
            raise self._crashed(server.ended()) from None
        if error := header.get("error"):
            cause = RuntimeError(error["traceback"])
            text = error["text"].replace(self._request["path"], str(self._path))
            raise UserError(text, error["hint"], error["code"]) from cause
        return header, arrays

    def _crashed(self, code: int) -> UserError:
        """What is told of a library that did not come to an end."""
        outcome = "crashes"
        if sys.platform != "win32" and code in (-signal.SIGXCPU, -signal.SIGKILL):
            outcome = "does not come to an end"
        return UserError(*_damaged(self._path, self._library.description, f"its reader {outcome}"))


def _damaged(path: Path, description: str, reason: str) -> tuple[str, str]:
    text = f"{path}: damaged {description} file: {reason}"
    return text, "copy the log again from its source, or export it as CSV with its own tool"


# ---------------------------------------------------------------------------- the other process


@dataclass(slots=True)
class _Server:
    """The other process, as this one sees it."""

    process: "subprocess.Popen[bytes]"
    owner: int  # the process that started it: another one must not use its pipes
    lock: threading.Lock = field(default_factory=threading.Lock)

    def send(self, request: Json) -> None:
        pipe = self._pipe(self.process.stdin)
        pipe.write(json.dumps(request).encode() + b"\n")
        pipe.flush()

    def header(self) -> Json:
        line = self._pipe(self.process.stdout).readline()
        if not line.endswith(b"\n"):
            raise EOFError
        answer: Json = json.loads(line)
        return answer

    def array(self, kind: str, length: int) -> Any:
        values: Any = np.empty(length, kind)
        view, filled = memoryview(values).cast("B") if length else memoryview(b""), 0
        pipe: Any = self._pipe(self.process.stdout)
        while filled < len(view):
            received = pipe.readinto(view[filled:])
            if not received:
                raise EOFError
            filled += received
        return values

    def ended(self) -> int:
        """The exit code; ends the process where it still runs."""
        _servers.pop(next((k for k, v in _servers.items() if v is self), ""), None)
        with contextlib.suppress(OSError):
            self._pipe(self.process.stdin).close()
        try:
            return self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    @staticmethod
    def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
        assert pipe is not None
        return pipe


_servers: dict[str, _Server] = {}
_starting = threading.Lock()


def _server(kind: str) -> _Server:
    """The process that reads logs of this kind, started if need be."""
    with _starting:
        server = _servers.get(kind)
        if server and server.owner == os.getpid() and server.process.poll() is None:
            return server
        command = [sys.executable, "-c", _START, json.dumps(sys.path), kind]
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)
        _servers[kind] = _Server(process, os.getpid())
        return _servers[kind]


@atexit.register
def _stop_servers() -> None:
    """Ends the processes that this one started."""
    for server in list(_servers.values()):
        if server.owner == os.getpid():
            server.ended()


def serve(kind: str) -> None:
    """Answers requests on stdin until there are no more; runs in the other process."""
    with contextlib.suppress(AttributeError, ValueError):
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # it ends without a word
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print
    previous: tuple[Any, Reader] | None = None
    for line in sys.stdin.buffer:
        request = json.loads(line)
        wanted = request.pop("wanted", None)
        try:
            files = [request["path"], *filter(os.path.isfile, request["options"]["dbc"])]
            key = json.dumps(request), [os.stat(file).st_mtime_ns for file in files]
            if previous is None or previous[0] != key:
                previous = None  # lets the file before go
                previous = key, _open_reader(kind, request)
            _limit(Path(request["path"]))
            _answer(output, previous[1], wanted)
        except (BrokenPipeError, KeyboardInterrupt):
            return
        except Exception as error:
            previous = None
            text, hint, code = _error_parts(error, kind, Path(request["path"]))
            trace = traceback.format_exc()
            answer = {"text": text, "hint": hint, "code": code, "traceback": trace}
            _write(output, {"error": answer}, [])


def _open_reader(kind: str, request: Json) -> Reader:
    """The format's reader on this log."""
    options = request["options"] | {"dbc": tuple(request["options"]["dbc"])}
    path = Path(request["path"])
    _limit(path)
    module = importlib.import_module(f".{kind}", __package__)
    reader: Reader = module.Reader(path, ReadOptions(**options))
    return reader


def _answer(output: IO[bytes], reader: Reader, wanted: Sequence[int] | None) -> None:
    if wanted is None:
        _write(output, dataclasses.asdict(reader.contents), [])
        return
    axes, series, notes = reader.read(wanted)
    arrays: list[Any] = [np.ascontiguousarray(t, "<i8") for t in axes]
    for entry in series:
        arrays.append(np.ascontiguousarray(entry.value, "<f8"))
        arrays += [np.ascontiguousarray(mask, "?") for mask in entry.masks.values()]
    note_tables = [dataclasses.asdict(note) for note in notes]
    places = [(int(entry.axis), list(entry.masks)) for entry in series]
    _write(output, {"axes": len(axes), "series": places, "notes": note_tables}, arrays)


def _write(output: IO[bytes], header: Json, arrays: Sequence[Any]) -> None:
    shapes = [(a.dtype.str, len(a)) for a in arrays]
    output.write(json.dumps({**header, "arrays": shapes}, default=str).encode() + b"\n")
    for array in arrays:
        output.write(memoryview(array).cast("B") if len(array) else b"")
    output.flush()


def _error_parts(error: Exception, kind: str, path: Path) -> tuple[str, str, int]:
    """Text, hint and exit code of what went wrong."""
    if isinstance(error, UserError):
        return error.text, error.hint, error.code
    if isinstance(error, MemoryError):
        size = _allowed(path.stat().st_size) / 2**30
        text = f"{path}: reading it takes more than {size:.0f} GiB of memory"
        return text, "split the log, or export the channels that are needed", 1
    reason = " ".join(str(error).split())[:120]
    if type(error) is not ValueError:
        reason = f"its structure is wrong ({type(error).__name__}: {reason})"
    return *_damaged(path, kind.upper(), reason), 1


def _allowed(size: int) -> int:
    return _MEMORY[0] + _MEMORY[1] * size


def _limit(path: Path) -> None:
    """Limits the memory and the time that reading a log of this size may take."""
    if sys.platform == "win32":
        return
    import resource

    size = path.stat().st_size
    usage = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(usage.ru_utime + usage.ru_stime + _SECONDS[0] + _SECONDS[1] * size)
    for kind, limit in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_DATA, _allowed(size))):
        hard = resource.getrlimit(kind)[1]
        soft_limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (soft_limit, hard))
