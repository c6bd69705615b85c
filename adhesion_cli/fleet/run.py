"""A run over many logs: what is missing is analysed, and each result is kept at once."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field

from ..core.children import STEP
from ..core.errors import UserError
from ..core.summary import FailedLog
from ..core.text import utf8
from ..results.tables import LogRow
from . import dataset, work
from .dataset import Dataset, KeptTables
from .locations import LogLocation
from .work import Job, Outcome
from .workers import Cluster, Processes

_DEAD = UserError(
    "the process that analysed the log died",
    "often memory is short: analyse this log alone with `adhesion analyze`",
)
Workers = Processes | Cluster


@dataclass(slots=True)
class FleetProgress:
    """How far a run is; counts are logs as the user names them."""

    logs: int
    read: int = 0  # of all logs, how many have been looked at
    completed: int = 0  # analysed in this run
    skipped: int = 0  # those that were there already
    lossy: int = 0  # of those two, how many have a finding that data was lost or may be wrong
    failed: list[FailedLog] = field(default_factory=list)  # those that have no result


def run(
    logs: Sequence[LogLocation],
    job: Job,
    dataset: Dataset,
    workers: Workers,
    force: bool = False,
    progress: Callable[[FleetProgress], None] = lambda _: None,
) -> FleetProgress:
    """Analyses the logs that have no result in the dataset; a UserError where it cannot go on.

    Those with the same content are analysed once, by the name of the first. With `force`, results
    that are there are made again.
    """
    dataset.prepare(job.depends())
    existing, state = dataset.finished_logs(), FleetProgress(len(logs))
    named = _identified(logs, job, dataset, workers, state, progress)
    items = []
    for digest, same_logs in named.items():
        item, rows = same_logs[0]._replace(sha256=digest), existing.get(digest, [])
        if force or not rows or rows[0].status == "error":  # what failed is tried again
            items.append(item)
            continue
        state.skipped += len(same_logs)
        state.lossy += len(same_logs) * rows[0].lossy
        if len(names := _names(same_logs, rows)) > len(rows):  # that it did not have before
            dataset.write([KeptTables(digest, names, rows[0], {})])
    progress(state)
    for batch in _worked(items, job, workers):
        tables = []
        for item, outcome in batch:
            names = _names(named[item.sha256], existing.get(item.sha256, []))
            tables.append(KeptTables(item.sha256, names, *outcome))
            _count(state, named[item.sha256], outcome.row)
        dataset.write(tables)
        progress(state)
    return state


def _identified(
    logs: Sequence[LogLocation],
    job: Job,
    finished: Dataset,
    workers: Workers,
    state: FleetProgress,
    progress: Callable[[FleetProgress], None],
) -> dict[str, list[LogLocation]]:
    """The logs by the hash of their content; one that cannot be read has failed."""
    named: dict[str, list[LogLocation]] = {}
    for log, digest in zip(logs, workers.map_jobs(work.identified, logs), strict=True):
        state.read += 1
        key = dataset.unread(log.name)
        if isinstance(digest, FailedLog):
            row = work.row(digest, job)
            finished.write([KeptTables(key, (log.name,), row, {})])
            _count(state, [log], row)
        else:
            finished.forget(key)  # an earlier run may not have been able to read it
            named.setdefault(digest, []).append(log)
        progress(state)
    return named


def _names(same_logs: Iterable[LogLocation], rows: Iterable[LogRow]) -> tuple[str, ...]:
    return tuple({*(utf8(log.name) for log in same_logs), *(row.log for row in rows)})


def _count(state: FleetProgress, same_logs: Sequence[LogLocation], row: LogRow) -> None:
    if row.status == "error":
        state.failed += [FailedLog(log.name, row.error or "", row.hint or "") for log in same_logs]
    else:
        state.completed += len(same_logs)
        state.lossy += len(same_logs) * row.lossy


def _worked(
    items: Iterable[LogLocation], job: Job, workers: Workers
) -> Iterator[list[tuple[LogLocation, Outcome]]]:
    """Each log with what became of it, as soon as that is known; new logs go into work first."""
    queue = deque((item, 1) for item in items)
    running: dict[Future[Outcome], tuple[LogLocation, int]] = {}
    batch: list[tuple[LogLocation, Outcome]] = []
    while queue or running or batch:
        while queue and len(running) < workers.capacity:
            item, tries = queue.popleft()
            running[workers.submit(work.analysed, item, job)] = item, tries
        if batch:
            yield batch
        batch = []
        for future in wait(running, STEP, FIRST_COMPLETED).done if running else ():
            item, tries = running.pop(future)
            try:
                batch.append((item, future.result()))
            except workers.died:
                if tries < workers.tries:
                    queue.appendleft((item, tries + 1))
                else:
                    batch.append((item, _failed(item, job, _DEAD)))
            except CancelledError as error:
                text = "the Dask scheduler is gone"
                raise UserError(text, "run again: what is done stays") from error
            except Exception as error:  # an internal error must not end the run
                batch.append((item, _failed(item, job, error)))


def _failed(item: LogLocation, job: Job, error: Exception) -> Outcome:
    return Outcome(work.row(work.failed(item, error), job), {})
