"""Brake applications, scores and budgets as rows of text, for screen, page and recording."""

from collections.abc import Sequence

from ..core.model import Score
from ..core.summary import BrakeApplication, ChannelSummary, Contribution, SlideSummary
from ..rail.highest import is_known
from . import text_tables
from .text_tables import DASH, number, when_and_where, with_u95

_OF_SHARES = (
    " A share above 100 % is one of correlated quantities: their errors cancel in part, and others "
    "have a negative share."
)
OF_BUDGETS = (
    "Uncertainty budget of the mean force by JCGM 100 (GUM). Type A: from the samples; type B: "
    "tolerances of the vehicle, stated or left by the log. u: standard uncertainty, in the unit "
    "of the value; noise in N. u(F): what it adds to the force; share: of the variance."
)


def row(axle: str, a: BrakeApplication) -> dict[str, str]:
    """A brake application: when, how fast, adhesion coefficient and force."""
    mu, force = a.coefficient, a.force_n
    known = mu is None or is_known(mu.mean, mu.mean_u95)  # and so is the mean force
    return {
        "axle": axle,
        "at [s]": number(a.start_s, 1),
        **when_and_where(a.time),
        "for [s]": number(a.end_s - a.start_s, 1),
        "v [km/h]": "–".join(number(v and 3.6 * v, 1) for v in (a.from_mps, a.to_mps)),
        "µ mean": mean_coefficient(a),
        "µ max": with_u95(mu and mu[2:], 1.0, 3),
        "F [kN]": with_u95(force, 1e-3, 2) if known or not force else text_tables.NOT_KNOWN,
        "Fmax [kN]": with_u95(force and force[2:], 1e-3, 2),
        **({text_tables.ED: with_u95(a.ed_share, 100.0, 0)} if a.ed_share else {}),
    }


def mean_coefficient(a: BrakeApplication) -> str:
    """The mean µ of a brake application."""
    return text_tables.coefficient_text(a.coefficient, a.other_brake)


def slid_row(axle: str, a: BrakeApplication) -> dict[str, str]:
    """The slides of a brake application, together; their time is the begin of the first.

    Where they are lower bounds, the first may begin earlier.
    """
    bound = a.at_least
    km = a.slide_position_km if a.position_from == "position" else None
    first: SlideSummary | BrakeApplication = a.slide_list[0] if a.slide_list else a
    return {
        "axle": axle,
        "at [s]": "≤ " * bound + number(first.start_s, 1),
        **when_and_where(first.time, km),
        "slides": str(a.slides),
        "for [s]": text_tables.bounded_number(a.slide_s, 1, bound),
        "distance [m]": text_tables.bounded_number(a.slide_distance_m, 0, bound),
        "max slip [%]": text_tables.slip_text(a.max_slip, bound, a.max_slip_u95),
        **({"locked [s]": number(a.longest_lock_s, 1)} if a.locked_s else {}),
        "energy [kJ]": text_tables.energy_text(a.slide_energy_j, a.slide_energy_u95_j, bound),
        "used [%]": text_tables.share_with_interval(a.utilisation, a.utilisation_ci),
    }


def score_row(s: Score) -> dict[str, str]:
    """How well one estimator follows."""
    return {
        "method": f"{s.algo} ≈" if s.alike and s.relative != 1.0 else s.algo,
        "RMSE [N]": number(s.rmse_n),
        "bias [N]": number(s.bias_n),
        "max [N]": number(s.max_error_n),
        "lag [s]": number(s.lag_s, 3),
        "gain": number(s.gain, 3),
        "t95 [s]": number(s.response_s, 2),
        "ripple [N]": newtons(s.ripple_n),
    }


def score_rows(scores: Sequence[Score]) -> list[dict[str, str]]:
    """The same of several, with what their own bands are worth; no column without a value."""
    rows = [
        {
            **score_row(s),
            "band [N]": number(s.band_n),
            "holds [%]": number(s.within and 100.0 * s.within),
        }
        for s in scores
    ]
    return text_tables.non_empty(rows)


def channel_row(c: ChannelSummary) -> dict[str, str]:
    """A channel of a log, and what it was taken for."""
    return {
        "channel": c.title,
        "meaning": c.meaning or DASH,
        "axle": number(c.axle),
        "unit": c.unit or ("not stated" if c.meaning else DASH),
    }


def budget_row(c: Contribution) -> dict[str, str]:
    """What one quantity adds to the uncertainty of a mean force."""
    unit = "" if c.unit == "-" else f" {c.unit}"
    return {
        "quantity": c.quantity,
        "type": c.type,
        "value": DASH if c.value is None else f"{c.value:.5g}{unit}",
        "u": f"{c.u:.3g}",
        "∂F/∂q": f"{c.sensitivity:.3g}",
        "u(F) [N]": number(c.contribution_n, 1),
        "share [%]": number(100.0 * c.share, 1),
    }


def combined(application: BrakeApplication) -> str:
    """The last line of a budget."""
    coverage, force = application.coverage, application.force_n
    assert coverage
    assert force
    freedom = coverage.degrees_of_freedom
    freedom_text = "many" if freedom is None or freedom > 999.0 else f"{freedom:.0f}"
    correlated = max((c.share for c in application.budget or ()), default=0.0) > 1.0
    return (
        f"F = {force.mean:.0f} ± {force.mean_u95:.0f} N (95 %); combined standard "
        f"uncertainty {coverage.u_n:.1f} N, coverage factor {coverage.k:.2f}, effective degrees of "
        f"freedom: {freedom_text}.{_OF_SHARES * correlated}"
    )


def newtons(value: float | None) -> str:
    """A force's error [N], with one decimal where that says more."""
    return number(value, 1 if value is not None and value < 10.0 else 0)
