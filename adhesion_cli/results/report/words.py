"""What a report says of a run: verdict, tables and findings, as plain text."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from ...core.finding import catalogue
from ...core.summary import BrakeApplication, FindingSummary
from ...core.text import enumerated
from ...rail.events import HIDDEN_TIME
from ..application_tables import application_tables
from ..result_rows import mean_coefficient
from ..text_tables import DASH, TitledTable, describe_times, number, numbered
from .run import ReportAxle, ReportRun

Mark = Literal["good", "slid", "locked", "unknown"]
Cells = Mapping[str, str]
_NO_FORCE = ("pressure-below-spring", "pressure-unit-suspect", "brake-unknown")
_MOST_BUDGETS = 12  # more brake applications: of each axle only the budget of the widest one
_NAMED_LOGS = 2  # logs of a finding in its line
_NAMED = 60  # letters for the channels of a finding in its line


@dataclass(frozen=True, slots=True)
class AxleVerdict:
    """What one axle did, for a reader in a hurry."""

    mark: Mark
    state: str  # a few words
    text: str  # sentences
    adhesion: str  # mean coefficient of the worst brake application, with its uncertainty


def span(a: BrakeApplication) -> str:
    """From and to, in seconds."""
    return f"{a.start_s:.1f}–{a.end_s:.1f}"


def brake_tables(runs: Sequence[ReportRun], all_rows: bool = False) -> list[TitledTable]:
    """Brake applications and slides, as on the screen; those of several runs together."""
    summaries = []
    for i, run in enumerate(runs, 1):
        log = run.summary.log._replace(path=f"run {i}")
        axles = tuple(axle.summary for axle in run.axles)
        summaries.append(replace(run.summary, log=log, axles=axles))
    return application_tables(summaries, all_rows, runs[0].cars)


def headline(run: ReportRun) -> tuple[Mark, str]:
    """The verdict on a run in one line."""
    marks = {a.number: verdict(a).mark for a in run.axles}
    count = max((len(a.applications) for a in run.axles), default=0)
    if not count:
        reasons = [g.title for g in finding_groups(run.summary.findings) if g.code in _NO_FORCE]
        return "unknown", ". ".join(["The log shows no brake application", *reasons]) + "."
    braked = "the brake application" if count == 1 else f"{count} brake applications"
    by_mark: dict[Mark, list[int]] = {}
    for axle, mark in marks.items():
        by_mark.setdefault(mark, []).append(axle)

    def axles_with(mark: Mark) -> str:
        return f"{'Axle' if len(by_mark[mark]) == 1 else 'Axles'} {numbered(by_mark[mark])}"

    if "locked" in by_mark:
        text = f"{axles_with('locked')} locked: the wheel stood while the train moved."
        return "locked", f"{text} {axles_with('slid')} slid." if "slid" in by_mark else text
    if "slid" in by_mark:
        slid_axles = (a for a in run.axles if marks[a.number] == "slid")
        slid = [sum(x.slides > 0 for x in a.applications) for a in slid_axles]
        share = f"{'up to ' * (min(slid) < max(slid))}{max(slid)} of " * (count > 1)
        return "slid", f"{axles_with('slid')} slid in {share}{braked}."
    if "unknown" in by_mark:
        if any(a.has_values("slip") for a in run.axles):
            return "unknown", f"{axles_with('unknown')} may have slid: parts have no train speed."
        return "unknown", "The log does not show whether wheels slid: there is no train speed."
    return "good", f"No wheel slid in {braked}."


def verdict(axle: ReportAxle) -> AxleVerdict:
    """The verdict on one axle."""
    applications = axle.applications
    slid = [a for a in applications if a.slides]
    if not applications:
        text = "The log shows no brake application."
        return AxleVerdict("unknown", "not braked", text, DASH)
    if slid:
        worst = max(slid, key=lambda a: (a.longest_lock_s or 0.0, a.max_slip or 0.0))
    else:
        worst = max(applications, key=lambda a: a.coefficient.mean if a.coefficient else -1.0)
    adhesion = mean_coefficient(worst).replace("±", " ± ")
    if slid:
        locked = bool(worst.locked_s)
        text = " ".join(_of_slides(slid, len(applications), worst))
        count = sum(a.slides for a in slid)
        times = {1: "once", 2: "twice"}.get(count, f"{count} times")
        state = "locked" if locked else f"slid {times}"
        return AxleVerdict("locked" if locked else "slid", state, text, adhesion)
    if not axle.has_values("slip"):
        text = "Without a train speed, slides cannot be seen."
        return AxleVerdict("unknown", "slides not known", text, adhesion)
    if not all(a.slip_unknown_s < HIDDEN_TIME for a in applications):
        text = "No slide seen. Without a train speed in parts of the braking, slides may be hidden."
        return AxleVerdict("unknown", "slides not known", text, adhesion)
    count = len(applications)
    text = f"No slide in {count} brake applications." if count > 1 else "No slide."
    if worst.coefficient:
        text += " The rail gave at least this adhesion."
    return AxleVerdict("good", "did not slide", text, adhesion)


def _of_slides(
    slid: Sequence[BrakeApplication], braked: int, worst: BrakeApplication
) -> Iterator[str]:
    bound_text = "at least " if worst.at_least else ""
    subject = "it"
    if braked > 1:
        yield f"Slid in {len(slid)} of {braked} brake applications."
        yield f"The one with the most slip is at {span(worst)} s."
        subject = "there it"
    total = number(worst.slide_s, 1)
    if worst.locked_s:
        yield f"The wheel stood still for {number(worst.locked_s, 1)} s while the train moved;"
        yield f"{subject} slid for {bound_text}{total} s."
    else:
        slip = ""
        if worst.max_slip is not None:
            share = f"{100.0 * worst.max_slip:.1f}\N{NO-BREAK SPACE}%"
            slip = f", with slip up to {bound_text}{share}"
        yield f"{subject.capitalize()} slid for {bound_text}{total} s{slip}."
    if worst.utilisation is not None:
        share = f"{100.0 * worst.utilisation:.0f}\N{NO-BREAK SPACE}%"
        yield f"In the slides it used {share} of the adhesion that the rail gave."
    else:
        yield "The slides do not show how much adhesion the rail gave."


_Numbered = tuple[int, BrakeApplication]  # after the number of its axle


def budgets(run: ReportRun) -> list[_Numbered]:
    """The brake applications with an uncertainty budget, of the axles that are drawn."""
    axles = [axle for axle in run.axles if axle.number in run.detailed]
    return [(a.number, x) for a in axles for x in a.applications if x.budget]


def widest(applications: Sequence[_Numbered]) -> Sequence[_Numbered]:
    """The budgets that a page has room for: of many, each axle's with the largest uncertainty."""
    if len(applications) <= _MOST_BUDGETS:
        return applications

    def u95(pair: _Numbered) -> float:
        return pair[1].force_n.mean_u95 if pair[1].force_n else 0.0

    return sorted(dict(sorted(applications, key=u95)).items())


