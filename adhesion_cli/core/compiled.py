"""Plain Python compiled: with `lanes`, the only module that knows numba.

`batch` runs an estimator over a whole log. For a hot loop of another module, write it as a plain
function of that module and call it through `function`:

    def march(x, h, n): ...            # plain floats and arrays, math, other plain functions

    fast = compiled.function(march)    # nothing is compiled before the first call
    fast(x, h, n)

Loops receive a part that they share as an argument, from `by_address`.

A compiled function calls other functions by name (`from .physics import G`, not `physics.G`).
These need no decorator. Arguments are positional: floats, ints, numpy arrays and NamedTuples of
importable modules. Each new combination of types compiles once.

A long call returns a number or nothing. More results go into arrays. numba would call Python to
make a NamedTuple, and Python crashes there if a signal (Ctrl-C) came meanwhile. Division by zero
gives inf or NaN, as in numpy. Arithmetic is strict: compiled and plain results are equal bit for
bit.

Machine code is kept on disk, in the user's cache folder, or in a temporary one if that cannot be
written. numba's own cache does not notice a change in another module. So each folder is named by a
hash over the files of all functions that a loop reaches and the constants that these name: an edit
compiles only the loops that it touches. Several processes may run at once.
"""

import math
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from .estimator import Estimator, check_step
from .model import Floats, Times, Wheelset


def _silent(text: str) -> None:
    """Reports nothing."""


tell: Callable[[str], None] = _silent  # reports what takes seconds; a program sets it

_KEEP = 64  # cache folders that stay, those used last: one per loop, of a few versions

# Only compiled code calls these functions. Inlined, tuples of arrays need no reference counts.
_INNER: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True}

_WRAPPER = """
def call({arguments}):
    return target({arguments})
"""

_making = threading.RLock()

_SAMPLE = "p, w, s, (t[i] - before) * 1e-9, K[i], y[i]"
_STEP = f"s = step({_SAMPLE})"
_SPLIT = """if t[i] - before != interval:
                interval = t[i] - before
                q = across(f, interval * 1e-9)
            {part}"""
_PART = "s = part(f, q, w, s, K[i], y[i])"
_PARTS = """for k in range(int(q.parts)):
                s = part(f, q, w, s, K[i], y[i], float(k))"""

# Slices, because an index that counts from 0 needs no check for a negative one.
_BATCH = """
def call(params, constants, t_all, K_all, y_all, starts, F_all, sigma_all, nis_all):
    p = Params({params})
    w = Wheelset({constants})
    {fixed}
    for j in range(len(starts)):
        segment = slice(starts[j], starts[j + 1] if j + 1 < len(starts) else len(t_all))
        t, K, y, F = t_all[segment], K_all[segment], y_all[segment], F_all[segment]
        sigma, squares = sigma_all[segment], nis_all[segment]
        s = init(p, w, K[0], y[0])
        F[0] = s.F
        {first}
        before = t[0]
        for i in range(1, len(t)):
            {judged}
            {step}
            F[i] = s.F
            {then}
            before = t[i]
"""


def batch(  # noqa: PLR0913 (the arrays of a record, without its class)
    est: Estimator,
    p: Any,
    w: Wheelset,
    t_ns: Times,
    K: Floats,
    y: Floats,
    starts: NDArray[np.int64],
) -> tuple[Floats, Floats | None]:
    """F̂ and its standard uncertainty [N] over one axle, shape (n,); None without one.

    Arguments and errors as of `judged`.
    """
    return _run(est, p, w, (t_ns, K, y), starts, False)[:2]


def judged(  # noqa: PLR0913 (the arrays of a record, without its class)
    est: Estimator,
    p: Any,
    w: Wheelset,
    t_ns: Times,
    K: Floats,
    y: Floats,
    starts: NDArray[np.int64],
) -> tuple[Floats, Floats | None, Floats | None]:
    """F̂, its standard uncertainty [N], normalised innovation squared, (n,); None without one.

    The last one is NaN at the samples that the estimator does not use.

    Args:
        est: the estimator.
        p: its parameters, from `methods.validated`.
        w: constants of the wheelset.
        t_ns: times [ns], rising strictly within each segment, shape (n,).
        K: clamping force [N], shape (n,).
        y: wheel speed [rad/s], shape (n,).
        starts: first index of each segment, rising from 0.

    Raises:
        UserError: where an interval is too long for `euler = 1`.
    """
    return _run(est, p, w, (t_ns, K, y), starts, est.nis is not None)


