"""The answer of `analyze` on the screen: brake applications, slides, estimators."""

from collections.abc import Sequence
from typing import Any

from ..rail.events import HIDDEN_TIME
from ..results.result_rows import row, slid_row
from . import terminal
from .terminal import number

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
    "tolerances of the vehicle as stated, or their defaults. u: standard uncertainty, in the unit "
    "of the value; noise in N. u(F): what it adds to the force; share: of the variance."
)
_AT_LEAST = "≥: the true value is at least this."


def tables(axles: Sequence[dict[str, Any]]) -> str:
    """Brake applications of every axle, then those with slides; keys as in the JSON."""
    every = [(str(axle["axle"]), one) for axle in axles for one in axle["applications"]]
    if not every:
        return "No brake application."
    parts = [terminal.records([row(*of) for of in every]), terminal.folded(_NOTE), ""]
    if slid := [slid_row(axle, one) for axle, one in every if one["slides"]]:
        least = any(one["at_least"] for _, one in every if one["slides"])
        note = f"{_OF_SLIDES} {_AT_LEAST}" if least else _OF_SLIDES
        return "\n".join([*parts, terminal.records(slid), terminal.folded(note)])
    unseen = max(one.get("slip_unknown_s", 0.0) for _, one in every)
    if unseen < HIDDEN_TIME:
        return "\n".join([*parts, "No slides."])
    where = f"without a train speed for up to {unseen:.1f} s of a brake application"
    return "\n".join([*parts, f"No slide seen, but slides may be hidden: {where}."])


def budgets(axles: Sequence[dict[str, Any]]) -> str:
    """The uncertainty budget of each brake application's mean force; keys as in the JSON."""
    from ..results.report.words import combined

    parts = []
    for axle in axles:
        for one in axle["applications"]:
            if one["budget"]:
                parts += [f"Axle {axle['axle']}, brake application at {one['start_s']:.1f} s:"]
                parts += [terminal.records([_budget_row(row) for row in one["budget"]], left=3)]
                parts += [terminal.folded(combined(one)), ""]
    return "\n".join([*parts, terminal.folded(_OF_BUDGETS), ""]) if parts else ""


def _budget_row(row: dict[str, Any]) -> dict[str, str]:
    unit = "" if row["unit"] == "-" else f" {row['unit']}"
    return {
        "quantity": row["quantity"], "type": row["type"],
        "value": "-" if row["value"] is None else f"{row['value']:.5g}{unit}",
        "u": f"{row['u']:.3g}", "∂F/∂q": f"{row['sensitivity']:.3g}",
        "u(F) [N]": number(row["contribution_n"], 1), "share [%]": number(100.0 * row["share"], 1),
    }  # fmt: skip
