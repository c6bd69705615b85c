"""The plan of a test series: which log is of which group, pairs to compare, limits, texts."""

import re
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from glob import glob
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from ..analysis.stated_values import table_of
from ..core import toml
from ..core.errors import UserError, unknown
from ..stops.series import QUANTITIES, GroupLimit

_DIGITS = re.compile(r"([0-9]+)")
_SECTIONS = ("group", "compare", "limits", "wsp", "protocol")
_GROUP_KEYS = {
    "logs": list, "vehicle": str, "nominal_speed": float, "rail": str, "load": str, "mode": str,
    "label": str, "limits": dict,
}  # fmt: skip
_RAILS = ("dry", "wet")
_WSP_KEYS = {*_RAILS, "pairs", "reservoir_volume"}
_TSI = "Regulation (EU) No 1302/2014"
_STRABVO = {30: 2.04, 40: 2.29, 50: 2.47, 60: 2.57, 70: 2.73}  # m/s² by the speed [km/h]
_STANDARDS = {  # published limits by name; those of the TSI with 250 for units from 250 km/h on
    name: (
        GroupLimit("response_time_s", longest_response, None, _TSI),
        GroupLimit("delay_s", 2.0, None, _TSI),
        GroupLimit("jerk", 4.0, None, _TSI),
        GroupLimit("mean_deceleration", 2.5, None, _TSI),
    )
    for name, longest_response in (("TSI LOC&PAS", 5.0), ("TSI LOC&PAS 250", 3.0))
} | {
    "StrabVO": tuple(  # emergency brakings of trams
        GroupLimit("mean_deceleration", None, bound, "StrabVO (Austria), annex 1", speed=speed)
        for speed, bound in _STRABVO.items()
    )
}
_HINT = 'a plan is TOML: [group.NAME] logs = ["FILE.csv"]; `adhesion stops --help` shows more'


class PlannedGroup(NamedTuple):
    """A group of a plan."""

    name: str
    logs: tuple[str, ...]  # names or patterns
    vehicle: Path | None = None
    nominal_speed: float = 0.0  # [km/h]; 0: the nearest usual one
    rail: str = ""
    load: str = ""
    mode: str = ""
    label: str = ""
    limits: Mapping[str, object] = {}  # of this group alone, as stated


class Plan(NamedTuple):
    """A test series as its engineer states it."""

    groups: tuple[PlannedGroup, ...] = ()
    pairs: tuple[tuple[str, str], ...] = ()
    limits: tuple[GroupLimit, ...] = ()
    wet_pairs: tuple[tuple[str, str], ...] = ()  # dry and wet group
    reservoir_volume: float = 0.0  # [l]; 0: not stated
    protocol: Mapping[str, str] = {}
    folder: Path = Path()  # of the plan: patterns with folders begin there

    def group_of(self, log: Path) -> PlannedGroup:
        """The group that names a log by its path, its file name or a pattern.

        Raises:
            UserError: where none or several do.
        """
        place = log.resolve().as_posix()
        groups = [g for g in self.groups if any(self._names(p, log.name, place) for p in g.logs)]
        if len(groups) > 1:
            names = " and ".join(group.name for group in groups)
            raise UserError(f"{log}: in the groups {names} of the plan", "name it in one", code=2)
        if not groups:
            hint = "name it in [group.NAME] logs, or leave it out"
            raise UserError(f"{log}: in no group of the plan", hint)
        return groups[0]

    def _names(self, pattern: str, name: str, place: str) -> bool:
        full = (self.folder / pattern).resolve().as_posix()
        return fnmatch(name, pattern) or fnmatch(place, full)


def read_plan(path: Path) -> Plan:
    """The plan of a file.

    Raises:
        UserError: for an unreadable file, an unknown key, a group that is not there.
    """
    tables = toml.read(path, _HINT)
    for key in tables:
        if key not in _SECTIONS:
            raise unknown(f"section of {path}", key, list(_SECTIONS))
    groups = tuple(_group(path, name, x) for name, x in _table(path, tables, "group").items())
    if not groups:
        raise UserError(f"{path}: no group", _HINT, code=2)
    names = [group.name for group in groups]
    comparison = table_of("compare", _table(path, tables, "compare"), ["pairs"])
    pairs = _pairs(path, names, "compare", comparison)
    wsp = table_of("wsp", _table(path, tables, "wsp"), sorted(_WSP_KEYS))
    stated_rails = [_known(path, names, wsp[k]) for k in _RAILS if k in wsp]
    if len(stated_rails) == 1:
        hint = 'state both, as [wsp] dry = "NAME" and wet = "NAME"'
        raise UserError(f"{path}: [wsp] needs dry and wet", hint, code=2)
    wet_pairs = *pairwise(stated_rails), *_pairs(path, names, "wsp", wsp)
    volume = wsp.get("reservoir_volume", 0.0)
    if not isinstance(volume, int | float) or volume < 0.0:
        text = f"{path}: wsp.reservoir_volume = {volume!r} is no volume"
        raise UserError(text, "in litres, for example reservoir_volume = 150", code=2)
    stated_limits = {"": _table(path, tables, "limits")} | {g.name: g.limits for g in groups}
    limits = tuple(
        limit._replace(group=group)
        for group, entries in stated_limits.items()
        for entry in entries.items()
        for limit in _limits(path, *entry)
    )
    protocol = {k: str(v) for k, v in _table(path, tables, "protocol").items()}
    return Plan(groups, pairs, limits, wet_pairs, float(volume), protocol, path.parent)


