"""A method in single precision: its own functions on float32, as `float` in C computes them.

Each function is bound anew. Its numbers, those of its module and the results of `math` become
float32, whose sums and products NumPy rounds once, as C does. C libraries do not round `expf` and
others exactly. So their results may be put off at random by some units in the last place.
"""

import math
import random
from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

ULPS = 2  # of a C library's function in single precision
_EXACT = {"sqrt", "fabs", "copysign", "floor", "ceil", "fmod", "isfinite", "isnan"}


class Single:
    """Gives the single-precision form of functions; each is made once.

    `seed` is that of the C library's errors; 0: it rounds exactly.
    """

    def __init__(self, seed: int = 0) -> None:
        self._copies: dict[FunctionType, FunctionType] = {}
        self._math = ModuleType("math")
        draw = random.Random(seed)
        for name, x in vars(math).items():
            ulps = 0 if name in _EXACT or seed == 0 else ULPS
            setattr(self._math, name, _rounded(x, draw, ulps) if callable(x) else x)

    def __call__(self, f: Any) -> FunctionType:
        """The function on float32."""
        assert isinstance(f, FunctionType)
        if f not in self._copies:
            names = dict(f.__globals__)
            consts = tuple(_single(x) for x in f.__code__.co_consts)
            copy = FunctionType(f.__code__.replace(co_consts=consts), names, f.__name__)
            self._copies[f] = copy
            for name in f.__code__.co_names:
                names[name] = self._bound(name, f.__globals__)
                if names[name] is None:
                    del names[name]
        return self._copies[f]

    def _bound(self, name: str, names: dict[str, Any]) -> Any:
        x = names.get(name, np.float32 if name == "float" else None)
        if x is math:
            return self._math
        return self(x) if isinstance(x, FunctionType) else _single(x)


def values(nested: Any) -> Any:
    """A tuple, or a NamedTuple, with float32 in place of float."""
    if isinstance(nested, tuple):
        singles = map(values, nested)
        return nested._make(singles) if hasattr(nested, "_make") else tuple(singles)
    return _single(nested)


def _single(x: Any) -> Any:
    return np.float32(x) if isinstance(x, float) else x


def _rounded(f: Callable[..., Any], draw: random.Random, ulps: int) -> Callable[..., Any]:
    def call(*of: float) -> Any:
        try:
            exact = f(*map(float, of))
        except OverflowError:
            exact = math.inf
        except ValueError:
            exact = math.nan
        if isinstance(exact, bool):
            return exact
        rounded = np.float32(exact)
        towards = np.float32(math.copysign(math.inf, draw.random() - 0.5))
        for _ in range(draw.randint(0, ulps)):
            rounded = np.nextafter(rounded, towards)
        return rounded

    return call
