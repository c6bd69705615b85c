"""Workers as processes of this machine: each has one log at a time, and may die."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

from ..core.errors import UserError
from . import work

# A worker computes with one thread: the other processors have workers of their own.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Processes:
    """So many processes, each in a pool of its own: a dead one is known with its log.

    Attributes:
        capacity: logs that are in work at once.
        died: what the future of a log raises whose process died.
        tries: how often a log whose process died is tried.
    """

    died: type[Exception] = BrokenExecutor
    tries = 2

    def __init__(self, count: int) -> None:
        self.capacity = count
        self._idle: SimpleQueue[ProcessPoolExecutor | None] = SimpleQueue()
        for _ in range(count):
            self._idle.put(None)  # started when there is work for it
        self._warm = False

    def each(self, do: Callable[[Any], Any], of: Sequence[Any]) -> Iterator[Any]:
        """`do` of each, in order; it mostly reads, so threads are enough."""
        with ThreadPoolExecutor(self.capacity) as threads:
            for first in range(0, len(of), work.BLOCK):
                yield from threads.map(do, of[first : first + work.BLOCK])

    def submit(self, do: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Calls a function in an idle process."""
        pool = self._idle.get() or self._started()
        with _uninterrupted():
            future = pool.submit(do, *arguments)
        future.add_done_callback(lambda done: self._idle.put(None if self._dead(done) else pool))
        return future

    def close(self) -> None:
        """Ends the processes, whatever they do: what they write is whole, or has no name."""
        for child in multiprocessing.active_children():
            child.kill()

    def _dead(self, done: "Future[Any]") -> bool:
        return done.cancelled() or isinstance(done.exception(), self.died)

    def _started(self) -> ProcessPoolExecutor:
        """A pool of one process; the first compiles what the others then find compiled."""
        for name in _THREADS:
            os.environ.setdefault(name, "1")
        pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)
        if not self._warm:
            with _uninterrupted():
                ready = pool.submit(work.warm)
            try:
                ready.result()
            except BrokenExecutor as error:
                text = "a process died before it had a log"
                raise UserError(text, "free memory, or lower --workers") from error
            self._warm = True
        return pool


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
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
