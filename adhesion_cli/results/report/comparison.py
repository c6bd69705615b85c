"""Several runs on one page: overlaid, and what differs from the first one."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ...core.text import by_uncertainty
from . import differences, sections, words
from .differences import Difference
from .markup import element, paragraph, table, text
from .run import ReportRun

if TYPE_CHECKING:
    from .plots import Figures

_OF_MARK = "≈: not distinguishable, the uncertainty (95 %) explains the difference."
_SHARED = (
    "The runs state the same vehicle. Errors of its parameters are then the same in both runs, and "
    "most of each cancels in a difference. This holds for one train whose brake friction has not "
    "changed."
)
_DIFFERENCE_NOTE = (
    "The runs state different vehicles. Only the parameters that they state alike cancel in a "
    "difference."
)
_BRACKETS = "In brackets: the uncertainty if nothing cancels, as for two trains."
_SETTINGS = 6  # that differ and are named
_OF_UTILISATION = "Uncertainties of the utilisation are those of the fits of both rails."
_UNPAIRED = (
    "Runs have different axles or numbers of brake applications. Those of equal number and place "
    "are compared, and the others are left out."
)
_QUANTITIES = {  # heading, factor and decimals at most
    "coefficient": ("Adhesion coefficient, mean", 1.0, 5),
    "force": ("Force, mean [kN]", 1e-3, 4),
    "utilisation": ("Used of the available adhesion [%]", 100.0, 2),
}


def body(runs: Sequence[ReportRun], figures: "Figures") -> Iterator[str]:
    """The page's content: differences first, then the overlays, then every run."""
    all_differences = differences.compare(runs)
    yield element("h1", f"Comparison of {len(runs)} runs")
    yield element("p", text(_headline(runs, all_differences)), "headline")
    yield from _distinctions(runs)
    yield table([_run(i, run) for i, run in enumerate(runs, 1)], text_columns=2)
    yield element("h2", "Differences from run 1")
    rows = _rows(all_differences)
    yield table(
        rows[: sections.MAX_ROWS], text_columns=1, css="long" * (len(rows) > sections.VISIBLE_ROWS)
    )
    if len(rows) > sections.MAX_ROWS:
        remainder = f"{sections.MAX_ROWS} of {len(rows)} rows. `adhesion report --json` writes all."
        yield paragraph(remainder, "note")
    shared = all(differences.same_vehicle(runs[0], run) for run in runs[1:])
    said = [_OF_MARK, _SHARED if shared else _DIFFERENCE_NOTE]
    said += [_BRACKETS] * any("(" in cell for row in rows for cell in row.values())
    said += [_OF_UTILISATION] * any(d.quantity == "utilisation" for d in all_differences)
    said += [_UNPAIRED] * differences.unpaired(runs)
    yield paragraph(" ".join(said), "note")
    for i, run in enumerate(runs, 1):
        yield from sections.care(run, f"Run {i}: read the figures with care.")
    for axle, places in figures.of_runs(runs).items():
        inside = element("h2", f"Axle {axle}") + "".join(sections.places(places))
        yield element("div", inside, "whole")
    yield paragraph("Grey: speed of the train, measured or estimated.", "note")
    yield paragraph(sections.BROWSER_NOTE, "too-old")
    for i, run in enumerate(runs, 1):
        yield element("h2", text(f"Run {i}: {run.name}"))
        yield from sections.verdict(run)
        yield sections.applications(run)
    yield sections.notes(runs)
    yield paragraph("`adhesion report RESULT` shows all of one run.", "note")


