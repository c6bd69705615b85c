"""What a check is, and which ones there are.

A check is a file in `diagnostics/checks/`; its name is the file's. The file holds

- `ABOUT`, of the type here;
- `Params`, a NamedTuple of every threshold. Each field has a default and is annotated
  `Annotated[float, Quantity(unit, text, low, high)]`. The text says why;
- `check(p, scene) -> Iterator[Finding]`, which changes nothing.

A file whose name starts with `_` is a helper of checks.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ..core import methods
from ..core.finding import Finding
from ..dynamics.train_grid import Scene
from ..records.screen import Thresholds


class About(NamedTuple):
    """What a check looks for, and which checks it comes after.

    Of each group, the checks after the first one that warns are not run: they would report the
    same error again by what follows from it.
    """

    title: str
    group: str
    rank: int  # place within the group


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """One check, as found in its file."""

    name: str  # as settings have it: "diagnostics.vehicle"
    about: About
    Params: type[Any]
    check: Callable[[Any, Scene], Iterator[Finding]]


@cache
def registry() -> Mapping[str, Check]:
    """Every check by name, in the order in which they run."""
    found = []
    for path in Path(__file__).with_name("checks").glob("[!_]*.py"):
        module = importlib.import_module(f"{__package__}.checks.{path.stem}")
        name = f"diagnostics.{path.stem}"
        found.append(Check(name, module.ABOUT, module.Params, module.check))
    found.sort(key=lambda c: (c.about.group, c.about.rank))
    return {c.name.partition(".")[2]: c for c in found}


class Sensors(NamedTuple):
    """A check of single channels: its file lies in `records/`, and `records.screen` makes it."""

    name: str  # as settings have it: "diagnostics.outliers"
    about: methods.About
    Params: type[Any]


def tunable() -> Mapping[str, Check | Sensors]:
    """Every check that has thresholds, by name: those of single channels first."""
    alone = {}
    for name in Thresholds._fields:
        module = importlib.import_module(f"..records.{name}", __package__)
        alone[name] = Sensors(f"diagnostics.{name}", module.ABOUT, module.Params)
    return alone | dict(registry())
