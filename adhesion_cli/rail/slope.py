"""Slope of the slip-adhesion curve at the operating point, and the AND-test: [S3] and [S4].

`step` takes one sample at a time. It runs inside a controller and, compiled, over a whole log.
Source: patent on slip-adhesion slope anti-skid control, Shanghai University of Engineering Science,
published 2024-10. Its formulas are missing in the text that we have. The derivation of all that
follows is in docs/explanation/derivation.md.

Slope. Both sides of dμ/dt = k ds/dt pass the filter δ/(p + δ), p = d/dt, so that nothing measured
is differentiated. With Δμ = μ − LP(μ) and Δs = s − LP(s), LP = δ/(p + δ),

    Δμ = k Δs.                                                                              [S3]

Least squares with the forgetting w(t, τ) = e^(−ρ(t−τ)) gives k = C/S, S = ∫ w Δs² dτ,
C = ∫ w Δs Δμ dτ. With P = 1/S this is the recursive form k̇ = P Δs (Δμ − kΔs), Ṗ = ρP − P²Δs².
The state holds S and C: their equations are linear, so the step is exact for straight lines and
stable at every interval.

Where the curve bends. A memory over both flanks of the peak would give the chord. Against that:

- The coordinate is x = asinh(s/a), dx/ds = 1/√(s² + a²), with a `knee`: the curve's scale is slip
  itself. Δμ = κ Δx, κ = dμ/dx, k = κ dx/ds. A large a is the patent's form.
- Memory ends with distance, too: δ' = δ (1 + 5 (Δx/L)²), ρ' = ρ (1 + 5 (Δx/L)²), with
  L² = max(λ², least² + (g σ_s)²), λ `straight`.
- The bend c is a second unknown, Δμ = κ Δx + c q with q = Δ(x²) − 2 x Δx. The fit minimises
  J = ∫ w (Δμ − κΔx − cq)² dτ + r c², and with T = ∫ w Δx q, B = ∫ w q², D = ∫ w q Δμ

      κ = (C − T D/(B + r))/E,  E = S − T²/(B + r).

  c is expected to be 0 with 1 sigma √(κ² + κ0²)/(1.4 λ); r follows from that and the residuals.

Confidence. Q = ∫ w Δμ² dτ − κC − cD is not explained, Z = ∫ w (least² + (g σ_s)²) dτ is what noise
makes of S, and Y = ∫ w σ_μ² dτ is the noise of μ:

    confidence = (1 − Z/E) (κ² + κ0²)/(κ² + κ0² + ε (Q + Y)/E) / (1 + B/(4 S (7 λ)²)).

κ0 belongs to the slope k0 `small` and keeps the confidence at the peak, where μ does not move.
ε is `doubt`. Below `surest` the slope is not observable. The numbers 5, 1.4, 7 and the defaults
were found by search over simulated slides.
"""

import math
from typing import Annotated, NamedTuple

from ..core.errors import UserError
from ..core.model import Quantity, fraction

_FADE = 5.0  # growth of both corners when the point has moved by L
_BEND = 1.4  # distance, in λ, over which the slope is expected to change
_MEMORY_DISTANCE = 7.0  # distance, in λ, from which what was seen counts half

REGIONS = ("unknown", "below", "optimal", "beyond")  # by the code that `region` gives
# As people read them. The AND-test is also true on a flat part of the curve far beyond its peak.
REGION_TITLES = ("unknown", "below", "flat", "beyond")


class Params(NamedTuple):
    """Filter, memory and guards of the slope."""

    delta: Annotated[float, Quantity("rad/s", "corner δ of the high-pass", 1e-3, 1e3)] = 0.6
    rho: Annotated[float, Quantity("1/s", "forgetting rate ρ", 1e-3, 1e3)] = 0.6
    least: Annotated[float, Quantity("-", "rms slip change that shows nothing", 1e-9, 1.0)] = 5e-4
    guard: Annotated[
        float, Quantity("-", "rms slip change over its noise that shows nothing", 1.0, 100.0)
    ] = 2.7
    straight: Annotated[
        float, Quantity("-", "share λ of slip over which the curve is straight", 1e-3, 1e9)
    ] = 0.18
    knee: Annotated[
        float, Quantity("-", "slip a above which the curve is scaled by slip itself", 1e-6, 1e6)
    ] = 0.005
    small: Annotated[float, Quantity("-", "slope k0 that counts as none", 1e-9, 1e3)] = 0.1
    doubt: Annotated[float, fraction("share ε of the unexplained that may be the slope's")] = 0.2
    surest: Annotated[float, fraction("least confidence of a slope")] = 0.5


class Bands(NamedTuple):
    """The bands of [S4]: slip [-] and slope dμ/ds [-]; ours, the patent gives no numbers."""

    slip_low: Annotated[float, Quantity("-", "least slip of the slip band", -1.0, 1.0)] = 0.01
    slip_high: Annotated[float, Quantity("-", "largest slip of the slip band", -1.0, 1.0)] = 0.2
    slope_low: Annotated[float, Quantity("-", "least slope of the slope band", -1e3, 1e3)] = -0.05
    slope_high: Annotated[float, Quantity("-", "largest slope of the band", -1e3, 1e3)] = 1.0


def check_bands(b: Bands, section: str) -> Bands:
    """The bands that `section` of the settings states.

    Raises:
        UserError: a band without width.
    """
    for name, lower, upper in (
        ("slip", b.slip_low, b.slip_high),
        ("slope", b.slope_low, b.slope_high),
    ):
        if lower >= upper:
            low_key, high_key = f"{section}.{name}_low", f"{section}.{name}_high"
            text = f"{low_key} = {lower:g} is not below {high_key} = {upper:g}"
            raise UserError(text, "a band is from low to high", code=2)
    return b


