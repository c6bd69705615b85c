"""The page: first the verdict, then every axle, the budget, the findings, and how it was made."""

import json
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from ... import __version__
from ..verified import verified
from . import comparison, sections, words
from .campaign import Campaign
from .markup import element, packed, paragraph, prose, table, text
from .run import Axle, Run

if TYPE_CHECKING:
    from .plots import Figures

_MOST = 2_900_000  # letters of a page: more numbers are not drawn
_BUDGETS = 12  # more brake applications: of each axle only the budget of the widest one
_LINES = 25  # findings of one code that are listed
_OF_FIGURES = (
    "Shaded: a wheel slides. Drag over a time to enlarge it: all figures follow. The symbols at "
    "the right edge of a figure set it back."
)
_OF_SCORES = (
    "Estimators follow the force online, sample by sample. Errors are those in brake applications. "
    "RMSE: root mean square error. ≈: the noise of the reference explains the difference from the "
    "best (95 %)."
)
_OF_BUDGETS = (
    "Uncertainty budget of the mean force by JCGM 100 (GUM), the largest share first. Type A: from "
    "the samples; type B: tolerances of the vehicle as stated, or their defaults."
)


def write(path: Path, runs: Sequence[Run]) -> None:
    """Writes a report.

    Args:
        path: file to write; its old content is lost.
        runs: one, or several to compare.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    with verified(path) as file:
        file.write(page(runs).encode("utf-8"))


def page(runs: Sequence[Run]) -> str:
    """The whole page; the same runs give the same text."""
    from .plots import VALUES, Figures  # Bokeh is slow to import

    body: list[str] = []
    for values in VALUES:
        figures = Figures(values)
        made = _single(runs[0], figures) if len(runs) == 1 else comparison.body(runs, figures)
        body = list(made)
        body += _packed(figures)
        if sum(map(len, body)) < _MOST:
            break
    return _whole(", ".join(r.name for r in runs), body)


def write_tables(path: Path, of: Campaign) -> None:
    """Writes a page of tables, as of a fleet.

    Args:
        path: file to write; its old content is lost.
        of: what it shows.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    from .plots import Figures  # Bokeh is slow to import

    figures = Figures()
    body = [element("h1", text(of.name)), element("p", text(of.verdict), "headline")]
    body += [paragraph(of.lead), paragraph(sections.TOO_OLD, "too-old")]
    for i, one in enumerate(of.tables):
        shown = one.rows[: sections.MOST]
        more = len(one.rows) - len(shown)
        css = "long" * (len(shown) > sections.MANY)
        body += [element("h2", text(one.title))]
        body += sections.places([figures.of_bars(one.figure, f"bars-{i}")] if one.figure else [])
        body += [table(shown, one.left, one.marks, css, one.links)]
        body += [paragraph(f"And {more} more.", "note")] * (more > 0)
        body += [paragraph(one.note, "note")] * bool(one.note)
    body += _explained(of.codes)
    body += [element("h2", "How this was made", id="about")]
    body += [table([{"Fact": k, "Value": v} for k, v in of.about.items()], left=2)]
    body += _packed(figures)
    with verified(path) as file:
        file.write(_whole(of.name, body).encode("utf-8"))


def _explained(codes: Sequence[str]) -> Iterator[str]:
    """What the catalogue says of findings, each with its place."""
    if codes:
        yield element("h2", "Findings explained", id="findings")
    for code in codes:
        title, parts = words.explained(code)
        inside = "".join(
            element("dt", text(name)) + element("dd", prose(said)) for name, said in parts
        )
        inside = element("h3", text(title)) + element("dl", inside)
        inside += paragraph(f"Code: {code}", "note")
        yield element("div", inside, "finding", id=f"finding-{text(code)}")


def _packed(figures: "Figures") -> list[str]:
    """What draws the figures."""
    return [packed("library", figures.library()), packed("figures", figures.as_json())]


def _whole(name: str, body: list[str]) -> str:
    """A page of this body."""
    here = files(__package__)
    style, script = (here.joinpath(f"page.{kind}").read_text("utf-8") for kind in ("css", "js"))
    head = [
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta name="generator" content="adhesion {__version__}">',
        element("title", text(f"Adhesion report: {name}")),
        element("style", style),
    ]
    body = [*body, element("script", script)]
    parts = ['<!DOCTYPE html>\n<html lang="en">\n<head>', *head, "</head>\n<body>", *body]
    return "\n".join([*parts, "</body>\n</html>\n"])


def _single(run: Run, figures: "Figures") -> Iterator[str]:
    drawn = figures.of_run(run)
    yield from _first_screen(run, drawn.overview)
    for axle in run.axles:
        yield from _axle(axle, drawn.axles[axle.number])
    if drawn.step:
        yield paragraph(
            f"The figures show the lowest and the highest values of parts of the log, about "
            f"{drawn.step:.2g} s apart in brake applications. The result file has every sample.",
            "note",
        )
    yield from _budgets(run)
    yield from _findings(run)
    yield from _about(run)


