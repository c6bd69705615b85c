"""Brake applications and scores as rows of text, for the screen and for pages."""

from ..core.model import Score
from ..core.summary import BrakeApplication
from ..core.text import by_uncertainty
from .text_tables import bounded_number, number


def row(axle: str, a: BrakeApplication) -> dict[str, str]:
    """A brake application: when, how fast, adhesion coefficient and force."""
    mu, force = a.coefficient, a.force_n
    return {
        "axle": axle,
        "at [s]": number(a.start_s, 1),
        "for [s]": number(a.end_s - a.start_s, 1),
        "v [m/s]": "–".join(number(v, 1) for v in (a.from_mps, a.to_mps)),
        "µ mean": _with_u95(mu and (mu.mean, mu.mean_u95), 1.0, 3),
        "µ max": _with_u95(mu and (mu.max, mu.max_u95), 1.0, 3),
        "F [kN]": _with_u95(force and (force.mean, force.mean_u95), 1e-3),
        "Fmax [kN]": _with_u95(force and (force.max, force.max_u95), 1e-3),
    }


def _with_u95(pair: tuple[float, float] | None, factor: float, digits: int | None = None) -> str:
    """A value with its uncertainty, to at most these decimals; without them to three digits."""
    if not pair:
        return "-"
    value, u95 = factor * pair[0], factor * pair[1]
    if digits is None:
        digits = 2 if abs(value) < 10.0 else 1
    return "±".join(by_uncertainty(value, u95, digits))


def slid_row(axle: str, a: BrakeApplication) -> dict[str, str]:
    """The slides of a brake application, together."""
    energy, utilisation, bound = a.slide_energy_j, a.utilisation, a.at_least
    highest = min(100.0 * (a.max_slip or 0.0), 100.0)
    return {
        "axle": axle,
        "at [s]": number(a.start_s, 1),
        "slides": str(a.slides),
        "for [s]": bounded_number(a.slide_s, 1, bound),
        "distance [m]": bounded_number(a.slide_distance_m, 0, bound),
        "max slip [%]": number(highest, 0) if highest > 99.5 else bounded_number(highest, 1, bound),
        "energy [kJ]": bounded_number(energy and 1e-3 * energy, 1, bound),
        "used [%]": number(utilisation and 100.0 * utilisation, 0),
    }


def score_row(axle: str, s: Score) -> dict[str, str]:
    """How well one estimator follows, on one axle or over all."""
    return {
        "axle": axle,
        "method": f"{s.algo} ≈" if s.alike and s.relative != 1.0 else s.algo,
        "RMSE [N]": number(s.rmse_n),
        "bias [N]": number(s.bias_n),
        "max [N]": number(s.max_error_n),
        "lag [s]": number(s.lag_s, 3),
        "gain": number(s.gain, 3),
        "t95 [s]": number(s.response_s, 2),
        "ripple [N]": newtons(s.ripple_n),
    }


def newtons(value: float | None) -> str:
    """A force's error [N], with one decimal where that says more."""
    return number(value, 1 if value is not None and value < 10.0 else 0)
