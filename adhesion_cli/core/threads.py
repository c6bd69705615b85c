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
most = _processors or 1  # threads at once; a program sets it


def each(do: Callable[[T], R], of: Sequence[T]) -> list[R]:
    """`do` of each, in order; the first error in that order is raised.

    Args:
        do: must not change what another call uses.
        of: what it is done for.
    """
    count = min(most, len(of))
    if count < 2:
        return [do(x) for x in of]
    from concurrent.futures import ThreadPoolExecutor  # slow to import

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(do, of))  # on an error it starts no other


def ahead(do: Callable[[T], R], of: Iterable[T]) -> Iterator[R]:
    """`do` of each, in order; while one is used, the next are being made.

    Args:
        do: must not change what another call uses.
        of: what it is done for; as many as there are processors are in work.
    """
    if most < 2:
        yield from map(do, of)
        return
    from concurrent.futures import Future, ThreadPoolExecutor  # slow to import

    with ThreadPoolExecutor(most) as pool:
        made: deque[Future[R]] = deque()
        for x in of:
            made.append(pool.submit(do, x))
            if len(made) == most:
                yield made.popleft().result()
        while made:
            yield made.popleft().result()
