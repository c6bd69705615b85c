"""The answer of `analyze` on the screen: brake applications, slides, estimators."""

from collections.abc import Sequence
from typing import Any

from ..core.text import by_uncertainty
from . import terminal
from .terminal import at_least, number

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
    parts = [terminal.records([_row(*of) for of in every]), terminal.folded(_NOTE), ""]
    if slid := [_slides(axle, one) for axle, one in every if one["slides"]]:
        least = any(one["at_least"] for _, one in every if one["slides"])
        note = f"{_OF_SLIDES} {_AT_LEAST}" if least else _OF_SLIDES
        return "\n".join([*parts, terminal.records(slid), terminal.folded(note)])
    return "\n".join([*parts, "No slides."])


def budgets(axles: Sequence[dict[str, Any]]) -> str:
    """The uncertainty budget of each brake application's mean force; keys as in the JSON."""
    parts = []
    for axle in axles:
        for one in axle["applications"]:
            if one["budget"]:
                parts += [f"Axle {axle['axle']}, brake application at {one['start_s']:.1f} s:"]
                parts += [terminal.records([_budget_row(row) for row in one["budget"]], left=3)]
                parts += [_combined(one), ""]
    return "\n".join([*parts, terminal.folded(_OF_BUDGETS), ""]) if parts else ""


def _budget_row(row: dict[str, Any]) -> dict[str, str]:
    unit = "" if row["unit"] == "-" else f" {row['unit']}"
    return {
        "quantity": row["quantity"], "type": row["type"],
        "value": "-" if row["value"] is None else f"{row['value']:.5g}{unit}",
        "u": f"{row['u']:.3g}", "∂F/∂q": f"{row['sensitivity']:.3g}",
        "u(F) [N]": number(row["contribution_n"], 1), "share [%]": number(100.0 * row["share"], 1),
    }  # fmt: skip


def _combined(one: dict[str, Any]) -> str:
    """The last line of a budget: combined and expanded uncertainty."""
    of, force = one["coverage"], one["force_n"]
    freedom = of["degrees_of_freedom"]
    many = "many" if freedom is None or freedom > 999.0 else f"{freedom:.0f}"
    return terminal.folded(
        f"F = {force['mean']:.0f} ± {force['mean_u95']:.0f} N (95 %); combined standard "
        f"uncertainty {of['u_n']:.1f} N, coverage factor {of['k']:.2f}, effective degrees of "
        f"freedom: {many}."
    )


def _row(axle: str, one: dict[str, Any]) -> dict[str, str]:
    mu, force = one["coefficient"] or {}, one["force_n"] or {}
    speeds = [number(one[key], 1) for key in ("from_mps", "to_mps")]
    return {
        "axle": axle, "at [s]": number(one["start_s"], 1),
        "for [s]": number(one["end_s"] - one["start_s"], 1), "v [m/s]": "–".join(speeds),
        "µ mean": _with_u95(mu, "mean", 1.0, 3), "µ max": _with_u95(mu, "max", 1.0, 3),
        "F [kN]": _with_u95(force, "mean", 1e-3), "Fmax [kN]": _with_u95(force, "max", 1e-3),
    }  # fmt: skip


def _with_u95(of: dict[str, float], key: str, factor: float, digits: int | None = None) -> str:
    """A value with its uncertainty, to at most these decimals; without them to three digits."""
    if not of:
        return "-"
    value, u95 = factor * of[key], factor * of[f"{key}_u95"]
    if digits is None:
        digits = 2 if abs(value) < 10.0 else 1
    return "±".join(by_uncertainty(value, u95, digits))


def _slides(axle: str, one: dict[str, Any]) -> dict[str, str]:
    energy, used, bound = one["slide_energy_j"], one["utilisation"], one["at_least"]
    highest = min(100.0 * one["max_slip"], 100.0)
    return {
        "axle": axle, "at [s]": number(one["start_s"], 1), "slides": str(one["slides"]),
        "for [s]": at_least(one["slide_s"], 1, bound),
        "distance [m]": at_least(one["slide_distance_m"], 0, bound),
        "max slip [%]": number(highest, 0) if highest > 99.5 else at_least(highest, 1, bound),
        "energy [kJ]": at_least(energy and 1e-3 * energy, 1, bound),
        "used [%]": number(used and 100.0 * used, 0),
    }  # fmt: skip