@dataclass(frozen=True, slots=True)
class FindingGroup:
    """All findings of one code, with the words of the catalogue."""

    code: str
    severity: str
    title: str
    sections: list[tuple[str, str]]  # heading, text
    lines: Sequence[Cells]  # each with channel, time and message
    logs: Sequence[str] = ()  # names of those that have it, of several


def finding_groups(findings: Sequence[FindingSummary]) -> list[FindingGroup]:
    """The findings by code, errors first; as the result has them where a code is not known."""
    return finding_groups_of_logs([("", finding) for finding in findings])


def finding_groups_of_logs(findings: Sequence[tuple[str, FindingSummary]]) -> list[FindingGroup]:
    """The same of findings after names of logs; a line that several have names them all."""
    order = ("error", "warning", "info")
    by_code: dict[tuple[str, str], list[tuple[str, FindingSummary]]] = {}
    for log, f in sorted(findings, key=lambda pair: order.index(pair[1].severity)):
        by_code.setdefault((f.severity, f.code), []).append((log, f))
    groups = []
    for (severity, code), group in by_code.items():
        logs_of_line: dict[tuple[str, str, str], list[str]] = {}
        for log, f in group:
            logs_of_line.setdefault((f.channel, describe_times([f]), f.message), []).append(log)
        lines = [
            ({"Log": ", ".join(dict.fromkeys(logs))} if any(logs) else {})
            | {"Channel": channel, "Time": time, "What": message}
            for (channel, time, message), logs in logs_of_line.items()
        ]
        remedy = " ".join(dict.fromkeys(f.hint for _, f in group if f.hint))
        logs = [log for log in dict.fromkeys(log for log, _ in group) if log]
        groups.append(FindingGroup(code, severity, *explained(code, remedy), lines, logs))
    return groups


def summary_line(group: FindingGroup) -> str:
    """What and where, in one line."""
    channels, times, messages = (
        list(dict.fromkeys(line[name] for line in group.lines if line[name]))
        for name in ("Channel", "Time", "What")
    )
    channel_text = enumerated(channels) if channels else ""
    if len(channel_text) > _NAMED:
        channel_text = f"{channels[0].partition(', ')[0]} and others"
    spans = [t for t in times if t.endswith((" s", "more"))]
    span_text = f"{spans[0]}{' and others' * (len(spans) > 1)}" if spans else ""
    message = messages[0] if len(messages) == 1 else f"{group.title}."
    logs = group.logs
    log_text = (
        enumerated(logs) if 0 < len(logs) <= _NAMED_LOGS else f"{len(logs)} logs" * bool(logs)
    )
    place = ", ".join(text for text in (log_text, channel_text, span_text) if text)
    return f"{place}: {message}" if place else message


def explained(code: str, remedy: str) -> tuple[str, list[tuple[str, str]]]:
    """Title of a code, and what the catalogue says of it with the remedy: headings and texts."""
    if entry := catalogue().get(code):
        texts = entry.cause, entry.effect, remedy, entry.limits
        heads = "Cause", "Effect on the result", "What to do", "Cannot see"
        return entry.title, [x for x in zip(heads, texts, strict=True) if x[1]]
    return code, [("What to do", remedy)] if remedy else []
