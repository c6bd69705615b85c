"""Sections of a page that a single run and a comparison have in common."""

from collections.abc import Iterator, Sequence

from . import words
from .markup import element, paragraph, table, text
from .run import ReportRun

VISIBLE_ROWS = 12  # rows of a table that are shown without scrolling, about
MAX_ROWS = 500  # rows of a table: more would need too much room
NOTE = (
    "± is the expanded uncertainty (95 %): noise and the tolerances of the vehicle's parameters. "
    "Adhesion coefficient: adhesion force over the weight on the axle; mean from build-up to "
    "release. Times are seconds after the start of the log."
)
OF_SLIDES = (
    "Sliding: time of all slides together. Heat: energy of friction between wheel and rail. Used: "
    "share of the available adhesion that the wheel used while it slid; a dash where the slides "
    "are too short to show it."
)
_NAMED = 60  # letters for the channels of a finding in its line
_BOUND_NOTE = "≥: the true value is at least this, as the train speed was estimated or is delayed."
BROWSER_NOTE = "This browser is too old to draw the figures. The tables are whole."


def verdict(run: ReportRun) -> Iterator[str]:
    """One line, a card for each axle, and what to take care of."""
    mark, said = words.headline(run)
    yield element("p", text(said), f"headline {mark}")
    cards = []
    for axle in run.axles:
        v = words.verdict(axle)
        cards.append(
            element(
                "div",
                "".join(
                    [
                        element("b", text(f"{v.title} {v.state}")),
                        element("div", text(f"µ {v.adhesion}"), "value")
                        if v.adhesion != words.DASH
                        else "",
                        paragraph(v.text),
                    ]
                ),
                f"card {v.mark}",
            )
        )
    yield element("div", "\n".join(cards), "cards")


def applications(run: ReportRun) -> str:
    """One row per axle and brake application."""
    rows = words.application_rows(run)
    rows_shown, note = rows, ""
    if len(rows) > MAX_ROWS:  # those with slides first
        order = sorted(range(len(rows)), key=lambda i: rows[i][0] not in ("slid", "locked"))
        rows_shown = [rows[i] for i in sorted(order[:MAX_ROWS])]
        note = paragraph(
            f"{MAX_ROWS} of {len(rows)} rows, those with slides first. "
            "`adhesion analyze LOG --table FILE.csv` writes all.",
            "note",
        )
    marks = [(mark, "Slides") for mark, _ in rows_shown]
    css = "long" * (len(rows_shown) > VISIBLE_ROWS)
    return table([row for _, row in rows_shown], marks=marks, css=css) + note


def notes(runs: Sequence[ReportRun]) -> str:
    """What the columns of `applications` mean."""
    slid = [
        application
        for r in runs
        for a in r.axles
        for application in a.applications
        if application.slides
    ]
    has_bound = any(application.at_least for application in slid)
    return paragraph(" ".join([NOTE, OF_SLIDES, *[_BOUND_NOTE] * has_bound]), "note")


def care(run: ReportRun, title: str = "") -> Iterator[str]:
    """Warnings and errors, where a reader who leaves early sees them.

    Args:
        run: with findings.
        title: above them, where the page does not list the findings; else they are links.
    """
    serious = [group for group in words.finding_groups(run.findings) if group.severity != "info"]
    if serious:
        items = [
            element("li", element("a", said, href=f"#finding-{group.code}") if not title else said)
            for group in serious
            for said in [text(_summary_line(group))]
        ]
        head = element("b", text(title or "Read the figures with care:"))
        yield element("div", f"{head}<ul>{''.join(items)}</ul>", "care")


def _summary_line(group: words.FindingGroup) -> str:
    """What and where, in one line."""
    channels, times, messages = (list(dict.fromkeys(x)) for x in zip(*group.lines, strict=True))
    channels = [c for c in channels if c]
    channel_text = words.listed(channels) if channels else ""
    if len(channel_text) > _NAMED:
        channel_text = f"{channels[0].partition(', ')[0]} and others"
    spans = [t for t in times if t.endswith((" s", "more"))]
    span_text = f"{spans[0]}{' and others' * (len(spans) > 1)}" if spans else ""
    said = messages[0] if len(messages) == 1 else f"{group.title}."
    place = ", ".join(piece for piece in (channel_text, span_text) if piece)
    return f"{place}: {said}" if place else said


def places(names: Sequence[str]) -> Iterator[str]:
    """Where figures go."""
    for name in names:
        yield element("div", "", "figure", id=name)
