"""The answer of `analyze` on the screen: brake applications, slides, estimators."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from ..core.summary import AxleSummary, ResultSummary
from ..rail.events import HIDDEN_TIME
from ..results.result_rows import OF_MARK, budget_row, combined, row, slid_row
from ..results.stop_rows import NOTE as STOP_NOTE
from ..results.stop_rows import describe_sources, short_row
from ..results.train_stops import (
    MANY_AXLES,
    MANY_ROWS,
    find_stops,
    group_axles,
    group_row,
    slide_severity,
    stop_row,
)
from . import terminal

_NOTE = (
    "One row per brake application; at: seconds after the start of the log. µ, F: adhesion "
    "coefficient and force, mean from build-up to release and highest, with expanded uncertainty "
    "(95\N{NO-BREAK SPACE}%)."
)
_OF_STOPS = (
    "One row per stop; at: seconds after the start of the log. µ mean: mean adhesion coefficient "
    "of all axles with its expanded uncertainty (95\N{NO-BREAK SPACE}%); µ of axles: lowest and "
    "highest mean. slid: axles with slides; the columns right of it are of the axle with the "
    "most slip."
)
_OF_GROUPS = "Groups of axles; axle, at: where the most slip was."
_OF_SLIDES = (
    "Slides of each brake application: number, time and distance together, largest slip, energy "
    "of friction between wheel and rail, and share of the available adhesion that was used "
    "(- where the slides do not show the available one)."
)
_OF_BUDGETS = (
    "Uncertainty budget of the mean force by JCGM 100 (GUM). Type A: from the samples; type B: "
    "tolerances of the vehicle, stated or left by the log. u: standard uncertainty, in the unit "
    "of the value; noise in N. u(F): what it adds to the force; share: of the variance."
)
_BOUND = "≥: the true value is at least this."
_SHOWN_STOPS = 20  # of more, the worst ones


def stops(summaries: Sequence[ResultSummary]) -> str:
    """The stops of the whole train, of one log or of several; empty without any."""
    named = [
        ({"log": Path(x.log.path).name} if len(summaries) > 1 else {}, stop)
        for x in summaries
        for stop in x.stops
    ]
    if not named:
        return ""
    rows = [name | short_row(stop) for name, stop in named[:_SHOWN_STOPS]]
    lines = [terminal.records(rows), terminal.folded(STOP_NOTE)]
    lines += [terminal.folded(describe_sources([stop for _, stop in named]))]
    if len(named) > len(rows):
        lines += [f"The first {len(rows)} of {len(named)} stops; `adhesion stops LOG` shows all."]
    invalid = [s for _, s in named if not s.valid]
    if invalid:
        reasons = ", ".join(dict.fromkeys(str(s.reason) for s in invalid))
        lines += [terminal.folded(f"Without a distance: no whole stop ({reasons}).")]
    return "\n".join(lines)


def tables(
    axles: Sequence[AxleSummary],
    all_rows: bool = False,
    cars: Mapping[int, str] = MappingProxyType({}),
) -> str:
    """The brake applications of a log: a row each, or, where they are many, a row per stop.

    Args:
        axles: of the log.
        cars: name of the car of each axle, where it is stated.
        all_rows: whether each brake application of each axle has its row, however many.
    """
    count = sum(len(axle.applications) for axle in axles)
    if not count:
        return "No brake application."
    if count > MANY_ROWS and len(axles) > 1 and not all_rows:
        return _by_stop([("", axles)], cars)
    return _by_application([("", axles)])


def tables_of_logs(
    summaries: Sequence[ResultSummary],
    all_rows: bool = False,
    cars: Mapping[int, str] = MappingProxyType({}),
) -> str:
    """The same of several logs, in one table."""
    pairs = [(Path(x.log.path).name, x.axles) for x in summaries]
    if not any(axle.applications for _, axles in pairs for axle in axles):
        return "No brake application."
    return _by_application(pairs) if all_rows else _by_stop(pairs, cars)


_Logs = Sequence[tuple[str, Sequence[AxleSummary]]]  # name, empty for one log, and axles


def _by_stop(logs: _Logs, cars: Mapping[int, str]) -> str:
    """A row per stop of each log; of many the worst ones, these first."""
    stops = [(name, stop) for name, axles in logs for stop in find_stops(axles)]
    lines = []
    shown = stops
    if len(stops) > _SHOWN_STOPS or not logs[0][0]:
        shown = sorted(stops, key=lambda pair: slide_severity(pair[1].worst), reverse=True)
        shown = shown[:_SHOWN_STOPS]
        has_slides = any(a.slides for _, stop in stops for a in stop.applications)
        order = "most slip first" if has_slides else "highest µ first"
        lines.append(f"{len(shown)} of {len(stops)} stops, {order}:")
    rows = [_named(name) | stop_row(stop) for name, stop in shown]
    lines.append(terminal.records(terminal.non_empty(rows)))
    lines += [terminal.folded(f"{_OF_STOPS} --rows shows every brake application of every axle.")]
    for name, axles in logs:
        if len(axles) > MANY_AXLES:
            rows = [_named(name) | group_row(group) for group in group_axles(axles, cars)]
            lines += ["", terminal.records(terminal.non_empty(rows)), _OF_GROUPS]
    if not any(a.slides for _, stop in stops for a in stop.applications):
        lines += ["", _no_slides([a.slip_unknown_s for _, s in stops for a in s.applications])]
    return "\n".join(lines)


def _by_application(logs: _Logs) -> str:
    """Brake applications of every axle, then those with slides."""
    keyed = [
        (_named(name), str(axle.axle), a)
        for name, axles in logs
        for axle in axles
        for a in axle.applications
    ]
    rows = [name | row(axle, a) for name, axle, a in keyed]
    marked = any(a.other_brake for *_, a in keyed)
    note = f"{_NOTE} {OF_MARK}" if marked else _NOTE
    lines = [terminal.records(rows), terminal.folded(note), ""]
    if slid := [name | slid_row(axle, a) for name, axle, a in keyed if a.slides]:
        has_bounds = any(a.at_least for *_, a in keyed if a.slides)
        note = f"{_OF_SLIDES} {_BOUND}" if has_bounds else _OF_SLIDES
        return "\n".join([*lines, terminal.records(slid), terminal.folded(note)])
    return "\n".join([*lines, _no_slides([a.slip_unknown_s for *_, a in keyed])])


def _named(name: str) -> dict[str, str]:
    """The column of the log, if there are several."""
    return {"log": name} if name else {}


def _no_slides(unknown_s: Sequence[float]) -> str:
    """That there are none, or that they may be hidden."""
    if max(unknown_s) < HIDDEN_TIME:
        return "No slides."
    place = f"without a train speed for up to {max(unknown_s):.1f} s of a brake application"
    return f"No slide seen, but slides may be hidden: {place}."


def budgets(axles: Sequence[AxleSummary]) -> str:
    """The uncertainty budget of each brake application's mean force."""
    lines = []
    for axle in axles:
        for a in axle.applications:
            if a.budget:
                lines += [f"Axle {axle.axle}, brake application at {a.start_s:.1f} s:"]
                lines += [terminal.records([budget_row(c) for c in a.budget], text_columns=3)]
                lines += [terminal.folded(combined(a)), ""]
    return "\n".join([*lines, terminal.folded(_OF_BUDGETS), ""]) if lines else ""