class State(NamedTuple):
    """Last sample, high-pass outputs, weighted integrals, and the answer."""

    slip: float
    mu: float
    dx: float  # Δx
    dsquare: float  # Δ(x²)
    dmu: float  # Δμ
    S: float  # ∫ w Δx² [s]
    U: float  # ∫ w Δx Δ(x²) [s]
    V: float  # ∫ w Δ(x²)² [s]
    C: float  # ∫ w Δx Δμ [s]
    N: float  # ∫ w Δ(x²) Δμ [s]
    M: float  # ∫ w Δμ² [s]
    Z: float  # ∫ w (least² + (guard σ_s)²) [s], of x
    Y: float  # ∫ w σ_μ² [s]
    confidence: float  # 0 not observable, 1 certain
    slope: float  # k = dμ/ds; NaN where not observable


def init(p: Params, slip: float, mu: float) -> State:
    """State at the first sample: the slope is unknown."""
    z = 0.0
    return State(slip, mu, z, z, z, z, z, z, z, z, z, z, z, z, math.nan)


def step(  # noqa: PLR0913 (a compiled step on plain floats)
    p: Params, s: State, h: float, slip: float, mu: float, slip_noise: float, mu_noise: float
) -> State:
    """State one sample later. After a sample without slip or μ (standstill) it starts anew.

    `h` is the interval since `s` [s]. Slip and μ are NaN where they do not exist; `slip_noise` and
    `mu_noise` are σ_s and σ_μ, 1 sigma of their noise [-].
    """
    if not (math.isfinite(slip) and math.isfinite(mu) and math.isfinite(s.slip)):
        return init(p, slip if math.isfinite(mu) else math.nan, mu)
    scale = 1.0 / math.hypot(slip, p.knee)  # dx/ds
    noise_floor = (p.least * p.least + p.guard * p.guard * slip_noise * slip_noise) * scale * scale
    distance = s.dx * s.dx / max(p.straight * p.straight, noise_floor)  # (Δx/L)²
    growth = 1.0 + _FADE * distance
    delta, rho = p.delta * growth, p.rho * growth
    decay = math.exp(-delta * h)
    ramp = -math.expm1(-delta * h) / (delta * h) if h > 0.0 else 1.0
    x_before, x = math.asinh(s.slip / p.knee), math.asinh(slip / p.knee)  # x
    dx = decay * s.dx + ramp * (x - x_before)  # Δx
    q = decay * s.dsquare + ramp * (x * x - x_before * x_before)  # Δ(x²)
    y = decay * s.dmu + ramp * (mu - s.mu)  # Δμ
    memory = math.exp(-rho * h)
    weight = -math.expm1(-rho * h) / rho  # ∫ w over the interval
    S = memory * s.S + weight * _mean(s.dx, dx, s.dx, dx)
    U = memory * s.U + weight * _mean(s.dx, dx, s.dsquare, q)
    V = memory * s.V + weight * _mean(s.dsquare, q, s.dsquare, q)
    C = memory * s.C + weight * _mean(s.dx, dx, s.dmu, y)
    N = memory * s.N + weight * _mean(s.dsquare, q, s.dmu, y)
    M = memory * s.M + weight * _mean(s.dmu, y, s.dmu, y)
    Z = memory * s.Z + weight * noise_floor
    Y = memory * s.Y + weight * mu_noise * mu_noise
    confidence, slope = 0.0, math.nan
    if Z < S and slip != 0.0:
        T = U - 2.0 * x * S
        B = max(V - 4.0 * x * U + 4.0 * x * x * S, 0.0)
        D = N - 2.0 * x * C
        kappa0_squared = (p.small / scale) ** 2  # κ0²
        chord = C / S
        r = (max(M - chord * C, 0.0) + Y) * (_BEND * p.straight) ** 2
        r /= chord * chord + kappa0_squared
        E = S - T * T / (B + r) if B + r > 0.0 else S
        if Z < E:
            c = (D - T * chord) / (B + r - T * T / S) if B + r > 0.0 else 0.0
            kappa = (C - T * c) / S  # [S3]
            unexplained = (max(M - kappa * C - c * D, 0.0) + Y) / E
            kappa_squared = kappa * kappa + kappa0_squared
            bend_factor = 1.0 + B / (4.0 * S * (_MEMORY_DISTANCE * p.straight) ** 2)
            confidence = (1.0 - Z / E) * kappa_squared
            confidence /= (kappa_squared + p.doubt * unexplained) * bend_factor
            if confidence >= p.surest:
                slope = kappa * scale
    return State(slip, mu, dx, q, y, S, U, V, C, N, M, Z, Y, confidence, slope)


def _mean(a: float, b: float, c: float, d: float) -> float:
    """Mean of the product of two straight lines, from a to b and from c to d."""
    return (2.0 * a * c + a * d + b * c + 2.0 * b * d) / 6.0


def region(slip: float, slope: float, bands: Bands) -> int:
    """Region of the operating point: index into `REGIONS`.

    The AND-test is true in `optimal` only. Outside the slip band, slip alone decides: `below` or
    `beyond`. Inside it the slope decides: `below` above its band, `beyond` below its band,
    `unknown` where the slope is not observable. Slip and slope dμ/ds [-] are NaN where not known.
    """
    if not math.isfinite(slip):
        return 0
    if not bands.slip_low <= slip <= bands.slip_high:
        return 1 if slip < bands.slip_low else 3
    if not math.isfinite(slope):
        return 0
    if not bands.slope_low <= slope <= bands.slope_high:
        return 1 if slope > bands.slope_high else 3
    return 2  # [S4]
