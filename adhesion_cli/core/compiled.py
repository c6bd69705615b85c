"""Plain Python compiled: the only module that knows numba.

`batch` runs an estimator over a whole log. For a hot loop of another module, write it as a plain
function of that module and call it through `function`:

    def march(x, h, n): ...            # plain floats and arrays, math, other plain functions

    fast = compiled.function(march)    # nothing is compiled before the first call
    fast(x, h, n)

A compiled function calls other functions by name (`from .physics import G`, not `physics.G`).
These need no decorator. Arguments are positional: floats, ints, numpy arrays and NamedTuples of
importable modules. Each new combination of types compiles once.

A long call returns a number or nothing. More results go into arrays. numba would call Python to
make a NamedTuple, and Python crashes there if a signal (Ctrl-C) came meanwhile. Division by zero
gives inf or NaN, as in numpy. Arithmetic is strict: compiled and plain results are equal bit for
bit.

Machine code is kept on disk, in the user's cache folder. numba's own cache does not notice a change
in another module. So each folder is named by a hash over the files of all functions that a loop
reaches and the constants that these name: an edit compiles only the loops that it touches. Several
processes may run at once.
"""

import math
import os
import shutil
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .cache_folder import cache_folder, silent
from .estimator import Estimator, check_step
from .model import Floats, Times, Wheelset

report: Callable[[str], None] = silent  # reports what takes seconds; a program sets it

_KEPT_FOLDERS = 64  # cache folders that stay, those used last: one per loop, of a few versions

_compiling = threading.RLock()

# Slices, because an index that counts from 0 needs no check for a negative one.
_BATCH = """
def call(params, constants, t_all, K_all, y_all, starts, F_all, sigma_all, nis_all):
    p = Params({params})
    w = Wheelset({constants})
    for j in range(len(starts)):
        segment = slice(starts[j], starts[j + 1] if j + 1 < len(starts) else len(t_all))
        t, K, y, F = t_all[segment], K_all[segment], y_all[segment], F_all[segment]
        sigma, squares = sigma_all[segment], nis_all[segment]
        s = init(p, w, K[0], y[0])
        F[0] = s.F
        {sigma_first}
        for i in range(1, len(t)):
            h = (t[i] - t[i - 1]) * 1e-9
            {nis}
            s = step(p, w, s, h, K[i], y[i])
            F[i] = s.F
            {sigma}
"""


class Estimate(NamedTuple):
    """What an estimator says over one axle; columns of shape (n,)."""

    force: Floats  # F̂ [N]
    sigma: Floats | None  # its standard uncertainty [N]; None where the method has none
    nis: Floats | None  # normalised innovation squared; NaN at samples that it does not use


def batch(  # noqa: PLR0913 (the arrays of a record, without its class)
    est: Estimator,
    p: Any,
    w: Wheelset,
    t_ns: Times,
    K: Floats,
    y: Floats,
    starts: NDArray[np.int64],
) -> Estimate:
    """An estimator over the samples of one axle.

    Args:
        est: the estimator.
        p: its parameters, from `methods.validate`.
        w: constants of the wheelset.
        t_ns: times [ns], rising strictly within each segment, shape (n,).
        K: clamping force [N], shape (n,).
        y: wheel speed [rad/s], shape (n,).
        starts: first index of each segment, rising from 0.

    Raises:
        UserError: where an interval is too long for `euler = 1`.
    """
    t, starts = (np.ascontiguousarray(x, np.int64) for x in (t_ns, starts))
    K, y = (np.ascontiguousarray(x, np.float64) for x in (K, y))
    if est.longest_step(p) < math.inf:
        h = np.diff(t)
        h[starts[1:] - 1] = 0  # between segments
        check_step(est, p, float(h.max(initial=0)) * 1e-9)
    F, sigma = np.empty(len(t)), np.empty(len(t) if est.has_sigma else 0)
    nis = np.full(len(t) if est.nis else 0, np.nan)
    _loop(est)(np.array(p, float), np.array(w, float), t, K, y, starts, F, sigma, nis)
    return Estimate(F, sigma if est.has_sigma else None, nis if est.nis else None)


def function(target: Any, stand_ins: Mapping[Any, Any] | None = None) -> Callable[..., Any]:
    """`target`, a plain function at module level, compiled at its first call and kept on disk.

    `stand_ins` are plain functions, by those that they replace wherever one is named.
    """
    assert isinstance(target, FunctionType)
    stand_ins = stand_ins or {}
    name = "_".join(f"{f.__module__}.{f.__name__}" for f in (target, *stand_ins.values()))
    with _compiling:
        return _compiled(name.replace(".", "_"), target, (), tuple(stand_ins.items()))


def _loop(est: Estimator) -> Callable[..., Any]:
    text = _BATCH.format(
        params=", ".join(f"params[{i}]" for i in range(len(est.Params._fields))),
        constants=", ".join(f"constants[{i}]" for i in range(len(Wheelset._fields))),
        sigma_first="sigma[0] = s.sigma" if est.has_sigma else "",
        sigma="sigma[i] = s.sigma" if est.has_sigma else "",
        nis="squares[i] = nis(p, w, s, h, K[i], y[i])" if est.nis else "",
    )
    names = {"init": est.init, "step": est.step, "Params": est.Params, "Wheelset": Wheelset}
    if est.nis:
        names["nis"] = est.nis
    with _compiling:
        return _compiled(f"batch_{est.name}", text, tuple(names.items()))


