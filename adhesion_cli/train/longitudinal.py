"""The train's longitudinal model: one joint fit of all brake applications.

While every wheel rolls, the wheelset equation and the force line give the rim speed from the
pressure. In each piece of a log, up to 12 s long,

    u(t) = α + γt² + (β − r) t − C ∫ u² dt − s c ∫ k dt − u s c k / (g κ),
    k(t) = (1 + f (u − ū)) max(K(t + τ) − o, 0).

K is the clamping force as a share of its highest value, c the deceleration by that.

| symbol | parameter |
|---|---|
| s, o | factor and offset of the force line |
| τ | delay of the pressure |
| κ = dµ/ds | creep stiffness: a braked wheel that rolls turns slower than the train by µ/κ |
| f | change of the friction with speed |
| r, C | running resistance of the train at low speed, its air drag over u² |
| β | gradient of the piece |

Delay and creep look the same within one application: both make the wheel react earlier. So each
parameter has a prior, and the fit gives the posterior of all together. Its maximum is found by
Gauss and Newton's method, its covariance is Laplace's. α and γ are eliminated in every piece.

A calibration takes shorter pieces without γ, and a gradient that changes along the track. Without
that a gradient that begins with a brake application is taken for force.

Every piece has its own error variance, which is estimated as well. A slide that was not recognised
gives its piece a large variance and so little weight. Errors that are correlated from sample to
sample count as fewer samples.

The rows are pieces, the parameters are shared: `solve.fit` takes the designs of one or many logs.

Sources: wheelset equation (1), force line (15); creep stiffness of 20 to 100 % of Kalker's. Air
drag: Rochard and Schmid, Proc. IMechE F 214 (2000) 185: 1.7e-5 1/m (long high-speed train); single
vehicles have up to 7e-5 1/m, by 0.6 kg/m³ times 10 m² over 80 t.
"""

import math
from collections.abc import Mapping

from ..core.model import Parameter, Vehicle
from ..core.physics import chain_ratio, fade_share
from .mean_axle import brake_sigma

UNITS = {
    "scale": "ln",
    "offset": "-",
    "delay": "s",
    "stiffness": "ln",
    "fade": "s/m",
    "resistance": "m/s²",
    "drag": "1/m",
}
SCALE, OFFSET, DELAY, STIFFNESS, FADE, RESISTANCE, DRAG = range(len(UNITS))
SHARED = len(UNITS)
Prior = Mapping[int, Parameter]  # of the shared parameters, by their place
CREEP = Parameter(math.log(22.0), 0.6)  # ln of 8 to 60 per unit of slip
_FADE = Parameter(0.0, 0.004)  # friction changes by some 10 % over 25 m/s [s/m]
RESISTANCE_OF_TRAINS = Parameter(0.015, 0.015)  # r [m/s²]
DRAG_OF_TRAINS = Parameter(3e-5, 2e-5)  # C [1/m]
_EXACT = 1e-4  # 1 sigma of ln s of a vehicle without tolerances
DELAY_SIGMA = 0.03  # 1 sigma of the delay by calipers, hoses and transducers [s]
_ZERO_SIGMA = 0.01  # 1 sigma of a pressure sensor's zero, of the highest K
EARLY = 0.5  # no sensor is as early: the train brakes later than the axles of the log [s]
LARGEST_DELAY = 5.0  # the largest delay that is looked for [s]
FLOOR = 0.005  # 1 sigma by which the model misses a rolling wheel's speed [m/s]


def tolerance(v: Vehicle) -> float:
    """1 sigma of the deceleration by the pressure, as a share of it, from what is stated."""
    return math.hypot(brake_sigma(v), v.axle_mass.share)


def line_prior(
    vehicle: Vehicle, top: float, speed: float, interval: float = 0.0
) -> dict[int, Parameter]:
    """The prior of every shared parameter by what is stated of the vehicle.

    It depends on the highest K [N], the mean speed [m/s] and the longest interval of samples [s].
    """
    fade, mean_share = vehicle.friction_fade, fade_share(speed, vehicle)
    spring = spring_share(top, vehicle).tolerance
    return {
        SCALE: Parameter(0.0, max(math.log1p(tolerance(vehicle)), _EXACT)),
        OFFSET: Parameter(0.0, math.hypot(spring, _ZERO_SIGMA)),
        DELAY: Parameter(0.0, math.hypot(DELAY_SIGMA, 0.25 * interval)),
        STIFFNESS: CREEP,
        FADE: Parameter(fade.value / mean_share, fade.tolerance or _FADE.tolerance),
        RESISTANCE: RESISTANCE_OF_TRAINS,
        DRAG: DRAG_OF_TRAINS,
    }


def spring_share(top: float, vehicle: Vehicle) -> Parameter:
    """What the return spring takes, of the highest K [N], as stated."""
    ratio, force = chain_ratio(vehicle), vehicle.spring_force
    return Parameter(ratio * force.value / top, ratio * force.tolerance / top)
