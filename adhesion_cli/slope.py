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
caught would keep the slope of its slide. So the memory is also one of distance in slip. The curve's
scale is slip itself (the peak lies at some slip, friction falls with the sliding), so it counts as
straight over

    L² = max(λ²s², least² + (g σ_s)²),

λ `straight`, the rest noise as below, and both corners grow with how far the point has come, in
multiples of it:

    δ' = δ (1 + (Δs/L)²),  ρ' = ρ (1 + 2 (Δs/L)²).

Δμ = k Δs holds as before, for any corner that is the same on both sides, at rest it is the patent's
filter, and in a fast sweep Δs stays near L. The 2: what the filter remembers of elsewhere fades as
Δs does, and the sums, which hold its square, as fast only with twice the rate. What is left is
judged by where it was seen: Δs spans s − Δs to s, with its middle u and, about the present slip,

    B² = ∫ w Δs² ((u − s)² + Δs²/12) dτ / S.

λ large turns both off. Slides of 1 to 3 s of another simulator, at 100 and 20 Hz (slip to 11 %,
σ of the train speed 0.02 m/s): above 3 % slip a slope was told in 48 to 62 % of the time without
this and is in 59 to 82 % with it; of what was told below 1 % slip (up to 32 % of that time) all was
wrong, and none is told now. What it costs: in long slides less is told, as one that swung wide
before counts less (`low-adhesion`: 94 to 58 %). λ = 0.2 tells 91 % there, but draws chords on rails
whose peak is broad: in steps of 0.15 s on `wet` half of what it told above 3 % slip was wrong.

How sure. M = ∫ w Δμ² dτ leaves Q = M − kC unexplained. Z = ∫ w (least² + (g σ_s)²) dτ is what S
is where nothing but noise moves the slip: σ_s is its 1 sigma, which for a speed's noise grows as
1/v. g > 1 because a memory of 1/ρ holds few independent values, and few are often larger than their
rms. Y = ∫ w σ_μ² dτ is the same of μ: few values also leave too little unexplained. (Q + Y)/S is a
slope squared, the error's scale, and

    confidence = (1 − Z/S) (k² + k0²)/(k² + k0² + (Q + Y)/S) / (1 + (B/(2.5 λ s))²):

no more than noise in the slip gives 0, else, but for k0, the squared correlation of Δμ and Δs;
k0 keeps it up at the peak, where μ does not move and no correlation can be. Noise in the slip
draws k towards 0, by at most the share Z/(g² S). B = 2.5 λ s halves the confidence. Below `surest`,
the slope is not observable.
"""

import math
from typing import Annotated, NamedTuple

from .model import Quantity

_FAR = 2.5  # times λs from the present slip, what was seen counts half

REGIONS = ("unknown", "below", "optimal", "beyond")  # by the code that `region` gives


class Params(NamedTuple):
    """Filter, memory and guards of the slope."""

    delta: Annotated[float, Quantity("rad/s", "corner δ of the high-pass", 1e-3, 1e3)] = 2.0
    rho: Annotated[float, Quantity("1/s", "forgetting rate ρ", 1e-3, 1e3)] = 2.0
    least: Annotated[float, Quantity("-", "rms slip change that shows nothing", 1e-9, 1.0)] = 5e-4
    guard: Annotated[
        float, Quantity("-", "rms slip change over its noise that shows nothing", 1.0, 100.0)
    ] = 3.0
    straight: Annotated[
        float, Quantity("-", "share λ of slip over which the curve is straight", 1e-3, 1e9)
    ] = 0.1
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
    U: float  # ∫ w Δs² u [s]
    V: float  # ∫ w Δs² (u² + Δs²/12) [s]
    C: float  # ∫ w Δs Δμ [s]
    M: float  # ∫ w Δμ² [s]
    Z: float  # ∫ w (least² + (guard σ_s)²) [s]
    Y: float  # ∫ w σ_μ² [s]
    confidence: float  # 0 not observable, 1 certain
    slope: float  # k = dμ/ds; NaN where not observable


def init(p: Params, slip: float, mu: float) -> State:
    """State at the first sample: nothing is known of the slope."""
    return State(slip, mu, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)


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
    delta, rho = p.delta * (1.0 + come), p.rho * (1.0 + 2.0 * come)
    decay = math.exp(-delta * h)
    ramp = -math.expm1(-delta * h) / (delta * h) if h > 0.0 else 1.0
    x = decay * s.dslip + ramp * (slip - s.slip)  # Δs
    y = decay * s.dmu + ramp * (mu - s.mu)  # Δμ
    keep = math.exp(-rho * h)
    new = -math.expm1(-rho * h) / rho  # ∫ w over the interval
    moved = new * (s.dslip * s.dslip + s.dslip * x + x * x) / 3.0
    middle = slip - x / 2.0  # u
    S = keep * s.S + moved
    U = keep * s.U + moved * middle
    V = keep * s.V + moved * (middle * middle + x * x / 12.0)
    cross = 2.0 * s.dslip * s.dmu + s.dslip * y + x * s.dmu + 2.0 * x * y
    C = keep * s.C + new * cross / 6.0
    M = keep * s.M + new * (s.dmu * s.dmu + s.dmu * y + y * y) / 3.0
    Z = keep * s.Z + new * least
    Y = keep * s.Y + new * mu_noise * mu_noise
    confidence, slope = 0.0, math.nan
    if Z < S and slip != 0.0:
        k = C / S  # [S3]
        left = (max(M - k * C, 0.0) + Y) / S
        known = k * k + p.small * p.small
        away = max(V - 2.0 * slip * U + slip * slip * S, 0.0) / S  # B²
        far = (_FAR * p.straight * slip) ** 2
        confidence = (1.0 - Z / S) * known / (known + left) * far / (far + away)
        if confidence >= p.surest:
            slope = k
    return State(slip, mu, x, y, S, U, V, C, M, Z, Y, confidence, slope)


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
