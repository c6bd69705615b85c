"""The answer of `analyze` on the screen: brake applications, slides, estimators."""

from collections.abc import Sequence

from ..core.summary import AxleSummary
from ..rail.events import HIDDEN_TIME
from ..results.result_rows import budget_row, combined, row, slid_row
from . import terminal

_NOTE = (
    "One row per brake application; at: seconds after the start of the log. µ, F: adhesion "
    "coefficient and force, mean from build-up to release and highest, with expanded uncertainty "
    "(95\N{NO-BREAK SPACE}%)."
)
_OF_SLIDES = (
    "Slides of each brake application: number, time and distance together, largest slip, energy "
    "of friction between wheel and rail, and share of the available adhesion that was used "
    "(- where the slides are too short to show the available one)."
)
_OF_BUDGETS = (
    "Uncertainty budget of the mean force by JCGM 100 (GUM). Type A: from the samples; type B: "
    "tolerances of the vehicle, stated or left by the log. u: standard uncertainty, in the unit "
    "of the value; noise in N. u(F): what it adds to the force; share: of the variance."
)
_BOUND = "≥: the true value is at least this."


def tables(axles: Sequence[AxleSummary]) -> str:
    """Brake applications of every axle, then those with slides."""
    pairs = [(str(axle.axle), a) for axle in axles for a in axle.applications]
    if not pairs:
        return "No brake application."
    lines = [terminal.records([row(*pair) for pair in pairs]), terminal.folded(_NOTE), ""]
    if slid := [slid_row(*pair) for pair in pairs if pair[1].slides]:
        has_bounds = any(a.at_least for _, a in pairs if a.slides)
        note = f"{_OF_SLIDES} {_BOUND}" if has_bounds else _OF_SLIDES
        return "\n".join([*lines, terminal.records(slid), terminal.folded(note)])
    unknown = max(a.slip_unknown_s for _, a in pairs)
    if unknown < HIDDEN_TIME:
        return "\n".join([*lines, "No slides."])
    place = f"without a train speed for up to {unknown:.1f} s of a brake application"
    return "\n".join([*lines, f"No slide seen, but slides may be hidden: {place}."])


def budgets(axles: Sequence[AxleSummary]) -> str:
    """The uncertainty budget of each brake application's mean force."""
    lines = []
    for axle in axles:
        for a in axle.applications:
            if a.budget:
                lines += [f"Axle {axle.axle}, brake application at {a.start_s:.1f} s:"]
                lines += [terminal.records([budget_row(c) for c in a.budget], text_columns=3)]
                lines += [terminal.folded(combined(a)), ""]
    return "\n".join([*lines, terminal.folded(_OF_BUDGETS), ""]) if lines else ""
