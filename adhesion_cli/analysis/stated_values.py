"""Values of settings as a user states them: tables with known keys, numbers, axles."""

from collections.abc import Iterable
from typing import Any

from ..core.errors import UserError, unknown
from ..core.model import Parameter
from ..core.toml import Table


def table_of(section: str, value: Any, known: Iterable[str] | None = None) -> Table:
    """The table of a section.

    Raises:
        UserError: where it is none, or has a key that is not known.
    """
    if not isinstance(value, dict):
        text = f"setting {section!r} is a table"
        raise UserError(text, f"write [{section}], then its keys", code=2)
    names = list(value if known is None else known)
    for key in value:
        if key not in names:
            raise unknown(f"key of [{section}]", key, names)
    return value


def is_number(value: Any) -> bool:
    """Whether a value is a number, and not true or false."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def plain_number(name: str, value: Any) -> float:
    """A number.

    Raises:
        UserError: for anything else.
    """
    if not is_number(value):
        raise UserError(f"{name} = {value!r} is not a number", "write a plain number", code=2)
    return float(value)


def parameter(
    name: str, entry: Any, share: float = 0.0, usual: float | None = None, least: float = 0.0
) -> Parameter:
    """A number, or `{value, tolerance}`.

    Where no tolerance is stated it is a `share` of the value, and at `least` that; where only it is
    stated, the value is the usual one.

    Raises:
        UserError: for anything else, and a negative tolerance.
    """
    table = {"value": entry} if not isinstance(entry, dict) else entry
    table_of(name, table, Parameter._fields)
    value = plain_number(name, table.get("value", usual))
    usual_tolerance = max(share * abs(value), least)
    tolerance = plain_number(f"{name}.tolerance", table.get("tolerance", usual_tolerance))
    if tolerance < 0.0:
        text = f"{name}: tolerance = {tolerance:g} is out of range"
        raise UserError(text, "1 sigma, in the unit of the value: from 0", code=2)
    return Parameter(value, tolerance)


def is_axle(value: Any) -> bool:
    """Whether a value is the number of an axle, which count from 1."""
    return type(value) is int and value > 0