def _run(
    est: Estimator, p: Any, w: Wheelset, columns: tuple[Times, Floats, Floats],
    starts: NDArray[np.int64], judge: bool,
) -> tuple[Floats, Floats | None, Floats | None]:  # fmt: skip
    """As `judged`; without `judge` it is faster, and no innovation is known."""
    t, starts = (np.ascontiguousarray(x, np.int64) for x in (columns[0], starts))
    K, y = (np.ascontiguousarray(x, np.float64) for x in columns[1:])
    if est.longest_step(p) < math.inf:
        h = np.diff(t)
        h[starts[1:] - 1] = 0  # between segments
        check_step(est, p, float(h.max(initial=0)) * 1e-9)
    F, sigma = np.empty(len(t)), np.empty(len(t) if est.has_sigma else 0)
    squares = np.full(len(t) if judge else 0, np.nan)
    _loop(est, judge)(np.array(p, float), np.array(w, float), t, K, y, starts, F, sigma, squares)
    return F, sigma if est.has_sigma else None, squares if judge else None


def function(target: Any, stand_ins: Mapping[Any, Any] | None = None) -> Callable[..., Any]:
    """`target`, a plain function at module level, compiled at its first call and kept on disk.

    Args:
        target: the function.
        stand_ins: plain functions, by those that they replace wherever one is named.
    """
    assert isinstance(target, FunctionType)
    stand_ins = stand_ins or {}
    code = target.__code__
    arguments = ", ".join(code.co_varnames[: code.co_argcount])
    name = "_".join(f"{f.__module__}.{f.__name__}" for f in (target, *stand_ins.values()))
    return _once(
        name.replace(".", "_"), _WRAPPER.format(arguments=arguments), (("target", target),),
        tuple(stand_ins.items()),
    )  # fmt: skip


def by_address(target: Any, *examples: Any) -> Any:
    """`target` compiled alone, as an argument for compiled functions that call it.

    They hold its address, not its code. So it is compiled once for all of them.

    Args:
        target: the function, as in `function`.
        examples: arguments of the types it is compiled for.
    """
    from numba import typeof
    from numba.core.types import WrapperAddressProtocol

    call: Any = function(target)
    types = tuple(map(typeof, examples))
    call.compile(types)
    made = call.overloads[types]
    wrapper = made.fndesc.llvm_cfunc_wrapper_name
    address = int(made.library.get_pointer_to_function(wrapper))

    class Address(WrapperAddressProtocol):
        def __wrapper_address__(self) -> int:
            return address

        def signature(self) -> Any:
            return made.signature

    return Address()


def _loop(est: Estimator, judge: bool) -> Callable[..., Any]:
    split = est.split
    part = _PARTS if split and split.has_parts else _PART
    text = _BATCH.format(
        fixed="f, interval = fixed(p), 1\n    q = across(f, 1e-9)" if split else "",
        step=_SPLIT.format(part=part) if split else _STEP,
        params=", ".join(f"params[{i}]" for i in range(len(est.Params._fields))),
        constants=", ".join(f"constants[{i}]" for i in range(len(Wheelset._fields))),
        first="sigma[0] = s.sigma" if est.has_sigma else "",
        then="sigma[i] = s.sigma" if est.has_sigma else "",
        judged=f"squares[i] = nis({_SAMPLE})" if judge else "",
    )
    functions = split.functions if split else {"step": est.step}
    reached = {"init": est.init, "Params": est.Params, "Wheelset": Wheelset, **functions}
    reached |= {"nis": est.nis} if judge else {}
    return _once(f"{'judged' if judge else 'batch'}_{est.name}", text, tuple(reached.items()))


def loop(
    name: str, text: str, reached: Mapping[str, Any], math: ModuleType, given: Mapping[str, Any]
) -> Callable[..., Any]:
    """`call` of the source `text`; sums of products may be rounded once (`lanes`).

    Args:
        name: of the source.
        text: the source.
        reached: plain functions and types by the names that it has for them.
        math: the module that these functions find as `math`.
        given: what numba takes as it is, by name.
    """
    return _once(name, text, tuple(reached.items()), (), math, tuple(given.items()))


def _once(*of: Any) -> Callable[..., Any]:
    """`_compiled`, whatever threads ask for it."""
    with _making:
        return _compiled(*of)


@cache
def _compiled(
    name: str, text: str, reached: tuple[tuple[str, Any], ...],
    stand_ins: tuple[tuple[Any, Any], ...] = (), math: ModuleType | None = None,
    given: tuple[tuple[str, Any], ...] = (),
) -> Callable[..., Any]:  # fmt: skip
    """`call` of the source `text`, which finds the objects `reached` under their names.

    Of each pair of `stand_ins` the second function is called wherever the first one is named. The
    source is a separate file, because numba's disk cache recognises a function by its file. It does
    not recognise a function that is an argument or a closure.
    """
    from numba import njit

    _load()
    folder = _folder(_key(x for _, x in (*reached, *stand_ins)))
    if not any(folder.glob(f"__pycache__/{name}.call-*.nbi")):
        tell("compiling, for the first run with these methods ...")
    path = folder / f"{name}.py"
    kept = _kept(path, text)
    module = sys.modules[name] = ModuleType(name)  # where numba looks for its globals
    lower = _Lower(math)
    for named, called in stand_ins:
        lower.done[named] = lower(called)
    module.__dict__.update(given)
    for key, x in reached:
        setattr(module, key, lower(x) if isinstance(x, FunctionType) else x)
    exec(compile(text, path, "exec"), module.__dict__)
    call: Any = njit(cache=kept, nogil=True, **lower.flags)(module.__dict__["call"])
    if kept:
        call._cache = _Cache(call._cache)
    made: Callable[..., Any] = call
    return made


