"""Slope of the slip-adhesion curve at the operating point, and the AND-test: [S3] and [S4].

One sample at a time, pure and plain, in the style of `estimator`: the same `step` runs inside a
controller and, compiled, over a whole log. Source: patent on slip-adhesion slope anti-skid control
(Shanghai University of Engineering Science, published 2024-10). Its formulas are lost in the text
that we have; they follow from what it says around them.

Slope. Along the curve k = dμ/ds = (dμ/dt)/(ds/dt), that is dμ/dt = k ds/dt. Differentiating what
was measured is hopeless, so both sides go through a first-order filter δ/(p + δ), p = d/dt, with
the corner δ. There

    δ p/(p + δ) μ = δ (μ − LP(μ)),  LP = δ/(p + δ)

is an ordinary high-pass output and no derivative is left: with Δμ = μ − LP(μ), Δs = s − LP(s) and
k constant over 1/δ,

    Δμ = k Δs.                                                                              [S3]

Least squares with exponential forgetting, w(t, τ) = e^(−ρ(t−τ)), of J(k) = ∫ w (Δμ − kΔs)² dτ.
∂J/∂k = 0 gives k = C/S with

    S = ∫ w Δs² dτ,  C = ∫ w Δs Δμ dτ;   Ṡ = Δs² − ρS,  Ċ = Δs Δμ − ρC,

and with P = 1/S: Ṗ = −P²Ṡ = ρP − P²Δs²; k̇ = PĊ + ṖC = P Δs (Δμ − kΔs), the recursive form. We
carry S and C and not P and k: the equations are then linear and decay, so the step is exact for
signals that are straight lines between samples, stable for every interval, and S → 0 where
Δs = 0, which is P → ∞ in the other form.

How sure. M = ∫ w Δμ² dτ leaves Q = M − kC unexplained. Z = ∫ w (least² + (g σ_s)²) dτ is what S
is where nothing but noise moves the slip: σ_s is its 1 sigma, which for a speed's noise grows as
1/v. g > 1 because a memory of 1/ρ holds few independent values, and few are often larger than their
rms. Y = ∫ w σ_μ² dτ is the same of μ: few values also leave too little unexplained. (Q + Y)/S is a
slope squared, the error's scale, and

    confidence = (1 − Z/S) (k² + k0²)/(k² + k0² + (Q + Y)/S):

no more than noise in the slip gives 0, else, but for k0, the squared correlation of Δμ and Δs;
k0 keeps it up at the peak, where μ does not move and no correlation can be. Noise in the slip
draws k towards 0, by at most the share Z/(g² S). Below `surest`, the slope is not observable.
"""

import math
from typing import Annotated, NamedTuple

from .model import Quantity

REGIONS = ("unknown", "below", "optimal", "beyond")  # by the code that `region` gives


class Params(NamedTuple):
    """Filter, memory and guards of the slope."""

    delta: Annotated[float, Quantity("rad/s", "corner δ of the high-pass", 1e-3, 1e3)] = 2.0
    rho: Annotated[float, Quantity("1/s", "forgetting rate ρ", 1e-3, 1e3)] = 2.0
    least: Annotated[float, Quantity("-", "rms slip change that shows nothing", 1e-9, 1.0)] = 5e-4
    guard: Annotated[
        float, Quantity("-", "rms slip change over its noise that shows nothing", 1.0, 100.0)
    ] = 3.0
    small: Annotated[float, Quantity("-", "slope k0 that counts as none", 1e-9, 1e3)] = 0.1
    surest: Annotated[float, Quantity("-", "least confidence of a slope", 0.0, 1.0)] = 0.5


class Bands(NamedTuple):
    """The preset domains of [S4]: slip [-] and slope dμ/ds [-]; ours, the patent states none."""

    slip_low: Annotated[float, Quantity("-", "least slip of the slip band", -1.0, 1.0)] = 0.01
    slip_high: Annotated[float, Quantity("-", "largest slip of the slip band", -1.0, 1.0)] = 0.2
    slope_low: Annotated[float, Quantity("-", "least slope of the slope band", -1e3, 1e3)] = -0.05
    slope_high: Annotated[float, Quantity("-", "largest slope of the band", -1e3, 1e3)] = 1.0


class State(NamedTuple):
    """Last sample, high-pass outputs, weighted integrals, and the answer."""

    slip: float
    mu: float
    dslip: float  # Δs
    dmu: float  # Δμ
    S: float  # ∫ w Δs² [s]
    C: float  # ∫ w Δs Δμ [s]
    M: float  # ∫ w Δμ² [s]
    Z: float  # ∫ w (least² + (guard σ_s)²) [s]
    Y: float  # ∫ w σ_μ² [s]
    confidence: float  # 0 not observable, 1 certain
    slope: float  # k = dμ/ds; NaN where not observable


def init(p: Params, slip: float, mu: float) -> State:
    """State at the first sample: nothing is known of the slope."""
    return State(slip, mu, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)


def step(
    p: Params, s: State, h: float, slip: float, mu: float, slip_noise: float, mu_noise: float
) -> State:
    """State one sample later; a sample without slip or μ (standstill) makes the next one a start.

    Args:
        p: parameters.
        s: state at the sample before.
        h: interval since then [s].
        slip: s [-], NaN where there is none.
        mu: adhesion coefficient [-].
        slip_noise: σ_s, 1 sigma of the slip's noise [-].
        mu_noise: σ_μ, the same of μ [-].
    """
    if not (math.isfinite(slip) and math.isfinite(mu) and math.isfinite(s.slip)):
        return init(p, slip if math.isfinite(mu) else math.nan, mu)
    decay = math.exp(-p.delta * h)
    ramp = -math.expm1(-p.delta * h) / (p.delta * h) if h > 0.0 else 1.0
    x = decay * s.dslip + ramp * (slip - s.slip)  # Δs
    y = decay * s.dmu + ramp * (mu - s.mu)  # Δμ
    keep = math.exp(-p.rho * h)
    new = -math.expm1(-p.rho * h) / p.rho  # ∫ w over the interval
    S = keep * s.S + new * (s.dslip * s.dslip + s.dslip * x + x * x) / 3.0
    cross = 2.0 * s.dslip * s.dmu + s.dslip * y + x * s.dmu + 2.0 * x * y
    C = keep * s.C + new * cross / 6.0
    M = keep * s.M + new * (s.dmu * s.dmu + s.dmu * y + y * y) / 3.0
    Z = keep * s.Z + new * (p.least * p.least + p.guard * p.guard * slip_noise * slip_noise)
    Y = keep * s.Y + new * mu_noise * mu_noise
    confidence, slope = 0.0, math.nan
    if Z < S:
        k = C / S  # [S3]
        left = (max(M - k * C, 0.0) + Y) / S
        known = k * k + p.small * p.small
        confidence = (1.0 - Z / S) * known / (known + left)
        if confidence >= p.surest:
            slope = k
    return State(slip, mu, x, y, S, C, M, Z, Y, confidence, slope)


def region(slip: float, slope: float, bands: Bands) -> int:
    """Where the operating point lies: index into `REGIONS`.

    The AND-test is true in `optimal` only. Where it is false, the slip band decides first: `below`
    with less slip, `beyond` with more, whatever slope is remembered from where the point has been.
    Inside it the slope decides: `below` where the curve rises more than the band has it, `beyond`
    where it falls more, `unknown` where it is not observable.

    Args:
        slip: s [-], NaN where there is none.
        slope: dμ/ds [-], NaN where not observable.
        bands: the preset domains.
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
