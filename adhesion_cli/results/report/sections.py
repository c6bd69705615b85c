"""Sections of a page that a single run and a comparison have in common."""

from collections.abc import Iterator, Sequence

from . import words
from .markup import element, paragraph, table, text
from .run import Run

MANY = 12  # rows of a table that are shown without scrolling, about
MOST = 500  # rows of a table: more would need too much room
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
_AT_LEAST = "≥: the true value is at least this, as the train speed was estimated or is delayed."
TOO_OLD = "This browser is too old to draw the figures. The tables are whole."


def verdict(run: Run) -> Iterator[str]:
    """One line, a card for each axle, and what to take care of."""
    mark, said = words.headline(run)
    yield element("p", text(said), f"headline {mark}")
    cards = []
    for axle in run.axles:
        v = words.verdict(axle)
        cards.append(element("div", "".join([
            element("b", text(f"{v.title} {v.state}")),
            element("div", text(f"µ {v.adhesion}"), "value") if v.adhesion != words.NONE else "",
            paragraph(v.text),
        ]), f"card {v.mark}"))  # fmt: skip
    yield element("div", "\n".join(cards), "cards")


def applications(run: Run) -> str:
    """One row per axle and brake application."""
    rows = words.application_rows(run)
    shown, note = rows, ""
    if len(rows) > MOST:  # those with slides first
        order = sorted(range(len(rows)), key=lambda i: rows[i][0] not in ("slid", "locked"))
        shown = [rows[i] for i in sorted(order[:MOST])]
        note = paragraph(
            f"{MOST} of {len(rows)} rows, those with slides first. `adhesion analyze LOG --table "
            "FILE.csv` writes all.", "note",
        )  # fmt: skip
    marks = [(mark, "Slides") for mark, _ in shown]
    css = "long" * (len(shown) > MANY)
    return table([row for _, row in shown], marks=marks, css=css) + note


def notes(runs: Sequence[Run]) -> str:
    """What the columns of `applications` mean."""
    slid = [one for r in runs for a in r.axles for one in a.applications if one.slides]
    least = any(one.at_least for one in slid)
    return paragraph(" ".join([NOTE, OF_SLIDES, *[_AT_LEAST] * least]), "note")


def care(run: Run, title: str = "") -> Iterator[str]:
    """Warnings and errors, where a reader who leaves early sees them.

    Args:
        run: with findings.
        title: above them, where the page does not list the findings; else they are links.
    """
    serious = [of for of in words.told(run.findings) if of.severity != "info"]
    if serious:
        items = [
            element("li", element("a", said, href=f"#finding-{of.code}") if not title else said)
            for of in serious
            for said in [text(_in_short(of))]
        ]
        head = element("b", text(title or "Read the figures with care:"))
        yield element("div", f"{head}<ul>{''.join(items)}</ul>", "care")


def _in_short(of: words.Told) -> str:
    """What and where, in one line."""
    channels, times, messages = (list(dict.fromkeys(x)) for x in zip(*of.lines, strict=True))
    channels = [c for c in channels if c]
    where = words.listed(channels) if channels else ""
    if len(where) > _NAMED:
        where = f"{channels[0].partition(', ')[0]} and others"
    spans = [t for t in times if t.endswith((" s", "more"))]
    first = f"{spans[0]}{' and others' * (len(spans) > 1)}" if spans else ""
    said = messages[0] if len(messages) == 1 else f"{of.title}."
    place = ", ".join(part for part in (where, first) if part)
    return f"{place}: {said}" if place else said


def places(names: Sequence[str]) -> Iterator[str]:
    """Where figures go."""
    for name in names:
        yield element("div", "", "figure", id=name)