def planned_logs(plan: Plan) -> list[Path]:
    """The files in the folder of a plan that its groups name, in their order.

    Raises:
        UserError: where a group names none.
    """
    logs: list[Path] = []
    for group in plan.groups:
        patterns = [str(plan.folder / pattern) for pattern in group.logs]
        matched = [Path(p) for pattern in patterns for p in sorted(glob(pattern), key=_by_number)]
        if not matched:
            text = f"group {group.name}: no log matches {', '.join(group.logs)} in {plan.folder}"
            raise UserError(text, "name the logs on the command line, or correct the plan")
        logs += matched
    return list(dict.fromkeys(logs))


def _by_number(name: str) -> list[tuple[int, str]]:
    """What sorts `run_9` before `run_10`."""
    return [(int(x) if x.isdigit() else -1, x) for x in _DIGITS.split(name)]


def _table(path: Path, tables: toml.Table, name: str) -> toml.Table:
    table = tables.get(name, {})
    if not isinstance(table, dict):
        raise UserError(f"{path}: {name} is a table", f"write [{name}], then its keys", code=2)
    return table


def _group(path: Path, name: str, entry: Any) -> PlannedGroup:
    place = f"{path}: group.{name}"
    if not isinstance(entry, dict) or not entry.get("logs"):
        raise UserError(f"{place} names no logs", 'for example logs = ["old_*.csv"]', code=2)
    values = dict(table_of(f"group.{name}", entry, _GROUP_KEYS))
    for key, value in values.items():
        kind = _GROUP_KEYS[key]
        if not isinstance(value, (int, float) if kind is float else kind):
            raise UserError(f"{place}.{key} = {value!r} is no {_KIND_NAMES[kind]}", _HINT, code=2)
    if "rail" in values and values["rail"] not in _RAILS:
        raise unknown(f"rail of [group.{name}]", values["rail"], list(_RAILS))
    values["logs"] = tuple(map(str, values["logs"]))
    if "vehicle" in values:
        values["vehicle"] = path.parent / values["vehicle"]
    return PlannedGroup(name, **values)


_KIND_NAMES = {list: "list", str: "text", float: "number", dict: "table"}


def _pairs(
    path: Path, names: Sequence[str], section: str, entries: toml.Table
) -> tuple[tuple[str, str], ...]:
    """The pairs of groups that a section states."""
    stated_pairs = entries.get("pairs", [])
    pairs = stated_pairs if isinstance(stated_pairs, list) else [stated_pairs]
    if any(not isinstance(pair, list) or len(pair) != 2 for pair in pairs):
        text = f"{path}: {section}.pairs = {stated_pairs!r} is no list of pairs"
        raise UserError(text, 'for example pairs = [["old", "new"]]', code=2)
    if one_group := [pair[0] for pair in pairs if pair[0] == pair[1]]:
        text = f"{path}: {section}.pairs compares group {one_group[0]!r} with itself"
        raise UserError(text, "name two groups", code=2)
    return tuple((_known(path, names, a), _known(path, names, b)) for a, b in pairs)


def _known(path: Path, names: Sequence[str], name: Any) -> str:
    if name not in names:
        raise unknown(f"group in {path}", str(name), list(names))
    return str(name)


def _limits(path: Path, key: str, entry: Any) -> tuple[GroupLimit, ...]:
    """The limits of a published rule, or the one of a quantity."""
    if key != "standard":
        return (_limit(path, key, entry),)
    if not isinstance(entry, str) or entry not in _STANDARDS:
        raise unknown(f"standard in [limits] of {path}", str(entry), list(_STANDARDS))
    return _STANDARDS[entry]


def _limit(path: Path, quantity: str, entry: Any) -> GroupLimit:
    if quantity not in QUANTITIES:
        raise unknown(f"quantity in [limits] of {path}", quantity, list(QUANTITIES))
    bounds = entry if isinstance(entry, dict) else {}
    numbers = {k: v for k, v in bounds.items() if isinstance(v, int | float)}
    if not numbers or bounds.keys() - {"max", "min"} or len(numbers) < len(bounds):
        text = f"{path}: limits.{quantity} = {entry!r} is no limit"
        raise UserError(text, "for example {max = 300}, {min = 0.9}, or both", code=2)
    return GroupLimit(quantity, numbers.get("max"), numbers.get("min"))
