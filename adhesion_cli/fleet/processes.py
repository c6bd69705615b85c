"""Workers as processes of this machine: each has one log at a time, and may die."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from ..core.errors import UserError
from . import work

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

# A worker computes with one thread: the other processors have workers of their own.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Processes:
    """So many processes, each with a pipe of its own: a dead one is known with its log.

    A pipe ends with its process, so nothing waits for one that was killed. The pools of Python do,
    and at the end of a run they may also write to a pipe that is closed already.

    Attributes:
        capacity: logs that are in work at once.
        died: what the future of a log raises whose process died.
        tries: how often a log whose process died is tried.
    """

    died: type[Exception] = BrokenExecutor
    tries = 2

    def __init__(self, count: int) -> None:
        self.capacity = count
        self._idle: SimpleQueue[_Worker | None] = SimpleQueue()
        for _ in range(count):
            self._idle.put(None)  # started when there is work for it
        self._started: list[_Worker] = []
        self._waiting = ThreadPoolExecutor(count)  # each for the answer of a process

    def map_jobs(self, do: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """`do` of each, in order; it mostly reads, so threads are enough."""
        with ThreadPoolExecutor(self.capacity) as threads:
            for start in range(0, len(items), work.BLOCK):
                yield from threads.map(do, items[start : start + work.BLOCK])

    def submit(self, do: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Calls a function in an idle process."""
        worker = self._idle.get() or self._start_worker()
        future = self._waiting.submit(worker.call, do, *arguments)
        future.add_done_callback(
            lambda finished: self._idle.put(None if self._dead(finished) else worker)
        )
        return future

    def close(self) -> None:
        """Ends the processes, whatever they do: what they write is whole, or has no name."""
        for worker in self._started:
            worker.process.kill()
        self._waiting.shutdown(cancel_futures=True)
        for worker in self._started:
            worker.process.join()
            worker.pipe.close()
        self._started.clear()

    def _dead(self, finished: "Future[Any]") -> bool:
        return finished.cancelled() or isinstance(finished.exception(), self.died)

    def _start_worker(self) -> "_Worker":
        """A new process; the first compiles what the others then find compiled."""
        for name in _THREADS:
            os.environ.setdefault(name, "1")
        is_first = not self._started
        with _uninterrupted():
            self._started.append(worker := _Worker())
        if is_first:
            try:
                worker.call(work.warm)
            except BrokenExecutor as error:
                text = "a process died before it had a log"
                raise UserError(text, "free memory, or lower --workers") from error
        return worker


class _Worker:
    """A process that calls functions, one at a time."""

    def __init__(self) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, child_pipe = spawn.Pipe()
        self.process = spawn.Process(target=_serve, args=(child_pipe,), daemon=True)
        try:
            self.process.start()
        finally:
            child_pipe.close()  # the process alone has it: the pipe ends with the process

    def call(self, do: Callable[..., Any], *arguments: Any) -> Any:
        """What the function returns or raises there.

        Raises:
            BrokenExecutor: the process died.
        """
        try:
            self.pipe.send((do, arguments))
            succeeded, answer = self.pipe.recv()
        except (EOFError, OSError) as error:
            raise BrokenExecutor("the process died") from error
        if not succeeded:
            raise answer
        return answer


def _serve(pipe: "Connection") -> None:
    """Calls what comes through a pipe, and sends what it returns or raises."""
    _begin()
    while True:
        try:
            do, arguments = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = True, do(*arguments)
        except Exception as error:  # the run says what becomes of the log
            answer = False, error
        pipe.send(answer)


def _begin() -> None:
    """Prepares this process; it ends when the run is gone, even killed."""
    work.prepare()
    if parent := multiprocessing.parent_process():

        def watch() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """A process that starts in here never gets Ctrl-C: the run does, and ends it."""
    old_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, old_mask)
