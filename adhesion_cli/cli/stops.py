"""`adhesion stops`: the brake test."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import LOG_KINDS, Shared, check, inputs, load_settings, option, shared

if TYPE_CHECKING:
    from ..stops.series import Difference, Group, LimitVerdict, WspSummary
    from ..studies.brake_test import BrakeTest

_OPTIONS = "config set_ dbc axle from_ to json force strict out"
_TABLE = "stops.csv"
_NOTE = (
    "Means of the valid stops with expanded uncertainties (95\N{NO-BREAK SPACE}%). sd: standard "
    "deviation of one stop; common: the part of the uncertainty that is the same in every stop and "
    "does not average out; scatter: range over mean; drift: change from stop to stop."
)
_LAMBDA = (
    "λ = C/s − D by constants of a secondary source, for the distance on level track from the "
    "nominal speed. They agree with SUBSET-026, A.3.7 within 1 % at 160 to 200 km/h and 6 % at "
    "140 km/h, not at 100 to 120 km/h."
)


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
    from ..results.stop_rows import NOTE, describe_sources, stop_row
    from . import terminal

    if not test.stops:
        return "No stop."
    names = {s.log for s in test.stops}
    rows = []
    for i, s in enumerate(test.stops, 1):
        log = {"log": Path(s.log).name} if len(names) > 1 else {}
        rows.append({"stop": str(i), **log, "group": s.group, **stop_row(s.stop)})
    invalid = [
        f"Stop {i} is not valid: {s.stop.reason}."
        for i, s in enumerate(test.stops, 1)
        if not s.stop.valid
    ]
    sources = describe_sources(tuple(s.stop for s in test.stops))
    sections = [
        "\n".join([terminal.records(rows, text_columns=2), terminal.folded(NOTE)]),
        "\n".join([terminal.folded(sources), *invalid]),
        _groups(test.groups),
        _differences(test.differences),
        _limits(test.limits),
        *(_wsp(x) for x in test.wsp),
        _braked_weights(test) if braked_weight else "",
        _budgets(test) if budget else "",
    ]
    return "\n\n".join(section for section in sections if section)


def _groups(groups: "Sequence[Group]") -> str:
    from ..core.text import by_uncertainty
    from ..stops.series import QUANTITIES
    from . import terminal

    rows = []
    for group in groups:
        for quantity, x in group.statistics.items():
            name, unit = QUANTITIES[quantity]
            factor = 3.6 if unit == "m/s" else 1.0
            mean, u95 = by_uncertainty(factor * x.mean, factor * x.u95, 3)
            rows.append(
                {
                    "group": group.name,
                    "quantity": f"{name} [{'km/h' if unit == 'm/s' else unit}]",
                    "n": str(x.n),
                    "mean": f"{mean}±{u95}",
                    "sd": terminal.number(x.sd and factor * x.sd, 3),
                    "common": terminal.number(factor * x.common_u95, 3),
                    "scatter [%]": terminal.number(100.0 * x.scatter, 1),
                    "drift": _drift(x.drift, x.drift_u95, factor),
                    "outliers": ", ".join(map(str, x.outliers)) or "-",
                }
            )
    if not rows:
        return "No valid stop."
    return "\n".join([terminal.records(rows, text_columns=2), terminal.folded(_NOTE)])


def _drift(drift: float | None, u95: float | None, factor: float) -> str:
    from ..core.text import by_uncertainty

    if drift is None or u95 is None:
        return "-"
    return "±".join(by_uncertainty(factor * drift, factor * u95, 3))


def _differences(rows: "Sequence[Difference]") -> str:
    from ..core.text import by_uncertainty
    from ..stops.series import QUANTITIES
    from . import terminal

    shown = []
    for x in rows:
        name, unit = QUANTITIES[x.quantity]
        factor = 3.6 if unit == "m/s" else 1.0
        value, u95 = by_uncertainty(factor * x.value, factor * x.u95, 3)
        verdict = "yes" if x.distinguishable else "not distinguishable"
        shown.append(
            {
                "from": x.earlier,
                "to": x.later,
                "quantity": f"{name} [{'km/h' if unit == 'm/s' else unit}]",
                "change": f"{value}±{u95}",
                "differs": verdict,
            }
        )
    return terminal.records(shown, text_columns=3) if shown else ""


def _limits(rows: "Sequence[LimitVerdict]") -> str:
    from ..core.text import by_uncertainty
    from ..stops.series import QUANTITIES
    from . import terminal

    shown = []
    for x in rows:
        name, unit = QUANTITIES[x.quantity]
        value, u95 = by_uncertainty(x.value, x.u95, 3)
        shown.append(
            {
                "group": x.group,
                "quantity": f"{name} [{unit}]",
                "limit": f"{x.kind} {x.limit:g}",
                "mean": f"{value}±{u95}",
                "verdict": x.verdict,
            }
        )
    if not shown:
        return ""
    note = "pass, fail: the whole interval keeps or breaks the limit; else undecided (JCGM 106)."
    return "\n".join([terminal.records(shown, text_columns=3), terminal.folded(note)])


def _wsp(x: "WspSummary") -> str:
    from . import terminal

    head = f"WSP, group {x.group}: "
    if x.extension is None or x.extension_u95 is None or x.k_wet is None:
        head += "extension not known: dry or wet stops are missing"
    else:
        extension, u95 = 100.0 * x.extension, 100.0 * x.extension_u95
        head += f"extension of the deceleration distance {extension:.1f} ± {u95:.1f} %, "
        head += f"K_wet {x.k_wet:.3f} (SUBSET-040, 4.4.1.5)"
    rows = [
        {
            "axle": str(a.axle),
            "max slip [%]": terminal.number(a.max_slip and 100.0 * a.max_slip, 1),
            "locked [s]": terminal.number(a.locked_s, 2),
            "valve actions": str(a.valve_actions),
            "initial µ": terminal.number(a.initial_coefficient, 3),
            "used [%]": terminal.number(a.utilisation and 100.0 * a.utilisation, 0),
        }
        for a in x.axles
    ]
    return "\n".join([terminal.folded(head), terminal.records(rows)] if rows else [head])


def _braked_weights(test: "BrakeTest") -> str:
    from ..stops.series import braked_weight_percentage
    from . import terminal

    rows = []
    for i, s in enumerate(test.stops, 1):
        level = s.measured("corrected_distance_m")
        value = level and braked_weight_percentage(s.stop.nominal_speed_kmh, level.value)
        rows.append({"stop": str(i), "group": s.group, "λ [%]": terminal.number(value, 0)})
    return "\n".join([terminal.records(rows, text_columns=2), terminal.folded(_LAMBDA)])


def _budgets(test: "BrakeTest") -> str:
    from . import terminal

    rows = [
        {
            "stop": str(i),
            "source": c.source,
            "common": "yes" if c.common else "no",
            "distance [m]": terminal.number(c.distance_m, 2),
            "a [m/s²]": terminal.number(c.deceleration, 4),
        }
        for i, s in enumerate(test.stops, 1)
        for c in s.stop.budget
    ]
    note = "Change of distance and deceleration by one standard uncertainty of each source."
    return "\n".join([terminal.records(rows, text_columns=3), terminal.folded(note)])
