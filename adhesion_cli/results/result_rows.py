"""Brake applications and scores as rows of text, for the screen and for pages."""

from collections.abc import Mapping
from typing import Any

from ..core.model import Score
from ..core.text import by_uncertainty
from .text_tables import at_least, number


def row(axle: str, application: Mapping[str, Any]) -> dict[str, str]:
    """A brake application: when, how fast, adhesion coefficient and force; keys as in the JSON."""
    mu, force = application["coefficient"] or {}, application["force_n"] or {}
    speeds = [number(application[key], 1) for key in ("from_mps", "to_mps")]
    return {
        "axle": axle, "at [s]": number(application["start_s"], 1),
        "for [s]": number(application["end_s"] - application["start_s"], 1), "v [m/s]": "–".join(speeds),
        "µ mean": _with_u95(mu, "mean", 1.0, 3), "µ max": _with_u95(mu, "max", 1.0, 3),
        "F [kN]": _with_u95(force, "mean", 1e-3), "Fmax [kN]": _with_u95(force, "max", 1e-3),
    }  # fmt: skip


def _with_u95(
    values: Mapping[str, float], key: str, factor: float, digits: int | None = None
) -> str:
    """A value with its uncertainty, to at most these decimals; without them to three digits."""
    if not values:
        return "-"
    value, u95 = factor * values[key], factor * values[f"{key}_u95"]
    if digits is None:
        digits = 2 if abs(value) < 10.0 else 1
    return "±".join(by_uncertainty(value, u95, digits))


def slid_row(axle: str, application: Mapping[str, Any]) -> dict[str, str]:
    """The slides of a brake application, together; keys as in the JSON."""
    energy, utilisation, bound = (
        application["slide_energy_j"],
        application["utilisation"],
        application["at_least"],
    )
    highest = min(100.0 * application["max_slip"], 100.0)
    return {
        "axle": axle, "at [s]": number(application["start_s"], 1), "slides": str(application["slides"]),
        "for [s]": at_least(application["slide_s"], 1, bound),
        "distance [m]": at_least(application["slide_distance_m"], 0, bound),
        "max slip [%]": number(highest, 0) if highest > 99.5 else at_least(highest, 1, bound),
        "energy [kJ]": at_least(energy and 1e-3 * energy, 1, bound),
        "used [%]": number(utilisation and 100.0 * utilisation, 0),
    }  # fmt: skip


def score_row(axle: str, s: Score) -> dict[str, str]:
    """How well one estimator follows, on one axle or over all."""
    return {
        "axle": axle, "method": f"{s.algo} ≈" if s.alike and s.relative != 1.0 else s.algo,
        "RMSE [N]": number(s.rmse_n), "bias [N]": number(s.bias_n),
        "max [N]": number(s.max_error_n), "lag [s]": number(s.lag_s, 3),
        "gain": number(s.gain, 3), "t95 [s]": number(s.response_s, 2),
        "ripple [N]": newtons(s.ripple_n),
    }  # fmt: skip


def newtons(value: float | None) -> str:
    """A force's error [N], with one decimal where that says more."""
    return number(value, 1 if value is not None and value < 10.0 else 0)
