"""One log, many parameter sets in one pass: an estimator's own step on lanes side by side.

Lane j holds parameter set j. The lanes are the innermost loop, and nothing in it depends on another
lane. So the compiler takes as many of them at once as a vector register holds. It cannot do that
with calls of the C library. So `lane_math` stands in for `math`, and sums of products are rounded
once. The forces are those of `compiled.batch` to about 1e-12, not bit for bit.
"""

import math
from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import Any, get_type_hints

import numpy as np

from . import compiled, lane_math
from .estimator import Estimator
from .model import Bools, Floats, Times, Wheelset

LANES = 32  # parameter sets side by side: some registers of them hide each other's latency

_TEXT = """
def call(params, constants, t_all, K_all, y_all, starts, target_all, judged_all, sums):
    wide()
    w = Wheelset({constants})
    {memory}
    for first in range(0, len(params), {lanes}):
        for j in range({lanes}):
            f = fixed({params})
            {put_fixed}
            put(total, j, 0.0)
        for k in range(len(starts)):
            segment = slice(starts[k], starts[k + 1] if k + 1 < len(starts) else len(t_all))
            t, K, y = t_all[segment], K_all[segment], y_all[segment]
            target, judged = target_all[segment], judged_all[segment]
            for j in range({lanes}):
                s = init({params}, w, K[0], y[0])
                {put_state}
            interval = 0
            most = 1
            for i in range(len(t)):
                if i > 0:
                    if t[i] - t[i - 1] != interval:
                        interval = t[i] - t[i - 1]
                        for j in range({lanes}):
                            q = across({fixed}, interval * 1e-9)
                            {put_across}
                        {count}
                    for n in range(most):
                        for j in range({lanes}):
                            s = part({fixed}, {across}, w, {state}, K[i], y[i]{number})
                            {then}
                if judged[i]:
                    for j in range({lanes}):
                        error = get(state_F, j) - target[i]
                        put(total, j, get(total, j) + error * error)
        for j in range({lanes}):
            sums[first + j] = get(total, j)
"""
_COUNT = """most = 1
                        for j in range({lanes}):
                            most = max(most, int(get(across_parts, j)))"""