@cache
def _compiled(
    name: str,
    source: str | FunctionType,
    names: tuple[tuple[str, Any], ...],
    stand_ins: tuple[tuple[Any, Any], ...] = (),
) -> Callable[..., Any]:
    """A function, or `call` of a source that finds functions and types under these names.

    Of each pair of `stand_ins` the second function is called wherever the first one is named. Each
    has a file of its own, because numba's disk cache recognises a function by its file. It does not
    recognise a function that is an argument or a closure.
    """
    from numba import njit

    roots = [x for _, x in (*names, *stand_ins)]
    folder = _folder(_key(roots if isinstance(source, str) else [source, *roots]))
    if not any(folder.glob(f"__pycache__/{name}.*.nbi")):
        report("compiling, for the first run with these methods ...")
    path = folder / f"{name}.py"
    has_file = _write_source(path, source if isinstance(source, str) else "")
    lowered: dict[FunctionType, Any] = {}
    for replaced, replacement in stand_ins:
        lowered[replaced] = _lower(replacement, lowered)
    if isinstance(source, str):
        module = sys.modules[name] = ModuleType(name)  # where numba looks for its globals
        for key, x in names:
            setattr(module, key, _lower(x, lowered) if isinstance(x, FunctionType) else x)
        exec(compile(source, path, "exec"), module.__dict__)
        plain = module.__dict__["call"]
    else:  # no second function around it: that costs a third of the compiling
        plain = _copy(source, _functions(source, lowered), str(path))
    options: Any = {"cache": has_file, "nogil": True, "no_cfunc_wrapper": True}
    call: Any = njit(error_model="numpy", **options)(plain)
    if has_file:
        call._cache = _Cache(call._cache)
    dispatcher: Callable[..., Any] = call
    return dispatcher


def _lower(f: FunctionType, lowered: dict[FunctionType, Any]) -> Any:
    """A plain function for numba, with every plain one that it names; `lowered` receives both."""
    if f not in lowered:
        named = {name: f.__globals__.get(name) for name in f.__code__.co_names}
        constants = {name: x for name, x in named.items() if isinstance(x, int | float | tuple)}
        lowered[f] = _inner(f, tuple(_functions(f, lowered).items()), repr(constants))
    return lowered[f]


def _functions(f: FunctionType, lowered: dict[FunctionType, Any]) -> dict[str, object]:
    """The plain functions that `f` names, for numba; arguments as of `_lower`."""
    named = {name: f.__globals__.get(name) for name in f.__code__.co_names}
    return {name: _lower(x, lowered) for name, x in named.items() if isinstance(x, FunctionType)}


def _copy(f: FunctionType, functions: Mapping[str, object], file: str) -> FunctionType:
    """The function of that file which calls these functions, by name."""
    code = f.__code__.replace(co_filename=file)
    return FunctionType(code, f.__globals__ | dict(functions), f.__name__, f.__defaults__)


@cache
def _inner(f: FunctionType, functions: tuple[tuple[str, Any], ...], constants: str) -> Any:
    """A function that only compiled code calls, shared by all; `constants` are what it names."""
    from numba import njit

    copy = _copy(f, dict(functions), f.__code__.co_filename)
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(error_model="numpy", **options)(copy)


class _Cache:
    """numba's cache on disk: one that is damaged or full costs time, and never a run."""

    def __init__(self, numba_cache: Any) -> None:
        self._numba_cache = numba_cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._numba_cache, name)

    def load_overload(self, *signature: Any) -> Any:
        """The machine code for a signature; None where there is none that can be read."""
        try:
            return self._numba_cache.load_overload(*signature)
        except Exception:  # whatever bytes are there: any error of pickle, or of numba
            report("the cache of compiled code is damaged: compiling anew ...")
            with suppress(OSError):
                self._numba_cache.flush()
            return None

    def save_overload(self, *signature: Any) -> None:
        """Keeps the machine code for a signature, where the disk takes it."""
        try:
            self._numba_cache.save_overload(*signature)
        except OSError as error:
            report(f"the cache of compiled code cannot be written: {error}")


def _key(roots: Iterable[Any]) -> str:
    """A hash over the files of functions and types, of all that these name, and over constants."""
    files, constants = set[Path](), set[str]()
    waiting, visited = list(roots), set[int]()
    while waiting:
        code = waiting.pop()
        if id(code) in visited:
            continue
        visited.add(id(code))
        files.add(Path(sys.modules[code.__module__].__file__ or "").resolve())
        for name in code.__code__.co_names if isinstance(code, FunctionType) else ():
            value = code.__globals__.get(name)
            if isinstance(value, FunctionType | type) and value.__module__ != "builtins":
                waiting.append(value)
            elif isinstance(value, int | float | tuple):
                constants.add(f"{name} {value!r}")
    contents = [*map(_source, sorted(files)), *(text.encode() for text in sorted(constants))]
    return sha256(b"\0".join(contents)).hexdigest()[:16]


def _folder(key: str) -> Path:
    """The cache folder of a key; makes it, and deletes those that were not used for long."""
    folder = cache_folder() / key
    with suppress(OSError):  # a full disk
        folder.mkdir(exist_ok=True)
        os.utime(folder)  # the latest used
    _prune(folder.parent)
    return folder


@cache
def _source(path: Path) -> bytes:
    return path.name.encode() + b"\0" + path.read_bytes() + b"\0"


def _prune(root: Path) -> None:
    with suppress(OSError):  # another process may do the same
        folders = sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for folder in folders[_KEPT_FOLDERS:]:
            shutil.rmtree(folder, ignore_errors=True)


def _write_source(path: Path, text: str) -> bool:
    """Whether `path` holds the text, written whole, with the one time that numba accepts."""
    temporary = path.with_suffix(f".{os.getpid()}")
    try:
        if not path.exists() or path.read_text("utf-8", "replace") != text:
            temporary.write_text(text, encoding="utf-8")
            os.utime(temporary, (0, 0))
            os.replace(temporary, path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        report(f"the cache of compiled code cannot be written: {error}")
        return False
    return True
