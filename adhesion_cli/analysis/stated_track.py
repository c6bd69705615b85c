"""`[track]`: the gradient of the line, a number in per mille or a profile over the position."""

import csv
from pathlib import Path

from ..core.errors import UserError, unknown
from ..core.model import Parameter, Quantity, Track
from ..core.toml import Table
from .stated_brake import number

GRADIENT = Quantity("‰", "gradient, uphill positive", -150.0, 150.0)
_EXAMPLE = 'gradient = 5.0, or {profile = "line.csv", position = "km"}'
_PER_MILLE, _KM = 1e-3, 1e3


def stated_track(table: Table) -> Track:
    """The line as stated.

    Args:
        table: `[track]`.

    Raises:
        UserError: an unknown key, a gradient that is no number, a profile that cannot be read.
    """
    if extra := table.keys() - {"gradient"}:
        raise unknown("key of [track]", min(extra), ["gradient"])
    entry, usual = table.get("gradient"), Track().gradient
    if entry is None:
        return Track()
    if isinstance(entry, dict) and "profile" in entry:
        return _along(entry)
    stated = number("track.gradient", entry)
    GRADIENT.check("track.gradient", stated.value)
    has_tolerance = isinstance(entry, dict) and "tolerance" in entry
    tolerance = _PER_MILLE * stated.tolerance if has_tolerance else usual.tolerance
    return Track(Parameter(_PER_MILLE * stated.value, tolerance), stated=True)


def as_stated(track: Track) -> Table:
    """A constant gradient as `[track]` states it; a profile belongs to its log and is left out."""
    if not track.stated or track.profile:
        return {}
    per_mille = {k: v / _PER_MILLE for k, v in track.gradient._asdict().items()}
    return {"gradient": per_mille}


def _along(entry: Table) -> Track:
    keys = ["profile", "position", "tolerance"]
    if extra := entry.keys() - {*keys}:
        raise unknown("key of track.gradient", min(extra), keys)
    for key in ("profile", "position"):
        if not isinstance(entry.get(key, ""), str):
            text = f"track.gradient.{key} = {entry[key]!r} is no text"
            raise UserError(text, f"for example {_EXAMPLE}", code=2)
    usual = Track().gradient.tolerance / _PER_MILLE
    tolerance = number("track.gradient.tolerance", entry.get("tolerance", usual)).value
    gradient = Parameter(0.0, _PER_MILLE * tolerance)
    return Track(gradient, True, _read(Path(entry["profile"])), entry.get("position", ""))


def _read(path: Path) -> tuple[tuple[float, float], ...]:
    """Places [m] and gradients [-] of a CSV with columns of km and per mille, and one head row."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        text = f"track.gradient.profile: {path} cannot be read: {reason}"
        raise UserError(text, "name a CSV with columns of km and per mille", code=2) from error
    head = text.split("\n", 1)[0]
    delimiter = next((d for d in ";\t," if d in head), ",")
    rows: list[tuple[float, float]] = []
    for line, row in enumerate(csv.reader(text.splitlines(), delimiter=delimiter), 1):
        cells = [cell.strip().replace(",", ".") for cell in row]
        if not any(cells):
            continue
        try:
            km, per_mille = float(cells[0]), float(cells[1])
        except (ValueError, IndexError) as error:
            if not rows and line == 1:
                continue  # the head
            problem = f"{path}, line {line}: no km and gradient"
            raise UserError(problem, "two numbers in a row: 12.350, -5.0", code=2) from error
        GRADIENT.check(f"{path}, line {line}: gradient", per_mille)
        if rows and not _KM * km > rows[-1][0]:
            problem = f"{path}, line {line}: km {km:g} does not rise"
            raise UserError(problem, "order the rows by km, each km once", code=2)
        rows.append((_KM * km, _PER_MILLE * per_mille))
    if not rows:
        raise UserError(f"{path}: no gradient", "rows of km and per mille", code=2)
    return tuple(rows)
