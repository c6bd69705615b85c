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
from .run import ReportAxle, ReportRun

if TYPE_CHECKING:
    from .plots import Figures

_PAGE_LIMIT = 2_900_000  # letters of a page: more numbers are not drawn
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


def write(path: Path, runs: Sequence[ReportRun]) -> None:
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


def page(runs: Sequence[ReportRun]) -> str:
    """The whole page; the same runs give the same text."""
    from .plots import VALUES, Figures  # Bokeh is slow to import

    body: list[str] = []
    for values in VALUES:
        figures = Figures(values)
        content = _single(runs[0], figures) if len(runs) == 1 else comparison.body(runs, figures)
        body = list(content)
        body += _packed(figures)
        if sum(map(len, body)) < _PAGE_LIMIT:
            break
    return _document(", ".join(r.name for r in runs), body)


def write_tables(path: Path, campaign: Campaign) -> None:
    """Writes a page of tables, as of a fleet.

    Args:
        path: file to write; its old content is lost.
        campaign: what it shows.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    from .plots import Figures  # Bokeh is slow to import

    figures = Figures()
    body = [element("h1", text(campaign.name)), element("p", text(campaign.verdict), "headline")]
    body += [paragraph(campaign.lead), paragraph(sections.BROWSER_NOTE, "too-old")]
    for i, campaign_table in enumerate(campaign.tables):
        rows = campaign_table.rows[: sections.MAX_ROWS]
        remaining = len(campaign_table.rows) - len(rows)
        css = "long" * (len(rows) > sections.VISIBLE_ROWS)
        body += [element("h2", text(campaign_table.title))]
        body += sections.places(
            [figures.of_bars(campaign_table.figure, f"bars-{i}")] if campaign_table.figure else []
        )
        body += [
            table(
                rows, campaign_table.text_columns, campaign_table.marks, css, campaign_table.links
            )
        ]
        body += [paragraph(f"And {remaining} more.", "note")] * (remaining > 0)
        body += [paragraph(campaign_table.note, "note")] * bool(campaign_table.note)
    body += _explained(campaign.codes)
    body += [element("h2", "How this was made", id="about")]
    body += [table([{"Fact": k, "Value": v} for k, v in campaign.about.items()], text_columns=2)]
    body += _packed(figures)
    with verified(path) as file:
        file.write(_document(campaign.name, body).encode("utf-8"))


def _explained(codes: Sequence[str]) -> Iterator[str]:
    """What the catalogue says of findings, each with its place."""
    if codes:
        yield element("h2", "Findings explained", id="findings")
    for code in codes:
        title, sections_of_text = words.explained(code)
        inside = "".join(
            element("dt", text(name)) + element("dd", prose(said))
            for name, said in sections_of_text
        )
        inside = element("h3", text(title)) + element("dl", inside)
        inside += paragraph(f"Code: {code}", "note")
        yield element("div", inside, "finding", id=f"finding-{text(code)}")


def _packed(figures: "Figures") -> list[str]:
    """What draws the figures."""
    return [packed("library", figures.library()), packed("figures", figures.as_json())]


def _document(name: str, body: list[str]) -> str:
    """A page of this body."""
    package = files(__package__)
    style, script = (package.joinpath(f"page.{kind}").read_text("utf-8") for kind in ("css", "js"))
    head = [
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta name="generator" content="adhesion {__version__}">',
        element("title", text(f"Adhesion report: {name}")),
        element("style", style),
    ]
    body = [*body, element("script", script)]
    fragments = ['<!DOCTYPE html>\n<html lang="en">\n<head>', *head, "</head>\n<body>", *body]
    return "\n".join([*fragments, "</body>\n</html>\n"])


def _single(run: ReportRun, figures: "Figures") -> Iterator[str]:
    plots = figures.of_run(run)
    yield from _first_screen(run, plots.overview)
    for axle in run.axles:
        yield from _axle(axle, plots.axles[axle.number])
    if plots.step:
        yield paragraph(
            f"The figures show the lowest and the highest values of parts of the log, about "
            f"{plots.step:.2g} s apart in brake applications. The result file has every sample.",
            "note",
        )
    yield from _budgets(run)
    yield from _findings(run)
    yield from _about(run)


def _first_screen(run: ReportRun, overview: Sequence[str]) -> Iterator[str]:
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
    is_long = sum(len(axle.applications) for axle in run.axles) > sections.VISIBLE_ROWS
    yield from [picture, *rows] if is_long else [*rows, picture]
    yield sections.notes([run])
    yield paragraph(sections.BROWSER_NOTE, "too-old")
    links = [(f"#axle-{a.number}", f"Axle {a.number}") for a in run.axles]
    links += [("#budget", "Uncertainty"), ("#findings", "Findings"), ("#about", "How it was made")]
    yield element("nav", " ".join(element("a", text(name), href=anchor) for anchor, name in links))


# ---- behind it


def _axle(axle: ReportAxle, places: Sequence[str]) -> Iterator[str]:
    yield element("h2", f"Axle {axle.number}", "page", id=f"axle-{axle.number}")
    yield from sections.places(places)
    if scores := words.score_rows(axle):
        heading = element("h3", f"Estimators against the {text(axle.against)}")
        yield element("div", heading + table(scores) + paragraph(_OF_SCORES, "note"), "whole")


def _budgets(run: ReportRun) -> Iterator[str]:
    yield element("h2", "Uncertainty of the mean force", id="budget")
    with_budget = [
        (axle, application)
        for axle in run.axles
        for application in axle.applications
        if application.budget
    ]
    if not with_budget:
        yield paragraph("No brake application has a force.")
        return
    yield paragraph(_OF_BUDGETS, "note")
    if len(with_budget) > _BUDGETS:
        yield paragraph(
            "Of each axle the brake application with the largest uncertainty. `adhesion analyze "
            "LOG --budget` shows all.",
            "note",
        )
        widest = {
            a.number: (a, o)
            for a, o in sorted(
                with_budget, key=lambda pair: pair[1].force_n.mean_u95 if pair[1].force_n else 0.0
            )
        }
        with_budget = [widest[number] for number in sorted(widest)]
    for axle, application in with_budget:
        time_span = words.span(application.start_s, application.end_s)
        heading = element("h3", f"Axle {axle.number}, brake application at {time_span} s")
        rows = table(words.budget_rows(application), text_columns=2)
        yield element(
            "div", heading + rows + paragraph(words.combined(application), "note"), "whole"
        )


def _findings(run: ReportRun) -> Iterator[str]:
    yield element("h2", "Findings", id="findings")
    groups = words.finding_groups(run.findings)
    if not groups:
        yield paragraph("None: the checks found nothing in this log.")
    for group in groups:
        heading = element("h3", f"{text(group.severity.capitalize())}: {text(group.title)}")
        rows = [
            {"Channel": channel, "Time": time_text, "What": message}
            for channel, time_text, message in group.lines[:_LINES]
        ]
        remaining = len(group.lines) - len(rows)
        remainder_note = (
            paragraph(f"And {remaining} more of this kind.", "note") if remaining else ""
        )
        fragments = "".join(
            element("dt", text(name)) + element("dd", prose(said)) for name, said in group.sections
        )
        code = paragraph(f"Code: {group.code}", "note")
        inside = [
            heading,
            table(rows, text_columns=3),
            remainder_note,
            element("dl", fragments),
            code,
        ]
        yield element(
            "div", "".join(inside), f"finding {text(group.severity)}", id=f"finding-{group.code}"
        )


def _about(run: ReportRun) -> Iterator[str]:
    yield element("h2", "How this was made", id="about")
    provenance = run.provenance
    facts = {
        "Log": run.name,
        "Format": run.log.format,
        "Rows": f"{run.log.rows_used} of {run.log.rows_read} used",
        "SHA-256 of the log": run.log.sha256,
        "Result file": run.file,
        "Analysed by": f"adhesion {provenance.get('version', 'unknown')}",
        "Reference": words.listed(
            sorted({a.summary.reference.method for a in run.axles}) or ["none"]
        ),
    }
    yield table([{"Fact": k, "Value": str(v)} for k, v in facts.items()], text_columns=2)
    yield element("h3", "Channels")
    yield table(
        [
            {
                "Channel": f"{c.name} {c.field}".strip(),
                "Meaning": str(c.meaning or ""),
                "Axle": str(c.axle or "all"),
                "Unit": str(c.unit),
                "Reason": str(c.reason),
            }
            for c in run.channels
        ],
        text_columns=5,
    )
    yield element("h3", "Vehicle")
    yield table(_vehicle(run), text_columns=1)
    settings = [{"Setting": k, "Value": v} for k, v in sorted(run.settings.items())]
    yield element("details", element("summary", "All settings") + table(settings, text_columns=2))
    yield element("h3", "Sources of the methods")
    sources = [element("li", text(line)) for line in provenance.get("sources", "").splitlines()]
    yield element("ul", "".join(sources))


def _vehicle(run: ReportRun) -> list[dict[str, str]]:
    """The vehicle's parameters with their standard uncertainties."""
    values_by_name: dict[str, dict[str, str]] = {}
    for key, value in sorted(run.settings.items()):
        section, _, name = key.partition(".")
        if section != "vehicle":
            continue
        if name.startswith("correlation"):
            values_by_name[name] = {"value": value}
        elif name == "wheel_radius":
            for i, entry in enumerate(json.loads(value), 1):
                values_by_name[f"wheel_radius, axle {i}"] = {k: f"{v:g}" for k, v in entry.items()}
        else:
            parameter, _, component = name.rpartition(".")
            values_by_name.setdefault(parameter, {})[component] = f"{json.loads(value):g}"
    return [
        {
            "Parameter": name.replace("_", " "),
            "Value": components.get("value", words.DASH),
            "Standard uncertainty": components.get("tolerance", words.DASH),
            "Unit": _unit(name),
        }
        for name, components in values_by_name.items()
    ]


def _unit(name: str) -> str:
    from ...core.model import Vehicle, quantities

    quantity = quantities(Vehicle).get(name.partition(",")[0])
    return quantity.unit if quantity else words.DASH
