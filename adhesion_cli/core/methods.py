"""Methods found in folders, one file each: what estimators and controllers have in common.

A method's name is its file's. The file holds

- `Params` and `State`, NamedTuples. Every field of `Params` has a default and is annotated
  `Annotated[float, Quantity(unit, text, low, high)]`. The last field of `State` is the answer.
- `init` and `step`, pure and plain Python on floats. They write `0.0`, never `0`: the type of a
  state field does not change. They import shared functions by name (`from ._han import fal_gain`).
- `ABOUT`, with title and source.

A file whose name starts with `_` holds shared functions, no method. The same `step` runs sample by
sample and, compiled by `compiled`, over whole logs.
"""

import importlib
import importlib.util
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
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
    path: Path


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


def scan(kind: Kind, *extra_folders: Path) -> dict[str, tuple[Method, ModuleType]]:
    """Every method of a kind by name, sorted: the package's own, then those of `extra_folders`.

    Raises:
        UserError: for a folder that does not exist, a file without such a method, a repeated name.
    """
    packaged_folder = Path(__file__).parents[1] / kind.folder
    methods: dict[str, tuple[Method, ModuleType]] = {}
    for folder in (packaged_folder, *map(Path, extra_folders)):
        if not folder.is_dir():
            raise UserError(f"{folder}: no such folder of {Path(kind.folder).name}", code=2)
        for path in sorted(folder.glob("[!_]*.py")):
            if path.stem in methods:
                existing = methods[path.stem][0].path
                raise UserError(f"{path}: {path.stem!r} is already {existing}", "rename the file")
            module = _module(kind, path, packaged=folder is packaged_folder)
            methods[path.stem] = _method(kind, path, module), module
    return dict(sorted(methods.items()))


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
    """`of.Params` with `overrides` in place of defaults.

    Raises:
        UserError: for a name that is no parameter, or a value outside its range.
    """
    by_name = {name: quantity for name, quantity, _ in parameters(tunable)}
    for name, value in overrides.items():
        if name not in by_name:
            raise unknown(f"parameter of {tunable.name}", name, list(by_name))
        by_name[name].check(f"{tunable.name}.{name}", value)
    return tunable.Params(**{name: float(value) for name, value in overrides.items()})


def _module(kind: Kind, path: Path, packaged: bool) -> ModuleType:
    """The module at `path`; one outside the package is loaded anew, under a unique name."""
    try:
        if packaged:
            place = kind.folder.replace("/", ".")
            return importlib.import_module(f"adhesion_cli.{place}.{path.stem}")
        # Named by its contents, wherever it is: cached machine code needs the same name again.
        sources = b"".join(p.read_bytes() for p in sorted(path.parent.glob("*.py")))
        folder = sha256(sources).hexdigest()[:8]
        spec = importlib.util.spec_from_file_location(
            f"{Path(kind.folder).name}_{folder}.{path.stem}", path
        )
        assert spec is not None  # the name ends in .py
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # where annotations are looked up
        spec.loader.exec_module(module)
    except Exception as e:
        text = f"{path}: cannot be loaded: {type(e).__name__}: {e}"
        raise UserError(text, kind.remedy) from e
    return module


def _method(kind: Kind, path: Path, module: ModuleType) -> Method:
    names = ("ABOUT", "Params", "State", "init", "step")
    missing = [name for name in names if not hasattr(module, name)]
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
    for name in P._fields:
        if name not in annotated or name not in P._field_defaults:
            text = f"{path}: Params.{name} lacks its Quantity or its default"
            raise UserError(text, kind.remedy)
    return Method(path.stem, about.title, about.source, P, S, module.init, module.step, path)


def bind(f: Callable[..., Any], stand_ins: Mapping[Any, Any]) -> Callable[..., Any]:
    """A plain function that calls others in place of some: `stand_ins` maps them."""
    assert isinstance(f, FunctionType)
    names = {
        name: stand_ins.get(x, x) if isinstance(x, FunctionType) else x
        for name, x in f.__globals__.items()
    }
    return FunctionType(f.__code__, names, f.__name__, f.__defaults__)
