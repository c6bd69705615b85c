"""`adhesion fleet`: many logs, on several processes or a cluster."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Shared, assignments, checked, option, shared

if TYPE_CHECKING:
    from ..fleet.run import State, Workers
    from ..fleet.work import Job

_FOLDER = Path("fleet-results")
_SHOWN = 10  # failed logs that are listed
_OPTIONS = (
    "config", "set_", "out", "algo", "reference", "axle", "from_", "to", "json", "force", "strict",
)  # fmt: skip


@shared(*_OPTIONS)
def command(
    paths: Annotated[list[str], typer.Argument(metavar="PATH", help="Logs, folders, globs, URLs.")],
    shared: Shared,
    workers: Annotated[
        int | None, option("--workers", "N", "Processes; one per processor if not given.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None, option("--scheduler", "tcp://HOST:PORT", "Work on this Dask cluster.")
    ] = None,
    recordings: Annotated[
        bool, option("--recordings", None, "Also write MCAP and Rerun of each log.")
    ] = False,
    summary: Annotated[
        bool, option("--summary", None, "Show the results in the folder PATH.")
    ] = False,
) -> int:
    """Analyse many logs, and keep the results as tables.

    Writes Parquet files to -o DIR (fleet-results if not given): applications, estimators, findings
    and logs. A second run analyses what is missing and what failed. A log that fails is a row with
    error and hint.

    Example: adhesion fleet logs/ 'archive/2026-*/*.mcap' -o results
    """
    from ..core.errors import UserError

    if summary:
        return _summary(paths, shared)
    if workers and scheduler:
        text = "--workers is for processes of this machine, --scheduler for a cluster"
        raise UserError(text, "leave out one of them", code=2)
    return _run(paths, shared, workers, scheduler, recordings)


def _run(
    paths: list[str], shared: Shared, workers: int | None, scheduler: str | None, records: bool
) -> int:
    import time

    from ..analysis.json_documents import dumps, tagged
    from ..fleet.dataset import Dataset
    from ..fleet.locations import find
    from ..fleet.run import run
    from . import terminal

    begin = time.perf_counter()
    folder = shared.out or _FOLDER
    job, logs = _job(shared, folder if records else None), find(paths)
    kept = Dataset(folder, job.settings, job.version)
    with _workers(workers, scheduler) as on, terminal.campaign(shared.quiet, len(logs)) as tell:
        state = run(logs, job, kept, on, shared.force, tell)
    seconds = time.perf_counter() - begin
    if shared.json:
        counts = {"done": state.done, "skipped": state.skipped, "failed": len(state.failed)}
        print(dumps(tagged("fleet", logs=state.logs, **counts, seconds=seconds)))
    else:
        print(_told(state, folder, seconds))
    _show_failed(state, shared.quiet)
    return 3 if state.failed else 0


def _job(shared: Shared, recordings: Path | None) -> "Job":
    """What is the same for every log, after a check of options and settings."""
    from .. import __version__
    from ..analysis.settings import stated
    from ..core.errors import UserError
    from ..fleet.run import hashed
    from ..fleet.work import Job

    checked(shared)
    tree = stated(shared.config, assignments(shared))
    algos, axles = tuple(dict.fromkeys(shared.algo)), tuple(dict.fromkeys(shared.axle))
    window = (shared.from_, shared.to)
    made = hashed(stated=tree, strict=shared.strict, algos=algos, axles=axles, window=window)
    folder = ""
    if recordings:
        try:
            recordings = recordings / "recordings"
            recordings.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            text = f"{recordings}: the folder cannot be made ({error.strerror})"
            raise UserError(text, "choose another with --out") from error
        folder = os.path.abspath(recordings)
    return Job(tree, shared.strict, algos, axles, window, __version__, made, folder)


@contextmanager
def _workers(count: int | None, scheduler: str | None) -> "Iterator[Workers]":
    """Who does the work; whatever happens, they end with the run."""
    from ..fleet.cluster import Cluster
    from ..fleet.processes import Processes

    of: Cluster | Processes
    of = Cluster(scheduler) if scheduler else Processes(count or _processors())
    try:
        yield of
    finally:
        of.close()


def _processors() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _told(state: "State", folder: Path, seconds: float) -> str:
    """The counts of a run, and what shows its results."""
    from ..core.text import printable

    counts = {
        "analysed": state.done, "skipped, as they have results": state.skipped,
        "failed": len(state.failed),
    }  # fmt: skip
    parts = [f"{n} {what}" for what, n in counts.items() if n]
    worked = state.done + len(state.failed)
    rate = f" ({worked / seconds:.1f} logs/s)" if worked else ""
    where = printable(str(folder))
    return "\n".join([
        f"{state.logs} logs: {', '.join(parts)}; {seconds:.1f} s{rate}",
        f"wrote {where}: applications, estimators, findings, logs",
        f"`adhesion fleet --summary {where}` shows them.",
    ])  # fmt: skip


def _show_failed(state: "State", quiet: bool) -> None:
    """The first failed logs on stderr, each with error and hint."""
    from . import terminal

    for log, error, hint in state.failed[:_SHOWN]:
        terminal.message(f"not analysed: {log}\n  error: {error}\n  hint: {hint}", quiet)
    if more := len(state.failed) - _SHOWN:
        text = f"and {more} more: the rows of `logs` whose status is error"
        terminal.message(text, quiet or more < 0)


def _summary(paths: list[str], shared: Shared) -> int:
    raise NotImplementedError
