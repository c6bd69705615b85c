"""Where processes start: children that call functions.

What a child does cannot end its caller. A child is a fresh Python on every system. It does not
import from the folder where it is started, its output goes nowhere, and it ends with its caller,
however that ends.
"""

import contextlib
import json
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from .cache_folder import cache_folder

# A child computes with one thread: the other processors have children of their own.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
_START += f"from {__name__} import serve; serve()"
_PATIENCE = 5.0  # for a child that ends by itself [s]
STEP = 0.5  # of a wait that an interrupt must end: Windows delivers no Ctrl-C during one [s]


class ChildDiedError(Exception):
    """A child ended before its answer, with this exit code; `was_late` if its time was over."""

    def __init__(self, code: int, was_late: bool = False) -> None:
        super().__init__(f"the process died ({code})")
        self.code, self.was_late = code, was_late


class Child:
    """A process that calls functions, one at a time."""

    def __init__(self) -> None:
        working_folder, package_folder = os.path.realpath("."), str(Path(__file__).parents[2])
        folders = [
            x for x in sys.path if x == package_folder or os.path.realpath(x) != working_folder
        ]
        path = json.dumps([*folders, package_folder])
        cache = {"XDG_CACHE_HOME": str(cache_folder().parent)}  # a temporary one is ours to remove
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=dict.fromkeys(_THREADS, "1") | os.environ | cache,
        )
        self._owner = os.getpid()  # a fork of this process must not use the pipes
        self._lock = threading.Lock()
        self._answers: SimpleQueue[Any] = SimpleQueue()  # what the process sent, or why it cannot
        threading.Thread(target=self._listen, daemon=True).start()
        self._number = 0  # of the request

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    @property
    def is_usable(self) -> bool:
        """Whether it waits for calls of this process."""
        return self._owner == os.getpid() and self._process.poll() is None

    def call(self, function: Callable[..., Any], *arguments: Any, seconds: float = math.inf) -> Any:
        """What the function returns or raises there, a ChildDiedError where the process died.

        It is of a module that the child can import. After so many seconds the process is ended.
        """
        requests = self._process.stdin
        assert requests is not None
        with self._lock:
            self._number += 1
            try:
                pickle.dump(pickle.dumps((self._number, function, arguments)), requests)
                requests.flush()
                number, outcome, trace = self._answer(seconds)
            except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(_PATIENCE)
                raise ChildDiedError(self.end()) from error
            except BaseException:  # its answer must not become that to the next request
                self.end()
                raise
        if number != self._number:
            raise ChildDiedError(self.end())
        if trace:
            raise outcome from RuntimeError(trace)
        return outcome

    def _listen(self) -> None:
        assert self._process.stdout is not None
        try:
            while True:
                self._answers.put(pickle.load(self._process.stdout))
        except Exception as error:  # the process has ended, or sent what is no answer
            self._answers.put(error)

    def _answer(self, seconds: float) -> Any:
        """The next answer; a process without one in time has died."""
        deadline = time.monotonic() + seconds
        while True:
            try:
                answer = self._answers.get(timeout=min(STEP, max(deadline - time.monotonic(), 0.0)))
            except Empty:
                if time.monotonic() >= deadline:
                    raise ChildDiedError(self.end(), was_late=True) from None
            else:
                if isinstance(answer, Exception):
                    raise answer
                return answer

    def end(self) -> int:
        """Ends the process, whatever it does; its exit code."""
        self._process.kill()
        code = self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        return code


def serve() -> None:
    """Calls functions for the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller gets it, and ends this process
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1):  # libraries print
        os.dup2(nowhere, stream)
    received: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_receive, args=(requests, received), daemon=True).start()
    while True:
        number, function, arguments = pickle.loads(received.get())
        try:
            answer = number, function(*arguments), ""
        except Exception as error:
            answer = number, error, traceback.format_exc()
        pickle.dump(answer, answers)
        answers.flush()


def _receive(requests: Any, received: "SimpleQueue[bytes]") -> None:
    """Takes requests; ends this process, even at work, when there is nobody to send them."""
    with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
        while True:
            received.put(pickle.load(requests))
    os._exit(1)
