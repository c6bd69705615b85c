"""`[track]`: the gradient of the line, a number in per mille or a profile over the position."""

import csv
import math
import re
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ..core.errors import UserError
from ..core.model import Parameter, Quantity, Track
from ..core.toml import Table
from .stated_values import parameter, plain_number, table_of

GRADIENT = Quantity("‰", "gradient, uphill positive", -150.0, 150.0)
_EXAMPLE = 'gradient = 5.0, or {profile = "line.csv", position = "km"}'
_PER_MILLE, _KM = 1e-3, 1e3
_METRES = re.compile(r"[\[(]\s*m\s*[\])]")


def stated_track(table: Table) -> Track:
    """The line as `[track]` states it.

    Raises:
        UserError: an unknown key, a gradient that is no number, a profile that cannot be read.
    """
    entry = table_of("track", table, ["gradient"]).get("gradient")
    if entry is None:
        return Track()
    if isinstance(entry, dict) and "profile" in entry:
        return _profile_track(entry)
    if isinstance(entry, dict) and "logs" in entry:
        gradient_table = table_of("track.gradient", entry, ["logs"])
        by_log = table_of("track.gradient.logs", gradient_table["logs"])
        names = [(pattern, f"track.gradient.logs.{pattern}") for pattern in by_log]
        return Track(gradients_of_logs=tuple((x, _gradient(y, by_log[x])) for x, y in names))
    return Track(_gradient("track.gradient", entry), stated=True)


def track_of_log(track: Track, name: str) -> Track:
    """The line of a log of this file name: the first pattern that fits it, else as it is."""
    for pattern, gradient in track.gradients_of_logs:
        if fnmatchcase(name, pattern):
            return Track(gradient, stated=True)
    return track


def _gradient(name: str, entry: Any) -> Parameter:
    """A stated number with its error [-]."""
    slope = parameter(name, entry)
    GRADIENT.check(name, slope.value)
    if isinstance(entry, dict) and "tolerance" in entry:
        return Parameter(_PER_MILLE * slope.value, _PER_MILLE * slope.tolerance)
    return Parameter(_PER_MILLE * slope.value, Track().gradient.tolerance)


def as_stated(track: Track) -> Table:
    """The line as `[track]` states it, with the rows of a profile."""
    value, tolerance = (x / _PER_MILLE for x in track.gradient)
    if track.profile:
        rows = [[place / _KM, gradient / _PER_MILLE] for place, gradient in track.profile]
        profile = {"profile": rows, "position": track.position, "tolerance": tolerance}
        return {"gradient": profile}
    return {"gradient": {"value": value, "tolerance": tolerance}} if track.stated else {}


def _profile_track(entry: Table) -> Track:
    table_of("track.gradient", entry, ["profile", "position", "tolerance"])
    position, profile = entry.get("position", ""), entry["profile"]
    if not isinstance(position, str) or not isinstance(profile, str | list):
        text = "track.gradient: profile and position are names"
        raise UserError(text, f"for example {_EXAMPLE}", code=2)
    usual = Track().gradient.tolerance / _PER_MILLE
    tolerance = plain_number("track.gradient.tolerance", entry.get("tolerance", usual))
    gradient = Parameter(0.0, _PER_MILLE * tolerance)
    rows = _read(Path(profile)) if isinstance(profile, str) else _listed(profile)
    return Track(gradient, True, tuple(_rising(rows)), position)


def _listed(profile: list[Any]) -> Iterator[tuple[str, float, float]]:
    """Place in the list, km and per mille of each row."""
    for i, row in enumerate(profile, 1):
        name = f"track.gradient.profile, row {i}"
        if not isinstance(row, list) or len(row) != len(("km", "per mille")):
            raise UserError(f"{name}: no km and gradient", "two numbers: [12.350, -5.0]", code=2)
        km, per_mille = (plain_number(name, x) for x in row)
        yield name, km, per_mille


def _read(path: Path) -> Iterator[tuple[str, float, float]]:
    """The same of a CSV with columns of km and per mille, and at most one head row.

    The head may say that places are in metres, as `distance [m]`.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        text = f"track.gradient.profile: {path} cannot be read: {reason}"
        raise UserError(text, "name a CSV with columns of km and per mille", code=2) from error
    head = text.split("\n", 1)[0]
    delimiter = next((d for d in ";\t," if d in head), ",")
    in_km = 1.0 / _KM if _METRES.search(head.split(delimiter, 1)[0]) else 1.0
    for line, row in enumerate(csv.reader(text.splitlines(), delimiter=delimiter), 1):
        cells = [cell.strip().replace(",", ".") for cell in row]
        if not any(cells):
            continue
        name = f"{path}, line {line}"
        try:
            yield name, in_km * float(cells[0]), float(cells[1])
        except (ValueError, IndexError) as error:
            if line > 1:  # the first is the head
                hint = "two numbers in a row: 12.350, -5.0"
                raise UserError(f"{name}: no km and gradient", hint, code=2) from error


def _rising(rows: Iterable[tuple[str, float, float]]) -> Iterator[tuple[float, float]]:
    """Places [m] and gradients [-], checked."""
    previous = -math.inf
    for name, km, per_mille in rows:
        GRADIENT.check(f"{name}: gradient", per_mille)
        if not km > previous:
            hint = "order the rows by km, each km once"
            raise UserError(f"{name}: km {km:g} does not rise", hint, code=2)
        previous = km
        yield _KM * km, _PER_MILLE * per_mille
    if previous == -math.inf:
        hint = "rows of km and per mille"
        raise UserError("track.gradient.profile: no gradient in it", hint, code=2)