def squares(  # noqa: PLR0913 (the arrays of a record, as in `compiled.batch`)
    est: Estimator,
    sets: Sequence[Any],
    w: Wheelset,
    t_ns: Times,
    K: Floats,
    y: Floats,
    starts: Any,
    target: Floats,
    judged: Bools,
) -> Floats:
    """Sum of (F̂ − target)² over the samples judged [N²], of each parameter set, shape (sets,).

    Args:
        est: an estimator whose step comes in three functions.
        sets: its parameters, stable at the longest interval.
        w: constants of the wheelset.
        t_ns: times [ns], rising strictly within each segment, shape (n,).
        K: clamping force [N], shape (n,).
        y: wheel speed [rad/s], shape (n,).
        starts: first index of each segment, rising from 0.
        target: the force that F̂ is compared with [N], shape (n,).
        judged: which samples count, shape (n,).
    """
    order = _by_parts(est, sets, t_ns)
    full = -(-len(sets) // LANES) * LANES
    params = np.array([sets[i] for i in order] + [sets[order[-1]]] * (full - len(sets)), float)
    sums = np.empty(full)
    _loop(est)(
        params, np.array(w, float), np.ascontiguousarray(t_ns, np.int64),
        *(np.ascontiguousarray(x, np.float64) for x in (K, y)),
        np.ascontiguousarray(starts, np.int64), np.ascontiguousarray(target, np.float64),
        np.ascontiguousarray(judged, np.bool_), sums,
    )  # fmt: skip
    found = np.empty(len(sets))
    found[order] = sums[: len(sets)]
    return found


def _by_parts(est: Estimator, sets: Sequence[Any], t_ns: Times) -> list[int]:
    """The order of the sets by their sub-steps: neighbours wait for the one that has most."""
    split, numbers = est.split, list(range(len(sets)))
    if split is None or not split.has_parts or len(t_ns) < 2:
        return numbers
    h = max(float(np.median(np.diff(t_ns))), 1.0) * 1e-9
    return sorted(numbers, key=lambda i: float(split.across(split.fixed(sets[i]), h).parts))


@cache
def _loop(est: Estimator) -> Any:
    split = est.split
    assert split is not None
    made: list[type[Any]] = []
    fixed, across, state = (
        _Kept(name, kind, made)
        for name, kind in (
            ("fixed", get_type_hints(split.fixed)["return"]),
            ("across", split.Across),
            ("state", est.State),
        )
    )
    parts = split.has_parts
    text = _TEXT.format(
        lanes=LANES,
        constants=", ".join(f"constants[{i}]" for i in range(len(Wheelset._fields))),
        params=f"Params({', '.join(f'params[first + j, {i}]' for i in range(len(est.Params._fields)))})",  # noqa: E501
        memory="\n    ".join(
            f"{name} = lane()" for name in (*fixed.names, *across.names, *state.names, "total")
        ),
        fixed=fixed.read, across=across.read, state=state.read,
        put_fixed=fixed.put("f", 12), put_across=across.put("q", 28),
        put_state=state.put("s", 16),
        count=_COUNT.format(lanes=LANES) if parts else "",
        number=", float(n)" if parts else "",
        then=state.put("s", 28, "n < get(across_parts, j)" if parts else ""),
    )  # fmt: skip
    functions = {**split.functions, "init": est.init}
    types = {kind.__name__: kind for kind in (est.Params, Wheelset, *made)}
    return compiled.loop(f"lanes_{est.name}", text, {**functions, **types}, _math(), _memory())


class _Kept:
    """A NamedTuple of floats in the memory of the lanes, one place for each float.

    Args:
        name: first part of the names of the places.
        kind: the NamedTuple.
        made: receives its type and those inside.
    """

    def __init__(self, name: str, kind: type[Any], made: list[type[Any]]) -> None:
        self.names: list[str] = []  # of the places
        self._paths: list[str] = []  # of the floats
        self._made = made
        self.read = self._walk(name, "", kind)  # an expression

    def _walk(self, name: str, path: str, kind: type[Any]) -> str:
        if not hasattr(kind, "_fields"):
            self.names.append(name)
            self._paths.append(path)
            return f"get({name}, j)"
        if kind not in self._made:
            self._made.append(kind)
        hints = get_type_hints(kind)
        fields = [self._walk(f"{name}_{x}", f"{path}.{x}", hints[x]) for x in kind._fields]
        return f"{kind.__name__}({', '.join(fields)})"

    def put(self, value: str, indent: int, where: str = "") -> str:
        """Statements that keep `value`, in the lanes where a condition holds."""
        other = " if " + where + " else get({}, j)" if where else ""
        statements = [
            f"put({name}, j, {value}{path}{other.format(name)})"
            for name, path in zip(self.names, self._paths, strict=True)
        ]
        return ("\n" + " " * indent).join(statements)


@cache
def _math() -> ModuleType:
    """`math` as the lanes call it."""
    names = {name: getattr(lane_math, name) for name in ("exp", "expm1", "sin", "cos")}
    stands_in = ModuleType("math")
    vars(stands_in).update(vars(math) | names | {"pow": lane_math.power})
    return stands_in


@cache
def _memory() -> dict[str, Any]:
    """`lane`, `get`, `put` and `wide` for numba.

    Each place is memory of its own on the stack. The compiler knows that no two of them overlap,
    which it does not know of arrays.
    """
    from llvmlite import ir
    from numba import types as kinds
    from numba.core import cgutils
    from numba.extending import intrinsic

    types: Any = kinds  # neither has annotations
    tools: Any = cgutils

    def lane(context: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            place = tools.alloca_once(builder, ir.ArrayType(ir.DoubleType(), LANES))
            place.align = 64
            return tools.gep(builder, place, 0, 0)

        return types.CPointer(types.float64)(), code

    def get(context: Any, place: Any, j: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.load(builder.gep(args[0], [args[1]]))

        return types.float64(place, j), code

    def put(context: Any, place: Any, j: Any, x: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            builder.store(args[2], builder.gep(args[0], [args[1]]))
            return context.get_dummy_value()

        return types.void(place, j, types.float64), code

    def wide(context: Any) -> Any:
        """Vectors of 512 bits, where the machine has them; by itself the compiler takes half."""

        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            set.add(builder.function.attributes, '"prefer-vector-width"="512"')
            return context.get_dummy_value()

        return types.void(), code

    return {f.__name__: intrinsic(f) for f in (lane, get, put, wide)}
