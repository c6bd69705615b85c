"""What an online estimator is, and which ones there are.

An estimator is one file in `estimators/`, its name is the file's. It holds

- `Params` and `State`, NamedTuples. Every field of `Params` has a default and is annotated
  `Annotated[float, Quantity(unit, text, low, high)]`; the last field of `State` is `F`, the
  estimate [N];
- `init(p, w, K, y) -> State`, the state at the first sample of a segment;
- `step(p, w, s, h, K, y) -> State`, the state one sample later: `w` is `model.Wheelset`, `h` the
  actual interval to this sample [s], `K` its clamping force [N], `y` its wheel speed [rad/s];
- `ABOUT`, one `About` record.

`init` and `step` are pure and plain Python on floats (`0.0`, never `0`: the type of a
state field does not change), and import the functions they share by name
(`from ._han import fal_gain`); a file whose name starts with `_` is such a helper, no estimator.
The same `step` runs sample by sample (`online`) and compiled over whole logs (`compiled.batch`).
Optional is `longest_step(p) -> float`, the longest interval [s] at which `step` is stable, for
parameters with which that is not every interval.

Time and rate. At t_k both ends of the interval (t_{k-1}, t_k] are known, so an estimator takes K
and y as straight lines across it: exact for ramps, and half an interval from a jump wherever in
the interval it was; the answer then depends on the signals, not on how often they were logged.
`euler = 1` is the printed alternative: both held at their value at t_{k-1}.

Start. ω̂ = y and F̂ = 0, as in the paper, also where a segment starts in mid-brake: the wheel may be
sliding there, so no better force is known. Such a segment opens with the response time.
"""

import importlib
import importlib.util
import math
import sys
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, Protocol

from .errors import UserError, unknown
from .model import Quantity, Wheelset


class Claim(NamedTuple):
    """How well an estimator follows the true force on a named scenario; tests hold it to that."""

    rmse: float  # [N]
    lag: float  # [s]


@dataclass(frozen=True, slots=True)
class About:
    """What a method is called, where it was published, and what it claims by scenario name."""

    title: str
    source: str
    claims: Mapping[str, Claim]


@dataclass(frozen=True, slots=True, eq=False)
class Estimator:
    """One estimator, as found in its file."""

    name: str
    title: str
    source: str
    claims: Mapping[str, Claim]
    Params: type[Any]
    State: type[Any]
    init: Callable[..., Any]
    step: Callable[..., Any]
    longest_step: Callable[[Any], float]
    path: Path


def registry(*extra_folders: Path) -> dict[str, Estimator]:
    """Every estimator by name, sorted: the package's own, then those of `extra_folders`.

    Raises:
        UserError: for a folder that is none, a file that is no estimator, a name given twice.
    """
    own = Path(__file__).parent / "estimators"
    found: dict[str, Estimator] = {}
    for folder in (own, *map(Path, extra_folders)):
        if not folder.is_dir():
            raise UserError(f"{folder}: no such folder of estimators", code=2)
        for path in sorted(folder.glob("[!_]*.py")):
            if path.stem in found:
                first = found[path.stem].path
                raise UserError(f"{path}: {path.stem!r} is already {first}", "rename the file")
            found[path.stem] = _estimator(path, _module(path, packaged=folder is own))
    return dict(sorted(found.items()))


class Tunable(Protocol):
    """What has named parameters: an estimator, a controller."""

    @property
    def name(self) -> str:
        """What users call it."""

    @property
    def Params(self) -> type[Any]:
        """The parameters."""


def parameters(est: Tunable) -> list[tuple[str, Quantity, float]]:
    """Name, `Quantity` and default of every parameter, in the order of `Params`."""
    hints = typing.get_type_hints(est.Params, include_extras=True)
    defaults = est.Params._field_defaults
    return [(name, hints[name].__metadata__[0], defaults[name]) for name in est.Params._fields]


