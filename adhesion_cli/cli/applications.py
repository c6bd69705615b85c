"""The uncertainty budgets of `analyze` on the screen."""

from collections.abc import Sequence

from ..core.summary import AxleSummary
from ..results.result_rows import budget_row, combined
from . import terminal

_OF_BUDGETS = (
    "Uncertainty budget of the mean force by JCGM 100 (GUM). Type A: from the samples; type B: "
    "tolerances of the vehicle, stated or left by the log. u: standard uncertainty, in the unit "
    "of the value; noise in N. u(F): what it adds to the force; share: of the variance."
)


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
