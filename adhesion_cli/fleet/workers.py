"""Workers on logs: processes of this machine, or those of a Dask cluster that runs already.

A process has one log at a time, and may die.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.pool import ThreadPool
from queue import SimpleQueue
from typing import Any

from .. import __version__
from ..core.annotated import Json
from ..core.children import Child, ChildDiedError
from ..core.errors import UserError
from ..core.imports import refuse_pandas
from ..core.text import printable
from . import locations, work

_SILENT = logging.CRITICAL + 1
_AGE = 5.0  # of the number of workers [s]


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
        """`do` of each, in order, by threads, as it reads; an interrupt does not wait."""
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


class Cluster:
    """A cluster, by the address of its scheduler; attributes as those of `Processes`.

    The scheduler itself gives a log to another worker when one dies, as often as its setting
    `allowed-failures` says.
    """

    tries = 1

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            text = "--scheduler needs dask.distributed, which is not installed"
            raise UserError(text, locations.EXTRA) from error
        for name in ("distributed", "distributed.client"):  # what it logs, our errors say
            logging.getLogger(name).setLevel(_SILENT)
        self.died: type[Exception] = KilledWorker
        try:
            self._client = Client(address, timeout="10s", set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            text = f"--scheduler {printable(address)}: no Dask scheduler answers there"
            hint = "start one with `dask scheduler`, or check host, port and firewall"
            raise UserError(text, hint) from error
        try:
            self._check()
        except BaseException:
            self._client.close()
            raise
        self._calls = self._client.get_executor(pure=False)
        self._warm = False
        self._count, self._last_check = 1, -math.inf

    @property
    def capacity(self) -> int:
        """Logs that are in work at once: one for each worker that is there."""
        if time.monotonic() > self._last_check + _AGE:
            self._count, self._last_check = max(1, len(self._workers())), time.monotonic()
        return self._count

    def map_jobs(self, do: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """`do` of each, in order, on the cluster."""
        for start in range(0, len(items), work.BLOCK):
            block = self._client.map(do, items[start : start + work.BLOCK], pure=False)
            yield from self._client.gather(block)

    def submit(self, do: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Calls a function on some worker."""
        if not self._warm:
            hosts = {worker["host"]: address for address, worker in self._workers().items()}
            submit = self._client.submit
            self._client.gather(
                [submit(work.warm, workers=[x], pure=False) for x in hosts.values()]
            )
            self._warm = True
        future: Future[Any] = self._calls.submit(do, *arguments)
        return future

    def close(self) -> None:
        """Leaves the cluster; what is in work there is of no use any more."""
        self._calls.shutdown(wait=False)
        self._client.close()

    def _workers(self) -> Json:
        workers: Json = self._client.scheduler_info(n_workers=-1)["workers"]
        return workers

    def _check(self) -> None:
        """Refuses a cluster without workers, or whose workers have another version."""
        hint = f"install adhesion-cli {__version__} with its extras on every worker"
        try:
            versions = self._client.run(version)
        except Exception as error:  # the worker cannot import this module
            text = f"a worker of the cluster has no adhesion-cli {__version__}"
            raise UserError(text, hint) from error
        if not versions:
            text = "the cluster has no worker"
            raise UserError(text, "start some, as `dask worker HOST:PORT --nthreads 1`")
        for worker, worker_version in versions.items():
            if worker_version != __version__:
                text = f"worker {printable(worker)} has version {worker_version} of adhesion-cli"
                raise UserError(text, hint)


def version() -> str:
    """The version of this program, on a worker."""
    return __version__
