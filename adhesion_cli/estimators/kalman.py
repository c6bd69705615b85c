"""Kalman filter of the wheel speed, force by iteration with a forgetting factor.

    ω̂(k+1|k) = ω̂(k|k) + h (aF̂(k) − aφK)                                            (6)
    G = P/(P + R),  ω̂(k+1|k+1) = ω̂(k+1|k) + G (y − ω̂(k+1|k)),  P ← (1 − G) P         (7)
    d = (1 − b)/(1 − b^(k+1)),  ε1 = ω̂(k+1|k+1) − ω̂(k|k) + h aφK
    F̂ ← (1 − d) F̂ + d ε1/(h a)

Departures. As printed, P only falls and the filter goes blind. Process noise q lets P grow; q = 0
is the printed filter. b and R are those of a step of 1 ms. Over h the forgetting is b^(h/1 ms) and
the noise R · 1 ms/h, so that the result does not depend on the log's rate. The paper gives no R;
here it is the 10⁻⁵ of its noise. G/h settles at √(q/(R · 1 ms)) = 32 1/s, which with the 19.5 ms
of b is a damping of 0.4; a larger q is faster and noisier. K is the mean over the step; printed is
the value before it.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import PAPER

STEP = 1e-3  # that b and R refer to [s]


class Params(NamedTuple):
    """b and P0 are the paper's, q and R ours."""

    b: Annotated[float, Quantity("-", "forgetting factor b per 1 ms", 1e-6, 0.999999)] = 0.95
    q: Annotated[float, Quantity("rad²/s³", "variance rate q of ω; 0: as printed", 0.0, 1e6)] = 1e-5
    R: Annotated[float, Quantity("rad²/s²", "variance R of y per 1 ms", 1e-12, 1e3)] = 1e-5
    P0: Annotated[float, Quantity("rad²/s²", "variance P of ω̂ at the start", 0.0, 1e6)] = 10.0
    euler: Annotated[float, Quantity("-", "1: K of the sample before, as printed", 0.0, 1.0)] = 0.0


class State(NamedTuple):
    """Filter, and the clamping force before."""

    omega: float  # ω̂ [rad/s]
    P: float  # its variance [rad²/s²]
    weight: float  # 1 − b^k
    K: float  # [N]
    F: float  # [N]


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """ω̂ = y, F̂ = 0."""
    return State(y, p.P0, 0.0, K, 0.0)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    K_mean = s.K if p.euler > 0.0 else 0.5 * (s.K + K)
    predicted = s.omega + h * w.a * (s.F - w.phi * K_mean)  # (6)
    P = s.P + p.q * h  # not in print
    gain = P / (P + p.R * STEP / h)
    omega = predicted + gain * (y - predicted)  # (7)
    b = math.pow(p.b, h / STEP)
    weight = b * s.weight + (1.0 - b)
    d = (1.0 - b) / weight
    eps1 = omega - s.omega + h * w.a * w.phi * K_mean
    F = (1.0 - d) * s.F + d * eps1 / (h * w.a)
    return State(omega, (1.0 - gain) * P, weight, K, F)


ABOUT = About(
    title="Kalman filter with forgetting factor",
    source=f"{PAPER}, (6) (7)",
    claims={"service-brake": Claim(28.0, 0.03), "low-adhesion": Claim(45.0, 0.04)},
)
