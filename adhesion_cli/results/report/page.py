"""The page: first the verdict, then every axle, the budget, the findings, and how it was made.

The templates beside this file say what stands where. Whatever comes from a log is text there and
never markup.
"""

import json
import re
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from zlib import compress

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ... import __version__
from ...core.model import Vehicle, quantities
from ...core.text import enumerated, printable, utf8
from .. import application_tables, carried_vehicle, result_rows, stop_rows, vehicle_text
from ..result_rows import channel_row
from ..text_tables import DASH
from ..train_stops import MANY_AXLES
from . import comparison, words
from .campaign import Campaign
from .plots import MOST_VALUES, Figures
from .protocol import Protocol, headline, parts
from .run import ReportRun

_PAGE_LIMIT = 2_900_000  # letters of a page: more numbers are not drawn
_TRIALS = 6


def page(runs: Sequence[ReportRun]) -> str:
    """The whole page; the same runs give the same text."""
    write = _run if len(runs) == 1 else _comparison
    text = ""
    for trial in range(_TRIALS):  # one is enough for ordinary logs
        text = write(runs, Figures(int(MOST_VALUES * 0.6**trial)))
        if len(text) < _PAGE_LIMIT:
            break
    return text


def campaign_page(campaign: Campaign) -> str:
    """A page of tables, as of a fleet."""
    figures = Figures()
    places = [
        [figures.of_bars(table.figure, f"bars-{i}")] if table.figure else []
        for i, table in enumerate(campaign.tables)
    ]
    about = _pairs(campaign.about.items(), "Fact")
    context = {"campaign": campaign, "places": places, "about": about}
    return _page("campaign.html", campaign.name, figures, context)


def protocol_page(protocol: Protocol) -> str:
    """The protocol of a brake test."""
    figures = Figures()
    context = {
        "protocol": protocol,
        "findings": words.finding_groups_of_logs(protocol.findings),
        "headline": headline,
        "parts": parts(protocol),
        "tables": stop_rows.series_tables(protocol.series, protocol.braked_weight, budget=True),
        "places": figures.of_stops(protocol.series.stops),
        "about": _pairs(protocol.about.items(), "Fact"),
    }
    return _page("protocol.html", protocol.title, figures, context)


def _run(runs: Sequence[ReportRun], figures: Figures) -> str:
    (run,) = runs
    context = {
        "run": run,
        "plots": figures.of_run(run),
        "about": _about(run),
        "vehicle_lines": [
            vehicle_text.describe_vehicle(run.summary.vehicle, [a.summary for a in run.axles]),
            vehicle_text.describe_motors([run.summary]),
        ],
        "stops": application_tables.stop_table([run.summary], all_rows=True),
        "channels": [channel_row(c) | {"reason": c.reason} for c in run.summary.channels],
        "vehicle": _vehicle(run.settings),
        "settings": _pairs(sorted(run.settings.items()), "Setting"),
    }
    return _page("run.html", run.name, figures, context)


def _comparison(runs: Sequence[ReportRun], figures: Figures) -> str:
    content = comparison.content(runs)
    plots = figures.of_runs(runs, adhesion=not content["commands"])
    context = {**content, "runs": runs, "plots": plots}
    return _page("comparison.html", ", ".join(run.name for run in runs), figures, context)


def _page(template: str, title: str, figures: Figures, context: Mapping[str, object]) -> str:
    script = {"library": _packed(figures.library()), "drawn": _packed(figures.as_json())}
    return _templates().get_template(template).render(context, title=title, **script)


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader(__package__, ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=_text,
    )
    environment.globals |= {
        "version": __version__,
        "MANY_AXLES": MANY_AXLES,
        "enumerated": enumerated,
        "result_rows": result_rows,
        "words": words,
    }
    environment.filters |= {"prose": _prose, "budget_row": result_rows.budget_row}
    return environment


def _text(value: object) -> str:
    """A text of a log, a file's name or a number, on one line."""
    return value if isinstance(value, Markup) else printable(utf8(str(value)))


def _prose(content: str) -> Markup:
    """Plain text whose parts between backticks are code; a number stays with its ± and %."""
    text = re.sub(
        r"(?<=\w) (?=± )|(?<=±) (?=\d)|(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", _text(content)
    )
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _packed(content: str) -> str:
    """Content that the page's script unpacks; base64 cannot end the element."""
    return b64encode(compress(content.encode("utf-8"), 9)).decode("ascii")


# ---- how it was made


def _pairs(items: Iterable[tuple[str, str]], head: str) -> list[dict[str, str]]:
    return [{head: name, "Value": value} for name, value in items]


def _about(run: ReportRun) -> list[dict[str, str]]:
    methods = sorted({a.summary.reference.method for a in run.axles}) or ["none"]
    facts = {
        "Log": run.name,
        "Format": run.summary.log.format,
        "Rows": f"{run.summary.log.rows_used} of {run.summary.log.rows_read} used",
        "SHA-256 of the log": run.summary.log.sha256,
        "Result file": run.file,
        "Analysed by": f"adhesion {run.provenance.get('version', 'unknown')}",
        "Reference": enumerated(methods),
    }
    return _pairs(facts.items(), "Fact")


def _vehicle(settings: Mapping[str, str]) -> list[dict[str, str]]:
    """The vehicle's parameters with their standard uncertainties."""
    parameters: dict[str, dict[str, str]] = {}
    for key, text in sorted(settings.items()):
        if not carried_vehicle.is_of_vehicle(key):
            continue
        name, values = key.removeprefix("vehicle."), json.loads(text)
        parameter, _, component = name.rpartition(".")
        if isinstance(values, list) and all(isinstance(x, dict) for x in values):
            several = settings.get(f"{key.rpartition('.')[0]}.axles")
            numbers = json.loads(several) if several else range(1, len(values) + 1)
            for number, own in zip(numbers, values, strict=True):
                parameters[f"{name}, axle {number}"] = {k: f"{v:g}" for k, v in own.items()}
        elif isinstance(values, list) or ".correlation" in f".{name}":  # or a table of friction
            axles = ", ".join(map(str, values)) if component == "axles" else text
            parameters[name] = {"value": axles}
        else:
            parameters.setdefault(parameter, {})[component] = f"{values:g}"
    units = {name: quantity.unit for name, quantity in quantities(Vehicle).items()}
    return [
        {
            "Parameter": carried_vehicle.parameter_title(name),
            "Value": components.get("value", DASH),
            "Standard uncertainty": components.get("tolerance", DASH),
            "Unit": units.get(name.partition(",")[0].rpartition(".")[2], DASH),
        }
        for name, components in parameters.items()
    ]
