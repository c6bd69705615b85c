"""Functions e^x, e^x − 1, sin, cos and x^a without a branch or a call, for `lanes`.

A compiler puts many of these side by side into one vector register, which it cannot do with a call
of the C library. An argument is reduced to a short interval, and a Taylor polynomial gives the
rest. Errors are below 1e-12, relative or of 1, for a power of e within ±700 and an angle within
1e6. Beyond, e stays at its power there. NaN stays NaN, but for a base.
"""

import math

import numpy as np

_MAGIC = 1.5 * 2.0**52  # a sum with it is rounded to an integer, which its last bits hold
_PER_LN2 = 1.0 / math.log(2.0)
_LN2, _LN2_REST = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
_QUARTER = float.fromhex("0x1.921fb544p+0")  # of a turn, in three parts
_QUARTER_2, _QUARTER_3 = float.fromhex("0x1.0b4611a6p-34"), float.fromhex("0x1.3198a2e037073p-69")
_PER_QUARTER = 2.0 / math.pi
_LEAST, _MOST = -708.0, 709.0
_ROOT_HALF = np.float64(math.sqrt(0.5)).view(np.int64).item()
_ONE = np.float64(1.0).view(np.int64).item()


def exp(x: float) -> float:
    """e^x."""
    m, scale = _parts(x)
    return scale + scale * m


def expm1(x: float) -> float:
    """e^x − 1, also for small x."""
    m, scale = _parts(x)
    return scale * m + (scale - 1.0)


def sin(x: float) -> float:
    """Of an angle [rad]."""
    s, c, turns = _circle(x)
    value = c if turns & 1 != 0 else s
    return -value if turns & 2 != 0 else value


def cos(x: float) -> float:
    """Of an angle [rad]."""
    s, c, turns = _circle(x)
    value = s if turns & 1 != 0 else c
    return -value if (turns + 1) & 2 != 0 else value


def power(x: float, a: float) -> float:
    """x^a, for x > 0, which is a number."""
    bits = np.float64(x).view(np.int64)
    n = (bits - _ROOT_HALF) >> 52  # x = m 2^n, m within a factor of √2 of 1
    m = np.int64(bits - (n << 52)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    p = 1.0 / 13.0 + z * (1.0 / 15.0)
    p = 1.0 / 9.0 + z * (1.0 / 11.0 + z * p)
    p = 1.0 / 5.0 + z * (1.0 / 7.0 + z * p)
    p = 1.0 / 3.0 + z * p
    part = 2.0 * s * (1.0 + z * p)
    # A sum with an integer that is made of bits: few machines convert integers side by side.
    whole = np.int64(n + _MAGIC_BITS).view(np.float64) - _MAGIC
    return exp(a * (whole * _LN2 + (part + whole * _LN2_REST)))


_MAGIC_BITS = np.float64(_MAGIC).view(np.int64).item()


def _parts(x: float) -> tuple[float, float]:
    """Both factors of e^x = (1 + m) 2^n: m and 2^n."""
    x = _LEAST if x < _LEAST else x
    x = _MOST if x > _MOST else x
    t = x * _PER_LN2 + _MAGIC
    n = t - _MAGIC
    r = (x - n * _LN2) - n * _LN2_REST
    p = 1.0 / 362880.0 + r * (1.0 / 3628800.0)
    p = 1.0 / 5040.0 + r * (1.0 / 40320.0 + r * p)
    p = 1.0 / 120.0 + r * (1.0 / 720.0 + r * p)
    p = 1.0 / 6.0 + r * (1.0 / 24.0 + r * p)
    p = 0.5 + r * p
    bits = np.float64(t).view(np.int64)
    return r + r * r * p, np.int64((bits << 52) + _ONE).view(np.float64)


def _circle(x: float) -> tuple[float, float, np.int64]:
    """Sine and cosine of x less its quarter turns, and their number."""
    t = x * _PER_QUARTER + _MAGIC
    n = t - _MAGIC
    r = ((x - n * _QUARTER) - n * _QUARTER_2) - n * _QUARTER_3
    z = r * r
    s = 1.0 / 362880.0 - z * (1.0 / 39916800.0 - z * (1.0 / 6227020800.0))
    s = 1.0 / 120.0 - z * (1.0 / 5040.0 - z * s)
    s = r - r * z * (1.0 / 6.0 - z * s)
    c = 1.0 / 3628800.0 - z * (1.0 / 479001600.0)
    c = 1.0 / 720.0 - z * (1.0 / 40320.0 - z * c)
    c = 1.0 - z * (0.5 - z * (1.0 / 24.0 - z * c))
    return s, c, np.float64(t).view(np.int64)
