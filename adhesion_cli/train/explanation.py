"""How the train slows, and by what that differs from the stated vehicle."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import Floats, Parameter

_EMPTY, _NO_PLACES = np.empty(0), np.empty(0, np.int64)


class OtherForceLine(NamedTuple):
    """Another force line: K is s (K − o)."""

    scale: float  # s
    offset: float  # o [N]
    factor: float  # on the highest K


class Piece(NamedTuple):
    """What a stretch of the log says of one number."""

    start: float  # seconds after the first time of the grid
    stop: float
    value: Parameter


class Design(NamedTuple):
    """The pieces of one log, and its clamping force all along."""

    t: Floats  # even, (n,) [s]
    K: Floats  # straight line of the pressure, below zero too, over the highest K; (n,)
    relative_speed: Floats  # u − ū (n,) [m/s]
    top: float  # the highest K [N]
    samples: NDArray[np.int64]  # samples of the pieces, (m,)
    gradient_covariance: Floats  # prior covariance of the pieces' gradients, (p, p) [m²/s⁴]
    has_quadratic: bool  # whether pieces have γ
    measured: Floats  # speed (m,) [m/s]
    c: float  # deceleration by the highest K [m/s²]
    noise: float  # 1 sigma of v's white noise [m/s]
    floor: float  # 1 sigma of what no noise shows: rounding, and what the model leaves out [m/s]
    shows_slides: bool  # whether a train speed would show that all wheels slide
    interval: float  # the longer one of speed and pressure [s]
    mean: float  # ū, at which c holds [m/s]
    creeps: bool  # whether the speed is that of wheels
    climb: Floats  # what the known gradient has taken from the speed, (m,) [m/s]
    gradient_sigma: float  # 1 sigma of the gradient that is not known [m/s²]
    by_motors: Floats  # deceleration by the motors' force all along, (n,) [m/s²]
    motor_sigma: Floats  # 1 sigma of it, one error of all samples, (n,) [m/s²]
    # by the pieces, see `pieces`
    piece_start: NDArray[np.int64] = _NO_PLACES  # of its first sample in `samples`, (p,)
    size: Floats = _EMPTY  # how many each has, (p,)
    time: Floats = _EMPTY  # from the piece's middle, (m,) [s]
    bend: Floats = _EMPTY  # t² of its piece without a straight line, of unit length; 0 without γ
    v: Floats = _EMPTY  # speed without α and γ (m,) [m/s]
    speed: Floats = _EMPTY  # that itself, smooth (m,) [m/s]
    squared: Floats = _EMPTY  # ∫u² dt without α and γ (m,) [m²/s]


class Explanation(NamedTuple):
    """What differs from the stated vehicle, as far as the log shows."""

    # by which the pressure is late, with its 1 sigma [s]; 0 where that is not sure
    pressure_delay: Parameter
    line: OtherForceLine | None  # None where it is as stated
    delay_or_line: bool = False  # it is one of both, and nothing says which
    # By the vehicle as stated: the gradient that would explain what the pressure does not, above 0
    # where it drives the train [m/s²].
    pieces: tuple[Piece, ...] = ()
    # The brake applications of wheels that roll, by the train speed, else by the wheels.
    design: Design | None = None


AS_STATED = Explanation(Parameter(0.0, 0.0), None)
