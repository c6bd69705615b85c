"""`adhesion fleet`: many logs, on several processes or a cluster."""

import os
from contextlib import closing
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import UserError
from ..core.text import printable
from .options import Shared, assignments, check_settings, option, shared

if TYPE_CHECKING:
    from ..fleet.run import FleetProgress, Workers
    from ..fleet.summary import FleetSummary
    from ..fleet.work import Job

_FOLDER = Path("fleet-results")
_LISTED_LOGS = 10  # failed logs that are listed
_WIDTH = 100  # columns of a summary
_OPTIONS = "config set_ dbc algo reference axle from_ to json force strict".split()


@shared(*_OPTIONS)
def command(
    paths: Annotated[list[str], typer.Argument(metavar="PATH", help="Logs, folders, globs, URLs.")],
    shared: Shared,
    out: Annotated[
        Path | None, option("-o --out", "DIR", "Folder for the tables; fleet-results if not given.")
    ] = None,
    workers: Annotated[
        int | None, option("--workers", "N", "Processes; one per processor if not given.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None, option("--scheduler", "tcp://HOST:PORT", "Work on this Dask cluster.")
    ] = None,
    summary: Annotated[
        bool,
        option(
            "--summary", None, "Show the results in the folder PATH; with -o, those of the run."
        ),
    ] = False,
) -> int:
    """Analyse many logs, and keep the results as tables.

    Writes Parquet files to -o DIR: applications, stops, estimators, findings and logs. A second run
    analyses what is missing and what failed. A log that fails is a row with error and hint.

    The exit code is 3 if a log failed, or if its data were lost or repaired or may be wrong.

    Example: adhesion fleet sample_logs -o results
    """
    if summary and out is None:
        return _summary(paths, shared)
    if workers and scheduler:
        text = "--workers is for processes of this machine, --scheduler for a cluster"
        raise UserError(text, "leave out one of them", code=2)
    from ..core import threads
    from ..fleet.workers import Cluster, Processes

    count = workers or threads.max_threads
    with closing(Cluster(scheduler) if scheduler else Processes(count)) as pool:
        code = _run(paths, shared, out or _FOLDER, pool)
    if summary and out and not shared.json:
        code = max(code, _summary([str(out)], shared))
    return code


def _run(paths: list[str], shared: Shared, out: Path, pool: "Workers") -> int:
    import time

    from ..core.document import dumps, tagged
    from ..fleet.dataset import Dataset
    from ..fleet.locations import find
    from ..fleet.run import run
    from ..results import atomic_files
    from . import terminal

    begin = time.perf_counter()
    atomic_files.refuse_url(out)
    job, logs = _job(shared), find(paths)
    dataset = Dataset(out, job.settings, job.version)
    state = run(logs, job, dataset, pool, shared.force, terminal.campaign(shared.quiet, len(logs)))
    seconds = time.perf_counter() - begin
    if shared.json:
        counts = {"done": state.completed, "skipped": state.skipped, "failed": len(state.failed)}
        counts |= {"lossy": state.lossy}
        print(dumps(tagged("fleet", logs=state.logs, **counts, seconds=seconds)))
    else:
        print(_status_text(state, out, seconds))
    terminal.show_failed(state.failed[:_LISTED_LOGS], shared.quiet)
    if (remaining := len(state.failed) - _LISTED_LOGS) > 0:
        text = f"and {remaining} more: the rows of `logs` whose status is error"
        terminal.message(text, shared.quiet)
    return 3 if state.failed or state.lossy else 0


def _job(shared: Shared) -> "Job":
    """What is the same for every log, after a check of options and settings."""
    from .. import __version__
    from ..analysis.settings import stated_tables
    from ..fleet.dataset import hashed
    from ..fleet.work import Job

    check_settings(shared)
    tree = stated_tables(shared.config, assignments(shared))
    dbc = [os.path.abspath(name) for name in tree.get("can", {}).get("dbc", ())]
    tree |= {"can": {"dbc": dbc}} if dbc else {}  # a worker may have another folder
    algos, axles = tuple(dict.fromkeys(shared.algo)), tuple(dict.fromkeys(shared.axle))
    window = (shared.from_, shared.to)
    job = Job(tree, shared.strict, algos, axles, window, __version__)
    hashes = [sha256(Path(name).read_bytes()).hexdigest() for name in dbc if os.path.isfile(name)]
    depends = job.depends() | ({"dbc": hashes} if hashes else {})
    return job._replace(settings=hashed(depends))


def _status_text(state: "FleetProgress", folder: Path, seconds: float) -> str:
    """The counts of a run, and what shows its results."""
    counts = {"analysed": state.completed, "skipped, as they have results": state.skipped}
    counts["failed"] = len(state.failed)
    counts_text = [f"{n} {count_name}" for count_name, n in counts.items() if n]
    worked = state.completed + len(state.failed)
    rate = f" ({worked / seconds:.1f} logs/s)" if worked else ""
    folder_name = printable(str(folder))
    lines = [f"{state.logs} logs: {', '.join(counts_text)}; {seconds:.1f} s{rate}"]
    if state.lossy:
        lines.append(f"data lost or repaired, or in doubt: {state.lossy} of them; see --summary")
    lines.append(f"wrote {folder_name}: applications, stops, estimators, findings, logs")
    return "\n".join([*lines, f"`adhesion fleet --summary {folder_name}` shows them."])


def _summary(paths: list[str], shared: Shared) -> int:
    from ..core.document import dumps
    from ..fleet.summary import summarise_fleet
    from . import terminal

    if len(paths) != 1:
        text = f"--summary shows one folder of results, not {len(paths)}"
        hint = f"adhesion fleet --summary {_FOLDER}; to analyse first, add -o {_FOLDER}"
        raise UserError(text, hint, code=2)
    summary = summarise_fleet(Path(paths[0]))
    print(dumps(summary.document) if shared.json else _text(summary))
    terminal.show(summary.loss, shared.quiet)
    return 3 if summary.loss else 0


def _text(fleet: "FleetSummary") -> str:
    from ..fleet import summary_tables
    from . import terminal

    lines = [summary_tables.head(fleet)]
    for table in summary_tables.tables(fleet):
        rows = terminal.records(table.rows, _WIDTH, table.text_columns)
        lines += ["", f"{table.title}:", rows]
    failed = [
        f"  {printable(row['log'])}\n    error: {printable(row['error'])}" for row in fleet.failed
    ]
    damaged, lost = ([f"  {printable(log)}" for log in x] for x in (fleet.damaged, fleet.lost))
    lines += [*_first_lines("Failed logs:", failed), *_first_lines("Damaged logs:", damaged)]
    lines += _first_lines("Damaged or missing results:", lost)
    return "\n".join(lines)


def _first_lines(title: str, lines: list[str]) -> list[str]:
    """The first lines under a title, and how many more there are."""
    remaining = len(lines) - _LISTED_LOGS
    remainder_line = [f"  and {remaining} more: --json lists them"] if remaining > 0 else []
    return ["", title, *lines[:_LISTED_LOGS], *remainder_line] if lines else []
