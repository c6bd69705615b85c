"""A method in single precision: its own functions on float32, as `float` in C computes them.

Each function is bound anew. Its numbers, those of its module and the results of `math` become
float32, whose sums and products NumPy rounds once, as C does. C libraries do not round `expf` and
others exactly, so the test of an export accepts more than this error.
"""

import math
from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any

import numpy as np


@cache
def single(f: Any) -> FunctionType:
    """The function on float32."""
    assert isinstance(f, FunctionType)
    names = dict(f.__globals__)
    consts = tuple(_single(x) for x in f.__code__.co_consts)
    copy = FunctionType(f.__code__.replace(co_consts=consts), names, f.__name__)
    for name in f.__code__.co_names:
        x = names.get(name, np.float32 if name == "float" else None)
        if x is not None:
            bound = single(x) if isinstance(x, FunctionType) else _single(x)
            names[name] = _library() if x is math else bound
    return copy


@cache
def _library() -> ModuleType:
    library = ModuleType("math")
    for name, x in vars(math).items():
        setattr(library, name, _rounded(x) if callable(x) else x)
    return library


def values(nested: Any) -> Any:
    """A tuple, or a NamedTuple, with float32 in place of float."""
    if isinstance(nested, tuple):
        singles = map(values, nested)
        return nested._make(singles) if hasattr(nested, "_make") else tuple(singles)
    return _single(nested)


def _single(x: Any) -> Any:
    return np.float32(x) if isinstance(x, float) else x


def _rounded(f: Callable[..., Any]) -> Callable[..., Any]:
    def call(*arguments: float) -> Any:
        try:
            exact = f(*map(float, arguments))
        except OverflowError:
            exact = math.inf
        except ValueError:
            exact = math.nan
        return exact if isinstance(exact, bool) else np.float32(exact)

    return call
