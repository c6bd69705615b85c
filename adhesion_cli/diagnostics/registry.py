"""What a check is, and which ones there are.

A check is a file in `diagnostics/checks/`; its name is the file's. The file holds

- `ABOUT`, of the type here;
- `Params`, a NamedTuple of every threshold. Each field has a default and is annotated
  `Annotated[float, Quantity(unit, text, low, high)]`. The text says why;
- `check(p, scene) -> Iterator[Finding]`, which changes nothing.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ..core import methods
from ..core.finding import Finding
from ..records.screen import Thresholds
from .scene import Scene

Checks = Mapping[str, Any]  # parameters of checks, by the check's name


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


class Sensors(NamedTuple):
    """A check of single channels.

    `records.screen` makes those in `records/`. `noise_model` comes after the estimators.
    """

    name: str  # as settings have it: "diagnostics.outliers"
    about: methods.About
    Params: type[Any]


@cache
def registry() -> Mapping[str, Check]:
    """Every check by name, in the order in which they run."""
    checks = {}
    folder = str(Path(__file__).with_name("checks"))
    for name in (m.name for m in pkgutil.iter_modules([folder])):
        module = importlib.import_module(f"{__package__}.checks.{name}")
        checks[name] = Check(f"diagnostics.{name}", module.ABOUT, module.Params, module.check)
    return dict(sorted(checks.items(), key=lambda x: x[1].about[1:]))


def tunable() -> Mapping[str, Check | Sensors]:
    """Every check that has thresholds, by name: those of single channels first."""
    sensor_checks = {}
    files = {name: f"..records.{name}" for name in Thresholds._fields}
    for name, file in {**files, "noise_model": ".noise_model"}.items():
        module = importlib.import_module(file, __package__)
        sensor_checks[name] = Sensors(f"diagnostics.{name}", module.ABOUT, module.Params)
    return sensor_checks | dict(registry())


def diagnose(scene: Scene, params: Checks | None = None) -> list[Finding]:
    """Everything that cannot be true, or hardly; `params` are by the name of a check.

    Nothing is changed: every finding names what to state so that the log is understood.
    """
    findings: list[Finding] = []
    groups_that_warned: set[str] = set()
    for name, check in registry().items():
        if check.about.group not in groups_that_warned:
            check_findings = list(check.check((params or {}).get(name, check.Params()), scene))
            findings += check_findings
            if any(f.severity != "info" for f in check_findings):
                groups_that_warned.add(check.about.group)
    return findings


def sensor_thresholds(params: Checks | None) -> Thresholds:
    """The parameters of the checks of single channels, of those of all checks."""
    return Thresholds(**{k: p for k, p in (params or {}).items() if k in Thresholds._fields})
