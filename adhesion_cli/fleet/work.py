"""What a worker does with one log. It gets plain values, and returns the bytes of the tables."""

import gc
import hashlib
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from ..analysis import settings
from ..analysis.analyze import analyze, evaluate
from ..analysis.summarise import summarise
from ..core import annotated, bundled, errors, threads
from ..core.summary import FailedLog, ResultSummary
from ..formats.open import check_kind
from ..results import tables
from ..results.tables import LogRow
from .dataset import OF_RESULTS
from .locations import LogLocation, local

BLOCK = 256  # logs whose hashes are asked for at once
_SINGLE_LOG = threading.Lock()  # a process analyses one log at a time, whatever threads it has
# With train speed and slides, and without: what other logs need, too. One axle of each is enough.
_SAMPLES: dict[str, tuple[int, ...]] = {"low-adhesion.csv": (1,), bundled.SAMPLE: ()}
_THRESHOLD = 100_000  # as in `__main__`: what is imported stays


class Job(NamedTuple):
    """What is the same for every log of a run."""

    stated: annotated.Json  # settings, from `settings.stated`
    strict: bool  # whether damaged data is an error
    algos: tuple[str, ...]  # estimators, all if empty
    axles: tuple[int, ...]  # all if empty
    window: tuple[float | None, float | None]  # seconds after each log's start, from and to
    version: str  # of this program
    settings: str = ""  # hash of what `depends` gives

    def depends(self) -> annotated.Json:
        """All that a result depends on, except the log and the version."""
        excluded = {"version", "settings"}
        return {name: value for name, value in self._asdict().items() if name not in excluded}


class Outcome(NamedTuple):
    """A log that was analysed, or failed."""

    row: LogRow  # of the table of logs
    files: dict[str, bytes]  # its other tables by name; none of a log that failed


def identified(log: LogLocation) -> str | FailedLog:
    """The hash of a log's content; why it cannot be read, where it cannot."""
    try:
        with local(log.place) as path:
            check_kind(path)
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
    except Exception as error:  # every kind of URL has its own errors
        return failed(log, error)


def analysed(log: LogLocation, job: Job) -> Outcome:
    """Analyses one log; an error becomes its row."""
    summary: ResultSummary | FailedLog
    files: dict[str, bytes]
    with _SINGLE_LOG:
        begin = time.perf_counter()
        place = log.place
        try:
            with local(place) as path:
                place = str(path)  # the copy of a URL
                summary, files = _tables(path, log, job)
        except Exception as error:
            summary, files = failed(log, error, place), {}
        return Outcome(row(summary, job, time.perf_counter() - begin), files)


def failed(log: LogLocation, error: Exception, place: str = "") -> FailedLog:
    """A log that has no result: error and hint by its name, also where `place` is its file."""
    said, name = errors.as_user_error(error), log.name
    text, hint = (x.replace(place or log.place, name) for x in (said.text, said.hint))
    return FailedLog(name, text, hint, log.sha256 or None)


def row(summary: ResultSummary | FailedLog, job: Job, seconds: float | None = None) -> LogRow:
    """The row of a log in the table of logs."""
    row = tables.log_row(summary)
    return replace(row, seconds=seconds, version=job.version, settings=job.settings)


def call_prepared(do: Callable[..., Any], *arguments: Any) -> Any:
    """Calls a function in a process that computes with one thread, and seldom looks for garbage."""
    gc.set_threshold(_THRESHOLD)
    pa.set_cpu_count(1)
    threads.max_threads = 1
    return do(*arguments)


def warm() -> None:
    """Loads what an analysis needs, and compiles it where that was not done on this machine."""
    default, folder = settings.load(folder=False), bundled.folder("sample_logs")
    for name, axles in _SAMPLES.items():
        summarise(analyze(folder / name, default, axles=axles, train_speed=True), {})


def _tables(path: Path, log: LogLocation, job: Job) -> tuple[ResultSummary, dict[str, bytes]]:
    flags = {"strict": job.strict, "several_loggers": True}
    settings_of_job = settings.load(job.stated, (), False, **flags)
    evaluated = evaluate(path, settings_of_job, job.algos, job.axles, job.window, train_speed=True)
    if evaluated.log.sha256 != log.sha256:
        hint = "run again when the logger has closed it"
        raise errors.UserError(f"{evaluated.log.path}: the file changed during the run", hint)
    log_summary = evaluated.summary.log._replace(path=log.name)
    summary = replace(evaluated.summary, log=log_summary)
    by_name = {name: tables.of_results(name, [summary]) for name in OF_RESULTS}
    return summary, {name: tables.packed(_of_run(rows, job)) for name, rows in by_name.items()}


def _of_run(table: Any, job: Job) -> Any:
    """A table with version and settings, as one folder may hold results of several."""
    for name in ("version", "settings"):
        table = table.append_column(name, pa.array([getattr(job, name)] * len(table), pa.string()))
    return table
