"""`adhesion stops`: the brake test."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import UserError
from . import options, results
from .options import Shared, option, shared

if TYPE_CHECKING:
    from ..studies.brake_test import BrakeTest

_OPTIONS = "config set_ dbc axle from_ to json force strict out"
_TABLE, _PAGE = "stops.csv", "stops.html"


@shared(*_OPTIONS.split())
def command(  # noqa: PLR0912, PLR0913 (one parameter per option, and one file each)
    shared: Shared,
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="LOG", help=f"{options.LOG_KINDS}, or results.")
    ] = None,
    plan: Annotated[
        Path | None, option("--plan", "FILE.toml", "Groups, pairs, limits and texts of the series.")
    ] = None,
    braked_weight: Annotated[
        bool, option("--lambda", None, "Also show the braked weight percentage, with its remark.")
    ] = False,
    report: Annotated[
        bool, option("--report", None, "Also write the protocol, a page to sign: stops.html.")
    ] = False,
    table: Annotated[
        Path | None,
        option("--table", "FILE", "Also write the stops: FILE.xlsx, FILE.csv or FILE.parquet."),
    ] = None,
    geojson: options.GeoJson = None,
    budget: Annotated[
        bool, option("--budget", None, "Show what each source adds to the uncertainty.")
    ] = False,
) -> int:
    """Evaluate brake tests: stops, series, differences, limits.

    One row per stop of the whole train: distance, deceleration, response time, corrected to level
    track and nominal speed, with uncertainties. Then statistics of groups, differences between
    them, and limits with a verdict. Without a plan, the groups are the nominal speeds.

    With -o DIR, writes the table of stops there (stops.csv). --report adds the protocol with
    figures, which prints on A4.

    A plan names logs of groups, as [group.old] logs = ["old_*.csv"], and may have [compare],
    [limits], [wsp] and [protocol]. Without LOG, it names the logs.

    Example: adhesion stops sample_logs/service-brake.csv
    """
    from ..core.document import dumps
    from ..results import atomic_files, tables
    from ..results.geojson import as_text, check_name
    from ..studies import brake_test
    from ..studies.plan import Plan, planned_logs, read_plan
    from . import terminal

    stated_plan = read_plan(plan) if plan else Plan()
    if not logs:
        if plan is None:
            raise UserError("no log", "adhesion stops LOG..., or --plan FILE.toml", code=2)
        logs = planned_logs(stated_plan)
    options.refuse_page_name(logs if report else ())
    if report and not shared.out:
        raise UserError("--report writes into a folder", "add -o DIR", code=2)
    folder = shared.out or Path()
    files = [folder / _TABLE] if shared.out else []
    files += [*([folder / _PAGE] if report else []), *(x for x in (table, geojson) if x)]
    if table:
        tables.kind(table)
    if geojson:
        check_name(geojson)
    options.check(shared, files, *logs, *([plan] if plan else []))
    test = brake_test.run(
        logs,
        lambda files: options.load_settings(
            replace(shared, config=[*shared.config, *files]), several_loggers=len(logs) > 1
        ),
        stated_plan,
        shared.axle,
        (shared.from_, shared.to),
        terminal.progress(shared.quiet),
    )
    if files:
        read = options.inputs(shared, *logs, *([plan] if plan else []))
        with atomic_files.outputs(files, shared.force, inputs=read) as places:
            for file, place in zip(files, places, strict=True):
                if file == geojson:
                    place.write_bytes(as_text(log.map for log in test.logs).encode())
                elif file.name == _PAGE and report:
                    from ..results.report import page  # slow to import

                    title = f"Brake test: {plan.stem}" if plan else "Brake test"
                    protocol = brake_test.protocol(test, title, braked_weight)
                    place.write_bytes(page.protocol_page(protocol).encode())
                else:
                    axles = ((log.path, log.axles) for log in test.logs)
                    sheets = tables.sheets_of_series(test.series, axles)
                    tables.write(place, tables.kind(file), sheets)
    if shared.json:
        document = brake_test.document(test)
        document["outputs"] = results.named(files)
        print(dumps(document))
    else:
        print(_text(test, braked_weight, budget))
        _show_findings(test, shared.quiet)
        if files:
            print(terminal.wrote(*files))
    lossy = terminal.lossy([finding for _, finding in test.findings_by_log])
    return 3 if lossy or test.failed else 0


def _text(test: "BrakeTest", braked_weight: bool, budget: bool) -> str:
    from ..results.stop_rows import series_tables
    from ..results.text_tables import folded

    if not test.series.stops:
        return "No stop."
    texts = ["\n".join(map(folded, test.vehicle_lines))] if test.vehicle_lines else []
    texts += [x.text() for x in series_tables(test.series, braked_weight, budget)]
    if not any(s.stop.valid for s in test.series.stops):
        texts.append("No valid stop.")
    return "\n\n".join(texts)


def _show_findings(test: "BrakeTest", quiet: bool) -> None:
    """Those on the series and those of its logs, each with the names of its logs."""
    from . import terminal

    if len(test.logs) == 1:
        terminal.show([finding for _, finding in test.findings_by_log], quiet)
        return
    of_logs = [(Path(x.path).name, x.findings) for x in test.logs]
    terminal.show_of_logs(of_logs, quiet, test.findings)
