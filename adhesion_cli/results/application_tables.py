"""The tables of a log on screen and recording: its stops, brake applications and slides."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from ..core.finding import is_doubt
from ..core.summary import AxleSummary, ResultSummary
from ..rail.events import HIDDEN_TIME
from . import train_stops
from .result_rows import row, slid_row
from .stop_rows import describe_columns, describe_reasons, describe_sources, short_row, stop_row
from .text_tables import DOUBT, TitledTable, describe_cells, doubted, non_empty

_NOTE = (
    "One row per brake application; at: seconds after the start of the log. µ, F: adhesion "
    "coefficient and force, mean from build-up to release and highest mean over 0.1 s, or as "
    "`analysis.peak_time` states, with expanded uncertainty (95\N{NO-BREAK SPACE}%)."
)
_OF_STOPS = (
    "One row per stop; at: seconds after the start of the log. µ mean: mean adhesion coefficient "
    "of all axles with its expanded uncertainty (95\N{NO-BREAK SPACE}%); µ of axles: lowest and "
    "highest mean. slid: axles with slides; the columns right of it are of the axle with the "
    "most slip."
)
_OF_GROUPS = "Groups of axles; axle, at: where the most slip was."
_OF_SLIDES = (
    "Slides of each brake application; at: begin of the first slide. Number, time and distance "
    "together, largest slip, energy of friction between wheel and rail, and share of the available "
    "adhesion that was used (- where the slides do not show the available one). Its "
    "95\N{NO-BREAK SPACE}% interval holds noise, tolerances of the vehicle, and other shapes of "
    "the slip-adhesion curve. The energy has the relative uncertainty of F. Where a wheel is "
    "locked, F is not measured: it is that before, or up to that after if the brake was vented."
)
_OF_DOUBT = f" {DOUBT}: the log contradicts its vehicle. µ and F may be wrong with it."
_OF_ROWS = "`adhesion analyze --rows` shows every brake application of every axle."
_TITLE, _SLIDES = "Brake applications", "Slides"
_BOUND = "≥: the true value is at least this, less its uncertainty; ≤: at most this."
_SHOWN_STOPS = 20  # of more, the worst ones


def stop_table(summaries: Sequence[ResultSummary], all_rows: bool = False) -> list[TitledTable]:
    """The stops of the whole train, of one or several logs; with `all_rows` each, and whole."""
    named = [
        (_named(Path(x.log.path).name if len(summaries) > 1 else ""), stop)
        for x in summaries
        for stop in x.stops
    ]
    if not named:
        return []
    stops = [stop for _, stop in named]
    shown_count, cells = (len(named), stop_row) if all_rows else (_SHOWN_STOPS, short_row)
    rows = non_empty([name | cells(stop) for name, stop in named[:shown_count]])
    notes = [describe_columns(rows), describe_sources(stops)]
    if len(named) > len(rows):
        notes += [f"The first {len(rows)} of {len(named)} stops; `adhesion stops LOG` shows all."]
    notes += filter(None, [describe_reasons(stops), describe_cells(rows)])
    return [TitledTable("Stops of the train", rows, note="\n".join(notes))]


def application_tables(
    summaries: Sequence[ResultSummary],
    all_rows: bool = False,
    cars: Mapping[int, str] = MappingProxyType({}),
) -> list[TitledTable]:
    """The brake applications: a row each, or, where they are many, a row per stop.

    With `all_rows` each brake application of each axle has its row, however many. `cars` has the
    name of the car of each axle, where it is stated.
    """
    is_single = len(summaries) == 1
    logs = [
        _NamedLog(
            "" if is_single else Path(x.log.path).name,
            x.axles,
            any(is_doubt(f.code, f.severity) for f in x.findings),
        )
        for x in summaries
    ]
    count = sum(len(axle.applications) for log in logs for axle in log.axles)
    if not count:
        return [TitledTable(_TITLE, [], note="No brake application.")]
    fits_screen = is_single and (count <= train_stops.MANY_ROWS or len(logs[0].axles) == 1)
    tables = _by_application(logs) if all_rows or fits_screen else _by_stop(logs)
    for name, axles, _ in logs:
        if len(axles) > train_stops.MANY_AXLES:
            rows = non_empty(
                [
                    _named(name) | train_stops.group_row(*x)
                    for x in train_stops.group_axles(axles, cars).items()
                ]
            )
            tables.append(TitledTable("Groups of axles", rows, note=_OF_GROUPS))
    return tables


class _NamedLog(NamedTuple):
    name: str  # empty for one log
    axles: Sequence[AxleSummary]
    in_doubt: bool  # whether it contradicts its vehicle


def _marked(cells: dict[str, str], in_doubt: bool) -> dict[str, str]:
    """A row with the mark of a log that contradicts its vehicle."""
    return {head: doubted(cell, in_doubt and head.startswith("µ")) for head, cell in cells.items()}


def _by_stop(logs: Sequence[_NamedLog]) -> list[TitledTable]:
    stops = [(log, stop) for log in logs for stop in train_stops.find_stops(log.axles)]
    shown_stops, lead = stops, ""
    has_slides = any(a.slides for _, stop in stops for a in stop)
    if len(stops) > _SHOWN_STOPS or not logs[0].name:
        shown_stops = sorted(
            stops, key=lambda pair: max(map(train_stops.slide_severity, pair[1])), reverse=True
        )
        shown_stops = shown_stops[:_SHOWN_STOPS]
        order = "most slip first" if has_slides else "highest µ first"
        lead = f"{len(shown_stops)} of {len(stops)} stops, {order}:"
    rows = non_empty(
        [
            _named(log.name) | _marked(train_stops.train_stop_row(x), log.in_doubt)
            for log, x in shown_stops
        ]
    )
    note = f"{_OF_STOPS} {_OF_ROWS}{_OF_DOUBT * any(log.in_doubt for log in logs)}"
    note = " ".join(filter(None, [note, describe_cells(rows)]))
    tables = [TitledTable(_TITLE, rows, note=note, lead=lead)]
    if has_slides:
        return tables
    return [*tables, _no_slides([a.slip_unknown_s for _, s in stops for a in s])]


def _by_application(logs: Sequence[_NamedLog]) -> list[TitledTable]:
    keyed = [
        (log, str(axle.axle), a) for log in logs for axle in log.axles for a in axle.applications
    ]
    rows = [_named(log.name) | _marked(row(axle, a), log.in_doubt) for log, axle, a in keyed]
    notes = [_NOTE, describe_cells(rows), (_OF_DOUBT * any(log.in_doubt for log in logs)).strip()]
    tables = [TitledTable(_TITLE, rows, note=" ".join(filter(None, notes)))]
    if slid := [_named(log.name) | slid_row(axle, a) for log, axle, a in keyed if a.slides]:
        has_bounds = any(a.at_least for *_, a in keyed if a.slides)
        note = f"{_OF_SLIDES} {_BOUND}" if has_bounds else _OF_SLIDES
        return [*tables, TitledTable(_SLIDES, slid, note=note)]
    return [*tables, _no_slides([a.slip_unknown_s for *_, a in keyed])]


def _named(name: str) -> dict[str, str]:
    return {"log": name} if name else {}


def _no_slides(unknown_s: Sequence[float]) -> TitledTable:
    """That there are none, or that they may be hidden."""
    note = "No slides."
    if max(unknown_s) >= HIDDEN_TIME:
        place = f"without a train speed for up to {max(unknown_s):.1f} s of a brake application"
        note = f"No slide seen, but slides may be hidden: {place}."
    return TitledTable(_SLIDES, [], note=note)