def _distinctions(runs: Sequence[ReportRun]) -> Iterator[str]:
    """That a difference comes from the settings and not from the train, where it may."""
    items = []
    for i, run in enumerate(runs[1:], 2):
        names = differences.settings_apart(runs[0], run)
        suffix = f" and {len(names) - _SETTINGS} more" * (len(names) > _SETTINGS)
        names_text = f": {', '.join(names[:_SETTINGS])}{suffix}" if names else ""
        if differences.same_log(runs[0], run):
            cause = (
                "Every difference is by the settings" if names else "The settings are equal, too"
            )
            items.append(
                f"Runs 1 and {i} are of the same log (equal SHA-256). {cause}{names_text}."
            )
        elif not differences.same_vehicle(runs[0], run):
            items.append(
                f"Runs 1 and {i} state different vehicles. Differences may be by the "
                f"settings{names_text}."
            )
    if items:
        head = element("b", "Compare with care:")
        listed = "".join(element("li", text(item)) for item in items)
        yield element("div", f"{head}<ul>{listed}</ul>", "care")


def _headline(runs: Sequence[ReportRun], all_differences: Sequence[Difference]) -> str:
    """How many mean adhesion coefficients differ clearly, and which way."""
    coefficients = [d for d in all_differences if d.quantity == "coefficient"]
    if not coefficients:
        return "The runs have no brake application in common."
    counts = {
        "higher": sum(d.difference > 0.0 for d in coefficients if not d.alike),
        "lower": sum(d.difference < 0.0 for d in coefficients if not d.alike),
        "not distinguishable": sum(d.alike for d in coefficients),
    }
    phrases = [f"{name} in {count}" for name, count in counts.items() if count]
    braked = words.plural(len(coefficients), "compared brake application")
    same_logs = all(differences.same_log(runs[0], run) for run in runs[1:])
    log = f"One log, {len(runs)} evaluations. " * same_logs
    return f"{log}Adhesion used, against run 1: {', '.join(phrases)} of {braked}."


def _run(place: int, run: ReportRun) -> dict[str, str]:
    """One row of the table of runs."""
    applications = [(axle, application) for axle in run.axles for application in axle.applications]
    means = [
        application.coefficient.mean for _, application in applications if application.coefficient
    ]
    slip = max((application.max_slip or 0.0 for _, application in applications), default=0.0)
    slides_known = any(words.slides_known(axle) for axle in run.axles)
    mean_range = [words.number(f(means), 3) for f in (min, max)] if means else [words.DASH]
    start = run.log.start
    return {
        "Run": str(place),
        "Log": run.name,
        "Begun": start[:16].replace("T", " ") if start else words.DASH,
        "Brake applications": str(max((len(a.applications) for a in run.axles), default=0)),
        "µ mean": "–".join(dict.fromkeys(mean_range)),
        "Slides": str(sum(application.slides for _, application in applications))
        if slides_known
        else "?",
        "Sliding for [s]": words.number(
            sum(application.slide_s for _, application in applications), 1
        ),
        "Most slip [%]": words.percent(min(slip, 1.0), 1) if slip else words.DASH,
        "SHA-256": run.log.sha256[:8],
    }


def _rows(all_differences: Sequence[Difference]) -> list[dict[str, str]]:
    """One row per run, axle and brake application."""
    rows: dict[tuple[int, int, int], dict[str, str]] = {}
    quantities = [q for q in _QUANTITIES if any(d.quantity == q for d in all_differences)]
    for d in all_differences:
        row = rows.setdefault(
            (d.run, d.axle, d.application),
            {
                "Run": str(d.run),
                "Axle": str(d.axle),
                "Brake application": str(d.application),
                **{_QUANTITIES[q][0]: words.DASH for q in quantities},
            },
        )
        head, factor, digits = _QUANTITIES[d.quantity]
        value, u95 = by_uncertainty(factor * d.difference, factor * d.u95, digits)
        _, u95_text = by_uncertainty(factor * d.difference, factor * d.u95_apart, digits)
        sign = "+" if float(value) > 0.0 else ""
        u95_apart = f" ({u95_text})" if u95_text != u95 else ""
        row[head] = f"{'≈ ' * d.alike}{sign}{value} ± {u95}{u95_apart}"
    return list(rows.values())