def _first_screen(run: Run, overview: Sequence[str]) -> Iterator[str]:
    log, start = run.log, run.log.start
    yield element("h1", text(run.name))
    begun = f", {start.replace('T', ' ').replace('Z', ' UTC')}" if start else ""
    yield paragraph(f"{log.format}, {log.duration_s:.1f} s{begun}", "soft")
    yield from sections.verdict(run)
    yield from sections.care(run)
    picture = element("div", "".join(sections.places(overview)), "whole")
    picture += paragraph(_OF_FIGURES, "note")
    heading = element("h2", "Brake applications", id="applications")
    rows = [heading, sections.applications(run)]
    many = sum(len(axle.applications) for axle in run.axles) > sections.MANY
    yield from [picture, *rows] if many else [*rows, picture]
    yield sections.notes([run])
    yield paragraph(sections.TOO_OLD, "too-old")
    links = [(f"#axle-{a.number}", f"Axle {a.number}") for a in run.axles]
    links += [("#budget", "Uncertainty"), ("#findings", "Findings"), ("#about", "How it was made")]
    yield element("nav", " ".join(element("a", text(name), href=to) for to, name in links))


# ---- behind it


def _axle(axle: Axle, places: Sequence[str]) -> Iterator[str]:
    yield element("h2", f"Axle {axle.number}", "page", id=f"axle-{axle.number}")
    yield from sections.places(places)
    if scores := words.score_rows(axle):
        heading = element("h3", f"Estimators against the {text(axle.against)}")
        yield element("div", heading + table(scores) + paragraph(_OF_SCORES, "note"), "whole")


def _budgets(run: Run) -> Iterator[str]:
    yield element("h2", "Uncertainty of the mean force", id="budget")
    every = [(axle, one) for axle in run.axles for one in axle.applications if one.budget]
    if not every:
        yield paragraph("No brake application has a force.")
        return
    yield paragraph(_OF_BUDGETS, "note")
    if len(every) > _BUDGETS:
        yield paragraph(
            "Of each axle the brake application with the largest uncertainty. `adhesion analyze "
            "LOG --budget` shows all.", "note",
        )  # fmt: skip
        widest = {
            a.number: (a, o)
            for a, o in sorted(
                every, key=lambda pair: pair[1].force_n.mean_u95 if pair[1].force_n else 0.0
            )
        }
        every = [widest[number] for number in sorted(widest)]
    for axle, one in every:
        when = words.span(one.start_s, one.end_s)
        heading = element("h3", f"Axle {axle.number}, brake application at {when} s")
        rows = table(words.budget_rows(one), left=2)
        yield element("div", heading + rows + paragraph(words.combined(one), "note"), "whole")


def _findings(run: Run) -> Iterator[str]:
    yield element("h2", "Findings", id="findings")
    found = words.told(run.findings)
    if not found:
        yield paragraph("None: the checks found nothing in this log.")
    for of in found:
        heading = element("h3", f"{text(of.severity.capitalize())}: {text(of.title)}")
        rows = [
            {"Channel": channel, "Time": when, "What": message}
            for channel, when, message in of.lines[:_LINES]
        ]
        more = len(of.lines) - len(rows)
        rest = paragraph(f"And {more} more of this kind.", "note") if more else ""
        parts = "".join(
            element("dt", text(name)) + element("dd", prose(said)) for name, said in of.parts
        )
        code = paragraph(f"Code: {of.code}", "note")
        inside = [heading, table(rows, left=3), rest, element("dl", parts), code]
        yield element(
            "div", "".join(inside), f"finding {text(of.severity)}", id=f"finding-{of.code}"
        )


def _about(run: Run) -> Iterator[str]:
    yield element("h2", "How this was made", id="about")
    of = run.provenance
    facts = {
        "Log": run.name, "Format": run.log.format,
        "Rows": f"{run.log.rows_used} of {run.log.rows_read} used",
        "SHA-256 of the log": run.log.sha256, "Result file": run.file,
        "Analysed by": f"adhesion {of.get('version', 'unknown')}",
        "Reference": words.listed(
            sorted({a.summary.reference.method for a in run.axles}) or ["none"]
        ),
    }  # fmt: skip
    yield table([{"Fact": k, "Value": str(v)} for k, v in facts.items()], left=2)
    yield element("h3", "Channels")
    yield table([
        {
            "Channel": f"{c.name} {c.field}".strip(), "Meaning": str(c.meaning or ""),
            "Axle": str(c.axle or "all"), "Unit": str(c.unit), "Reason": str(c.reason),
        }
        for c in run.channels
    ], left=5)  # fmt: skip
    yield element("h3", "Vehicle")
    yield table(_vehicle(run), left=1)
    settings = [{"Setting": k, "Value": v} for k, v in sorted(run.settings.items())]
    yield element("details", element("summary", "All settings") + table(settings, left=2))
    yield element("h3", "Sources of the methods")
    sources = [element("li", text(line)) for line in of.get("sources", "").splitlines()]
    yield element("ul", "".join(sources))


def _vehicle(run: Run) -> list[dict[str, str]]:
    """The vehicle's parameters with their standard uncertainties."""
    found: dict[str, dict[str, str]] = {}
    for key, value in sorted(run.settings.items()):
        section, _, name = key.partition(".")
        if section != "vehicle":
            continue
        if name.startswith("correlation"):
            found[name] = {"value": value}
        elif name == "wheel_radius":
            for i, one in enumerate(json.loads(value), 1):
                found[f"wheel_radius, axle {i}"] = {k: f"{v:g}" for k, v in one.items()}
        else:
            parameter, _, part = name.rpartition(".")
            found.setdefault(parameter, {})[part] = f"{json.loads(value):g}"
    return [
        {
            "Parameter": name.replace("_", " "), "Value": of.get("value", words.NONE),
            "Standard uncertainty": of.get("tolerance", words.NONE), "Unit": _unit(name),
        }
        for name, of in found.items()
    ]  # fmt: skip


def _unit(name: str) -> str:
    from ...core.model import Vehicle, quantities

    known = quantities(Vehicle).get(name.partition(",")[0])
    return known.unit if known else words.NONE
