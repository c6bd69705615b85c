"""A run over many logs: what is missing is analysed, and each result is kept at once."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from ..core.errors import UserError, as_user_error
from ..core.text import utf8
from ..results.tables import LogRow
from . import dataset, work
from .dataset import Dataset, DoneLog, Kept
from .locations import Location
from .work import Done, Item, Job

_DEAD = {
    "error": "the process that analysed the log died",
    "hint": "often memory is short: analyse this log alone with `adhesion analyze`",
}


class Workers(Protocol):
    """Who does the work: see `processes.Processes`."""

    tries: int

    @property
    def died(self) -> type[Exception]:
        """What the future of a log raises whose process died."""

    @property
    def capacity(self) -> int:
        """Logs that are in work at once."""

    def each(self, do: Callable[[Any], Any], of: Sequence[Any]) -> Iterator[Any]:
        """`do` of each, in order."""

    def submit(self, do: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Calls a function in some process."""


class Failed(NamedTuple):
    """A log without a result."""

    name: str
    error: str
    hint: str


@dataclass(slots=True)
class State:
    """How far a run is; counts are logs as the user names them.

    Attributes:
        logs: all.
        read: of these, how many have been looked at.
        done: analysed in this run.
        skipped: those that were there already.
        lossy: of those two, how many have a finding that data was lost or may be wrong.
        failed: those that have no result.
    """

    logs: int
    read: int = 0
    done: int = 0
    skipped: int = 0
    lossy: int = 0
    failed: list[Failed] = field(default_factory=list)


def run(
    logs: Sequence[Location],
    job: Job,
    kept: Dataset,
    workers: Workers,
    force: bool = False,
    tell: Callable[[State], None] = lambda _: None,
) -> State:
    """Analyses the logs that have no result in the dataset.

    Args:
        logs: the logs; those with the same content are analysed once, by the name of the first.
        job: what is the same for all.
        kept: where the results are.
        workers: who does the work.
        force: whether results that are there are made again.
        tell: receives the state of the run after each step.

    Raises:
        UserError: results cannot be written, or the cluster is lost.
    """
    kept.prepare(job.depends())
    there, state = kept.done(), State(len(logs))
    named = _identified(logs, job, kept, workers, state, tell)
    items = []
    for digest, of in named.items():
        item = Item(of[0], digest)
        if force or not _complete(item, job, there.get(digest, [])):
            items.append(item)
        else:
            state.skipped += len(of)
            state.lossy += len(of) * there[digest][0].lossy
            _name(kept, digest, there[digest], of)
    tell(state)
    for batch in _worked(items, job, workers):
        kept.write(
            Kept(item.sha256, _names(named[item.sha256], there.get(item.sha256, [])), *done)
            for item, done in batch
        )
        for item, done in batch:
            _count(state, named[item.sha256], done.row)
        tell(state)
    return state


def _identified(
    logs: Sequence[Location],
    job: Job,
    kept: Dataset,
    workers: Workers,
    state: State,
    tell: Callable[[State], None],
) -> dict[str, list[Location]]:
    """The logs by the hash of their content; one that cannot be read has failed."""
    named: dict[str, list[Location]] = {}
    for log, (digest, told) in zip(logs, workers.each(work.identified, logs), strict=True):
        state.read += 1
        key = dataset.unread(log.name)
        if told:
            row = work.row(work.failed(Item(log, ""), told), job, None)
            kept.write([Kept(key, (log.name,), row, {})])
            _count(state, [log], row)
        else:
            kept.forget(key)  # an earlier run may not have been able to read it
            named.setdefault(digest, []).append(log)
        tell(state)
    return named


def _complete(item: Item, job: Job, rows: Sequence[DoneLog]) -> bool:
    """Whether a log has its results: what failed is tried again."""
    done = bool(rows) and rows[0].status != "error"
    return done and all(path.exists() for path in work.recordings(item, job))


def _name(kept: Dataset, key: str, rows: Sequence[DoneLog], of: Sequence[Location]) -> None:
    """Adds the names that a log did not have when it was analysed."""
    names = _names(of, rows)
    if len(names) > len(rows):
        kept.write([Kept(key, names, kept.row(key), {})])


def _names(of: Iterable[Location], rows: Iterable[DoneLog]) -> tuple[str, ...]:
    return tuple({*(utf8(log.name) for log in of), *(row.log for row in rows)})


def _count(state: State, of: Sequence[Location], row: LogRow) -> None:
    if row.status == "error":
        state.failed += [Failed(log.name, row.error or "", row.hint or "") for log in of]
    else:
        state.done += len(of)
        state.lossy += len(of) * row.lossy


def _worked(items: Iterable[Item], job: Job, workers: Workers) -> Iterator[list[tuple[Item, Done]]]:
    """Each log with what became of it, as soon as that is known; new logs go into work first.

    Raises:
        UserError: the cluster is lost.
    """
    left = deque((item, 1) for item in items)
    running: dict[Future[Done], tuple[Item, int]] = {}
    batch: list[tuple[Item, Done]] = []
    while left or running or batch:
        while left and len(running) < workers.capacity:
            item, tries = left.popleft()
            running[workers.submit(work.analysed, item, job)] = item, tries
        if batch:
            yield batch
        batch = []
        for future in wait(running, return_when=FIRST_COMPLETED).done if running else ():
            item, tries = running.pop(future)
            try:
                batch.append((item, future.result()))
            except workers.died:
                if tries < workers.tries:
                    left.appendleft((item, tries + 1))
                else:
                    batch.append((item, _failed(item, job, _DEAD)))
            except CancelledError as error:
                text = "the Dask scheduler is gone"
                raise UserError(text, "run again: what is done stays") from error
            except Exception as error:  # an internal error must not end the run
                told = as_user_error(error)
                batch.append((item, _failed(item, job, {"error": told.text, "hint": told.hint})))


def _failed(item: Item, job: Job, told: dict[str, str]) -> Done:
    return Done(work.row(work.failed(item, told), job, None), {})
