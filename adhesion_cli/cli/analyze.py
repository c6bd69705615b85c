"""`adhesion analyze`: the main job."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from . import results
from .options import ALL_NAMES, GeoJson, Logs, Shared, option, refuse_page_name, shared

if TYPE_CHECKING:
    import pyarrow as pa

    from ..core.model import Result
    from ..core.summary import ResultSummary


@shared(*ALL_NAMES)
def command(  # noqa: PLR0913 (one parameter per option)
    logs: Logs,
    shared: Shared,
    scores: Annotated[bool, option("--scores", None, "Score the estimators axle by axle.")] = False,
    rows: Annotated[
        bool, option("--rows", None, "Show every brake application of every axle, however many.")
    ] = False,
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
    geojson: GeoJson = None,
) -> int:
    """Compute adhesion force and coefficient of each log.

    Shows each brake application with its uncertainty, the slides, and how well each online
    estimator follows. Writes <log>.adhesion.mcap and <log>.adhesion.rrd.

    --table writes one row per log, axle and brake application. A workbook (FILE.xlsx) also has
    sheets of the stops, the slides, the estimators, the findings and the logs.

    Many brake applications are shown as one row per stop of the train, the worst first. Several
    logs are taken for one train's: one table has the stops of all, and what they have in common is
    said once.

    Of several logs, those that fail are listed, and the others are written. With --strict, none is
    written if one fails.

    Example: adhesion analyze sample_logs/service-brake.csv
    """
    from ..analysis.outputs import write_report
    from ..analysis.summarise import summarise
    from ..analysis.vehicle_findings import with_friction_findings
    from ..core.document import dumps, result_document
    from ..core.summary import FailedLog
    from ..results.geojson import as_text, check_name, map_of_log
    from . import terminal

    if report:
        refuse_page_name(logs)
    if table:
        from ..results import tables  # slow to import

        suffix = tables.kind(table)
    if geojson:
        check_name(geojson)
    folder = shared.out or Path()
    sets: list[list[Path]] = [[*results.pair(folder, log, "adhesion")] for log in logs]
    if report:
        sets = [[*files, files[0].with_suffix(".html")] for files in sets]
    paths = [path for files in sets for path in files] + [x for x in (table, geojson) if x]
    outcomes = results.analysed_or_failed(shared, logs, paths)
    pairs = zip(outcomes, sets, strict=True)
    successes = [(r, files) for r, files in pairs if not isinstance(r, FailedLog)]
    successes[0][1].extend(x for x in (table, geojson) if x)
    files = [str(path) for path in shared.config or ()]
    analysed = with_friction_findings([r for r, _ in successes], files)
    written = [files for _, files in successes]
    summaries = [
        summarise(r, results.named(files)) for r, files in zip(analysed, written, strict=True)
    ]
    pairs_of_log = zip(analysed, summaries, strict=True)
    maps = (map_of_log(r.log, s.stops, s.axles) for r, s in pairs_of_log)
    map_text = as_text(maps) if geojson else ""
    with results.written(shared, analysed, written, summaries) as places:
        for record, _, *other_files in written if report else ():
            write_report(places[other_files[0]], places[record], record.name)
        if table:
            tables.write(places[table], suffix, _sheets(summaries))
        if geojson:
            places[geojson].write_bytes(map_text.encode())
    of_log = iter(summaries)
    if shared.json:
        entries = (f if isinstance(f, FailedLog) else next(of_log) for f in outcomes)
        print(dumps(result_document(list(entries))))
    else:
        _show(analysed, summaries, shared.quiet, rows, budget)
        _show_scores(analysed, summaries, scores)
        files_of = [[*x.outputs.values()] for x in summaries]
        is_single = len(summaries) == 1
        print(terminal.wrote(*files_of[0]) if is_single else terminal.wrote_sets(files_of))
        terminal.show_failed(f for f in outcomes if isinstance(f, FailedLog))
    code = results.finished(shared, written[-1][1], [f for r in analysed for f in r.findings])
    return 3 if len(successes) < len(outcomes) else code


def _sheets(summaries: "Sequence[ResultSummary]") -> "dict[str, pa.Table]":
    """The tables of `--table`, of which a workbook has all."""
    from ..results import tables

    names = "applications", "stops", "slides", "estimators", "findings"
    sheets = {name: tables.of_results(name, summaries) for name in names}
    return sheets | {"logs": tables.table(map(tables.log_row, summaries), tables.LOGS)}


def _show(
    results: "Sequence[Result]",
    summaries: "Sequence[ResultSummary]",
    quiet: bool,
    all_rows: bool,
    with_budgets: bool,
) -> None:
    """Tables and findings; of several logs what they have in common once."""
    from ..results.application_tables import application_tables, stop_table
    from ..results.vehicle_text import describe_vehicles, vehicles_of_logs
    from . import terminal

    is_single = len(results) == 1
    findings = [
        (Path(r.log.path).name, [f for f in r.findings if f.code != "friction-differs"])
        for r in results
    ]
    friction_findings = [f for f in results[0].findings if f.code == "friction-differs"]
    terminal.show(friction_findings, quiet)
    terminal.show_commands(friction_findings, quiet)
    vehicles = describe_vehicles(vehicles_of_logs(summaries))
    logs = terminal.describe_logs(summaries)
    head = logs if is_single else terminal.folded(logs)
    print("\n".join([head, *map(terminal.folded, vehicles)]))
    cars = {axle.number: axle.car for axle in results[0].vehicle.axles}
    tables = [*stop_table(summaries), *application_tables(summaries, all_rows, cars)]
    print("\n" + "\n\n".join(x.text() for x in tables) + "\n", flush=True)
    for summary in summaries if with_budgets else ():
        name = f"{summary.log.path}:\n" * (not is_single)
        print(f"{name}{terminal.budgets(summary.axles)}")
    if is_single:
        terminal.show(results[0].findings, quiet)
    else:
        terminal.show_of_logs(findings, quiet)


def _show_scores(
    results: "Sequence[Result]", summaries: "Sequence[ResultSummary]", by_axle: bool
) -> None:
    from ..scores.metrics import pool_scores
    from . import terminal

    axles = [axle for result in results for axle in result.axles]
    if by_axle:
        for result, summary in zip(results, summaries, strict=True):
            print("\n".join(map(terminal.describe_reference, summary.axles)))
            rows = [(str(a.record.axle), s) for a in result.axles for s in a.scores]
            name = Path(result.log.path).name if len(results) > 1 else ""
            if rows:
                print(f"Estimators {terminal.scores(rows, name)}")
        return
    name = "all" if len(axles) > 1 else str(axles[0].record.axle)
    if rows := [(name, s) for s in pool_scores(a.scores for a in axles)]:
        print(f"Estimators {terminal.scores(rows)}")
