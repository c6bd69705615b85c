"""Work on several processors at once, with the results of one after the other.

Compiled loops, numpy's long operations and compression run without Python's lock.
"""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

_processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
max_threads = _processors or 1  # threads at once; a program sets it


def run_each(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """`function` of each, in order, or the first error; no call may change what another uses."""
    return list(run_ahead(function, items)) if len(items) > 1 else [function(x) for x in items]


def run_ahead(function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """`function` of each, in order, on all processors ahead of use; see `run_each`."""
    if max_threads < 2:
        yield from map(function, items)
        return
    from concurrent.futures import Future, ThreadPoolExecutor  # slow to import

    with ThreadPoolExecutor(max_threads) as pool:
        futures: deque[Future[R]] = deque()
        for x in items:
            futures.append(pool.submit(function, x))
            if len(futures) == max_threads:
                yield futures.popleft().result()
        while futures:
            yield futures.popleft().result()
