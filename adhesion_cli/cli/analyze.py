"""`adhesion analyze`: the main job."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from . import results
from .options import ALL_NAMES, Logs, Shared, option, shared

if TYPE_CHECKING:
    from ..core.model import Result
    from ..core.summary import ResultSummary


@shared(*ALL_NAMES)
def command(
    logs: Logs,
    shared: Shared,
    scores: Annotated[bool, option("--scores", None, "Score the estimators axle by axle.")] = False,
    budget: Annotated[
        bool, option("--budget", None, "Show what each quantity adds to the uncertainty.")
    ] = False,
    report: Annotated[
        bool, option("--report", None, "Also write <log>.adhesion.html, a page to forward.")
    ] = False,
    table: Annotated[
        Path | None,
        option("--table", "FILE", "Also write tables: FILE.xlsx, FILE.csv or FILE.parquet."),
    ] = None,
) -> int:
    """Compute adhesion force and coefficient of each log.

    Shows each brake application with its uncertainty, the slides, and how well each online
    estimator follows. Writes <log>.adhesion.mcap and <log>.adhesion.rrd.

    --table writes one row per log, axle and brake application. A workbook (FILE.xlsx) also has
    sheets of the estimators, the findings and the logs.

    Of several logs, those that fail are listed, and the others are written. With --strict, none is
    written if one fails.

    Example: adhesion analyze sample_logs/service-brake.csv
    """
    from ..analysis.json_documents import result_document
    from ..analysis.outputs import write_report
    from ..analysis.summarise import summarise
    from ..core.document import dumps
    from ..core.summary import FailedLog

    if table:
        _suffix(table)
    sets: list[list[Path]] = [[*results.pair(shared, log, "adhesion")] for log in logs]
    if report:
        sets = [[*files, files[0].with_suffix(".html")] for files in sets]
    paths = [path for files in sets for path in files] + ([table] if table else [])
    outcomes = results.analysed_or_failed(shared, logs, paths)
    pairs = zip(outcomes, sets, strict=True)
    successes = [(r, files) for r, files in pairs if not isinstance(r, FailedLog)]
    if table:
        successes[0][1].append(table)
    summaries = [summarise(r, results.named(files)) for r, files in successes]
    attachments: dict[Path, results.Attach] = {
        files[2]: partial(write_report, name=files[0].name) for _, files in successes if report
    }
    if table:
        attachments[table] = partial(_write_table, name=table, summaries=summaries)
    analysed, written = [r for r, _ in successes], [files for _, files in successes]
    results.write(shared, analysed, written, summaries, attachments=attachments)
    of_log = iter(summaries)
    if shared.json:
        rows = (f if isinstance(f, FailedLog) else next(of_log) for f in outcomes)
        print(dumps(result_document(list(rows))))
    else:
        for result, _ in successes:
            _show(result, next(of_log), scores, budget, shared.quiet)
        results.show_failed([f for f in outcomes if isinstance(f, FailedLog)])
    code = results.finished(shared, written[-1][1], [f for r in analysed for f in r.findings])
    return 3 if len(successes) < len(outcomes) else code


def _suffix(table: Path) -> str:
    """The format of the table."""
    from ..results.tables import kind

    return kind(table)


def _write_table(place: Path, _: Path, *, name: Path, summaries: "Sequence[ResultSummary]") -> None:
    from ..results import tables

    sheets = {
        "applications": tables.applications(summaries),
        "estimators": tables.estimators(summaries),
        "findings": tables.findings(summaries),
        "logs": tables.table(map(tables.log_row, summaries), tables.LOGS),
    }
    tables.write(place, _suffix(name), sheets)


def _show(
    result: "Result", summary: "ResultSummary", by_axle: bool, budget: bool, quiet: bool
) -> None:
    """One log: brake applications, findings, scores, files."""
    from ..results.vehicle_text import describe_vehicle
    from ..scores.metrics import pool_scores
    from . import applications, terminal

    vehicle = terminal.folded(describe_vehicle(summary.vehicle, summary.axles))
    tables = applications.tables(summary.axles)
    print(f"{terminal.describe_log(summary)}\n{vehicle}\n\n{tables}\n", flush=True)
    if budget:
        print(applications.budgets(summary.axles))
    terminal.show(result.findings, quiet)
    rows = [(str(a.record.axle), s) for a in result.axles for s in a.scores]
    if by_axle:
        print("\n".join(map(terminal.describe_reference, summary.axles)))
    elif len(result.axles) > 1:
        rows = [("all", s) for s in pool_scores(a.scores for a in result.axles)]
    if rows:
        print(f"Estimators {terminal.scores(rows)}")
    print(terminal.wrote(*summary.outputs.values()))
