"""What a report says of a run: verdict, tables and findings, as plain text."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ...core.finding import CatalogueEntry, catalogue
from ...core.summary import BrakeApplication, FindingSummary, MeanAndHighest
from ...core.text import by_uncertainty
from ...rail.events import HIDDEN_TIME
from .run import Axle, Run

Mark = Literal["good", "slid", "locked", "unknown"]
Cells = Mapping[str, str]
NONE = "–"
_NO_FORCE = ("pressure-below-spring", "pressure-unit-suspect", "brake-unknown")
_LOCKED = 0.995  # slip of a wheel that stands while the train moves


@dataclass(frozen=True, slots=True)
class Verdict:
    """What one axle did, for a reader in a hurry."""

    title: str
    mark: Mark
    state: str  # a few words
    text: str  # sentences
    adhesion: str  # mean coefficient of the worst brake application, with its uncertainty


def number(value: float | None, digits: int = 0) -> str:
    """A number with fixed digits; a dash where there is none."""
    return NONE if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def percent(share: float | None, digits: int = 0) -> str:
    """A share in percent; a dash where there is none."""
    return number(share if share is None else 100.0 * share, digits)


def span(begin: float, end: float, digits: int = 1) -> str:
    """From and to, in seconds."""
    return f"{begin:.{digits}f}–{end:.{digits}f}"


def measured(pair: tuple[float, float] | None, factor: float, digits: int) -> str:
    """A value with its expanded uncertainty; a dash where there is none."""
    if not pair:
        return NONE
    return " ± ".join(by_uncertainty(factor * pair[0], factor * pair[1], digits))


def _mean(x: MeanAndHighest | None) -> tuple[float, float] | None:
    return x and (x.mean, x.mean_u95)


def _highest(x: MeanAndHighest | None) -> tuple[float, float] | None:
    return x and (x.max, x.max_u95)


def plural(count: int, name: str) -> str:
    """A number of things."""
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def listed(names: Sequence[object]) -> str:
    """A list as a sentence has it."""
    *first, last = map(str, names)
    return f"{', '.join(first)} and {last}" if first else last


def slides_known(axle: Axle) -> bool:
    """Whether the log shows slip: it has a train speed, or one was made of several axles."""
    return axle.known("slip")


def _seen(axle: Axle, one: BrakeApplication) -> bool:
    """Whether a slide in this brake application would have been seen."""
    return slides_known(axle) and one.slip_unknown_s < HIDDEN_TIME


def headline(run: Run) -> tuple[Mark, str]:
    """The verdict on a run in one line."""
    marks = {a.number: verdict(a).mark for a in run.axles}
    count = max((len(a.applications) for a in run.axles), default=0)
    if not count:
        why = [of.title for of in told(run.findings) if of.code in _NO_FORCE]
        return "unknown", ". ".join(["The log shows no brake application", *why]) + "."
    braked = "the brake application" if count == 1 else f"{count} brake applications"
    by_mark: dict[Mark, list[int]] = {}
    for axle, mark in marks.items():
        by_mark.setdefault(mark, []).append(axle)

    def of(mark: Mark) -> str:
        return f"{'Axle' if len(by_mark[mark]) == 1 else 'Axles'} {listed(by_mark[mark])}"

    if "locked" in by_mark:
        others = f" {of('slid')} slid." if "slid" in by_mark else ""
        return "locked", f"{of('locked')} locked: the wheel stood while the train moved.{others}"
    if "slid" in by_mark:
        slid = [len(_slid(a)) for a in run.axles if marks[a.number] == "slid"]
        share = f"{'up to ' * (min(slid) < max(slid))}{max(slid)} of " * (count > 1)
        return "slid", f"{of('slid')} slid in {share}{braked}."
    if "unknown" in by_mark:
        if any(slides_known(a) for a in run.axles):
            return "unknown", f"{of('unknown')} may have slid: parts have no train speed."
        return "unknown", "The log does not show whether wheels slid: there is no train speed."
    return "good", f"No wheel slid in {braked}."


def _slid(axle: Axle) -> list[BrakeApplication]:
    """The brake applications of an axle that have slides."""
    return [one for one in axle.applications if one.slides]


def verdict(axle: Axle) -> Verdict:
    """The verdict on one axle."""
    title, every = f"Axle {axle.number}", axle.applications
    slid = _slid(axle)
    if not every:
        return Verdict(title, "unknown", "not braked", "The log shows no brake application.", NONE)
    worst = max(slid, key=lambda one: one.max_slip or 0.0) if slid else _most_adhesion(every)
    adhesion = measured(_mean(worst.coefficient), 1.0, 3)
    if slid:
        locked = (worst.max_slip or 0.0) > _LOCKED
        text = " ".join(_of_slides(slid, len(every), worst))
        state = "locked" if locked else f"slid {_times(sum(one.slides for one in slid))}"
        return Verdict(title, "locked" if locked else "slid", state, text, adhesion)
    if not slides_known(axle):
        text = "Without a train speed, slides cannot be seen."
        return Verdict(title, "unknown", "slides not known", text, adhesion)
    if not all(_seen(axle, one) for one in every):
        text = "No slide seen. Without a train speed in parts of the braking, slides may be hidden."
        return Verdict(title, "unknown", "slides not known", text, adhesion)
    least = "The rail gave at least this adhesion." if worst.coefficient else ""
    braked = "No slide" + (f" in {len(every)} brake applications." if len(every) > 1 else ".")
    return Verdict(title, "good", "did not slide", f"{braked} {least}".strip(), adhesion)


def _most_adhesion(every: Sequence[BrakeApplication]) -> BrakeApplication:
    """The brake application with the highest mean adhesion coefficient, if any has one."""
    return max(every, key=lambda one: one.coefficient.mean if one.coefficient else -1.0)


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _of_slides(
    slid: Sequence[BrakeApplication], braked: int, worst: BrakeApplication
) -> Iterator[str]:
    least = "at least " if worst.at_least else ""
    who = "it"
    if braked > 1:
        yield f"Slid in {len(slid)} of {braked} brake applications."
        yield f"The one with the most slip is at {span(worst.start_s, worst.end_s)} s."
        who = "there it"
    total = number(worst.slide_s, 1)
    if (worst.max_slip or 0.0) > _LOCKED:
        yield f"The wheel stood still while the train moved; {who} slid for {least}{total} s."
    else:
        slip = f"{percent(worst.max_slip, 1)}\N{NO-BREAK SPACE}%"
        yield f"{who.capitalize()} slid for {least}{total} s, with slip up to {slip}."
    if worst.utilisation is not None:
        used = percent(worst.utilisation)
        yield f"In the slides it used {used}\N{NO-BREAK SPACE}% of the adhesion that the rail gave."
    else:
        yield "The slides are too short to show how much adhesion the rail gave."


def application_rows(run: Run) -> list[tuple[Mark, Cells]]:
    """One row per axle and brake application, in the order of time."""
    every = [(axle, one) for axle in run.axles for one in axle.applications]
    every.sort(key=lambda pair: (round(pair[1].start_s), pair[0].number))
    return [(_mark(axle, one), _application(axle, one)) for axle, one in every]


def _mark(axle: Axle, one: BrakeApplication) -> Mark:
    if not one.slides:
        return "good" if _seen(axle, one) else "unknown"
    return "locked" if (one.max_slip or 0.0) > _LOCKED else "slid"


def _application(axle: Axle, one: BrakeApplication) -> Cells:
    kmh = [number(v if v is None else 3.6 * v) for v in (one.from_mps, one.to_mps)]
    slid, least = bool(one.slides), "≥ " if one.at_least else ""

    def if_slid(text: str) -> str:
        return NONE if not slid or text == NONE else f"{least}{text}"

    energy = one.slide_energy_j
    return {
        "Axle": str(axle.number), "Time [s]": span(one.start_s, one.end_s),
        "Speed [km/h]": "–".join(kmh),
        "Adhesion coefficient, mean": measured(_mean(one.coefficient), 1.0, 3),
        "highest": measured(_highest(one.coefficient), 1.0, 3),
        "Force, mean [kN]": measured(_mean(one.force_n), 1e-3, 2),
        "Slides": str(one.slides) if one.slides or _seen(axle, one) else "?",
        "Sliding for [s]": if_slid(number(one.slide_s, 1)),
        "Most slip [%]": if_slid(percent(min(one.max_slip or 0.0, 1.0), 1)),
        "Heat [kJ]": if_slid(number(energy and 1e-3 * energy, 1)),
        "Used of the available adhesion [%]": percent(one.utilisation),
    }  # fmt: skip


def score_rows(axle: Axle) -> list[Cells]:
    """How well each estimator follows, the best first."""
    return [
        {
            "Estimator": f"{s.algo} ≈" if s.alike and s.relative != 1.0 else s.algo,
            "RMSE [N]": number(s.rmse_n), "Bias [N]": number(s.bias_n),
            "Largest error [N]": number(s.max_error_n), "Delay [s]": number(s.lag_s, 3),
            "Gain": number(s.gain, 3),
            "Its own 95 % band [N]": number(s.band_n),
            "holds [%]": percent(s.within),
        }
        for s in axle.summary.estimators
    ]  # fmt: skip


def budget_rows(one: BrakeApplication) -> list[Cells]:
    """What each quantity adds to the uncertainty of a mean force, the largest first."""
    rows: list[Cells] = []
    for row in one.budget or ():
        unit = "" if row.unit == "-" else f" {row.unit}"
        value = NONE if row.value is None else f"{row.value:.5g}{unit}"
        rows.append({
            "Quantity": row.quantity.replace("_", " "), "Type": row.type, "Value": value,
            "Standard uncertainty": f"{row.u:.3g}{unit}",
            "Sensitivity [N per unit]": f"{row.sensitivity:.3g}",
            "Adds [N]": number(row.contribution_n, 1),
            "Share [%]": percent(row.share, 1),
        })  # fmt: skip
    return rows


def combined(one: BrakeApplication) -> str:
    """The last line of a budget."""
    coverage, force = one.coverage, one.force_n
    assert coverage
    assert force
    freedom = coverage.degrees_of_freedom
    many = "many" if freedom is None or freedom > 999.0 else f"{freedom:.0f}"
    return (
        f"F = {force.mean:.0f} ± {force.mean_u95:.0f} N (95 %); combined standard "
        f"uncertainty {coverage.u_n:.1f} N, coverage factor {coverage.k:.2f}, effective degrees of "
        f"freedom: {many}."
    )


@dataclass(frozen=True, slots=True)
class Told:
    """All findings of one code, with the words of the catalogue."""

    code: str
    severity: str
    title: str
    lines: list[tuple[str, str, str]]  # channel, time, message
    parts: list[tuple[str, str]]  # heading, text


_SEVERITIES = ("error", "warning", "info")
_PARTS = {"cause": "Cause", "effect": "Effect on the result", "limits": "Cannot see"}


def told(findings: Sequence[FindingSummary]) -> list[Told]:
    """The findings by code, errors first; as the result has them where a code is not known."""
    by_code: dict[tuple[str, str], list[FindingSummary]] = {}
    for severity in _SEVERITIES:
        for f in findings:
            if f.severity == severity:
                by_code.setdefault((severity, f.code), []).append(f)
    return [
        _told(severity, catalogue().get(code), code, of) for (severity, code), of in by_code.items()
    ]


def explained(code: str) -> tuple[str, list[tuple[str, str]]]:
    """Title of a code, and what the catalogue says of it: headings and texts."""
    words = catalogue().get(code)
    if words is None:
        return code, []
    parts = [(name, str(getattr(words, key))) for key, name in _PARTS.items()]
    parts.append(("What to do", f"`adhesion explain {code}` and the page of each log say it."))
    return words.title, [p for p in parts if p[1]]


def _told(
    severity: str, words: CatalogueEntry | None, code: str, of: Sequence[FindingSummary]
) -> Told:  # fmt: skip
    lines = [(f.channel, _when(f), f.message) for f in of]
    hints = list(dict.fromkeys(f.hint for f in of if f.hint))
    parts = [(name, getattr(words, key)) for key, name in _PARTS.items()] if words else []
    parts.insert(2 if parts else 0, ("What to do", " ".join(hints)))
    return Told(code, severity, words.title if words else code, lines, [p for p in parts if p[1]])


def _when(f: FindingSummary) -> str:
    """The first time span, and how many more there are."""
    spans = f.spans
    if not spans:
        return f"{f.count} ×" if f.count > 1 else ""
    begin, end = spans[0]
    first = f"{begin:.2f} s" if end - begin < 0.005 else f"{span(begin, end, 2)} s"
    return f"{first} and {len(spans) - 1} more" if len(spans) > 1 else first
