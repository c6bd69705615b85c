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

Where the curve bends. k is constant over the memory only as long as the point stays where the curve
is straight; one memory over both flanks of the peak draws a chord through them, and a wheel that is
caught would keep the slope of its slide. Two things against it. The memory is also one of distance
in slip. The curve's scale is slip itself (the peak lies at some slip, friction falls with the
sliding), so with

    L² = max(λ²s², least² + (g σ_s)²),

λ `straight`, the rest noise as below, both corners grow with how far the point has come:

    δ' = δ (1 + 5 (Δs/L)²),  ρ' = ρ (1 + 5 (Δs/L)²).

Δμ = k Δs holds as before, for any corner that is the same on both sides; at rest it is the patent's
filter, and in a fast sweep Δs stays near L/√5. And the bend is a second unknown. About the present
slip s, μ(u) = μ(s) + k (u − s) + c (u − s)²; the high-pass of (u − s)² is q = Δ(s²) − 2 s Δs, so

    Δμ = k Δs + c q,  J = ∫ w (Δμ − kΔs − cq)² dτ + r c²,

five sums in place of two, carried with Δ(s²) for q, as s moves. Where a slope is steep the curve
bends soon: c is expected to be 0 with 1 sigma c0 = √(k² + k0²)/(1.4 λ s), and r = (Q + Y)/c0² with
what a straight line leaves, Q + Y as below: on a curve that is seen clearly r is small and c free,
in noise c stays 0. With T = ∫ w Δs q, B = ∫ w q², D = ∫ w q Δμ, ∂J/∂k = ∂J/∂c = 0 gives

    k = (C − T D/(B + r))/E,  E = S − T²/(B + r):

E is the excitation that is left for k; where slip came one way only, k and c are the same to it,
and E is small. c has its own error where the memory reaches far: a point that came from u to s has
q ≈ −2 Δs (s − (s + u)/2), so B/(4 S) is the mean square distance from s at which Δs was seen.
λ large turns all of this off.

How sure. M = ∫ w Δμ² dτ leaves Q = M − kC − cD unexplained. Z = ∫ w (least² + (g σ_s)²) dτ is what
S is where nothing but noise moves the slip: σ_s is its 1 sigma, which for a speed's noise grows as
1/v. g > 1 because a memory of 1/ρ holds few independent values, and few are often larger than their
rms. Y = ∫ w σ_μ² dτ is the same of μ: few values also leave too little unexplained. (Q + Y)/E is a
slope squared, the error's scale, ε `doubt` its share that may be k's, and

    confidence = (1 − Z/E) (k² + k0²)/(k² + k0² + ε (Q + Y)/E) / (1 + B/(4 S (7 λ s)²)):

no more than noise in the slip gives 0, else, but for k0 and ε, the squared correlation of Δμ and
Δs; k0 keeps it up at the peak, where μ does not move and no correlation can be. Noise in the slip
draws k towards 0, by at most the share Z/(g² E). Below `surest`, the slope is not observable. The
5, 1.4, 7 and the defaults were found by search over simulated slides; docs/slip.md has what is told
of others.
"""

import math
from typing import Annotated, NamedTuple

from .model import Quantity

_FADE = 5.0  # by which both corners grow once the point has come by L
_BEND = 1.4  # times λs from the present slip, the slope is expected to be another
_FAR = 7.0  # and what was seen counts half

REGIONS = ("unknown", "below", "optimal", "beyond")  # by the code that `region` gives


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
    ] = 0.16
    small: Annotated[float, Quantity("-", "slope k0 that counts as none", 1e-9, 1e3)] = 0.1
    doubt: Annotated[
        float, Quantity("-", "share ε of the unexplained that may be the slope's", 0.0, 1.0)
    ] = 0.2
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
    dsquare: float  # Δ(s²)
    dmu: float  # Δμ
    S: float  # ∫ w Δs² [s]
    U: float  # ∫ w Δs Δ(s²) [s]
    V: float  # ∫ w Δ(s²)² [s]
    C: float  # ∫ w Δs Δμ [s]
    N: float  # ∫ w Δ(s²) Δμ [s]
    M: float  # ∫ w Δμ² [s]
    Z: float  # ∫ w (least² + (guard σ_s)²) [s]
    Y: float  # ∫ w σ_μ² [s]
    confidence: float  # 0 not observable, 1 certain
    slope: float  # k = dμ/ds; NaN where not observable


def init(p: Params, slip: float, mu: float) -> State:
    """State at the first sample: nothing is known of the slope."""
    z = 0.0
    return State(slip, mu, z, z, z, z, z, z, z, z, z, z, z, z, math.nan)


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
    least = p.least * p.least + p.guard * p.guard * slip_noise * slip_noise
    come = s.dslip * s.dslip / max((p.straight * slip) ** 2, least)  # (Δs/L)²
    faster = 1.0 + _FADE * come
    delta, rho = p.delta * faster, p.rho * faster
    decay = math.exp(-delta * h)
    ramp = -math.expm1(-delta * h) / (delta * h) if h > 0.0 else 1.0
    x0, q0, y0 = s.dslip, s.dsquare, s.dmu
    x = decay * x0 + ramp * (slip - s.slip)  # Δs
    q = decay * q0 + ramp * (slip * slip - s.slip * s.slip)  # Δ(s²)
    y = decay * y0 + ramp * (mu - s.mu)  # Δμ
    keep = math.exp(-rho * h)
    new = -math.expm1(-rho * h) / rho  # ∫ w over the interval
    S = keep * s.S + new * _mean(x0, x, x0, x)
    U = keep * s.U + new * _mean(x0, x, q0, q)
    V = keep * s.V + new * _mean(q0, q, q0, q)
    C = keep * s.C + new * _mean(x0, x, y0, y)
    N = keep * s.N + new * _mean(q0, q, y0, y)
    M = keep * s.M + new * _mean(y0, y, y0, y)
    Z = keep * s.Z + new * least
    Y = keep * s.Y + new * mu_noise * mu_noise
    confidence, slope = 0.0, math.nan
    if Z < S and slip != 0.0:
        T = U - 2.0 * slip * S
        B = max(V - 4.0 * slip * U + 4.0 * slip * slip * S, 0.0)
        D = N - 2.0 * slip * C
        none, straight = p.small * p.small, p.straight * slip
        chord = C / S
        r = (max(M - chord * C, 0.0) + Y) * (_BEND * straight) ** 2 / (chord * chord + none)
        E = S - T * T / (B + r) if B + r > 0.0 else S
        if Z < E:
            c = (D - T * chord) / (B + r - T * T / S) if B + r > 0.0 else 0.0
            k = (C - T * c) / S  # [S3]
            left = (max(M - k * C - c * D, 0.0) + Y) / E
            known = k * k + none
            near = 1.0 + B / (4.0 * S * (_FAR * straight) ** 2)
            confidence = (1.0 - Z / E) * known / (known + p.doubt * left) / near
            if confidence >= p.surest:
                slope = k
    return State(slip, mu, x, q, y, S, U, V, C, N, M, Z, Y, confidence, slope)


def _mean(a: float, b: float, c: float, d: float) -> float:
    """Mean of the product of two straight lines, from a to b and from c to d."""
    return (2.0 * a * c + a * d + b * c + 2.0 * b * d) / 6.0


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
