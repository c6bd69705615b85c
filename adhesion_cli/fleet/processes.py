"""Workers as processes of this machine: each has one log at a time, and may die."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.pool import ThreadPool
from queue import SimpleQueue
from typing import Any

from ..core.children import Child, ChildDiedError
from ..core.errors import UserError
from ..core.imports import refuse_pandas
from . import work


class Processes:
    """So many child processes; one that dies is known with its log."""

    died: type[Exception] = ChildDiedError  # what the future of a log raises whose process died
    tries = 2  # of a log whose process died

    def __init__(self, count: int) -> None:
        self.capacity = count  # logs that are in work at once
        self._idle: SimpleQueue[Child | None] = SimpleQueue()
        for _ in range(count):
            self._idle.put(None)  # started when there is work for it
        self._started: list[Child] = []
        self._waiting = ThreadPoolExecutor(count)  # each for the answer of a process

    def map_jobs(self, do: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """`do` of each, in order; it mostly reads, so threads are enough.

        A caller that is interrupted does not wait for what they read.
        """
        with ThreadPool(self.capacity) as threads:
            yield from threads.imap(do, items)

    def submit(self, do: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Calls a function in an idle process."""
        child = self._idle.get()
        if child is None or not child.is_usable:
            child = self._start_child()
        future = self._waiting.submit(child.call, work.call_prepared, do, *arguments)
        future.add_done_callback(lambda _: self._idle.put(child))
        return future

    def close(self) -> None:
        """Ends the processes, whatever they do: what they write is whole, or has no name."""
        for child in self._started:
            child.end()
        self._waiting.shutdown(cancel_futures=True)

    def _start_child(self) -> Child:
        """A new process; the first compiles what the others then find compiled."""
        self._started.append(child := Child())
        try:
            child.call(refuse_pandas)
            if len(self._started) == 1:
                child.call(work.call_prepared, work.warm)
        except ChildDiedError as error:
            text = "a process died before it had a log"
            raise UserError(text, "free memory, or lower --workers") from error
        return child