class _Cache:
    """numba's cache on disk: one that is damaged or full costs time, and never a run."""

    def __init__(self, numbas: Any) -> None:
        self._numbas = numbas

    def __getattr__(self, name: str) -> Any:
        return getattr(self._numbas, name)

    def load_overload(self, *of: Any) -> Any:
        """The machine code for a signature; None where there is none that can be read."""
        try:
            return self._numbas.load_overload(*of)
        except Exception:  # whatever bytes are there: any error of pickle, or of numba
            tell("the cache of compiled code is damaged: compiling anew ...")
            with suppress(OSError):
                self._numbas.flush()
            return None

    def save_overload(self, *of: Any) -> None:
        """Keeps the machine code for a signature, where the disk takes it."""
        try:
            self._numbas.save_overload(*of)
        except OSError as error:
            tell(f"the cache of compiled code cannot be written: {error}")


@cache
def _load() -> None:
    """Loads numba's array functions without scipy.linalg, which takes a fifth of a short run.

    numba looks for it here, and again when it compiles a function that needs it.
    """
    from numba.np import linalg

    look: Any = getattr(linalg, "ensure_blas", None)
    linalg.ensure_blas = _absent
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = look


def _absent() -> NoReturn:
    raise ImportError


class _Lower:
    """Plain functions for numba, with every plain function that they name.

    Args:
        math: what they find as `math`, with plain functions; then products and sums may be fused.
    """

    def __init__(self, math: ModuleType | None) -> None:
        self.done: dict[FunctionType, Any] = {}
        self.flags: dict[str, Any] = {"error_model": "numpy"}
        self._math: ModuleType | None = None
        if math:
            self.flags["fastmath"] = {"contract"}
            lowered = ModuleType("math")
            for name, x in vars(math).items():
                setattr(lowered, name, self(x) if isinstance(x, FunctionType) else x)
            self._math = lowered

    def __call__(self, f: FunctionType) -> Any:
        from numba import njit

        if f not in self.done:
            names = dict(f.__globals__)
            for name in f.__code__.co_names:
                if isinstance(names.get(name), FunctionType):
                    names[name] = self(names[name])
            if self._math and "math" in names:
                names["math"] = self._math
            plain = FunctionType(f.__code__, names, f.__name__, f.__defaults__)
            self.done[f] = njit(**self.flags, **_INNER)(plain)
        return self.done[f]


def _key(roots: Iterable[Any]) -> str:
    """A hash over what functions and types, and all that these name, are made of.

    These are the files of functions and types, and the values of constants from any file.
    """
    files, constants = set[Path](), set[str]()
    waiting, seen = list(roots), set[int]()
    while waiting:
        code = waiting.pop()
        if id(code) in seen:
            continue
        seen.add(id(code))
        files.add(Path(sys.modules[code.__module__].__file__ or "").resolve())
        for name in code.__code__.co_names if isinstance(code, FunctionType) else ():
            value = code.__globals__.get(name)
            if isinstance(value, FunctionType | type) and value.__module__ != "builtins":
                waiting.append(value)
            elif isinstance(value, int | float | tuple):
                constants.add(f"{name} {value!r}")
    parts = [*map(_source, sorted(files)), *(text.encode() for text in sorted(constants))]
    return sha256(b"\0".join(parts)).hexdigest()[:16]


def _folder(key: str) -> Path:
    """The cache folder of a key; makes it, and deletes those that were not used for long."""
    folder = _root() / key
    try:
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        os.utime(folder)  # the latest used
    except OSError:
        return Path(tempfile.mkdtemp(prefix="adhesion-"))
    _prune(folder.parent)
    return folder


def _root() -> Path:
    """Where the cache is, unless it cannot be written."""
    named = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return Path(named or Path.home() / ".cache") / "adhesion-cli"


@cache
def _source(path: Path) -> bytes:
    return path.name.encode() + b"\0" + path.read_bytes() + b"\0"


def _prune(root: Path) -> None:
    with suppress(OSError):  # another process may do the same
        folders = sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for old in folders[_KEEP:]:
            shutil.rmtree(old, ignore_errors=True)


def _kept(path: Path, text: str) -> bool:
    """Whether `path` holds the text; it is written if it did not, and the disk takes it.

    It is written whole, with one fixed time: numba then accepts the copy of every process.
    """
    part = path.with_suffix(f".{os.getpid()}")
    try:
        if not path.exists() or path.read_text("utf-8", "replace") != text:
            part.write_text(text, encoding="utf-8")
            os.utime(part, (0, 0))
            os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        tell(f"the cache of compiled code cannot be written: {error}")
        return False
    return True
