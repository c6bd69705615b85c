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
caught would keep the slope of its slide. Three things against it. The curve's scale is slip itself:
the peak lies at some slip, friction falls with the sliding, and from half that slip to twice it is
as far. So all of the above is done in

    x = asinh(s/a),  dx/ds = 1/√(s² + a²),

which is s/a for slip much below a, `knee`, and ln(2s/a) above: Δμ = κ Δx with κ = dμ/dx, and
k = κ dx/ds; every slip below, and its noise, is one of x. a large is the patent's form. The memory
is also one of distance: with

    L² = max(λ², least² + (g σ_s)²),

λ `straight`, the rest noise as below, both corners grow with how far the point has come:

    δ' = δ (1 + 5 (Δx/L)²),  ρ' = ρ (1 + 5 (Δx/L)²).

Δμ = κ Δx holds as before, for any corner that is the same on both sides; at rest it is the patent's
filter, and in a fast sweep Δx stays near L/√5. And the bend is a second unknown. About the present
x, μ(u) = μ(x) + κ (u − x) + c (u − x)²; the high-pass of (u − x)² is q = Δ(x²) − 2 x Δx, so

    Δμ = κ Δx + c q,  J = ∫ w (Δμ − κΔx − cq)² dτ + r c²,

five sums in place of two, carried with Δ(x²) for q, as x moves. Where a slope is steep the curve
bends soon: c is expected to be 0 with 1 sigma c0 = √(κ² + κ0²)/(1.4 λ), and r = (Q + Y)/c0² with
what a straight line leaves, Q + Y as below: on a curve that is seen clearly r is small and c free,
in noise c stays 0. With T = ∫ w Δx q, B = ∫ w q², D = ∫ w q Δμ, ∂J/∂κ = ∂J/∂c = 0 gives

    κ = (C − T D/(B + r))/E,  E = S − T²/(B + r):

E is the excitation that is left for κ; where slip came one way only, κ and c are the same to it,
and E is small. c has its own error where the memory reaches far: a point that came from u to x has
q ≈ −2 Δx (x − (x + u)/2), so B/(4 S) is the mean square distance from x at which Δx was seen.
λ large turns memory and bend off.

How sure. M = ∫ w Δμ² dτ leaves Q = M − κC − cD unexplained. Z = ∫ w (least² + (g σ_s)²) dτ is what
S is where nothing but noise moves the slip: σ_s is its 1 sigma, which for a speed's noise grows as
1/v. g > 1 because a memory of 1/ρ holds few independent values, and few are often larger than their
rms. Y = ∫ w σ_μ² dτ is the same of μ: few values also leave too little unexplained. (Q + Y)/E is a
slope squared, the error's scale, ε `doubt` its share that may be κ's, and

    confidence = (1 − Z/E) (κ² + κ0²)/(κ² + κ0² + ε (Q + Y)/E) / (1 + B/(4 S (7 λ)²)):

no more than noise in the slip gives 0, else, but for κ0 and ε, the squared correlation of Δμ and
Δx; κ0, of the slope k0 `small`, keeps it up at the peak, where μ does not move and no correlation
can be. Noise in the slip draws κ towards 0, by at most the share Z/(g² E). Below `surest`, the
slope is not observable. The 5, 1.4, 7 and the defaults were found by search over simulated slides;
docs/explanation/slip.md says what happens on others.
"""

import math
from typing import Annotated, NamedTuple

from ..core.errors import UserError
from ..core.model import Quantity

_FADE = 5.0  # by which both corners grow once the point has come by L
_BEND = 1.4  # times λ from the present x, the slope is expected to be another
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
    ] = 0.18
    knee: Annotated[
        float, Quantity("-", "slip a above which the curve's scale is slip itself", 1e-6, 1e6)
    ] = 0.005
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


def checked(b: Bands, section: str) -> Bands:
    """The bands that `section` of the settings states.

    Raises:
        UserError: a band without width.
    """
    for name, low, high in (
        ("slip", b.slip_low, b.slip_high), ("slope", b.slope_low, b.slope_high),
    ):  # fmt: skip
        if low >= high:
            text = f"{section}.{name}_low = {low:g} is not below {section}.{name}_high = {high:g}"
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
    """State at the first sample: nothing is known of the slope."""
    z = 0.0
    return State(slip, mu, z, z, z, z, z, z, z, z, z, z, z, z, math.nan)


def step(  # noqa: PLR0913
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
    per = 1.0 / math.hypot(slip, p.knee)  # dx/ds
    least = (p.least * p.least + p.guard * p.guard * slip_noise * slip_noise) * per * per
    come = s.dx * s.dx / max(p.straight * p.straight, least)  # (Δx/L)²
    faster = 1.0 + _FADE * come
    delta, rho = p.delta * faster, p.rho * faster
    decay = math.exp(-delta * h)
    ramp = -math.expm1(-delta * h) / (delta * h) if h > 0.0 else 1.0
    was, at = math.asinh(s.slip / p.knee), math.asinh(slip / p.knee)  # x
    dx = decay * s.dx + ramp * (at - was)  # Δx
    q = decay * s.dsquare + ramp * (at * at - was * was)  # Δ(x²)
    y = decay * s.dmu + ramp * (mu - s.mu)  # Δμ
    keep = math.exp(-rho * h)
    new = -math.expm1(-rho * h) / rho  # ∫ w over the interval
    S = keep * s.S + new * _mean(s.dx, dx, s.dx, dx)
    U = keep * s.U + new * _mean(s.dx, dx, s.dsquare, q)
    V = keep * s.V + new * _mean(s.dsquare, q, s.dsquare, q)
    C = keep * s.C + new * _mean(s.dx, dx, s.dmu, y)
    N = keep * s.N + new * _mean(s.dsquare, q, s.dmu, y)
    M = keep * s.M + new * _mean(s.dmu, y, s.dmu, y)
    Z = keep * s.Z + new * least
    Y = keep * s.Y + new * mu_noise * mu_noise
    confidence, slope = 0.0, math.nan
    if Z < S and slip != 0.0:
        T = U - 2.0 * at * S
        B = max(V - 4.0 * at * U + 4.0 * at * at * S, 0.0)
        D = N - 2.0 * at * C
        none = (p.small / per) ** 2  # κ0²
        chord = C / S
        r = (max(M - chord * C, 0.0) + Y) * (_BEND * p.straight) ** 2 / (chord * chord + none)
        E = S - T * T / (B + r) if B + r > 0.0 else S
        if Z < E:
            c = (D - T * chord) / (B + r - T * T / S) if B + r > 0.0 else 0.0
            kappa = (C - T * c) / S  # [S3]
            left = (max(M - kappa * C - c * D, 0.0) + Y) / E
            known = kappa * kappa + none
            near = 1.0 + B / (4.0 * S * (_FAR * p.straight) ** 2)
            confidence = (1.0 - Z / E) * known / (known + p.doubt * left) / near
            if confidence >= p.surest:
                slope = kappa * per
    return State(slip, mu, dx, q, y, S, U, V, C, N, M, Z, Y, confidence, slope)


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
