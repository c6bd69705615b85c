"""Several runs on one page: overlaid, and what differs from the first one."""

from collections.abc import Iterator, Sequence

from ...core.model import Z95
from ...core.summary import BrakeApplication
from ...core.text import by_uncertainty
from ..text_tables import DASH, number, numbered
from . import differences
from .differences import RunDifference
from .run import ReportRun

_SETTINGS = 8  # that differ and are named
_QUANTITIES = {  # heading, factor and decimals at most
    "coefficient": ("Adhesion coefficient, mean", 1.0, 5),
    "force": ("Force, mean [kN]", 1e-3, 4),
    "utilisation": ("Used of the available adhesion [%]", 100.0, 2),
}


def content(runs: Sequence[ReportRun]) -> dict[str, object]:
    """What the page has besides the runs and their figures, by its name in the template."""
    all_differences = differences.compare(runs)
    rows = _rows(all_differences)
    findings = differences.friction_findings(runs)
    return {
        "headline": " ".join([f.message for f in findings]) or _headline(runs, all_differences),
        "commands": findings[0].names["commands"] if findings else "",
        "cautions": list(cautions(runs)),
        "run_rows": [_run(i, run, not findings) for i, run in enumerate(runs, 1)],
        "rows": rows,
        "same_vehicle": all(differences.same_vehicle(runs[0], run) for run in runs[1:]),
        "has_brackets": any("(" in cell for row in rows for cell in row.values()),
        "has_utilisation": any(d.quantity == "utilisation" for d in all_differences),
        "unpaired": differences.unpaired(runs),
    }


def cautions(runs: Sequence[ReportRun]) -> Iterator[str]:
    """That a difference comes from the settings and not from the train, where it may."""
    places_by_text: dict[str, list[int]] = {}
    for place, run in enumerate(runs[1:], 2):
        names = differences.settings_apart(runs[0], run)
        suffix = f" and {len(names) - _SETTINGS} more" * (len(names) > _SETTINGS)
        names_text = f": {', '.join(names[:_SETTINGS])}{suffix}" * bool(names)
        if differences.same_log(runs[0], run):
            cause = f"Every difference is by the settings{names_text}."
            cause = cause if names else "The settings are equal, too."
            text = f"the same log as run 1 (equal SHA-256). {cause}"
        elif differences.same_statement(runs[0], run):
            forces = (x.summary.vehicle.force_per_bar_n for x in (runs[0], run))
            values = " and ".join(number(x and x / 1e3, 3) for x in forces)
            text = (
                "the same vehicle is stated, and each log shows its own brake force within the "
                f"tolerances: {values} kN per bar and axle."
            )
        elif not differences.same_vehicle(runs[0], run):
            text = f"another vehicle than run 1. Differences may be by the settings{names_text}."
        else:
            continue
        places_by_text.setdefault(text, []).append(place)
    for text, places in places_by_text.items():
        yield f"{'Run' if len(places) == 1 else 'Runs'} {numbered(places)}: {text}"


def _headline(runs: Sequence[ReportRun], all_differences: Sequence[RunDifference]) -> str:
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
    count = len(coefficients)
    braked = f"{count} compared brake application{'s' * (count != 1)}"
    same_logs = all(differences.same_log(runs[0], run) for run in runs[1:])
    log = f"One log, {len(runs)} evaluations. " * same_logs
    return f"{log}Adhesion used, against run 1: {', '.join(phrases)} of {braked}."


def _run(place: int, run: ReportRun, comparable: bool) -> dict[str, str]:
    """One row of the table of runs; µ only where those of the runs are comparable."""
    applications = [a for axle in run.axles for a in axle.applications]
    means = [a.coefficient.mean for a in applications if a.coefficient and comparable]
    slip = max((a.max_slip or 0.0 for a in applications), default=0.0)
    slides_known = any(axle.has_values("slip") for axle in run.axles)
    mean_range = [number(f(means), 3) for f in (min, max)] if means else [DASH]
    start, brake = run.summary.log.start, run.summary.brake
    per_bar = brake and brake.deceleration_per_bar
    u95 = brake and per_bar and Z95 * brake.sigma * per_bar
    return {
        "Run": str(place),
        "Log": run.name,
        "Begun": start[:16].replace("T", " ") if start else DASH,
        "Brake applications": str(max((len(a.applications) for a in run.axles), default=0)),
        "Braked for [s]": number(sum(a.end_s - a.start_s for a in _first_axle(run)), 1),
        "Speed lost over time [m/s²]": number(_mean_deceleration(run), 3),
        "per bar": " ± ".join(by_uncertainty(per_bar, u95, 3)) if per_bar and u95 else DASH,
        "µ mean": "–".join(dict.fromkeys(mean_range)),
        "Slides": str(sum(a.slides for a in applications)) if slides_known else "?",
        "Sliding for [s]": number(sum(a.slide_s for a in applications), 1),
        "Most slip [%]": number(100.0 * min(slip, 1.0), 1) if slip else DASH,
        "SHA-256": run.summary.log.sha256[:8],
    }


def _first_axle(run: ReportRun) -> Sequence[BrakeApplication]:
    return next((axle.applications for axle in run.axles if axle.applications), ())


def _mean_deceleration(run: ReportRun) -> float | None:
    """Speed lost over time in the brake applications [m/s²]; None where a speed is not known."""
    lost = [
        (a.from_mps - a.to_mps, a.end_s - a.start_s)
        for a in _first_axle(run)
        if a.from_mps is not None and a.to_mps is not None
    ]
    return sum(speed for speed, _ in lost) / sum(time for _, time in lost) if lost else None


def _rows(all_differences: Sequence[RunDifference]) -> list[dict[str, str]]:
    rows: dict[tuple[int, int, int], dict[str, str]] = {}
    heads = [x[0] for q, x in _QUANTITIES.items() if any(d.quantity == q for d in all_differences)]
    for d in all_differences:
        keys = {"Run": d.run, "Axle": d.axle, "Brake application": d.application}
        empty = {name: str(place) for name, place in keys.items()} | dict.fromkeys(heads, DASH)
        row = rows.setdefault((d.run, d.axle, d.application), empty)
        head, factor, digits = _QUANTITIES[d.quantity]
        value, u95 = by_uncertainty(factor * d.difference, factor * d.u95, digits)
        _, u95_text = by_uncertainty(factor * d.difference, factor * d.u95_apart, digits)
        sign = "+" if float(value) > 0.0 else ""
        u95_apart = f" ({u95_text})" if u95_text != u95 else ""
        row[head] = f"{'≈ ' * d.alike}{sign}{value} ± {u95}{u95_apart}"
    return list(rows.values())
