"""Several runs on one page: overlaid, and what differs from the first one."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ...core.text import by_uncertainty
from . import differences, sections, words
from .differences import Difference
from .markup import element, paragraph, table, text
from .run import Run

if TYPE_CHECKING:
    from .plots import Figures

_OF_MARK = "≈: not distinguishable, the uncertainty (95 %) explains the difference."
_SHARED = (
    "The runs state the same vehicle. Errors of its parameters are then the same in both runs, and "
    "most of each cancels in a difference. This holds for one train whose brake friction has not "
    "changed."
)
_APART = (
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
_SHOWN = {  # heading, factor and decimals at most
    "coefficient": ("Adhesion coefficient, mean", 1.0, 5),
    "force": ("Force, mean [kN]", 1e-3, 4),
    "utilisation": ("Used of the available adhesion [%]", 100.0, 2),
}


def body(runs: Sequence[Run], figures: "Figures") -> Iterator[str]:
    """The page's content: differences first, then the overlays, then every run."""
    found = differences.every(runs)
    yield element("h1", f"Comparison of {len(runs)} runs")
    yield element("p", text(_headline(runs, found)), "headline")
    yield from _apart(runs)
    yield table([_run(i, run) for i, run in enumerate(runs, 1)], left=2)
    yield element("h2", "Differences from run 1")
    rows = _rows(found)
    yield table(rows[: sections.MOST], left=1, css="long" * (len(rows) > sections.MANY))
    if len(rows) > sections.MOST:
        more = f"{sections.MOST} of {len(rows)} rows. `adhesion report --json` writes all."
        yield paragraph(more, "note")
    shared = all(differences.same_vehicle(runs[0], run) for run in runs[1:])
    said = [_OF_MARK, _SHARED if shared else _APART]
    said += [_BRACKETS] * any("(" in cell for row in rows for cell in row.values())
    said += [_OF_UTILISATION] * any(d.quantity == "utilisation" for d in found)
    said += [_UNPAIRED] * differences.unpaired(runs)
    yield paragraph(" ".join(said), "note")
    for i, run in enumerate(runs, 1):
        yield from sections.care(run, f"Run {i}: read the figures with care.")
    for axle, places in figures.of_runs(runs).items():
        inside = element("h2", f"Axle {axle}") + "".join(sections.places(places))
        yield element("div", inside, "whole")
    yield paragraph("Grey: speed of the train, measured or estimated.", "note")
    yield paragraph(sections.TOO_OLD, "too-old")
    for i, run in enumerate(runs, 1):
        yield element("h2", text(f"Run {i}: {run.name}"))
        yield from sections.verdict(run)
        yield sections.applications(run)
    yield sections.notes(runs)
    yield paragraph("`adhesion report RESULT` shows all of one run.", "note")


def _apart(runs: Sequence[Run]) -> Iterator[str]:
    """That a difference comes from the settings and not from the train, where it may."""
    items = []
    for i, run in enumerate(runs[1:], 2):
        names = differences.settings_apart(runs[0], run)
        more = f" and {len(names) - _SETTINGS} more" * (len(names) > _SETTINGS)
        which = f": {', '.join(names[:_SETTINGS])}{more}" if names else ""
        if differences.same_log(runs[0], run):
            by = "Every difference is by the settings" if names else "The settings are equal, too"
            items.append(f"Runs 1 and {i} are of the same log (equal SHA-256). {by}{which}.")
        elif not differences.same_vehicle(runs[0], run):
            items.append(
                f"Runs 1 and {i} state different vehicles. Differences may be by the "
                f"settings{which}."
            )
    if items:
        head = element("b", "Compare with care:")
        listed = "".join(element("li", text(one)) for one in items)
        yield element("div", f"{head}<ul>{listed}</ul>", "care")


def _headline(runs: Sequence[Run], found: Sequence[Difference]) -> str:
    """How many mean adhesion coefficients differ clearly, and which way."""
    of = [d for d in found if d.quantity == "coefficient"]
    if not of:
        return "The runs have no brake application in common."
    counts = {
        "higher": sum(d.difference > 0.0 for d in of if not d.alike),
        "lower": sum(d.difference < 0.0 for d in of if not d.alike),
        "not distinguishable": sum(d.alike for d in of),
    }
    parts = [f"{name} in {count}" for name, count in counts.items() if count]
    braked = words.plural(len(of), "compared brake application")
    one = all(differences.same_log(runs[0], run) for run in runs[1:])
    log = f"One log, {len(runs)} evaluations. " * one
    return f"{log}Adhesion used, against run 1: {', '.join(parts)} of {braked}."


def _run(place: int, run: Run) -> dict[str, str]:
    """One row of the table of runs."""
    every = [(axle, one) for axle in run.axles for one in axle.applications]
    means = [one.coefficient.mean for _, one in every if one.coefficient]
    slip = max((one.max_slip or 0.0 for _, one in every), default=0.0)
    known = any(words.slides_known(axle) for axle in run.axles)
    ends = [words.number(f(means), 3) for f in (min, max)] if means else [words.NONE]
    start = run.log.start
    return {
        "Run": str(place), "Log": run.name,
        "Begun": start[:16].replace("T", " ") if start else words.NONE,
        "Brake applications": str(max((len(a.applications) for a in run.axles), default=0)),
        "µ mean": "–".join(dict.fromkeys(ends)),
        "Slides": str(sum(one.slides for _, one in every)) if known else "?",
        "Sliding for [s]": words.number(sum(one.slide_s for _, one in every), 1),
        "Most slip [%]": words.percent(min(slip, 1.0), 1) if slip else words.NONE,
        "SHA-256": run.log.sha256[:8],
    }  # fmt: skip


def _rows(found: Sequence[Difference]) -> list[dict[str, str]]:
    """One row per run, axle and brake application."""
    rows: dict[tuple[int, int, int], dict[str, str]] = {}
    shown = [q for q in _SHOWN if any(d.quantity == q for d in found)]
    for d in found:
        row = rows.setdefault((d.run, d.axle, d.application), {
            "Run": str(d.run), "Axle": str(d.axle), "Brake application": str(d.application),
            **{_SHOWN[q][0]: words.NONE for q in shown},
        })  # fmt: skip
        head, factor, digits = _SHOWN[d.quantity]
        value, u95 = by_uncertainty(factor * d.difference, factor * d.u95, digits)
        _, apart = by_uncertainty(factor * d.difference, factor * d.u95_apart, digits)
        sign = "+" if float(value) > 0.0 else ""
        wide = f" ({apart})" if apart != u95 else ""
        row[head] = f"{'≈ ' * d.alike}{sign}{value} ± {u95}{wide}"
    return list(rows.values())
