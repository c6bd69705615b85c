"""`adhesion stops`: the brake test."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import LOG_KINDS, Shared, check, inputs, load_settings, option, shared

if TYPE_CHECKING:
    from ..studies.brake_test import BrakeTest

_OPTIONS = "config set_ dbc axle from_ to json force strict out"
_TABLE = "stops.csv"


@shared(*_OPTIONS.split())
def command(
    shared: Shared,
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="LOG", help=f"{LOG_KINDS}, or results.")
    ] = None,
    plan: Annotated[
        Path | None, option("--plan", "FILE.toml", "Groups, pairs, limits and texts of the series.")
    ] = None,
    braked_weight: Annotated[
        bool, option("--lambda", None, "Also show the braked weight percentage, with its remark.")
    ] = False,
    budget: Annotated[
        bool, option("--budget", None, "Show what each source adds to the uncertainty.")
    ] = False,
) -> int:
    """Evaluate brake tests: stops, series, differences, limits.

    One row per stop of the whole train: distance, deceleration, response time, corrected to level
    track and nominal speed, with uncertainties. Then statistics of groups, differences between
    them, and limits with a verdict. Without a plan, the groups are the nominal speeds.

    With -o DIR, writes the table of stops there (stops.csv).

    A plan names logs of groups, as [group.old] logs = ["old_*.csv"], and may have [compare],
    [limits], [wsp] and [protocol]. Without LOG, it names the logs.

    Example: adhesion stops sample_logs/service-brake.csv
    """
    from ..core.document import dumps
    from ..core.errors import UserError
    from ..results import atomic_files, tables
    from ..studies import brake_test
    from ..studies.plan import Plan, planned_logs, read_plan
    from . import terminal

    stated_plan = read_plan(plan) if plan else Plan()
    if not logs:
        if plan is None:
            raise UserError("no log", "adhesion stops LOG..., or --plan FILE.toml", code=2)
        logs = planned_logs(stated_plan, plan.parent)
    files = [shared.out / _TABLE] if shared.out else []
    check(shared, files, *logs, *([plan] if plan else []))
    progress = terminal.progress(shared.quiet)
    request = brake_test.Request(tuple(shared.axle), (shared.from_, shared.to))
    series = brake_test.run(
        logs,
        lambda files: load_settings(replace(shared, config=[*shared.config, *files])),
        stated_plan,
        request,
        progress,
    )
    if files:
        read = inputs(shared, *logs)
        table = tables.stops_of_series((s.log, s.group, s.label, s.stop) for s in series.stops)
        with atomic_files.outputs(files, shared.force, inputs=read) as (place,):
            tables.write(place, ".csv", {"stops": table})
    if shared.json:
        document = brake_test.document(series)
        document["outputs"] = {"csv": str(files[0])} if files else {}
        print(dumps(document))
    else:
        print(_text(series, braked_weight, budget))
        terminal.show(series.findings, shared.quiet)
        if files:
            print(terminal.wrote(*files))
    lossy = terminal.lossy(series.findings)
    return 3 if lossy or series.failed else 0


def _text(test: "BrakeTest", braked_weight: bool, budget: bool) -> str:
    """What the screen shows of a series."""
    from ..results import stop_rows as rows
    from . import terminal

    if not test.stops:
        return "No stop."

    def section(table: list[dict[str, str]], text_columns: int, note: str = "") -> str:
        lines = [terminal.records(table, text_columns=text_columns)] if table else []
        return "\n".join([*lines, *([terminal.folded(note)] if table and note else [])])

    sources = rows.describe_sources([s.stop for s in test.stops])
    sections = [
        section(rows.series_rows(test.stops), 2, rows.NOTE),
        "\n".join([terminal.folded(sources), *rows.invalid_stops(test.stops)]),
        section(rows.group_rows(test.groups), 2, rows.OF_GROUPS) or "No valid stop.",
        section(rows.difference_rows(test.differences), 3),
        section(rows.limit_rows(test.limits), 3, rows.OF_LIMITS),
        *("\n".join([rows.describe_wsp(x), section(rows.wsp_rows(x), 1)]) for x in test.wsp),
    ]
    if braked_weight:
        sections.append(section(rows.braked_weight_rows(test.stops), 2, rows.OF_LAMBDA))
    if budget:
        sections.append(section(rows.budget_rows(test.stops), 3, rows.OF_BUDGET))
    return "\n\n".join(filter(None, sections))
