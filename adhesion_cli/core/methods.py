"""Methods found in folders, one file each: what estimators and controllers have in common.

A method's name is its file's. The file holds

- `Params` and `State`, NamedTuples. Every field of `Params` has a default and is annotated
  `Annotated[float, Quantity(unit, text, low, high)]`. The last field of `State` is the answer.
- `init` and `step`, pure and plain Python on floats. They write `0.0`, never `0`: the type of a
  state field does not change. They import shared functions by name (`from ._noise import learn`).
- `ABOUT`, with title and source.

A file whose name starts with `_` holds shared functions, no method. The same `step` runs sample by
sample and, compiled by `compiled`, over whole logs.
"""

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Annotated, Any, NamedTuple, Protocol

from .errors import UserError, unknown
from .model import Quantity, quantities

# What control units accept (`export`). A longer interval is a gap: a method starts anew there.
Interval = Annotated[float, Quantity("s", "interval since the sample before", 1e-6, 10.0)]


@dataclass(frozen=True, slots=True)
class About:
    """What a method is called and where it was published."""

    title: str
    source: str


@dataclass(frozen=True, slots=True, eq=False)
class Method:
    """One method, as found in its file."""

    name: str
    title: str
    source: str
    Params: type[Any]
    State: type[Any]
    init: Callable[..., Any]
    step: Callable[..., Any]


class Kind(NamedTuple):
    """A kind of method: where its files lie and what they answer."""

    folder: str  # in the package
    noun: str  # "an estimator"
    about: type[About]  # what `ABOUT` is
    answer: tuple[str, ...]  # last fields of State
    meaning: str  # of them
    module: str  # that says what a file must hold

    @property
    def remedy(self) -> str:
        """Where the contents of such a file are explained."""
        return f"see `adhesion_cli.{self.module}` on what the file of {self.noun} holds"


def scan(kind: Kind) -> dict[str, tuple[Method, ModuleType]]:
    """Every method of a kind by name, sorted; a UserError for a file without one."""
    package = importlib.import_module(f"adhesion_cli.{kind.folder.replace('/', '.')}")
    methods: dict[str, tuple[Method, ModuleType]] = {}
    for name in sorted(info.name for info in pkgutil.iter_modules(package.__path__)):
        if not name.startswith("_"):
            module = importlib.import_module(f"{package.__name__}.{name}")
            methods[name] = _method(kind, name, module), module
    return methods


class Tunable(Protocol):
    """What has named parameters."""

    @property
    def name(self) -> str:
        """What users call it."""

    @property
    def Params(self) -> type[Any]:
        """The parameters."""


def parameters(tunable: Tunable) -> list[tuple[str, Quantity, float]]:
    """Name, `Quantity` and default of every parameter, in the order of `Params`."""
    defaults = tunable.Params._field_defaults
    return [(name, q, defaults[name]) for name, q in quantities(tunable.Params).items()]


def validate(tunable: Tunable, overrides: Mapping[str, float]) -> Any:
    """`Params` with `overrides` in place of defaults; a UserError for a bad name or value."""
    by_name = {name: quantity for name, quantity, _ in parameters(tunable)}
    for name, value in overrides.items():
        if name not in by_name:
            raise unknown(f"parameter of {tunable.name}", name, list(by_name))
        by_name[name].check(f"{tunable.name}.{name}", value)
    return tunable.Params(**{name: float(value) for name, value in overrides.items()})


def _method(kind: Kind, name: str, module: ModuleType) -> Method:
    path, names = module.__file__, ("ABOUT", "Params", "State", "init", "step")
    missing = [x for x in names if not hasattr(module, x)]
    if missing:
        raise UserError(f"{path}: not {kind.noun}, lacks {', '.join(missing)}", kind.remedy)
    about, P, S = module.ABOUT, module.Params, module.State
    if not isinstance(about, kind.about):
        text = f"{path}: ABOUT must be a `{kind.about.__module__}.{kind.about.__name__}`"
        raise UserError(text, kind.remedy)
    if S._fields[-len(kind.answer) :] != kind.answer:
        text = f"{path}: State must end with {', '.join(kind.answer)}: {kind.meaning}"
        raise UserError(text, kind.remedy)
    annotated = quantities(P)
    for field in P._fields:
        if field not in annotated or field not in P._field_defaults:
            text = f"{path}: Params.{field} lacks its Quantity or its default"
            raise UserError(text, kind.remedy)
    return Method(name, about.title, about.source, P, S, module.init, module.step)


def bind(f: Callable[..., Any], stand_ins: Mapping[Any, Any]) -> Callable[..., Any]:
    """A plain function that calls others in place of some: `stand_ins` maps them."""
    assert isinstance(f, FunctionType)
    names = {
        name: stand_ins.get(x, x) if isinstance(x, FunctionType) else x
        for name, x in f.__globals__.items()
    }
    return FunctionType(f.__code__, names, f.__name__, f.__defaults__)