def validated(est: Tunable, overrides: Mapping[str, float]) -> Any:
    """`est.Params` with `overrides` in place of defaults.

    Raises:
        UserError: for a name that is no parameter, or a value outside its range.
    """
    known = {name: quantity for name, quantity, _ in parameters(est)}
    for name, value in overrides.items():
        if name not in known:
            raise unknown(f"parameter of {est.name}", name, list(known))
        q = known[name]
        if not q.low <= value <= q.high:
            raise UserError(
                f"{est.name}.{name} = {value:g} is out of range ({q.text})",
                f"{q.low:g} to {q.high:g} {q.unit}",
                code=2,
            )
    return est.Params(**{name: float(value) for name, value in overrides.items()})


def online(
    est: Estimator, p: Any, w: Wheelset, samples: Iterable[tuple[int, float, float]]
) -> Iterator[float]:
    """F̂ [N] after each sample of one segment, as the samples arrive; needs no compiler.

    Args:
        est: the estimator.
        p: its parameters, from `validated`.
        w: constants of the wheelset.
        samples: (time [ns], K [N], y [rad/s]), time rising strictly.

    Raises:
        UserError: at an interval at which these parameters are unstable.
    """
    state: Any = None
    before = 0
    for t, K, y in samples:
        if state is None:
            state = est.init(p, w, K, y)
        else:
            h = (t - before) * 1e-9
            check_step(est, p, h)
            state = est.step(p, w, state, h, K, y)
        before = t
        yield state.F


def check_step(est: Estimator, p: Any, h: float) -> None:
    """Refuse an interval `h` [s] at which `est` with parameters `p` is unstable.

    Raises:
        UserError: naming the longest stable interval.
    """
    longest = est.longest_step(p)
    if h > longest:
        raise UserError(
            f"{est.name}: an interval of {h:.4g} s is unstable with euler = 1, "
            f"the longest stable one is {longest:.4g} s",
            f"leave {est.name}.euler at 0, which is stable at every interval",
        )


def _module(path: Path, packaged: bool) -> ModuleType:
    """The module at `path`; one outside the package is loaded anew, under a name of its own."""
    try:
        if packaged:
            return importlib.import_module(f"{__package__}.estimators.{path.stem}")
        folder = sha256(str(path.parent.resolve()).encode()).hexdigest()[:8]
        spec = importlib.util.spec_from_file_location(f"estimators_{folder}.{path.stem}", path)
        assert spec is not None  # the name ends in .py
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # where annotations are looked up
        spec.loader.exec_module(module)
    except Exception as e:
        raise UserError(f"{path}: cannot be loaded: {type(e).__name__}: {e}", _REMEDY) from e
    return module


def _estimator(path: Path, module: ModuleType) -> Estimator:
    names = ("ABOUT", "Params", "State", "init", "step")
    missing = [name for name in names if not hasattr(module, name)]
    if missing:
        raise UserError(f"{path}: not an estimator, lacks {', '.join(missing)}", _REMEDY)
    about, P, S = module.ABOUT, module.Params, module.State
    if not isinstance(about, About):
        raise UserError(f"{path}: ABOUT must be an `About`", _REMEDY)
    est = Estimator(
        path.stem, about.title, about.source, about.claims, P, S, module.init, module.step,
        getattr(module, "longest_step", _any_step), path,
    )  # fmt: skip
    if S._fields[-1] != "F":
        raise UserError(f"{path}: the last field of State must be F, the estimate [N]", _REMEDY)
    hints = typing.get_type_hints(P, include_extras=True)
    for name in P._fields:
        quantity = getattr(hints[name], "__metadata__", (None,))[0]
        if not isinstance(quantity, Quantity) or name not in P._field_defaults:
            raise UserError(f"{path}: Params.{name} lacks its Quantity or its default", _REMEDY)
    return est


def _any_step(p: Any) -> float:
    return math.inf


_REMEDY = "see `adhesion_cli.estimator` on what an estimator file holds"
